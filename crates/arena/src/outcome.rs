//! How an episode ends.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The four ends of a test episode. Goal goes before crash, crash before time limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeOutcome {
    /// The goal was reached.
    Success,
    /// The nearest thing at a crash was a wall or a static obstacle.
    CollisionWall,
    /// The nearest thing at a crash was a pedestrian.
    CollisionPedestrian,
    /// The step limit was reached first.
    Timeout,
}

impl EpisodeOutcome {
    /// All outcomes, in the order of their discriminants.
    pub const ALL: [Self; 4] = [Self::Success, Self::CollisionWall, Self::CollisionPedestrian, Self::Timeout];
}

impl fmt::Display for EpisodeOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Success => "success",
            Self::CollisionWall => "collision_wall",
            Self::CollisionPedestrian => "collision_pedestrian",
            Self::Timeout => "timeout",
        })
    }
}
