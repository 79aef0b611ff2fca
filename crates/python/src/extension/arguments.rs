//! Arguments and errors that the classes share.

use std::path::PathBuf;

use glam::Vec2;
use jostle_arena::LoadedPolicy;
use jostle_arena::metrics::EpisodeMetrics;
use jostle_sim::{Pose, SimConfig};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::crowd_rooms::EpisodeEnd;
use crate::finite;
use crate::picture::Picture;
use crate::settings::{self, RecordingFile, Settings};
use crate::threads;

/// A mistake of the caller's: one line.
pub(super) fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Refuses work for threads that a fork has lost.
pub(super) fn check_threads(needs_threads: bool) -> PyResult<()> {
    threads::check(needs_threads).map_err(PyRuntimeError::new_err)
}

/// The keywords of the Python side, resolved.
#[derive(Clone, FromPyObject, IntoPyObject)]
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
    #[pyo3(item)]
    pool_half: Vec<PathBuf>,
    #[pyo3(item)]
    recording: Option<PathBuf>,
    #[pyo3(item)]
    recording_interval: Option<f64>,
    #[pyo3(item)]
    recording_gap: Option<f64>,
}

impl Keywords {
    /// The training configuration that they name.
    pub(super) fn base(&self) -> PyResult<jostle_ppo::Config> {
        base(self.config.clone(), &self.overrides)
    }

    /// The training configuration for a policy: the file that they name, or else the rooms of its
    /// training, with their overrides.
    pub(super) fn base_for(&self, policy: &LoadedPolicy) -> PyResult<jostle_ppo::Config> {
        let sim = policy.sim_config().map_err(value_error)?;
        let n_agents = usize::try_from(policy.file.provenance.n_agents).map_err(value_error)?;
        self.base_from(sim, n_agents)
    }

    /// The training configuration for a planner: the file that they name, or else the rooms that it
    /// was made for, with their overrides.
    pub(super) fn base_of(&self, made_for: &jostle_ppo::Config) -> PyResult<jostle_ppo::Config> {
        self.base_from(made_for.sim.clone(), made_for.n_agents)
    }

    fn base_from(&self, sim: SimConfig, n_agents: usize) -> PyResult<jostle_ppo::Config> {
        if self.config.is_some() {
            return self.base();
        }
        settings::trained(sim, n_agents, &self.overrides).map_err(|error| of_settings(&error))
    }

    /// Settings of rooms that are made from `base`.
    pub(super) fn settings(&self, base: &jostle_ppo::Config) -> PyResult<Settings> {
        let crowd = self.crowd.parse().map_err(value_error)?;
        let pools = jostle_runs::policies::pools(&self.pool, &self.pool_half, &[crowd], "pool_half");
        let pools = pools.map_err(value_error)?;
        let Some(path) = self.recording.clone() else {
            return Settings::new(base, crowd, self.n_pedestrians, self.robot_visible, pools)
                .map_err(value_error);
        };
        let file = RecordingFile { path, interval: self.recording_interval, max_gap: self.recording_gap };
        let settings = Settings::new(base, crowd, None, self.robot_visible, pools);
        let settings = settings.and_then(|settings| settings.with_recording(&file, self.n_pedestrians));
        settings.map_err(value_error)
    }

    /// The same keywords from any working directory.
    pub(super) fn absolute(&self) -> PyResult<Self> {
        let all = |paths: &[PathBuf]| paths.iter().map(absolute).collect::<PyResult<Vec<_>>>();
        Ok(Self {
            config: self.config.as_ref().map(absolute).transpose()?,
            pool: all(&self.pool)?,
            pool_half: all(&self.pool_half)?,
            recording: self.recording.as_ref().map(absolute).transpose()?,
            ..self.clone()
        })
    }
}

/// Reads a training configuration and applies overrides; errors speak of `settings`, not of the
/// command line's `--set`.
pub(super) fn base(config: Option<PathBuf>, overrides: &[String]) -> PyResult<jostle_ppo::Config> {
    settings::base(config.as_deref(), overrides).map_err(|error| of_settings(&error))
}

fn of_settings(error: &jostle_ppo::PpoError) -> PyErr {
    let line = error.to_string();
    value_error(line.strip_prefix("--set ").map_or(line.clone(), |rest| format!("settings: {rest}")))
}

/// The keys of a configuration's map that are not read, one line each.
pub(super) fn notes(config: &jostle_ppo::Config) -> PyResult<Vec<String>> {
    settings::notes(config).map_err(value_error)
}

/// Actions [B, 2] as pairs.
pub(super) fn pairs(py: Python<'_>, actions: &PyBuffer<f32>) -> PyResult<Vec<[f32; 2]>> {
    if actions.dimensions() != 2 || actions.shape()[1] != 2 {
        let found = actions.shape();
        return Err(value_error(format!("actions: found shape {found:?}, expected rows of 2")));
    }
    Ok(actions.to_vec(py)?.as_chunks().0.to_vec())
}

/// Writes the answer of `act` to rows [B, `width`] of Python's into actions [B, 2]; `act` runs
/// without Python's lock.
pub(super) fn act_on_rows(
    py: Python<'_>,
    width: usize,
    observations: &PyBuffer<f32>,
    actions: &PyBuffer<f32>,
    act: impl FnOnce(&[f32], &mut [[f32; 2]]) + Send,
) -> PyResult<()> {
    let rows = rows(py, width, observations, actions, 2)?;
    let mut answers = vec![[0.0; 2]; observations.shape()[0]];
    check_threads(answers.len() > 1)?;
    py.detach(|| act(&rows, &mut answers));
    actions.copy_from_slice(py, answers.as_flattened())
}

/// Observations, if they are finite rows [B, `width`] and there is a row of `n_answers` for each.
pub(super) fn rows(
    py: Python<'_>,
    width: usize,
    observations: &PyBuffer<f32>,
    answers: &PyBuffer<f32>,
    n_answers: usize,
) -> PyResult<Vec<f32>> {
    let found = observations.shape();
    if found.len() != 2 || found[1] != width || answers.shape() != [found[0], n_answers] {
        return Err(value_error(format!("observations: found shape {found:?}, expected rows of {width}")));
    }
    let rows = observations.to_vec(py)?;
    finite::check_rows(&rows, width).map_err(value_error)?;
    Ok(rows)
}

/// Writes row i of an array [B, len of the row] of Python's, in place: the row of an array is a
/// view of it.
pub(super) fn write_row(array: &Bound<'_, PyAny>, i: usize, row: &[f32]) -> PyResult<()> {
    PyBuffer::get(&array.get_item(i)?)?.copy_from_slice(array.py(), row)
}

/// A path that means the same from any working directory.
pub(super) fn absolute(path: &PathBuf) -> PyResult<PathBuf> {
    std::path::absolute(path).map_err(|error| value_error(format!("{}: {error}", path.display())))
}

/// x, y, heading, goal x, goal y.
pub(super) fn place(pose: Pose, goal: Vec2) -> [f32; 5] {
    [pose.position.x, pose.position.y, pose.heading, goal.x, goal.y]
}

/// Height, width, and the bytes of the pixels.
pub(super) type Pixels<'py> = (usize, usize, Bound<'py, PyBytes>);

/// A picture for Python.
pub(super) fn pixels(py: Python<'_>, picture: Picture) -> Pixels<'_> {
    (picture.height, picture.width, PyBytes::new(py, &picture.rgb))
}

/// A snapshot as bytes.
pub(super) fn to_bytes<'py>(py: Python<'py>, snapshot: &impl serde::Serialize) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &serde_json::to_vec(snapshot).expect("finite numbers and texts are always JSON"))
}

/// A snapshot from bytes.
pub(super) fn from_bytes<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> PyResult<T> {
    serde_json::from_slice(bytes).map_err(|error| value_error(format!("snapshot: {error}")))
}

/// There is no row i.
pub(super) fn no_row(i: usize) -> PyErr {
    value_error(format!("found room {i}, expected one of those there are"))
}

/// Python's dictionary of an episode that ended.
pub(super) fn episode_info<'py>(py: Python<'py>, end: &EpisodeEnd) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    let EpisodeEnd { finished, min_clearance } = end;
    info.set_item("outcome", finished.outcome.to_string())?;
    info.set_item("is_success", finished.outcome == jostle_arena::Outcome::Success)?;
    info.set_item("episode_index", finished.episode)?;
    measures(&info, finished.steps, &finished.metrics, *min_clearance)?;
    Ok(info)
}

/// The measures of an episode; NaN where only a success has one.
pub(super) fn measures(
    info: &Bound<'_, PyDict>,
    steps: u64,
    metrics: &EpisodeMetrics,
    min_clearance: f32,
) -> PyResult<()> {
    let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
    info.set_item("steps", steps)?;
    info.set_item("time", metrics.time)?;
    info.set_item("path_length", metrics.path_length)?;
    info.set_item("straight_distance", metrics.straight_distance)?;
    info.set_item("extra_time", or_nan(metrics.extra_time))?;
    info.set_item("extra_distance", or_nan(metrics.extra_distance))?;
    info.set_item("average_speed", or_nan(metrics.average_speed))?;
    info.set_item("min_clearance", f64::from(min_clearance))
}
