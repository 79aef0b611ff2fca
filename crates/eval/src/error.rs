//! Refusals of an evaluation: the place, what was found, what was expected.

use std::path::PathBuf;

use jostle_arena::ArenaError;
use jostle_diversity::DiversityError;
use jostle_peds::PedsError;
use jostle_policy::PolicyError;
use jostle_sim::SimError;

/// Error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
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
    /// A file is no suite.
    #[error("{}: {problem}", file.display())]
    Suite {
        /// The file.
        file: PathBuf,
        /// The fault.
        problem: String,
    },
    /// A file is no entry of a leaderboard.
    #[error("{}: {problem}", file.display())]
    Board {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A line of a record file is not a record.
    #[error("{}: line {line}: {problem}", file.display())]
    Record {
        /// The file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The fault.
        problem: String,
    },
    /// A record file holds records of another cell.
    #[error("{}: holds cell {found}, expected {expected}; it is left as it is", file.display())]
    OtherCell {
        /// The file.
        file: PathBuf,
        /// Cell hash of its records.
        found: String,
        /// Cell hash asked for.
        expected: String,
    },
    /// Another process is writing the record file.
    #[error("{}: another run is writing this file", file.display())]
    Locked {
        /// The file.
        file: PathBuf,
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
    /// A room, a crowd or a robot refused.
    #[error(transparent)]
    Arena(#[from] ArenaError),
    /// A crowd refused.
    #[error(transparent)]
    Peds(#[from] PedsError),
    /// The simulator refused.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A policy or its file was refused.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The diversity metric refused.
    #[error(transparent)]
    Diversity(#[from] DiversityError),
}

impl EvalError {
    /// For `map_err` on file operations.
    pub(crate) fn io(file: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let file = file.to_path_buf();
        move |reason| Self::Io { file, action, reason }
    }
}
