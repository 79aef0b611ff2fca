//! How a step of an episode can end. Truncated and terminated are told apart by type: a time limit is not an outcome.

use serde::{Deserialize, Serialize};

/// Why an episode terminated.
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

/// What became of an episode in one step.
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
    /// Whether the episode goes on.
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
