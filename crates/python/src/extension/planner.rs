//! A planner for Python: observations in, actions out, as a policy; and the robot of a test.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use jostle_arena::{Planner, RobotPolicy};
use jostle_ppo::Config;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};

use super::arguments::{act_on_rows, base, from_bytes, to_bytes, value_error};

/// A planner of a robot.
#[pyclass(name = "Planner", module = "jostle._jostle", frozen)]
pub(super) struct PyPlanner {
    pub(super) planner: Planner,
    /// The training configuration of which simulator and number of agents are taken.
    pub(super) base: Config,
    /// `None` where it knows positions.
    policy: Option<Mutex<Box<dyn RobotPolicy>>>,
}

impl PyPlanner {
    fn of(planner: Planner, base: Config) -> PyResult<Self> {
        let rows = (!planner.knows_positions()).then(|| planner.policy(&base.sim));
        let policy = rows.transpose().map_err(value_error)?.map(Mutex::new);
        Ok(Self { planner, base, policy })
    }
}

#[pymethods]
impl PyPlanner {
    #[new]
    fn new(name: &str, config: Option<PathBuf>, overrides: Vec<String>) -> PyResult<Self> {
        let planner = name.parse().map_err(value_error)?;
        let base = base(config, &overrides)?;
        Self::of(planner, base)
    }

    /// The planner of a pickle.
    #[staticmethod]
    fn restored(name: &str, base: &[u8]) -> PyResult<Self> {
        Self::of(name.parse().map_err(value_error)?, from_bytes(base)?)
    }

    /// For `pickle`: its name and the configuration, which needs no file any more.
    #[expect(clippy::type_complexity, reason = "what pickle asks for")]
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (&'static str, Bound<'py, PyBytes>))> {
        let (class, this): (Bound<'_, PyType>, _) = (slf.get_type(), slf.get());
        Ok((class.getattr("restored")?, (this.planner.name(), to_bytes(slf.py(), &this.base))))
    }

    /// For `copy.deepcopy`: a planner never changes.
    fn __deepcopy__(slf: Bound<'_, Self>, _memo: Bound<'_, PyAny>) -> Py<Self> {
        slf.unbind()
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &'static str {
        self.planner.name()
    }

    /// Its method, in a line.
    #[getter]
    fn description(&self) -> &'static str {
        self.planner.description()
    }

    /// True if it reads everyone's true position and velocity instead of observation rows.
    #[getter]
    fn knows_positions(&self) -> bool {
        self.planner.knows_positions()
    }

    /// SHA-256 of its name, version and settings.
    #[getter]
    fn sha256(&self) -> String {
        self.planner.identity().sha256
    }

    /// Length of an observation row.
    #[getter]
    fn observation_len(&self) -> usize {
        self.base.sim.observation_len()
    }

    /// Angle of every beam that it expects, from straight ahead, counter-clockwise (rad).
    #[getter]
    fn beam_angles(&self) -> Vec<f64> {
        self.base.sim.laser.beam_angles().collect()
    }

    /// Writes the action of every row.
    fn act(&self, py: Python<'_>, observations: PyBuffer<f32>, actions: PyBuffer<f32>) -> PyResult<()> {
        let Some(policy) = &self.policy else {
            let name = self.planner.name();
            return Err(value_error(format!(
                "planner {name}: found observation rows, expected everyone's true position and velocity, which a row does \
                 not tell; jostle.evaluate tests it"
            )));
        };
        act_on_rows(py, self.observation_len(), &observations, &actions, |rows, answers| {
            policy.lock().unwrap_or_else(PoisonError::into_inner).act(rows, answers);
        })
    }
}
