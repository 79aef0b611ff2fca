//! The one error type of this crate. Each message is one line that names where, what was found and
//! what was expected.

use std::path::PathBuf;

/// Why a configuration, a checkpoint or an update was refused.
#[derive(Debug, thiserror::Error)]
pub enum PpoError {
    /// A configuration key is unknown, of the wrong type, or out of range.
    #[error("{location}: {field}: found {found}, expected {expected}")]
    Config {
        /// `file:line:column`, `--set key=value`, or `configuration` for one that was made in code.
        location: String,
        /// Dotted path of the key.
        field: String,
        /// The value found.
        found: String,
        /// The values that would be accepted.
        expected: String,
    },
    /// A configuration file or an override is not TOML at all.
    #[error("{location}: {message}")]
    Syntax {
        /// As in [`PpoError::Config`].
        location: String,
        /// The parser's words.
        message: String,
    },
    /// A file cannot be read or written. The message holds the reason, which is therefore not
    /// handed on as a source.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The action attempted.
        action: &'static str,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// A checkpoint is truncated, damaged, of another format or of another shape.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The tensor, the metadata key or the part of the format.
        field: String,
        /// The value found.
        found: String,
        /// The value expected.
        expected: String,
    },
    /// A number that is not finite stopped the run; the last checkpoint is untouched.
    #[error("update {update}: {tensor}{} is not finite", agent.map(|a| format!(" of agent {a}")).unwrap_or_default())]
    NotFinite {
        /// The update that was being computed, counted from 1.
        update: u64,
        /// The tensor.
        tensor: String,
        /// The agent (room · N + agent), where the tensor belongs to one.
        agent: Option<usize>,
    },
    /// The simulator refused its configuration or a state.
    #[error(transparent)]
    Sim(#[from] jostle_sim::SimError),
    /// The networks refused their configuration or parameters.
    #[error(transparent)]
    Policy(#[from] jostle_policy::PolicyError),
    /// The discriminators refused their configuration or parameters.
    #[error(transparent)]
    Diversity(#[from] jostle_diversity::DiversityError),
    /// The processes of a run do not fit it, or one of them failed or is gone.
    #[error("{reason}")]
    Ranks {
        /// What happened, and on which rank.
        reason: String,
    },
    /// The thread pool could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// The number asked for.
        threads: usize,
        /// The system's reason.
        reason: String,
    },
}
