//! The one error type of this crate: what was found, what was expected, and where.

use std::path::PathBuf;

/// Everything that this crate refuses.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// A field of a [`NetworkConfig`](crate::NetworkConfig) is out of bounds.
    #[error("network configuration: {field}: found {found}, expected {expected}")]
    Config {
        /// The field's name.
        field: &'static str,
        /// The value that was given.
        found: String,
        /// The values that are accepted.
        expected: String,
    },
    /// Parameters do not fit the layout that they were given for.
    #[error("parameters: {tensor}: found {found}, expected {expected}")]
    Parameters {
        /// The tensor (or "all" for the flat vector).
        tensor: String,
        /// The value that was given.
        found: String,
        /// The value that the layout asks for.
        expected: String,
    },
    /// A batch does not fit the network.
    #[error("batch: {field}: found {found}, expected {expected}")]
    Batch {
        /// The field of the batch.
        field: &'static str,
        /// The value that was given.
        found: String,
        /// The values that the network takes.
        expected: String,
    },
    /// A file's content is not what it should be.
    #[error("{}: {field}: found {found}, expected {expected}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// The tensor, the metadata key or the part of the format.
        field: String,
        /// The content of the file.
        found: String,
        /// The content that is accepted.
        expected: String,
    },
    /// A file cannot be read or written at all. The message holds the reason, which is therefore
    /// not handed on as a source.
    #[error("{}: cannot {action}: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The action that failed.
        action: &'static str,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// The device of the reference back end refused an operation. The message holds candle's own,
    /// which is therefore not handed on as a source.
    #[error("candle: {0}")]
    Candle(candle_core::Error),
}

impl From<candle_core::Error> for PolicyError {
    /// Without the stack that candle adds where `RUST_BACKTRACE` is set: a message is one line.
    fn from(error: candle_core::Error) -> Self {
        match error {
            candle_core::Error::WithBacktrace { inner, .. } => (*inner).into(),
            error => Self::Candle(error),
        }
    }
}
