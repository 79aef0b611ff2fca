//! The result of a step, and the ends of an episode. Truncated and terminated are different variants: after a time limit the
//! value of the last state counts, after an outcome it is 0.

use crate::traits::Role;
use serde::{Deserialize, Serialize};

/// The reason for which an episode terminated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The goal was reached.
    Success,
    /// Too near to a wall or an obstacle.
    CollisionWall,
    /// Too near to another body.
    CollisionAgent,
}

/// The state of an episode after one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepEnd {
    /// It goes on.
    #[default]
    Running,
    /// It came to an end of its own; the value after it is 0.
    Terminated(Outcome),
    /// The time limit cut it off.
    Truncated,
}

impl StepEnd {
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
