//! How a robot drives, beyond whether it arrives: nearness, time to collision, smoothness, stalling. Not of the paper.
//!
//! Reading order: [`Driving`] (an episode's values), [`DrivingMeter`] (how they are measured while it runs), [`DrivingSummary`]
//! (means over episodes, and what follows from times and distances alone). Everything is f64; `docs/metrics.md` has the formulas with
//! their reasons.
//!
//! # References
//!
//! A. Francis et al., "Principles and Guidelines for Evaluating Social Robot Navigation Algorithms", 2023, arXiv:2306.16740, names
//! these measures and leaves thresholds open. P. Anderson et al., "On Evaluation of Embodied Navigation Agents", 2018,
//! arXiv:1807.06757 (SPL). E. T. Hall, "The Hidden Dimension", 1966 (intimate and personal space).

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::metrics::{EpisodeMetrics, MetricScale};
use crate::outcome::EpisodeOutcome;
use crate::report::suite::cvar;

/// Farthest distance between outlines that counts as intimate space (m).
pub const INTIMATE: f64 = 0.45;
/// The same for personal space, which contains the intimate one (m).
pub const PERSONAL: f64 = 1.2;
/// Times to collision below these are counted (s).
pub const TTC_LIMITS: [f64; 2] = [1.0, 2.0];
/// A robot that drives more slowly than this stands (m/s).
pub const STALL_SPEED: f64 = 0.05;
/// An episode that runs out of time is a deadlock if the robot has stood for so long at its end (s).
pub const DEADLOCK_TIME: f64 = 5.0;
/// Share of the episodes in the tail of the least clearances.
pub const TAIL: f64 = 0.05;

/// How the robot drove in one episode. Steps are control periods; the one that ended the episode counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driving {
    /// Least distance between the robot's outline and a pedestrian's after a step (m); `None` without pedestrians.
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
    /// How many of them end the episode without a break.
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

    /// One step: the velocity that the robot drove with (m/s, along the axes of the world), and everyone else after it.
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

/// Time until two that keep their velocities are within each other's reach (s); 0 where they are, `None` where they never will be.
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

/// How the robot drove over a set of episodes. `None` where no episode has a value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrivingSummary {
    /// Success weighted by path length: mean over all episodes of success × straight way over way.
    pub spl: Option<f64>,
    /// Straight way to the goal's edge over the way driven, mean over the successes.
    pub path_efficiency: Option<f64>,
    /// The same of times, at full speed.
    pub time_efficiency: Option<f64>,
    /// Mean over the episodes of the least clearance (m).
    pub min_clearance: Option<f64>,
    /// Mean of the least clearances in their lowest 5 % (m).
    pub min_clearance_tail: Option<f64>,
    /// Share of all steps with a time to collision below 1 s and below 2 s.
    pub ttc_below: [Option<f64>; 2],
    /// Share of all steps in intimate space.
    pub intimate: Option<f64>,
    /// Share of all steps in personal space.
    pub personal: Option<f64>,
    /// Mean over the episodes of the mean squared jerk (m²/s⁶).
    pub mean_squared_jerk: Option<f64>,
    /// Mean over the episodes of the time in which the robot stood (s).
    pub stalled_time: Option<f64>,
    /// Share of the episodes that ran out of time while the robot stood ([`DEADLOCK_TIME`]).
    pub deadlocks: Option<f64>,
}

/// What a summary needs of an episode.
#[derive(Clone, Copy, Debug)]
pub struct Driven<'a> {
    /// How it ended.
    pub outcome: EpisodeOutcome,
    /// Time and way.
    pub metrics: &'a EpisodeMetrics,
    /// `None` for an episode that was stored before there were these values.
    pub driving: Option<&'a Driving>,
}

impl DrivingSummary {
    /// Summary of episodes. Where one has no [`Driving`], only what follows from times and ways is there.
    ///
    /// # Formula
    ///
    /// With ℓ = d₀ − `r_goal`: SPL = mean(success · ℓ/max(ℓ, L)), path efficiency = mean(ℓ/max(ℓ, L)), time efficiency =
    /// mean(min(1, ℓ/(`v_max`·T))), the last two over the successes. An episode that is at its goal from the start counts 1.
    pub fn new<'a>(scale: &MetricScale, episodes: impl IntoIterator<Item = Driven<'a>>) -> Self {
        let (mut spl, mut path, mut time) = (Vec::new(), Vec::new(), Vec::new());
        let mut driven = Some(Vec::new());
        for Driven { outcome, metrics, driving } in episodes {
            let edge = (metrics.straight_distance - scale.goal_radius).max(0.0);
            let share = |whole: f64| if whole > edge { edge / whole } else { 1.0 };
            if outcome == EpisodeOutcome::Success {
                path.push(share(metrics.path_length));
                time.push(share(scale.v_max * metrics.time));
            }
            spl.push(if outcome == EpisodeOutcome::Success { share(metrics.path_length) } else { 0.0 });
            driven = driven.zip(driving).map(|(mut all, driving)| {
                all.push((outcome, metrics.time, *driving));
                all
            });
        }
        let driven = driven.unwrap_or_default();
        let all = |value: &dyn Fn(&Driving) -> f64| -> Vec<f64> {
            driven.iter().map(|(_, _, driving)| value(driving)).collect()
        };
        let steps: f64 = driven.iter().map(|(_, time, _)| (time / scale.dt).round()).sum();
        let share = |value: &dyn Fn(&Driving) -> u64| {
            (steps > 0.0).then(|| driven.iter().map(|(_, _, d)| value(d) as f64).sum::<f64>() / steps)
        };
        let clearances: Vec<f64> =
            driven.iter().filter_map(|(_, _, driving)| driving.min_clearance).collect();
        let deadlock = |(outcome, _, driving): &(EpisodeOutcome, f64, Driving)| {
            let stood = driving.final_stall_steps as f64 * scale.dt;
            f64::from(u8::from(
                *outcome == EpisodeOutcome::Timeout && stood >= DEADLOCK_TIME - scale.dt / 2.0,
            ))
        };
        Self {
            spl: mean(&spl),
            path_efficiency: mean(&path),
            time_efficiency: mean(&time),
            min_clearance: mean(&clearances),
            min_clearance_tail: cvar(&clearances, TAIL),
            ttc_below: [share(&|d| d.ttc_steps[0]), share(&|d| d.ttc_steps[1])],
            intimate: share(&|d| d.intimate_steps),
            personal: share(&|d| d.personal_steps),
            mean_squared_jerk: mean(&all(&|d| d.mean_squared_jerk)),
            stalled_time: mean(&all(&|d| d.stalled_steps as f64 * scale.dt)),
            deadlocks: mean(&driven.iter().map(deadlock).collect::<Vec<_>>()),
        }
    }
}

impl DrivingSummary {
    /// Name (as in CSV files), head (as in tables, with its unit) and value of every measure, in the order of the fields.
    pub fn columns(&self) -> [(&'static str, &'static str, Option<f64>); 12] {
        [
            ("spl", "SPL", self.spl),
            ("path_efficiency", "path efficiency", self.path_efficiency),
            ("time_efficiency", "time efficiency", self.time_efficiency),
            ("min_clearance", "least clearance (m)", self.min_clearance),
            ("min_clearance_tail", "its 5 % tail (m)", self.min_clearance_tail),
            ("ttc_below_1", "TTC < 1 s", self.ttc_below[0]),
            ("ttc_below_2", "TTC < 2 s", self.ttc_below[1]),
            ("intimate", "within 0.45 m", self.intimate),
            ("personal", "within 1.2 m", self.personal),
            ("mean_squared_jerk", "jerk² (m²/s⁶)", self.mean_squared_jerk),
            ("stalled_time", "stalled (s)", self.stalled_time),
            ("deadlocks", "deadlocks", self.deadlocks),
        ]
    }

    /// A summary without a value.
    pub const EMPTY: Self = Self {
        spl: None,
        path_efficiency: None,
        time_efficiency: None,
        min_clearance: None,
        min_clearance_tail: None,
        ttc_below: [None; 2],
        intimate: None,
        personal: None,
        mean_squared_jerk: None,
        stalled_time: None,
        deadlocks: None,
    };
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
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

    /// Successes of 10 m to the goal's edge by ways of 10 m in 10 s and 12.5 m in 20 s, a crash, and a timeout that stood.
    #[test]
    fn a_summary_by_hand() {
        use EpisodeOutcome::{CollisionPedestrian, Success, Timeout};
        let scale = MetricScale { dt: 0.5, goal_radius: 0.5, v_max: 1.0 };
        let rows =
            [(Success, 20, 10.0), (Success, 40, 12.5), (CollisionPedestrian, 10, 2.0), (Timeout, 80, 3.0)];
        let metrics =
            rows.map(|(outcome, steps, way)| EpisodeMetrics::from_totals(&scale, outcome, steps, way, 10.5));
        let driving = |clearance, stalled_steps, final_stall_steps| Driving {
            min_clearance: Some(clearance),
            ttc_steps: [3, 6],
            intimate_steps: 15,
            personal_steps: 30,
            mean_squared_jerk: clearance * 10.0,
            stalled_steps,
            final_stall_steps,
        };
        let all = [driving(1.0, 0, 0), driving(2.0, 0, 0), driving(0.2, 4, 4), driving(0.4, 16, 10)];
        let episodes = |n: usize| {
            let given = rows.iter().zip(&metrics).zip(&all).enumerate();
            given.map(move |(i, (((outcome, _, _), metrics), driving))| Driven {
                outcome: *outcome,
                metrics,
                driving: (i < n).then_some(driving),
            })
        };
        let summary = DrivingSummary::new(&scale, episodes(4));
        assert_eq!(summary.spl, Some((1.0 + 0.8) / 4.0));
        assert_eq!(summary.path_efficiency, Some(0.9));
        assert_eq!(summary.time_efficiency, Some(0.75));
        assert!((summary.min_clearance.unwrap() - 0.9).abs() < 1e-12);
        // 5 % of four episodes are a fifth of the worst one.
        assert!((summary.min_clearance_tail.unwrap() - 0.2).abs() < 1e-12);
        // 150 steps in all.
        assert_eq!(summary.ttc_below, [Some(12.0 / 150.0), Some(24.0 / 150.0)]);
        assert_eq!((summary.intimate, summary.personal), (Some(0.4), Some(0.8)));
        assert!((summary.mean_squared_jerk.unwrap() - 9.0).abs() < 1e-12);
        assert_eq!(summary.stalled_time, Some(2.5));
        assert_eq!(summary.deadlocks, Some(0.25), "who crashed while standing is no deadlock");
        let without = DrivingSummary::new(&scale, episodes(3));
        assert_eq!(without.spl, summary.spl);
        assert_eq!((without.min_clearance, without.ttc_below, without.deadlocks), (None, [None; 2], None));
        assert_eq!(DrivingSummary::new(&scale, []).spl, None);
    }
}
