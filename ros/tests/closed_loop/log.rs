//! Logs of peers: one JSON object a line.

use std::path::Path;

use serde::Deserialize;

/// A line.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Entry {
    pub(crate) event: String,
    /// Seconds since 1970; nanoseconds in the file.
    #[serde(deserialize_with = "seconds")]
    pub(crate) t: f64,
    /// Nanoseconds, as they are: to tell which scan a command answers.
    #[serde(default)]
    pub(crate) stamp: i64,
    /// Nanoseconds.
    #[serde(rename = "t_ns", default)]
    pub(crate) sent: i64,
    #[serde(default)]
    pub(crate) v: f64,
    #[serde(default)]
    pub(crate) w: f64,
    #[serde(default)]
    pub(crate) x: f64,
    #[serde(default)]
    pub(crate) y: f64,
    #[serde(default)]
    pub(crate) heading: f64,
    pub(crate) clearance: Option<f64>,
    #[serde(default)]
    pub(crate) discs: Vec<[f64; 3]>,
}

fn seconds<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(i64::deserialize(deserializer)? as f64 * 1e-9)
}

/// All lines so far; a last line that is still being written is left out.
pub(crate) fn read(path: &Path) -> Vec<Entry> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.split_inclusive('\n')
        .filter(|line| line.ends_with('\n'))
        .map(|line| {
            serde_json::from_str(line).unwrap_or_else(|error| panic!("{}: {error}: {line}", path.display()))
        })
        .collect()
}

pub(crate) fn commands(entries: &[Entry]) -> impl Iterator<Item = &Entry> {
    entries.iter().filter(|entry| entry.event == "command")
}

pub(crate) fn first_zero_after(entries: &[Entry], time: f64) -> Option<f64> {
    commands(entries).find(|c| c.t > time && c.v == 0.0 && c.w == 0.0).map(|command| command.t)
}
