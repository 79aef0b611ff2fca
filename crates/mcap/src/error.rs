//! The one error type of this crate.

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum McapError {
    /// A moment does not fit the recording's scanner, or a number is none.
    #[error("episode {episode}, moment {moment}: {field}: found {found}, expected {expected}")]
    Moment {
        /// The episode's place in the list, from 0.
        episode: usize,
        /// The moment's place in the episode, from 0.
        moment: usize,
        /// Which of its fields.
        field: &'static str,
        /// What it holds.
        found: String,
        /// What would be accepted.
        expected: String,
    },
    /// A setting of the recording is out of range.
    #[error("{field}: found {found}, expected {expected}")]
    Setting {
        /// Its name.
        field: &'static str,
        /// The value given.
        found: String,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The file cannot be written. The message holds the reason, which is therefore not handed on
    /// as a source.
    #[error("cannot write MCAP: {reason}")]
    Write {
        /// The reason.
        reason: String,
    },
}
