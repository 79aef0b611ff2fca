//! A trained policy for Python: observations in, mean actions out.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use jostle_arena::{LoadedPolicy, RobotPolicy as _, TrainedRobot};
use jostle_policy::encoder::EncoderScratch;
use jostle_policy::{Backend, Encoder};
use jostle_runs::policies;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::PyType;

use super::arguments::{absolute, act_on_rows, rows, value_error};

/// A policy from a checkpoint, with one behaviour token.
#[pyclass(name = "Policy", module = "jostle._jostle", frozen)]
pub(super) struct PyPolicy {
    pub(super) loaded: LoadedPolicy,
    pub(super) token: u32,
    path: PathBuf,
    robot: Mutex<TrainedRobot>,
}

#[pymethods]
impl PyPolicy {
    #[new]
    fn new(path: PathBuf, token: u32) -> PyResult<Self> {
        let path = policies::checkpoint(&path).map_err(value_error)?;
        let loaded = policies::load(&path).map_err(value_error)?;
        let robot = TrainedRobot::new(&loaded, token, Backend::default()).map_err(value_error)?;
        Ok(Self { loaded, token, path: absolute(&path)?, robot: Mutex::new(robot) })
    }

    /// For `pickle`: where it was read from, and which bytes they were.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyType>, (PathBuf, u32), String) {
        let this = slf.get();
        (slf.get_type(), (this.path.clone(), this.token), this.sha256().to_owned())
    }

    /// Refuses a file that is no longer the one that was pickled.
    fn __setstate__(&self, sha256: &str) -> PyResult<()> {
        if self.sha256() == sha256 {
            return Ok(());
        }
        let (path, found) = (self.path.display(), self.sha256());
        Err(value_error(format!("{path}: found SHA-256 {found}, expected {sha256}, as when it was pickled")))
    }

    /// For `copy.deepcopy`: a policy never changes.
    fn __deepcopy__(slf: Bound<'_, Self>, _memo: Bound<'_, PyAny>) -> Py<Self> {
        slf.unbind()
    }

    /// Its name in a report.
    #[getter]
    fn name(&self) -> &str {
        &self.loaded.identity.name
    }

    /// SHA-256 of its file.
    #[getter]
    fn sha256(&self) -> &str {
        &self.loaded.identity.sha256
    }

    /// Behaviour token.
    #[getter]
    fn token(&self) -> u32 {
        self.token
    }

    /// Number of behaviours, M.
    #[getter]
    fn n_behaviours(&self) -> usize {
        self.loaded.file.network.n_behaviours
    }

    /// Length of an observation row.
    #[getter]
    fn observation_len(&self) -> usize {
        self.loaded.file.network.observation_len()
    }

    /// Angle of every beam of the laser that it was trained with, from straight ahead,
    /// counter-clockwise (rad); `None` where its file does not say.
    #[getter]
    fn beam_angles(&self) -> PyResult<Option<Vec<f64>>> {
        if !self.loaded.file.metadata.contains_key("sim") {
            return Ok(None);
        }
        let sim = self.loaded.sim_config().map_err(value_error)?;
        Ok(Some(sim.laser.beam_angles().collect()))
    }

    /// Length of an input row: what the network reads of an observation row.
    #[getter]
    fn input_len(&self) -> usize {
        self.loaded.file.network.input_len()
    }

    /// Writes what the network reads of every row.
    fn encode(&self, py: Python<'_>, observations: PyBuffer<f32>, inputs: PyBuffer<f32>) -> PyResult<()> {
        let (width, n_inputs) = (self.observation_len(), self.input_len());
        let rows = rows(py, width, &observations, &inputs, n_inputs)?;
        let network = &self.loaded.file.network;
        let mut encoded = Vec::with_capacity(inputs.item_count());
        py.detach(|| Encoder::new(network).append(&rows, &mut EncoderScratch::default(), &mut encoded));
        inputs.copy_from_slice(py, &encoded)
    }

    /// Writes the mean action of every row.
    fn act(&self, py: Python<'_>, observations: PyBuffer<f32>, actions: PyBuffer<f32>) -> PyResult<()> {
        act_on_rows(py, self.observation_len(), &observations, &actions, |rows, answers| {
            self.robot.lock().unwrap_or_else(PoisonError::into_inner).act(rows, answers);
        })
    }
}
