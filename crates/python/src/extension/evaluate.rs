//! The test of a policy from Python: the protocol of `cargo xtask evaluate`, with a Python function
//! as the robot.

use std::sync::{Arc, Mutex, PoisonError};

use jostle_arena::robot::Rows;
use jostle_arena::room::RoomPlan;
use jostle_arena::{PolicyIdentity, Robot, RobotPolicy, TrainedRobot};
use jostle_eval::{EvalError, Protocol, Subject};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;

use super::arguments::{self, Keywords, check_threads, value_error, write_row};
use super::planner::PyPlanner;
use super::policy::PyPolicy;
use crate::settings::Settings;

/// The findings of a test: its result and its records as JSON, as the command line writes them, and
/// the number of agents.
type Found = (String, String, usize);

/// Tests a function. `act(observations, n)` answers n actions for the first n rows of an array
/// that `zeros` made for (rows, `observation_len`), which is the same in every call.
#[pyfunction]
pub(super) fn evaluate(
    py: Python<'_>,
    act: Py<PyAny>,
    zeros: Bound<'_, PyAny>,
    name: &str,
    keywords: Keywords,
    episodes: u64,
    seed: u64,
    lock_step: usize,
) -> PyResult<Found> {
    let mut settings = keywords.settings(&keywords.base()?)?;
    (settings.config.lock_step, settings.config.seed) = (lock_step, seed);
    settings.config.validate().map_err(value_error)?;
    let failure = Arc::default();
    let width = settings.config.sim.observation_len();
    let n_rows = usize::try_from(episodes).map_or(lock_step, |episodes| episodes.min(lock_step));
    let mut robot = PythonRobot::new(act, &zeros, n_rows, width, Arc::clone(&failure))?;
    let identity = PolicyIdentity::custom(name, "");
    let run = run(py, settings, &mut robot, &Subject { identity: &identity, token: 0 }, episodes);
    // An exception of Python's comes before the refusal that it led to.
    if let Some(error) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
        return Err(error);
    }
    run
}

/// The keys of the map of a test's rooms that are not read, one line each; `policy` is a trained
/// one, or `None`.
#[pyfunction]
pub(super) fn notes(keywords: Keywords, policy: Option<Bound<'_, PyPolicy>>) -> PyResult<Vec<String>> {
    let base = match &policy {
        Some(policy) => keywords.base_for(&policy.get().loaded)?,
        None => keywords.base()?,
    };
    arguments::notes(&base)
}

/// Tests a trained policy, without a way through Python. Simulator and number of agents are
/// those of its training unless the keywords say otherwise.
#[pyfunction]
pub(super) fn evaluate_policy(
    py: Python<'_>,
    policy: &PyPolicy,
    keywords: Keywords,
    episodes: u64,
    seed: u64,
    lock_step: usize,
) -> PyResult<Found> {
    let mut settings = keywords.settings(&keywords.base_for(&policy.loaded)?)?;
    (settings.config.lock_step, settings.config.seed) = (lock_step, seed);
    jostle_arena::crowds::check_observation(&settings.config, &policy.loaded).map_err(value_error)?;
    let mut robot =
        TrainedRobot::new(&policy.loaded, policy.token, settings.config.backend).map_err(value_error)?;
    let subject = Subject { identity: &policy.loaded.identity, token: policy.token };
    run(py, settings, &mut robot, &subject, episodes)
}

/// Tests a planner, without a way through Python. Simulator and number of agents are those that it
/// was made for unless the keywords say otherwise.
#[pyfunction]
pub(super) fn evaluate_planner(
    py: Python<'_>,
    planner: &PyPlanner,
    keywords: Keywords,
    episodes: u64,
    seed: u64,
    lock_step: usize,
) -> PyResult<Found> {
    let mut settings = keywords.settings(&keywords.base_of(&planner.base)?)?;
    (settings.config.lock_step, settings.config.seed) = (lock_step, seed);
    let plan = RoomPlan::new(&settings.config, settings.crowd).map_err(value_error)?;
    let mut robot = planner.planner.robot(&plan).map_err(value_error)?;
    let identity = planner.planner.identity();
    run(py, settings, &mut *robot, &Subject { identity: &identity, token: 0 }, episodes)
}

fn run(
    py: Python<'_>,
    settings: Settings,
    robot: &mut dyn Robot,
    subject: &Subject<'_>,
    episodes: u64,
) -> PyResult<Found> {
    check_threads(true)?;
    let Settings { config, crowd, pools } = settings;
    let n_agents = config.n_agents;
    py.detach(|| {
        let run = Protocol::new(config, pools)?.evaluate(robot, *subject, crowd, episodes, None, |_| ())?;
        let text = |json: serde_json::Result<String>| json.expect("results and records are always JSON");
        let (result, records) = (serde_json::to_string(&run.result), serde_json::to_string(&run.records));
        Ok((text(result), text(records), n_agents))
    })
    .map_err(|error: EvalError| value_error(error))
}

/// A robot that a Python function drives. The rooms write what they see straight into Python's
/// array.
pub(super) struct PythonRobot {
    act: Py<PyAny>,
    observations: Py<PyAny>,
    width: usize,
    failure: Arc<Mutex<Option<PyErr>>>,
}

impl PythonRobot {
    /// A robot that `act` drives, with an array of `zeros` for as many rows. What Python raises is
    /// left in `failure`.
    pub(super) fn new(
        act: Py<PyAny>,
        zeros: &Bound<'_, PyAny>,
        n_rows: usize,
        width: usize,
        failure: Arc<Mutex<Option<PyErr>>>,
    ) -> PyResult<Self> {
        let observations = zeros.call1(((n_rows, width),))?.unbind();
        Ok(Self { act, observations, width, failure })
    }

    /// The same robot, with the same array: both must not be asked at once.
    pub(super) fn clone_ref(&self, py: Python<'_>) -> Self {
        let (act, observations) = (self.act.clone_ref(py), self.observations.clone_ref(py));
        Self { act, observations, width: self.width, failure: Arc::clone(&self.failure) }
    }

    fn ask(&self, rows: Rows<'_, '_>, actions: &mut [[f32; 2]]) -> PyResult<()> {
        Python::attach(|py| {
            let observations = self.observations.bind(py);
            for (i, row) in rows.enumerate() {
                write_row(observations, i, row)?;
            }
            let answer = self.act.bind(py).call1((observations, actions.len()))?;
            let answer: PyBuffer<f32> = answer.extract()?;
            if answer.shape() != [actions.len(), 2] {
                let (found, expected) = (answer.shape(), [actions.len(), 2]);
                return Err(value_error(format!("actions: found shape {found:?}, expected {expected:?}")));
            }
            answer.copy_to_slice(py, actions.as_flattened_mut())
        })
    }
}

impl RobotPolicy for PythonRobot {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        self.act_rows(&mut observations.chunks_exact(self.width), &mut Vec::new(), actions);
    }

    fn act_rows(&mut self, rows: Rows<'_, '_>, _memory: &mut Vec<f32>, actions: &mut [[f32; 2]]) {
        if let Err(error) = self.ask(rows, actions) {
            *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            // The rooms refuse it at once, so that the test ends here.
            actions.fill([f32::NAN; 2]);
        }
    }
}
