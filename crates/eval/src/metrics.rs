//! Metrics of episodes and their summaries (paper, Table 4), in f64.
//!
//! Times and distances are compared with the straight way to the goal's edge at full speed, so they
//! are defined for successful episodes alone: an episode that ended early has no arrival to
//! compare.
//!
//! # References
//!
//! P. Long et al., "Towards Optimally Decentralized Multi-Robot Collision Avoidance via Deep
//! Reinforcement Learning", ICRA 2018, section V-B, doi:10.1109/ICRA.2018.8461113.

use serde::{Deserialize, Serialize};

use crate::statistics::{Interval, wilson};
use jostle_arena::Outcome;
use jostle_arena::metrics::EpisodeMetrics;

/// Mean and sample standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanStd {
    /// Mean; `None` without a value.
    pub mean: Option<f64>,
    /// Sample standard deviation (n − 1); `None` for fewer than two values.
    pub std: Option<f64>,
}

impl MeanStd {
    /// Of a list of values, summed in its order, in two passes.
    pub fn from_values(values: &[f64]) -> Self {
        let n = values.len() as f64;
        if values.is_empty() {
            return Self { mean: None, std: None };
        }
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let std = (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt());
        Self { mean: Some(mean), std }
    }
}

/// The check that no episode travelled farther than its time allows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceCheck {
    /// Largest extra distance − `v_max` · extra time over the successes (m); `None` without one.
    pub worst: Option<f64>,
    /// Successful episodes in which it exceeds [`DistanceCheck::TOLERANCE`].
    pub violations: u64,
}

impl DistanceCheck {
    /// Allowance for rounding (m).
    pub const TOLERANCE: f64 = 1e-6;

    /// True if no episode breaks the bound.
    pub fn holds(&self) -> bool {
        self.violations == 0
    }
}

/// Counts, rate, interval and means over a set of episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of episodes.
    pub episodes: u64,
    /// Goal reached.
    pub success: u64,
    /// Crashed into a wall or a static obstacle.
    pub collision_wall: u64,
    /// Crashed into a pedestrian.
    pub collision_pedestrian: u64,
    /// Ran out of steps.
    pub timeout: u64,
    /// Share of successes; `None` without episodes.
    pub success_rate: Option<f64>,
    /// Its 95 % Wilson interval.
    pub wilson_95: Option<Interval>,
    /// Extra time over the successes (s).
    pub extra_time: MeanStd,
    /// Extra distance over the successes (m).
    pub extra_distance: MeanStd,
    /// Average speed over the successes (m/s).
    pub average_speed: MeanStd,
    /// Extra distance ≤ `v_max` · extra time.
    pub distance_check: DistanceCheck,
}

impl Summary {
    /// Summary of episodes in the given order.
    pub fn from_episodes<'a>(
        v_max: f64,
        episodes: impl IntoIterator<Item = (Outcome, &'a EpisodeMetrics)>,
    ) -> Self {
        let mut counts = [0_u64; Outcome::ALL.len()];
        let (mut times, mut distances, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
        let mut check = DistanceCheck { worst: None, violations: 0 };
        for (outcome, metrics) in episodes {
            counts[outcome as usize] += 1;
            times.extend(metrics.extra_time);
            distances.extend(metrics.extra_distance);
            speeds.extend(metrics.average_speed);
            if let (Some(time), Some(distance)) = (metrics.extra_time, metrics.extra_distance) {
                let excess = distance - v_max * time;
                check.worst = Some(check.worst.map_or(excess, |worst: f64| worst.max(excess)));
                check.violations += u64::from(excess > DistanceCheck::TOLERANCE);
            }
        }
        let [success, collision_wall, collision_pedestrian, timeout] = counts;
        let episodes = counts.iter().sum();
        Self {
            episodes,
            success,
            collision_wall,
            collision_pedestrian,
            timeout,
            success_rate: (episodes > 0).then(|| success as f64 / episodes as f64),
            wilson_95: wilson(success, episodes),
            extra_time: MeanStd::from_values(&times),
            extra_distance: MeanStd::from_values(&distances),
            average_speed: MeanStd::from_values(&speeds),
            distance_check: check,
        }
    }
}

#[cfg(test)]
mod tests {
    use jostle_arena::metrics::MetricScale;

    use super::*;

    const SCALE: MetricScale = MetricScale { dt: 0.5, goal_radius: 0.5, v_max: 2.0 };

    #[test]
    fn one_success_by_hand() {
        let positions = [[0.0, 0.0], [3.0, 4.0], [3.0, 7.5]];
        let metrics = EpisodeMetrics::from_positions(&SCALE, Outcome::Success, &positions, [3.0, 8.0]);
        assert_eq!(metrics.time, 1.0);
        assert_eq!(metrics.path_length, 8.5);
        let to_edge = 73.0_f64.sqrt() - 0.5;
        assert_eq!(metrics.extra_time, Some(1.0 - to_edge / 2.0));
        assert_eq!(metrics.extra_distance, Some(8.5 - to_edge));
        assert_eq!(metrics.average_speed, Some(8.5));
        // 8.5 m in 1 s at 2 m/s: the check must see it.
        let summary = Summary::from_episodes(2.0, [(Outcome::Success, &metrics)]);
        assert_eq!(summary.distance_check.violations, 1);
        assert!((summary.distance_check.worst.unwrap() - 6.5).abs() < 1e-12);
    }

    #[test]
    fn a_failure_has_no_extras_and_one_value_no_spread() {
        let failed = EpisodeMetrics::from_positions(&SCALE, Outcome::Timeout, &[[0.0; 2]], [1.0, 0.0]);
        assert_eq!((failed.extra_time, failed.extra_distance, failed.average_speed), (None, None, None));
        let summary = Summary::from_episodes(2.0, [(Outcome::Timeout, &failed)]);
        assert_eq!((summary.timeout, summary.success_rate), (1, Some(0.0)));
        assert_eq!(summary.extra_time, MeanStd { mean: None, std: None });
        assert_eq!(MeanStd::from_values(&[2.0]), MeanStd { mean: Some(2.0), std: None });
        assert_eq!(MeanStd::from_values(&[1.0, 3.0]), MeanStd { mean: Some(2.0), std: Some(2.0_f64.sqrt()) });
        assert_eq!(Summary::from_episodes(1.0, []).success_rate, None);
    }

    #[test]
    fn the_check_bears_rounding_and_nothing_more() {
        let episode = |excess| EpisodeMetrics {
            extra_time: Some(0.0),
            extra_distance: Some(excess),
            ..EpisodeMetrics::from_totals(&SCALE, Outcome::Success, 1, 1.0, 1.0)
        };
        let check = |excesses: &[f64]| {
            let episodes: Vec<_> = excesses.iter().map(|excess| episode(*excess)).collect();
            Summary::from_episodes(2.0, episodes.iter().map(|e| (Outcome::Success, e))).distance_check
        };
        let bearable = check(&[DistanceCheck::TOLERANCE, -3.0]);
        assert_eq!(bearable, DistanceCheck { worst: Some(DistanceCheck::TOLERANCE), violations: 0 });
        assert!(bearable.holds());
        let broken = check(&[0.0, 1.0, 0.5]);
        assert_eq!(broken, DistanceCheck { worst: Some(1.0), violations: 2 });
        assert!(!broken.holds());
    }
}
