//! The one error type of the crate: every message names the field or file, what was found and what was expected.

use std::path::{Path, PathBuf};

/// Characters of a file that an error repeats at most.
const FOUND_MAX: usize = 200;

/// Why a simulator could not be built, restored or given a map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A configuration or state field holds a value that cannot work.
    #[error("{field}: found {found}, expected {expected}")]
    Field {
        /// Dotted path of the field, as in the TOML file below `[sim]`.
        field: String,
        /// The value as it stands.
        found: String,
        /// What would have been accepted.
        expected: String,
    },
    /// A file (map, grid image) is unreadable or malformed.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The field, line or part of the file.
        field: String,
        /// What stands there.
        found: String,
        /// What would have been accepted.
        expected: String,
    },
    /// A map file is of a kind that this build does not read: a cargo feature is off.
    #[error(
        "{}: format: found one that this build does not read, expected a build of jostle-sim with the feature `{feature}`",
        path.display()
    )]
    Feature {
        /// The file.
        path: PathBuf,
        /// The feature that is needed.
        feature: &'static str,
    },
}

impl SimError {
    /// A [`SimError::Field`].
    pub(crate) fn field(
        field: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        Self::Field { field: field.into(), found: found.to_string(), expected: expected.into() }
    }

    /// A [`SimError::File`]; what a file holds is shortened and put on one line.
    pub(crate) fn file(
        path: &Path,
        field: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        let (field, expected) = (one_line(&field.into()), expected.into());
        Self::File { path: path.to_path_buf(), field, found: one_line(&found.to_string()), expected }
    }
}

#[cfg(not(all(feature = "png", feature = "toml", feature = "yaml")))]
impl SimError {
    /// A [`SimError::Feature`].
    pub(crate) fn feature(path: &Path, feature: &'static str) -> Self {
        Self::Feature { path: path.to_path_buf(), feature }
    }
}

/// Text of a file as a part of a message: without control characters, at most [`FOUND_MAX`] characters.
pub(crate) fn one_line(text: &str) -> String {
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    let mut line: String = text.chars().take(FOUND_MAX).map(clean).collect();
    if text.chars().nth(FOUND_MAX).is_some() {
        line.push('…');
    }
    line
}
