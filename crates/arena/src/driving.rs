//! Measures of driving beyond arrival: nearness, time to collision, smoothness, stalling. Not of
//! the paper.
//!
//! Reading order: [`Driving`] (an episode's values), [`DrivingMeter`] (how they are measured while
//! it runs); `jostle_eval::driving` summarises them. Everything is f64; `docs/metrics.md` has the
//! formulas with their reasons.
//!
//! # References
//!
//! A. Francis et al., "Principles and Guidelines for Evaluating Social Robot Navigation
//! Algorithms", 2023, arXiv:2306.16740, names these measures and leaves thresholds open. E. T.
//! Hall, "The Hidden Dimension", 1966 (intimate and personal space).

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Farthest distance between outlines that counts as intimate space (m).
pub const INTIMATE: f64 = 0.45;
/// The same for personal space, which contains the intimate one (m).
pub const PERSONAL: f64 = 1.2;
/// Times to collision below these are counted (s).
pub const TTC_LIMITS: [f64; 2] = [1.0, 2.0];
/// A robot that drives more slowly than this stands (m/s).
pub const STALL_SPEED: f64 = 0.05;

/// The robot's driving in one episode. Steps are control periods; the one that ended the episode
/// counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driving {
    /// Least distance between the robot's outline and a pedestrian's after a step (m); `None`
    /// without pedestrians.
    pub min_clearance: Option<f64>,
    /// Steps after which the time to collision was below [`TTC_LIMITS`].
    pub ttc_steps: [u64; 2],
    /// Steps after which a pedestrian's outline was nearer than [`INTIMATE`].
    pub intimate_steps: u64,
    /// The same for [`PERSONAL`].
    pub personal_steps: u64,
    /// Mean over the steps of the squared jerk (m²/s⁶).
    pub mean_squared_jerk: f64,
    /// Steps in which the robot drove more slowly than [`STALL_SPEED`].
    pub stalled_steps: u64,
    /// Number of those at the end of the episode, without a break.
    pub final_stall_steps: u64,
}

/// A pedestrian beside the robot after a step, seen from the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Distance between the outlines (m).
    pub clearance: f64,
    /// Its centre minus the robot's (m).
    pub position: DVec2,
    /// Its velocity minus the robot's (m/s).
    pub velocity: DVec2,
    /// Distance of the centres at which the two count as collided (m).
    pub reach: f64,
}

/// Measures an episode as it runs.
#[derive(Clone, Debug)]
pub struct DrivingMeter {
    dt: f64,
    steps: u64,
    min_clearance: Option<f64>,
    ttc_steps: [u64; 2],
    intimate_steps: u64,
    personal_steps: u64,
    squared_jerk: f64,
    stalled_steps: u64,
    final_stall_steps: u64,
    /// Velocities of the last two steps, the newest first; the robot stands before its first.
    velocities: [DVec2; 2],
}

impl DrivingMeter {
    /// At the start of an episode with a control period of `dt` s.
    pub fn new(dt: f64) -> Self {
        Self {
            dt,
            steps: 0,
            min_clearance: None,
            ttc_steps: [0; 2],
            intimate_steps: 0,
            personal_steps: 0,
            squared_jerk: 0.0,
            stalled_steps: 0,
            final_stall_steps: 0,
            velocities: [DVec2::ZERO; 2],
        }
    }

    /// One step: the velocity that the robot drove with (m/s, along the axes of the world), and
    /// everyone else after it.
    ///
    /// # Formula
    ///
    /// jerk = (V(k) − 2·V(k − 1) + V(k − 2))/dt², with V = 0 before the first step.
    pub fn step(&mut self, velocity: DVec2, neighbours: impl IntoIterator<Item = Neighbour>) {
        self.steps += 1;
        let [last, before] = self.velocities;
        self.squared_jerk += ((velocity - 2.0 * last + before) / (self.dt * self.dt)).length_squared();
        self.velocities = [velocity, last];
        if velocity.length() < STALL_SPEED {
            self.stalled_steps += 1;
            self.final_stall_steps += 1;
        } else {
            self.final_stall_steps = 0;
        }
        let (mut nearest, mut soonest) = (f64::INFINITY, f64::INFINITY);
        for neighbour in neighbours {
            nearest = nearest.min(neighbour.clearance);
            soonest = soonest.min(time_to_collision(&neighbour).unwrap_or(f64::INFINITY));
        }
        if nearest < f64::INFINITY {
            self.min_clearance = Some(self.min_clearance.map_or(nearest, |least| least.min(nearest)));
        }
        self.intimate_steps += u64::from(nearest < INTIMATE);
        self.personal_steps += u64::from(nearest < PERSONAL);
        for (steps, limit) in self.ttc_steps.iter_mut().zip(TTC_LIMITS) {
            *steps += u64::from(soonest < limit);
        }
    }

    /// The episode as far as it has run.
    pub fn driving(&self) -> Driving {
        Driving {
            min_clearance: self.min_clearance,
            ttc_steps: self.ttc_steps,
            intimate_steps: self.intimate_steps,
            personal_steps: self.personal_steps,
            mean_squared_jerk: if self.steps == 0 { 0.0 } else { self.squared_jerk / self.steps as f64 },
            stalled_steps: self.stalled_steps,
            final_stall_steps: self.final_stall_steps,
        }
    }
}

/// Time until two that keep their velocities are within each other's reach (s); 0 where they are,
/// `None` where they never will be.
///
/// # Formula
///
/// The lesser root of |p + u·t| = r: t = (−p·u − √((p·u)² − u²·(p² − r²)))/u².
pub fn time_to_collision(neighbour: &Neighbour) -> Option<f64> {
    let Neighbour { position, velocity, reach, .. } = neighbour;
    let outside = position.length_squared() - reach * reach;
    if outside <= 0.0 {
        return Some(0.0);
    }
    let (closing, speed_sq) = (-position.dot(*velocity), velocity.length_squared());
    let discriminant = closing * closing - speed_sq * outside;
    (closing > 0.0 && discriminant >= 0.0).then(|| (closing - discriminant.sqrt()) / speed_sq)
}
#[cfg(test)]
mod tests {
    use super::*;

    fn beside(clearance: f64, position: [f64; 2], velocity: [f64; 2]) -> Neighbour {
        Neighbour { clearance, position: position.into(), velocity: velocity.into(), reach: 1.0 }
    }

    #[test]
    fn times_to_collision_by_hand() {
        let time = |position, velocity| time_to_collision(&beside(9.0, position, velocity));
        assert_eq!(time([3.0, 0.0], [-1.0, 0.0]), Some(2.0), "2 m to go at 1 m/s");
        // Passes at 0.6 m: the circle is met 0.8 m before the nearest point, 5 − 0.8 m on at 2 m/s.
        let aslant = time([5.0, 0.6], [-2.0, 0.0]).unwrap();
        assert!((aslant - 2.1).abs() < 1e-12, "{aslant}");
        assert_eq!(time([3.0, 0.0], [1.0, 0.0]), None, "it leaves");
        assert_eq!(time([3.0, 1.5], [-1.0, 0.0]), None, "it passes by");
        assert_eq!(time([3.0, 0.0], [0.0, 0.0]), None, "both stand");
        assert_eq!(time([0.6, 0.8], [5.0, 0.0]), Some(0.0), "they touch");
        assert_eq!(time([4.0, 1.0], [-2.0, 0.0]), Some(2.0), "they graze");
    }

    #[test]
    fn an_episode_by_hand() {
        let mut meter = DrivingMeter::new(0.5);
        assert_eq!(meter.driving().mean_squared_jerk, 0.0);
        // From rest to 1 m/s and on: jerks of 1, −1 and 0 m/s by dt² = 0.25 s².
        meter.step(DVec2::X, [beside(1.5, [2.0, 0.0], [-1.0, 0.0]), beside(3.0, [9.0, 0.0], [0.0, 0.0])]);
        meter.step(DVec2::X, [beside(1.2, [4.0, 0.0], [-2.0, 0.0]), beside(0.45, [9.0, 0.0], [0.0, 0.0])]);
        meter.step(DVec2::X, [beside(0.4, [1.5, 0.0], [-1.0, 0.0])]);
        let driving = meter.driving();
        assert_eq!(driving.mean_squared_jerk, (16.0 + 16.0) / 3.0);
        // Times to collision: 1, 1.5, 0.5 s. A limit that is met is not undercut.
        assert_eq!(driving.ttc_steps, [1, 3]);
        assert_eq!((driving.intimate_steps, driving.personal_steps), (1, 2));
        assert_eq!(driving.min_clearance, Some(0.4));
        assert_eq!((driving.stalled_steps, driving.final_stall_steps), (0, 0));
        // Stands, starts, stands twice. It never was so near again.
        for speed in [0.04, 0.05, 0.0, 0.049] {
            meter.step(DVec2::new(0.0, speed), []);
        }
        let driving = meter.driving();
        assert_eq!((driving.stalled_steps, driving.final_stall_steps), (3, 2));
        assert_eq!(driving.min_clearance, Some(0.4));
    }

    #[test]
    fn nobody_is_no_clearance() {
        let mut meter = DrivingMeter::new(0.1);
        meter.step(DVec2::X, []);
        let driving = meter.driving();
        assert_eq!((driving.min_clearance, driving.personal_steps, driving.ttc_steps), (None, 0, [0; 2]));
    }
}
