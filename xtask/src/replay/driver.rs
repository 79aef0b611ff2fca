//! Who drives the robot of a replay: a trained policy, or one written by hand.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use jostle_eval::config::EvalConfig;
use jostle_eval::robot::TrainedRobot;
use jostle_eval::{LoadedPolicy, PerRow, RobotPolicy};

use crate::policies;

/// The name that asks for the hand-written policy.
pub(crate) const GOAL_SEEKER: &str = "goal-seeker";

/// Metres that the hand-written policy wants to be free on either side of its way.
const HALF_WIDTH: f32 = 0.75;
/// How far it looks ahead (m).
const LOOK_AHEAD: f32 = 3.0;
/// Directions that it considers, from −120° to 120°.
const CANDIDATES: usize = 41;

/// A policy with what a reader wants to know of it.
pub(crate) struct Driver {
    pub(crate) name: String,
    pub(crate) note: String,
    /// `None` for the hand-written policy, which has none.
    pub(crate) token: Option<u32>,
    pub(crate) policy: Option<LoadedPolicy>,
}

impl Driver {
    /// A checkpoint, a run folder's newest checkpoint, or the hand-written policy.
    pub(crate) fn open(path: &Path, token: u32) -> Result<Self> {
        if path.as_os_str() == GOAL_SEEKER {
            return Ok(Self::goal_seeker());
        }
        let policy = policies::load(&policies::checkpoint(path)?)?;
        let provenance = &policy.file.provenance;
        let mut note = format!(
            "M = {}, {} updates, seed {}, token {token}",
            policy.file.network.n_behaviours, provenance.update, provenance.seed
        );
        if let Ok(sim) = policy.sim_config()
            && !sim.laser.is_full_circle()
        {
            let _ = write!(note, ", its laser sees {}", sim.laser.view());
        }
        Ok(Self { name: policy.identity.name.clone(), note, token: Some(token), policy: Some(policy) })
    }

    /// The hand-written policy.
    pub(crate) fn goal_seeker() -> Self {
        let note = "written by hand: turns to the free direction nearest to its goal; nothing was learned"
            .to_owned();
        Self { name: GOAL_SEEKER.to_owned(), note, token: None, policy: None }
    }

    /// The robot, ready to act in rooms of the configuration.
    pub(crate) fn robot(&self, config: &EvalConfig) -> Result<Box<dyn RobotPolicy>> {
        self.robot_with(self.token.unwrap_or(0), config)
    }

    /// The robot with another token than the driver's own; the hand-written policy knows none.
    pub(crate) fn robot_with(&self, token: u32, config: &EvalConfig) -> Result<Box<dyn RobotPolicy>> {
        if let Some(policy) = &self.policy {
            return Ok(Box::new(TrainedRobot::new(policy, token, config.backend)?));
        }
        let beams: Vec<[f32; 2]> =
            config.sim.laser.beam_angles().map(|angle| direction(angle as f32)).collect();
        Ok(Box::new(PerRow::new(move |row: &[f32]| seek(&beams, row))))
    }
}

fn direction(angle: f32) -> [f32; 2] {
    [angle.cos(), angle.sin()]
}

/// Turns to the candidate direction that is free for long and near the goal's, and slows down where its way is blocked.
fn seek(beams: &[[f32; 2]], row: &[f32]) -> [f32; 2] {
    let (scans, motion) = row.split_at(row.len() - 4);
    let scan = &scans[scans.len() - beams.len()..];
    let points: Vec<[f32; 2]> = scan
        .iter()
        .zip(beams)
        .map(|(&value, [x, y])| ((value + 0.5) * 10.0, x, y))
        .filter(|&(range, ..)| range < LOOK_AHEAD + HALF_WIDTH)
        .map(|(range, x, y)| [range * x, range * y])
        .collect();
    let goal = motion[1].atan2(motion[0]);
    let reach = motion[0].hypot(motion[1]).min(LOOK_AHEAD);
    let cost = |angle: f32| {
        let off =
            (goal - angle + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU) - std::f32::consts::PI;
        off.abs() + 4.0 * (1.0 - free(&points, angle).min(reach) / reach.max(1e-3)) + 0.1 * angle.abs()
    };
    let spread = 240.0_f32.to_radians();
    let candidates = (0..CANDIDATES)
        .map(|k| spread * (k as f32 / (CANDIDATES - 1) as f32 - 0.5))
        .map(|angle| (cost(angle), angle));
    let (_, angle) = candidates.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0.0));
    let ahead = free(&points, 0.0);
    [(ahead * 0.8).clamp(0.0, 1.0) * angle.cos().max(0.0), (2.0 * angle).clamp(-1.0, 1.0)]
}

/// How far the way in a direction is free, up to the look-ahead.
fn free(points: &[[f32; 2]], angle: f32) -> f32 {
    let [cos, sin] = direction(angle);
    let blocked = points.iter().filter_map(|[x, y]| {
        let (along, across) = (x * cos + y * sin, y * cos - x * sin);
        (along > 0.0 && across.abs() < HALF_WIDTH).then_some(along - HALF_WIDTH)
    });
    blocked.fold(LOOK_AHEAD, f32::min).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::{direction, seek};

    #[test]
    fn it_drives_to_a_free_goal_and_turns_from_a_wall() {
        let beams: Vec<[f32; 2]> =
            (0..64).map(|k| direction(std::f32::consts::TAU * k as f32 / 64.0)).collect();
        let row = |ranges: &dyn Fn(usize) -> f32, goal: [f32; 2]| -> Vec<f32> {
            let scan: Vec<f32> = (0..64).map(|k| ranges(k) / 10.0 - 0.5).collect();
            [scan.repeat(3), vec![goal[0], goal[1], 0.0, 0.0]].concat()
        };
        let [v, w] = seek(&beams, &row(&|_| 10.0, [8.0, 0.0]));
        assert!(v > 0.99 && w.abs() < 0.01);
        let [_, left] = seek(&beams, &row(&|_| 10.0, [0.0, 8.0]));
        assert_eq!(left, 1.0);
        // A block straight ahead.
        let [v, w] = seek(&beams, &row(&|k| if (4..=60).contains(&k) { 10.0 } else { 1.0 }, [8.0, 0.0]));
        assert!(v < 0.3 && w.abs() > 0.5);
    }
}
