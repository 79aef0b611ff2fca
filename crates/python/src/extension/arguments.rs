//! Arguments and errors that the classes share.

use std::path::PathBuf;

use jostle_eval::room::FinishedEpisode;
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::settings::{self, Settings};
use crate::threads;

/// A mistake of the caller's: one line.
pub(super) fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Refuses work for threads that a fork has lost.
pub(super) fn check_threads(needs_threads: bool) -> PyResult<()> {
    threads::check(needs_threads).map_err(PyRuntimeError::new_err)
}

/// What the keywords of the Python side come down to.
#[derive(FromPyObject)]
pub(super) struct Keywords {
    #[pyo3(item)]
    config: Option<PathBuf>,
    #[pyo3(item)]
    overrides: Vec<String>,
    #[pyo3(item)]
    crowd: String,
    #[pyo3(item)]
    n_pedestrians: Option<usize>,
    #[pyo3(item)]
    robot_visible: Option<bool>,
    #[pyo3(item)]
    pool: Vec<PathBuf>,
}

impl Keywords {
    /// The training configuration that they name.
    pub(super) fn base(&self) -> PyResult<jostle_ppo::Config> {
        base(self.config.clone(), &self.overrides)
    }

    /// Whether they change what a policy brings along.
    pub(super) fn has_base(&self) -> bool {
        self.config.is_some() || !self.overrides.is_empty()
    }

    /// Settings of rooms that are made from `base`.
    pub(super) fn settings(&self, base: &jostle_ppo::Config) -> PyResult<Settings> {
        let crowd = self.crowd.parse().map_err(value_error)?;
        Settings::new(base, crowd, self.n_pedestrians, self.robot_visible, &self.pool).map_err(value_error)
    }
}

/// Reads a training configuration and applies overrides; errors speak of `settings`, not of the command line's `--set`.
pub(super) fn base(config: Option<PathBuf>, overrides: &[String]) -> PyResult<jostle_ppo::Config> {
    settings::base(config.as_deref(), overrides).map_err(|error| {
        let line = error.to_string();
        value_error(line.strip_prefix("--set ").map_or(line.clone(), |rest| format!("settings: {rest}")))
    })
}

/// Actions [B, 2] as pairs.
pub(super) fn pairs(py: Python<'_>, actions: &PyBuffer<f32>) -> PyResult<Vec<[f32; 2]>> {
    if actions.dimensions() != 2 || actions.shape()[1] != 2 {
        let found = actions.shape();
        return Err(value_error(format!("actions: found shape {found:?}, expected rows of 2")));
    }
    Ok(actions.to_vec(py)?.as_chunks().0.to_vec())
}

/// Writes row i of an array [B, len of the row] of Python's, in place: the row of an array is a view of it.
pub(super) fn write_row(array: &Bound<'_, PyAny>, i: usize, row: &[f32]) -> PyResult<()> {
    PyBuffer::get(&array.get_item(i)?)?.copy_from_slice(array.py(), row)
}

/// There is no row i.
pub(super) fn no_row(i: usize) -> PyErr {
    value_error(format!("found room {i}, expected one of those there are"))
}

/// What Python is told of an episode that ended.
pub(super) fn episode_info<'py>(py: Python<'py>, end: &FinishedEpisode) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    info.set_item("outcome", end.outcome.to_string())?;
    info.set_item("is_success", end.outcome == jostle_eval::EpisodeOutcome::Success)?;
    info.set_item("episode_index", end.episode)?;
    info.set_item("steps", end.steps)?;
    info.set_item("path_length", end.metrics.path_length)?;
    info.set_item("straight_distance", end.metrics.straight_distance)?;
    Ok(info)
}
