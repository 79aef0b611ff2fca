//! The result of a step, and the outcomes of an episode.
//!
//! An episode is truncated by its time limit and terminated by any other outcome. A learner must
//! tell the two apart: the value after a terminated episode is 0, and after a truncated one that of
//! its last observation.

use crate::traits::Role;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The outcome of an episode. The goal goes before a crash, and a crash before the time limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The goal was reached.
    Success,
    /// The nearest thing at a crash was a wall or an obstacle.
    CollisionWall,
    /// The nearest thing at a crash was another body: a pedestrian in a test, another agent in
    /// training.
    CollisionPedestrian,
    /// The time limit was reached first.
    Timeout,
}

impl Outcome {
    /// All outcomes, in the order of their discriminants.
    pub const ALL: [Self; 4] = [Self::Success, Self::CollisionWall, Self::CollisionPedestrian, Self::Timeout];
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Success => "success",
            Self::CollisionWall => "collision_wall",
            Self::CollisionPedestrian => "collision_pedestrian",
            Self::Timeout => "timeout",
        })
    }
}

/// The state of an episode after one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepEnd {
    /// It goes on.
    #[default]
    Running,
    /// It has ended.
    Ended(Outcome),
}

impl StepEnd {
    /// The state of an episode after its step number `steps`, by what the step led to and by the
    /// time limit.
    pub fn new(reached: Option<Outcome>, steps: u32, step_limit: u32) -> Self {
        match reached {
            Some(outcome) => Self::Ended(outcome),
            None if steps >= step_limit => Self::Ended(Outcome::Timeout),
            None => Self::Running,
        }
    }

    /// The outcome; `None` while the episode goes on.
    pub fn outcome(self) -> Option<Outcome> {
        match self {
            Self::Running => None,
            Self::Ended(outcome) => Some(outcome),
        }
    }

    /// True if the episode ended by itself: the value after it is 0.
    pub fn is_terminated(self) -> bool {
        self.outcome().is_some_and(|outcome| outcome != Outcome::Timeout)
    }

    /// True if the time limit cut the episode off: the value after it is that of its last
    /// observation.
    pub fn is_truncated(self) -> bool {
        self == Self::Ended(Outcome::Timeout)
    }

    /// True if the episode goes on.
    pub fn is_running(self) -> bool {
        self == Self::Running
    }
}

/// An episode that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSummary {
    /// Steps it took.
    pub steps: u32,
    /// Sum of the displacements, m.
    pub path_length: f64,
    /// Distance from start to goal, m.
    pub straight_distance: f32,
    /// Undiscounted sum of the rewards (the environment's own).
    pub episode_return: f64,
    /// The behaviour token it was driven by.
    pub token: u32,
}

/// The result of one step for one agent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Transition {
    /// The clipped copy of the action.
    pub executed: [f32; 2],
    /// The environment's reward.
    pub reward: f32,
    /// The state of the episode after the step.
    pub end: StepEnd,
    /// The episode, if it ended.
    pub episode: Option<EpisodeSummary>,
    /// The agent's role in that step: a learner unless there is a training crowd.
    pub role: Role,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_limit_truncates_and_everything_else_terminates() {
        let state = |reached, steps| {
            let end = StepEnd::new(reached, steps, 10);
            (end.is_running(), end.is_terminated(), end.is_truncated(), end.outcome())
        };
        assert_eq!(state(None, 9), (true, false, false, None));
        assert_eq!(state(None, 10), (false, false, true, Some(Outcome::Timeout)));
        for outcome in [Outcome::Success, Outcome::CollisionWall, Outcome::CollisionPedestrian] {
            // Also in the step that reaches the limit.
            assert_eq!(state(Some(outcome), 10), (false, true, false, Some(outcome)));
        }
    }

    /// Records hold these words.
    #[test]
    fn outcomes_are_stored_by_their_names() {
        for outcome in Outcome::ALL {
            assert_eq!(serde_json::to_string(&outcome).unwrap(), format!("\"{outcome}\""));
        }
        let names = Outcome::ALL.map(|outcome| outcome.to_string());
        assert_eq!(names, ["success", "collision_wall", "collision_pedestrian", "timeout"]);
    }
}
