//! Refusals of this node when it starts: the place, what was found, what was expected.
//!
//! A fault later, while the robot may be moving, is no error but a [`Stop`](crate::stop::Stop): a
//! zero command with its reason.

use std::path::PathBuf;

use jostle_arena::ArenaError;
use jostle_runs::RunsError;

/// Error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum RosError {
    /// A file cannot be read. The message holds the system's reason, which is therefore not handed
    /// on as a source.
    #[error("{}: cannot read: {reason}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// A parameter file is no TOML, has a key that nobody knows, or a value of another type.
    #[error("{place}: {problem}")]
    Parameters {
        /// File and line.
        place: String,
        /// The fault.
        problem: String,
    },
    /// A parameter is outside its range.
    #[error("{place}: {key}: found {found}, expected {expected}")]
    Parameter {
        /// The file, or the option of the command line.
        place: String,
        /// The key.
        key: &'static str,
        /// The value given.
        found: String,
        /// The values that would be accepted.
        expected: String,
    },
    /// A topic's name is none.
    #[error("topic {name}: {problem}")]
    Topic {
        /// The name given.
        name: String,
        /// The fault.
        problem: String,
    },
    /// An environment variable of ROS is not what it may be.
    #[error("{name}: found {found}, expected {expected}")]
    Environment {
        /// The variable.
        name: &'static str,
        /// Its value.
        found: String,
        /// The values that would be accepted.
        expected: &'static str,
    },
    /// ROS 2's transport refused.
    #[error("cannot {action}: {reason}")]
    Transport {
        /// The action attempted.
        action: &'static str,
        /// The transport's reason.
        reason: String,
    },
    /// The policy panicked; the robot has been stopped.
    #[error("the policy panicked: {reason}; the robot has been commanded to stop")]
    Panic {
        /// The panic's message.
        reason: String,
    },
    /// The driving process ended without having been asked to; the robot has been stopped.
    #[error("the driving process ended by itself ({status}); the robot has been commanded to stop")]
    Killed {
        /// Its exit status.
        status: std::process::ExitStatus,
    },
    /// No policy where one was named.
    #[error(transparent)]
    Runs(Box<RunsError>),
    /// The policy refused.
    #[error(transparent)]
    Eval(Box<ArenaError>),
}

impl RosError {
    /// For `map_err` on the transport's operations.
    pub(crate) fn transport<E: std::fmt::Display>(action: &'static str) -> impl FnOnce(E) -> Self {
        move |reason| Self::Transport { action, reason: reason.to_string() }
    }
}

impl From<RunsError> for RosError {
    fn from(error: RunsError) -> Self {
        Self::Runs(Box::new(error))
    }
}

impl From<ArenaError> for RosError {
    fn from(error: ArenaError) -> Self {
        Self::Eval(Box::new(error))
    }
}
