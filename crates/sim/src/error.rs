//! The one error type of the crate: every message names the field or file, what was found and what
//! was expected.
//!
//! A refusal that a program may want to act on has a variant with its numbers; the others, which
//! are for a reader, are [`SimError::Field`] and [`SimError::File`].

use std::path::{Path, PathBuf};

/// Characters of a file that an error repeats at most.
const FOUND_MAX: usize = 200;

/// Why a simulator could not be built, restored or given a map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A number of the configuration lies outside its range.
    #[error("{field}: found {found}, expected {}", range(*low, *high, *above_low))]
    OutOfRange {
        /// Dotted path of the field, as in the TOML file below `[sim]`.
        field: String,
        /// The number.
        found: f32,
        /// Lower end of the range.
        low: f32,
        /// Upper end of the range, itself accepted.
        high: f32,
        /// True if `low` itself is not accepted.
        above_low: bool,
    },
    /// A room is too small for so many bodies: with their clearances they could leave no place for
    /// another start.
    #[error("n_agents: found {n_bodies}, expected {}", few_bodies(*free_area))]
    RoomTooSmall {
        /// Number of bodies asked for.
        n_bodies: usize,
        /// Area in which a start can be, m².
        free_area: f32,
    },
    /// No two places of a room that can be reached from one another are a goal distance apart.
    #[error("spawn.goal_distance: found {found}, expected {}", near_goals(*largest))]
    GoalTooFar {
        /// The goal distance, m.
        found: f32,
        /// The largest distance that would be accepted, m.
        largest: f32,
    },
    /// A snapshot is of rooms of another seed, number or size.
    #[error("state.{field}: found {found}, expected {expected}")]
    OtherRooms {
        /// The field of the snapshot.
        field: &'static str,
        /// Its value.
        found: u64,
        /// The value of the rooms that it was to be restored into.
        expected: u64,
    },
    /// Another value of the configuration or of a snapshot cannot work.
    #[error("{field}: found {found}, expected {expected}")]
    Field {
        /// Dotted path of the field, as in the TOML file below `[sim]`.
        field: String,
        /// The value.
        found: String,
        /// The accepted values.
        expected: String,
    },
    /// A file cannot be read.
    #[error("{}: file: found {reason}, expected a readable file", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The kind of the system's error.
        kind: std::io::ErrorKind,
        /// The system's words.
        reason: String,
    },
    /// A file (map, grid image) is malformed.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The field, line or part of the file.
        field: String,
        /// Its content, shortened.
        found: String,
        /// The accepted content.
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
    /// The field, the value found and the values expected, as the message has them, if the error is
    /// about a value and not about a file: for whoever puts the field's section or file in front of
    /// it.
    pub fn setting(&self) -> Option<(String, String, String)> {
        match self {
            Self::OutOfRange { field, found, low, high, above_low } => {
                Some((field.clone(), found.to_string(), range(*low, *high, *above_low)))
            }
            Self::RoomTooSmall { n_bodies, free_area } => {
                Some(("n_agents".to_owned(), n_bodies.to_string(), few_bodies(*free_area)))
            }
            Self::GoalTooFar { found, largest } => {
                Some(("spawn.goal_distance".to_owned(), found.to_string(), near_goals(*largest)))
            }
            Self::OtherRooms { field, found, expected } => {
                Some((format!("state.{field}"), found.to_string(), expected.to_string()))
            }
            Self::Field { field, found, expected } => Some((field.clone(), found.clone(), expected.clone())),
            Self::Unreadable { .. } | Self::File { .. } | Self::Feature { .. } => None,
        }
    }

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

fn range(low: f32, high: f32, above_low: bool) -> String {
    format!("a number in {}{low}, {high}]", if above_low { '(' } else { '[' })
}

fn few_bodies(free_area: f32) -> String {
    format!("so few that their spawn clearances cover less than 80 % of {free_area:.1} m² of free area")
}

fn near_goals(largest: f32) -> String {
    format!(
        "at most {largest:.2} m, the largest distance between two places that can be reached from one another"
    )
}

#[cfg(not(all(feature = "png", feature = "toml", feature = "yaml")))]
impl SimError {
    /// A [`SimError::Feature`].
    pub(crate) fn feature(path: &Path, feature: &'static str) -> Self {
        Self::Feature { path: path.to_path_buf(), feature }
    }
}

/// Text of a file as a part of a message: without control characters, at most [`FOUND_MAX`]
/// characters.
pub(crate) fn one_line(text: &str) -> String {
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    let mut line: String = text.chars().take(FOUND_MAX).map(clean).collect();
    if text.chars().nth(FOUND_MAX).is_some() {
        line.push('…');
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [`SimError::setting`] and the message are two ways to the same words.
    #[test]
    fn settings_are_told_in_the_words_of_the_message() {
        let field = || "a".to_owned();
        let about_values = [
            SimError::OutOfRange { field: field(), found: 0.1, low: 0.5, high: 2.0, above_low: false },
            SimError::OutOfRange { field: field(), found: f32::NAN, low: 0.0, high: 2.0, above_low: true },
            SimError::RoomTooSmall { n_bodies: 7, free_area: 12.34 },
            SimError::GoalTooFar { found: 10.0, largest: 8.126 },
            SimError::OtherRooms { field: "seed", found: 1, expected: 2 },
            SimError::field("a", 1, "2"),
        ];
        for error in &about_values {
            let (field, found, expected) = error.setting().expect("about a value");
            assert_eq!(error.to_string(), format!("{field}: found {found}, expected {expected}"));
        }
        assert_eq!(about_values[0].to_string(), "a: found 0.1, expected a number in [0.5, 2]");
        assert_eq!(about_values[1].to_string(), "a: found NaN, expected a number in (0, 2]");
        let path = Path::new("m.toml");
        assert_eq!(SimError::file(path, "walls", "nothing", "walls").setting(), None);
    }
}
