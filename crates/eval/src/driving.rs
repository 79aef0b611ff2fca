//! Driving over many episodes: means, shares and tails. Not of the paper.
//!
//! [`DrivingSummary`] sums up what `jostle_arena::driving` measures, and what follows from times
//! and distances only. Everything is f64; `docs/metrics.md` has the formulas with their reasons.
//!
//! # References
//!
//! A. Francis et al., "Principles and Guidelines for Evaluating Social Robot Navigation
//! Algorithms", 2023, arXiv:2306.16740, names these measures. P. Anderson et al., "On Evaluation of
//! Embodied Navigation Agents", 2018, arXiv:1807.06757 (SPL).

use jostle_arena::Outcome;
use jostle_arena::driving::Driving;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};
use serde::{Deserialize, Serialize};

use crate::statistics::cvar;

/// An episode that runs out of time is a deadlock if the robot has stood for so long at its end
/// (s).
pub const DEADLOCK_TIME: f64 = 5.0;
/// Share of the episodes in the tail of the least clearances.
pub const TAIL: f64 = 0.05;

/// The robot's driving over a set of episodes. `None` where no episode has a value.
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

/// The part of an episode that a summary needs.
#[derive(Clone, Copy, Debug)]
pub struct Driven<'a> {
    /// Its outcome.
    pub outcome: Outcome,
    /// Time and way.
    pub metrics: &'a EpisodeMetrics,
    /// `None` for an episode that was stored before there were these values.
    pub driving: Option<&'a Driving>,
}

impl DrivingSummary {
    /// Summary of episodes. Where one has no [`Driving`], only what follows from times and ways is
    /// there.
    ///
    /// # Formula
    ///
    /// With ℓ = d₀ − `r_goal`: SPL = mean(success · ℓ/max(ℓ, L)), path efficiency = mean(ℓ/max(ℓ,
    /// L)), time efficiency = mean(min(1, ℓ/(`v_max`·T))), the last two over the successes. An
    /// episode that is at its goal from the start counts 1.
    pub fn new<'a>(scale: &MetricScale, episodes: impl IntoIterator<Item = Driven<'a>>) -> Self {
        let (mut spl, mut path, mut time) = (Vec::new(), Vec::new(), Vec::new());
        let mut driven = Some(Vec::new());
        for Driven { outcome, metrics, driving } in episodes {
            let edge = (metrics.straight_distance - scale.goal_radius).max(0.0);
            let share = |whole: f64| if whole > edge { edge / whole } else { 1.0 };
            if outcome == Outcome::Success {
                path.push(share(metrics.path_length));
                time.push(share(scale.v_max * metrics.time));
            }
            spl.push(if outcome == Outcome::Success { share(metrics.path_length) } else { 0.0 });
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
        let deadlock = |(outcome, _, driving): &(Outcome, f64, Driving)| {
            let stood = driving.final_stall_steps as f64 * scale.dt;
            f64::from(u8::from(*outcome == Outcome::Timeout && stood >= DEADLOCK_TIME - scale.dt / 2.0))
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
    /// Name (as in CSV files), head (as in tables, with its unit) and value of every measure, in
    /// the order of the fields.
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

    /// The largest value that each of [`Self::columns`] can have: 1 of a share. The least of all is
    /// 0.
    pub const LARGEST: [f64; 12] = {
        const ANY: f64 = f64::INFINITY;
        [1.0, 1.0, 1.0, ANY, ANY, 1.0, 1.0, 1.0, 1.0, ANY, ANY, 1.0]
    };

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

    /// Successes of 10 m to the goal's edge by ways of 10 m in 10 s and 12.5 m in 20 s, a crash,
    /// and a timeout that stood.
    #[test]
    fn a_summary_by_hand() {
        use Outcome::{CollisionPedestrian, Success, Timeout};
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
        let unbounded = summary.columns().into_iter().zip(DrivingSummary::LARGEST);
        let unbounded: Vec<&str> =
            unbounded.filter(|(_, largest)| *largest > 1.0).map(|((name, ..), _)| name).collect();
        assert_eq!(unbounded, ["min_clearance", "min_clearance_tail", "mean_squared_jerk", "stalled_time"]);
        let without = DrivingSummary::new(&scale, episodes(3));
        assert_eq!(without.spl, summary.spl);
        assert_eq!((without.min_clearance, without.ttc_below, without.deadlocks), (None, [None; 2], None));
        assert_eq!(DrivingSummary::new(&scale, []).spl, None);
    }
}
