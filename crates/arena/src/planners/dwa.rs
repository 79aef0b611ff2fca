//! `dwa`: a dynamic window among things that move. Constant commands (v, ω) are rolled out and the
//! best one is driven for one control period.
//!
//! Reading order: [`DwaConfig`] (what is weighed), [`Dwa`], [`super::tracks`] (what moves),
//! `rollouts` (where commands lead).
//!
//! # Formula
//!
//! score = `progress`·(d₀ − d)/(`v_max`·T) − `heading`·|φ|/π + `clearance`·c − `hit`·(1 − t/(T +
//! Δt)), with d₀ and d the distances to the goal now and at the end of the horizon T, φ the angle
//! to the goal at the end, c the least clearance on the way as a share of what is wished for, and t
//! the time of the first place within the margin of something (the last term is 0 without one). A
//! command that gets to the goal counts as one that drives to it at full speed, and what comes
//! after does not count.
//!
//! # Departures
//!
//! Fox, Burgard and Thrun take static obstacles and admit commands after which the robot can stop.
//! Here commands act at once (Stage's velocity mode), so that every command can be stopped, and
//! what matters is where the others will be.
//!
//! # References
//!
//! D. Fox, W. Burgard, S. Thrun, "The dynamic window approach to collision avoidance", IEEE
//! Robotics and Automation Magazine 4(1), 1997, doi:10.1109/100.580977.

use glam::Vec2;
use jostle_sim::SimConfig;
use serde::Serialize;

use super::each_row::RowPlanner;
use super::reader::{RowReader, angle_of};
use super::rollouts::{Rollouts, lower_to};
use super::tracks::{Cluster, ScanTracks, TrackConfig};
use crate::error::ArenaError;

/// Returns of what stands still that are nearer together than this count once (m).
const SPACING: f32 = 0.15;

/// The rollouts and their weights. The defaults were chosen on walkers made for the purpose, like
/// those of the validation crowds, and checked once on the validation crowds; the six test crowds
/// were looked at afterwards.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DwaConfig {
    /// Rules that make beams one thing, and tell the things that may move.
    pub tracks: TrackConfig,
    /// Speeds, evenly from 0 to the robot's highest.
    pub speeds: usize,
    /// Turning rates, evenly from the robot's highest to the right to that to the left.
    pub rates: usize,
    /// Places on the way that are looked at.
    pub steps: usize,
    /// Time between two of them (s).
    pub step: f32,
    /// Distance from a thing's visible middle at which it counts as hit (m).
    pub margin: f32,
    /// The same for returns of what cannot move, such as walls (m).
    pub margin_still: f32,
    /// Clearance beyond the margin that is wished for (m).
    pub wish: f32,
    /// The same for what cannot move (m).
    pub wish_still: f32,
    /// Weight of what cannot move in the clearance: it counts from 0 (not at all) to 1 (as things
    /// that move).
    pub still: f32,
    /// Weight of the way made towards the goal.
    pub progress: f32,
    /// Weight of the angle to the goal at the end.
    pub heading: f32,
    /// Weight of the clearance.
    pub clearance: f32,
    /// Weight of a hit: the sooner the dearer.
    pub hit: f32,
}

impl Default for DwaConfig {
    fn default() -> Self {
        Self {
            tracks: TrackConfig::default(),
            speeds: 6,
            rates: 13,
            steps: 15,
            step: 0.2,
            margin: 0.7,
            margin_still: 0.6,
            wish: 1.5,
            wish_still: 0.3,
            still: 0.5,
            progress: 1.0,
            heading: 0.3,
            clearance: 5.0,
            hit: 3.0,
        }
    }
}

impl DwaConfig {
    /// Checks every range.
    ///
    /// # Errors
    ///
    /// The first field out of its range.
    pub fn validate(&self) -> Result<(), ArenaError> {
        let refuse = |field, found: String, expected: &str| {
            Err(ArenaError::Setting { field, found, expected: expected.to_owned() })
        };
        for (field, n) in [("speeds", self.speeds), ("rates", self.rates), ("steps", self.steps)] {
            if !(1..=1000).contains(&n) {
                return refuse(field, n.to_string(), "1 to 1000");
            }
        }
        let positive = [
            ("tracks.gap", self.tracks.gap),
            ("step", self.step),
            ("wish", self.wish),
            ("wish_still", self.wish_still),
        ];
        for (field, value) in positive {
            if !(value > 0.0 && value <= 100.0) {
                return refuse(field, value.to_string(), "above 0, to 100");
            }
        }
        let weights = [
            ("tracks.size_max", self.tracks.size_max),
            ("tracks.shift_max", self.tracks.shift_max),
            ("margin", self.margin),
            ("margin_still", self.margin_still),
            ("still", self.still),
            ("progress", self.progress),
            ("heading", self.heading),
            ("clearance", self.clearance),
            ("hit", self.hit),
        ];
        for (field, value) in weights {
            if !(0.0..=100.0).contains(&value) {
                return refuse(field, value.to_string(), "0 to 100");
            }
        }
        Ok(())
    }
}

/// The planner. A decision is a function of the row.
#[derive(Clone, Debug)]
pub struct Dwa {
    reader: RowReader,
    config: DwaConfig,
    goal_radius: f32,
    /// The way that full speed makes within the horizon (m).
    reach: f32,
    rollouts: Rollouts,
}

impl Dwa {
    /// The planner of a robot.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn new(sim: &SimConfig, config: DwaConfig) -> Result<Self, ArenaError> {
        config.validate()?;
        let limits = [sim.robot.v_max, sim.robot.w_max];
        let rollouts = Rollouts::new(config.speeds, config.rates, limits, config.steps, config.step);
        Ok(Self {
            reader: RowReader::new(sim),
            goal_radius: sim.episode.goal_radius,
            reach: (sim.robot.v_max * rollouts.horizon()).max(f32::MIN_POSITIVE),
            config,
            rollouts,
        })
    }

    /// Splits the clusters into things with a velocity and returns of what stands, as far as they
    /// can matter.
    fn look(&self, scratch: &mut DwaScratch) {
        let DwaScratch { tracks, movers, still, .. } = scratch;
        movers.clear();
        still.clear();
        let farthest = self.reach + self.config.margin_still + self.config.wish_still;
        for cluster in &tracks.clusters {
            match cluster.velocity {
                Some(velocity) => movers.push((cluster.centre, velocity)),
                None => thin_out(cluster, &tracks.returns, farthest, still),
            }
        }
    }

    /// Fills in clearance, time of the first hit and arrival of every command.
    fn roll_out(&self, goal: Vec2, scratch: &mut DwaScratch) {
        let DwaScratch { movers, still, to_mover, to_still, fates, .. } = scratch;
        let (config, n) = (&self.config, self.rollouts.commands.len());
        fates.clear();
        fates.resize(n, Fate { clearance: 1.0, hit: None, arrives: false });
        for (time, xs, ys) in self.rollouts.steps() {
            for least in [&mut *to_mover, &mut *to_still] {
                least.clear();
                least.resize(n, f32::INFINITY);
            }
            for (position, velocity) in movers.iter() {
                lower_to(to_mover, xs, ys, *position + *velocity * time);
            }
            for point in still.iter() {
                lower_to(to_still, xs, ys, *point);
            }
            for (k, fate) in fates.iter_mut().enumerate().filter(|(_, fate)| !fate.arrives) {
                let from_mover = to_mover[k].sqrt() - config.margin;
                let from_still = to_still[k].sqrt() - config.margin_still;
                let share = |free: f32, wish: f32| (free / wish).clamp(0.0, 1.0);
                let of_still = 1.0 - config.still * (1.0 - share(from_still, config.wish_still));
                fate.clearance = fate.clearance.min(share(from_mover, config.wish)).min(of_still);
                if from_mover.min(from_still) < 0.0 && fate.hit.is_none() {
                    fate.hit = Some(time);
                }
                fate.arrives = Vec2::new(xs[k], ys[k]).distance(goal) < self.goal_radius;
            }
        }
    }

    /// The command with the highest score; of equal ones the first.
    fn best(&self, goal: Vec2, fates: &[Fate]) -> [f32; 2] {
        let (config, horizon) = (&self.config, self.rollouts.horizon());
        let now = goal.length();
        let ends = self.rollouts.ends().zip(&self.rollouts.headings).zip(fates);
        let scores = ends.map(|((end, heading), fate)| {
            let to_goal = goal - end;
            let (progress, off) = if fate.arrives {
                (1.0, 0.0)
            } else {
                let off = jostle_sim::wrap_angle(f64::from(angle_of(to_goal) - heading));
                ((now - to_goal.length()) / self.reach, off.abs() / std::f32::consts::PI)
            };
            let hit = fate.hit.map_or(0.0, |time| 1.0 - time / (horizon + self.rollouts.step));
            config.progress * progress - config.heading * off + config.clearance * fate.clearance
                - config.hit * hit
        });
        let mut best = (f32::NEG_INFINITY, [0.0; 2]);
        for (score, command) in scores.zip(&self.rollouts.commands) {
            if score > best.0 {
                best = (score, *command);
            }
        }
        best.1
    }
}

impl RowPlanner for Dwa {
    type Scratch = DwaScratch;

    fn reader(&self) -> &RowReader {
        &self.reader
    }

    fn plan(&self, row: &[f32], scratch: &mut DwaScratch) -> [f32; 2] {
        scratch.tracks.find(&self.reader, &self.config.tracks, row);
        let goal = self.reader.goal(row);
        self.look(scratch);
        self.roll_out(goal, scratch);
        self.best(goal, &scratch.fates)
    }
}

/// Memory of a decision that is kept for the next.
#[derive(Clone, Debug, Default)]
pub struct DwaScratch {
    tracks: ScanTracks,
    /// Place and velocity of things that may move.
    movers: Vec<(Vec2, Vec2)>,
    /// Returns of what stands.
    still: Vec<Vec2>,
    /// Square distances of every command's place to the nearest of either.
    to_mover: Vec<f32>,
    to_still: Vec<f32>,
    fates: Vec<Fate>,
}

/// The robot's fate under a command.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fate {
    /// Least share of the clearance that is wished for.
    clearance: f32,
    /// Time of the first place within a margin (s).
    hit: Option<f32>,
    /// True if it gets to the goal.
    arrives: bool,
}

/// Appends a cluster's returns up to a distance, of neighbours that are close together the first,
/// and always the last.
fn thin_out(cluster: &Cluster, returns: &[Option<Vec2>], farthest: f32, still: &mut Vec<Vec2>) {
    let mut last: Option<Vec2> = None;
    for k in 0..cluster.beams {
        let Some(point) = returns[(cluster.first + k) % returns.len()] else { continue };
        let apart = last.is_none_or(|last| last.distance_squared(point) > SPACING * SPACING);
        if point.length_squared() <= farthest * farthest && (apart || k + 1 == cluster.beams) {
            still.push(point);
            last = Some(point);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;

    fn plan(scene: &Scene) -> [f32; 2] {
        let planner = Dwa::new(&SimConfig::default(), DwaConfig::default()).unwrap();
        planner.plan(&scene.row(), &mut DwaScratch::default())
    }

    #[test]
    fn an_open_way_is_driven_at_full_speed() {
        assert_eq!(plan(&Scene::empty()), [1.0, 0.0]);
        assert!(plan(&Scene::empty().with_goal(0.0, 8.0))[1] > 0.5, "left");
        assert!(plan(&Scene::empty().with_goal(0.0, -8.0))[1] < -0.5, "right");
    }

    #[test]
    fn a_wall_ahead_is_not_driven_into() {
        let walled = |at: f32| Scene::empty().with_velocity(1.0, 0.0).with_wall([at, -3.0], [at, 3.0]);
        let [v, w] = plan(&walled(1.0));
        assert!(v < 0.5 || w.abs() > 0.5, "({v}, {w})");
        assert_eq!(plan(&walled(5.0)), [1.0, 0.0], "far ahead it does not matter yet");
    }

    #[test]
    fn it_waits_or_turns_for_someone_who_crosses_and_not_for_one_who_has() {
        // Both are 2.5 m ahead and 1.5 m to the left; one walks across the robot's way, the other
        // away from it.
        let walker = |u: f32| Scene::empty().with_velocity(1.0, 0.0).with_walker([2.5, 1.8], 0.3, [0.0, u]);
        let crossing = plan(&walker(-0.8));
        assert!(crossing[0] < 1.0 || crossing[1] != 0.0, "{crossing:?}");
        let leaving = plan(&walker(0.8));
        assert!(leaving[0] == 1.0 && leaving[1].abs() < 0.2, "{leaving:?}");
    }

    #[test]
    fn someone_who_comes_from_behind_is_run_from() {
        let chased = plan(&Scene::empty().with_velocity(0.6, 0.0).with_walker([-1.5, 0.0], 0.3, [1.0, 0.0]));
        assert!(chased[0] == 1.0, "{chased:?}");
    }

    #[test]
    fn left_and_right_are_alike() {
        let scene = Scene::empty()
            .with_velocity(0.8, 0.4)
            .with_goal(6.0, 2.0)
            .with_walker([2.0, 0.7], 0.3, [-0.5, -0.3])
            .with_wall([-3.0, -2.0], [5.0, -2.5]);
        let ([v, w], mirrored) = (plan(&scene), plan(&scene.mirrored()));
        assert_eq!([v, -w], mirrored);
    }

    #[test]
    fn a_setting_out_of_range_is_named() {
        let refused =
            |config: DwaConfig| Dwa::new(&SimConfig::default(), config).map(|_| ()).unwrap_err().to_string();
        let config = DwaConfig::default();
        assert_eq!(refused(DwaConfig { speeds: 0, ..config.clone() }), "speeds: found 0, expected 1 to 1000");
        assert_eq!(
            refused(DwaConfig { wish: 0.0, ..config.clone() }),
            "wish: found 0, expected above 0, to 100"
        );
        assert_eq!(refused(DwaConfig { hit: f32::NAN, ..config }), "hit: found NaN, expected 0 to 100");
    }
}
