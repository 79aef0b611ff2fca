//! Wall times of cells. They go to a file of their own, never into a report that must be the same
//! twice.

use serde::{Deserialize, Serialize};

use super::grid::csv_line;

/// Duration of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellTiming {
    /// The cell's hash.
    pub cell: String,
    /// Crowd and policy, for people.
    pub label: String,
    /// Episodes run now (not those reused).
    pub episodes: u64,
    /// Wall time (s), as measured by the caller.
    pub seconds: f64,
}

/// The timings as CSV with a header.
pub fn timings_csv(timings: &[CellTiming]) -> String {
    let mut text = csv_line(["cell", "label", "episodes", "seconds"]);
    for timing in timings {
        let seconds = format!("{:.3}", timing.seconds);
        text += &csv_line([&timing.cell, &timing.label, &timing.episodes.to_string(), &seconds]);
    }
    text
}
