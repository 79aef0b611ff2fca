//! Refusals of a room, a crowd or a robot: the place, what was found, what was expected.

use std::path::PathBuf;

use jostle_peds::{CrowdKind, CrowdName, PedsError};
use jostle_policy::PolicyError;
use jostle_sim::SimError;

/// Error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum ArenaError {
    /// A setting is outside its range.
    #[error("{field}: found {found}, expected {expected}")]
    Setting {
        /// Name of the setting.
        field: &'static str,
        /// The value given.
        found: String,
        /// The values that would be accepted.
        expected: String,
    },
    /// A learned crowd was asked for without policies to drive it.
    #[error("crowd {crowd} needs a pool of pedestrian policies; found none")]
    EmptyPool {
        /// The crowd.
        crowd: CrowdKind,
    },
    /// A crowd of the user's own was asked for by its name only.
    #[error(
        "crowd {crowd} is no built-in one, and no settings can make it; expected the crowd itself (see `RoomPlan::among` and \
         `Protocol::evaluate_among`)"
    )]
    OwnCrowd {
        /// Its name.
        crowd: CrowdName,
    },
    /// No planner has this name.
    #[error("planner: found {name}, expected straight, brake, goal-seeker, dwa, orca or social-force{hint}")]
    UnknownPlanner {
        /// The name asked for.
        name: String,
        /// The names most like it, as the end of a message.
        hint: String,
    },
    /// A planner that knows positions was asked to drive by rows.
    #[error(
        "planner {planner}: found observation rows, expected everyone's position, which a row does not tell; it drives in a test by its name"
    )]
    KnowsPositions {
        /// Its name.
        planner: &'static str,
    },
    /// A file cannot be read or written. The message holds the reason, which is therefore not
    /// handed on as a source.
    #[error("{}: cannot {action}: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The action attempted.
        action: &'static str,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// The robot's policy gave an action that is not a finite number.
    #[error("episode {episode}, step {step}: the robot's action is ({v}, {w}); expected finite numbers")]
    Action {
        /// Episode index.
        episode: u64,
        /// Step within it.
        step: u32,
        /// Linear part.
        v: f32,
        /// Angular part.
        w: f32,
    },
    /// The simulator refused.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A crowd refused.
    #[error(transparent)]
    Peds(#[from] PedsError),
    /// A policy or its file was refused.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

impl ArenaError {
    /// For `map_err` on file operations.
    pub(crate) fn io(file: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let file = file.to_path_buf();
        move |reason| Self::Io { file, action, reason }
    }
}
