//! What the table keeps of tests: how many episodes among each crowd, and how many reached the
//! goal.

use jostle_eval::report::{CellResult, Evaluation};

/// Episodes that were driven among a crowd, and those that reached the goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) episodes: u64,
    pub(super) success: u64,
}

/// A policy's tests, by the names of the crowds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tests(pub(super) Vec<(String, Tally)>);

impl Tests {
    pub(super) fn from_evaluation(tested: &Evaluation) -> Self {
        let tally =
            |cell: &CellResult| Tally { episodes: cell.summary.episodes, success: cell.summary.success };
        Self(tested.cells.iter().map(|cell| (cell.crowd.to_string(), tally(cell))).collect())
    }

    /// Among a crowd; `None` where there is no such test.
    pub(super) fn among(&self, crowd: &str) -> Option<Tally> {
        self.0.iter().find(|(name, _)| name == crowd).map(|(_, tally)| *tally)
    }

    /// Share of successes among a crowd; `None` without an episode.
    pub(super) fn rate(&self, crowd: &str) -> Option<f64> {
        let Tally { episodes, success } = self.among(crowd)?;
        (episodes > 0).then(|| success as f64 / episodes as f64)
    }
}
