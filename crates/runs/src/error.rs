//! The one error type of this crate: the path, what was found there, what was expected.

use std::path::{Path, PathBuf};

use jostle_arena::ArenaError;

/// Why a path leads to no policy.
#[derive(Debug, thiserror::Error)]
pub enum RunsError {
    /// A file or folder cannot be read. The message holds the system's reason, which is therefore
    /// not handed on as a source.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The action attempted.
        action: &'static str,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// Nothing is there.
    #[error("{}: found no such file or folder, expected {expected}{hint}", path.display())]
    Missing {
        /// The path.
        path: PathBuf,
        /// The values that would be accepted.
        expected: &'static str,
        /// The nearest names, as the end of a message.
        hint: String,
    },
    /// A folder that is no run's.
    #[error("{} is no run folder; name a checkpoint file or a folder that `train` made", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A run that has not finished a checkpoint yet.
    #[error("{} holds no finished checkpoint (no file `latest`)", path.display())]
    NoCheckpoint {
        /// The run folder.
        path: PathBuf,
    },
    /// A folder without anything that could be a policy.
    #[error("{} holds no run folder and no checkpoint", path.display())]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A checkpoint outside a run folder, which has no half-trained sibling.
    #[error("crowd SO needs half-trained policies, and {} is no run's checkpoint; name them with {option}", path.display())]
    NoRunToHalve {
        /// The checkpoint.
        path: PathBuf,
        /// The option that names half-trained policies.
        option: &'static str,
    },
    /// A run that did not keep its checkpoint at half the training.
    #[error("crowd SO needs {}, which is not there; name another with {option}", path.display())]
    NoHalf {
        /// The missing checkpoint.
        path: PathBuf,
        /// The option that names half-trained policies.
        option: &'static str,
    },
    /// A policy was refused.
    #[error(transparent)]
    Eval(#[from] ArenaError),
}

impl RunsError {
    /// For `map_err` on file operations.
    pub(crate) fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |reason| Self::Io { path, action, reason }
    }
}
