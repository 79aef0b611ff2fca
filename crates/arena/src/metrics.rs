//! Metrics of one episode (paper, Table 4), in f64; `jostle_eval::metrics` summarises them.
//!
//! Times and distances are compared with the straight way to the goal's edge at full speed, so they
//! are defined for successful episodes only: an episode that ended early has no arrival to compare.

use serde::{Deserialize, Serialize};

use jostle_sim::Outcome;

/// The numbers of the task that the metrics need.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MetricScale {
    /// Control period (s).
    pub dt: f64,
    /// Distance at which the goal counts as reached (m).
    pub goal_radius: f64,
    /// The robot's highest speed (m/s).
    pub v_max: f64,
}

/// Metrics of one episode. The last three are `None` unless it succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeMetrics {
    /// Duration (s).
    pub time: f64,
    /// Length of the way travelled (m).
    pub path_length: f64,
    /// Distance from the start to the goal's centre (m).
    pub straight_distance: f64,
    /// Time beyond the straight way at full speed (s).
    pub extra_time: Option<f64>,
    /// Way beyond the straight one (m); a little below 0 is rounding, since no way is shorter than
    /// the straight one.
    pub extra_distance: Option<f64>,
    /// Way over time (m/s); `None` also for an episode without a step.
    pub average_speed: Option<f64>,
}

impl EpisodeMetrics {
    /// Metrics from an episode's totals.
    ///
    /// # Formula
    ///
    /// extra time = T − (d₀ − `r_goal`)/`v_max`; extra distance = L − (d₀ − `r_goal`); average
    /// speed = L/T.
    pub fn from_totals(
        scale: &MetricScale,
        outcome: Outcome,
        steps: u64,
        path_length: f64,
        straight_distance: f64,
    ) -> Self {
        let time = scale.dt * steps as f64;
        let to_edge = straight_distance - scale.goal_radius;
        let success = outcome == Outcome::Success;
        Self {
            time,
            path_length,
            straight_distance,
            extra_time: success.then(|| time - to_edge / scale.v_max),
            extra_distance: success.then_some(path_length - to_edge),
            average_speed: (success && steps > 0).then(|| path_length / time),
        }
    }

    /// Metrics from the positions of an episode, the first being its start.
    ///
    /// # Panics
    ///
    /// If `positions` is empty.
    pub fn from_positions(
        scale: &MetricScale,
        outcome: Outcome,
        positions: &[[f64; 2]],
        goal: [f64; 2],
    ) -> Self {
        let path_length = positions.windows(2).map(|pair| distance(pair[0], pair[1])).sum();
        let straight = distance(positions[0], goal);
        Self::from_totals(scale, outcome, positions.len() as u64 - 1, path_length, straight)
    }
}

/// Euclidean distance.
pub fn distance(from: [f64; 2], to: [f64; 2]) -> f64 {
    (to[0] - from[0]).hypot(to[1] - from[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: MetricScale = MetricScale { dt: 0.5, goal_radius: 0.5, v_max: 2.0 };

    #[test]
    fn a_success_without_a_step_has_no_speed() {
        let metrics = EpisodeMetrics::from_totals(&SCALE, Outcome::Success, 0, 0.0, 0.5);
        assert_eq!((metrics.extra_time, metrics.extra_distance), (Some(0.0), Some(0.0)));
        assert_eq!(metrics.average_speed, None);
    }
}
