//! [`RobotRoom`] for Python: the core of `parallel_env`.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use jostle_sim::{Outcome, StepEnd, Transition};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arguments::{base, check_threads, pairs, value_error, write_row};
use crate::robot_rooms::RobotRoom;

/// A room of robots whose episodes begin together.
#[pyclass(name = "RobotRoom", module = "jostle._jostle", frozen)]
pub(super) struct PyRobotRoom {
    config: jostle_ppo::Config,
    n_behaviours: u32,
    room: Mutex<RobotRoom>,
}

/// Index, reward, terminated, truncated, information.
type Step<'py> = (usize, f64, bool, bool, Bound<'py, PyDict>);

#[pymethods]
impl PyRobotRoom {
    #[new]
    fn new(
        config: Option<PathBuf>,
        overrides: Vec<String>,
        n_agents: Option<usize>,
        n_behaviours: u32,
    ) -> PyResult<Self> {
        let mut config = base(config, &overrides)?;
        config.n_agents = n_agents.unwrap_or(config.n_agents);
        check_threads(false)?;
        let room = RobotRoom::new(&config.sim, config.n_agents, n_behaviours, 0).map_err(value_error)?;
        Ok(Self { config, n_behaviours, room: Mutex::new(room) })
    }

    /// Length of an observation row.
    #[getter]
    fn observation_len(&self) -> usize {
        self.config.sim.observation_len()
    }

    /// Angle of every beam from straight ahead, counter-clockwise (rad).
    #[getter]
    fn beam_angles(&self) -> Vec<f64> {
        self.config.sim.laser.beam_angles().collect()
    }

    /// Robots in the room.
    #[getter]
    fn n_agents(&self) -> usize {
        self.config.n_agents
    }

    /// The robots' largest linear and angular velocity (m/s, rad/s).
    #[getter]
    fn limits(&self) -> [f32; 2] {
        [self.config.sim.robot.v_max, self.config.sim.robot.w_max]
    }

    /// Least and largest observation row.
    fn bounds(&self) -> PyResult<[Vec<f32>; 2]> {
        self.lock().bounds().map_err(value_error)
    }

    /// Places all robots by a seed, writes their first observations, and tells their behaviour tokens.
    fn begin(&self, seed: u64, observations: Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
        let room = RobotRoom::new(&self.config.sim, self.config.n_agents, self.n_behaviours, seed);
        let room = room.map_err(value_error)?;
        for agent in 0..self.config.n_agents {
            write_row(&observations, agent, room.observation(agent))?;
        }
        let tokens = room.tokens().to_vec();
        *self.lock() = room;
        Ok(tokens)
    }

    /// Steps the robots that are there and lists (index, reward, terminated, truncated, info) of each.
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: PyBuffer<f32>,
        observations: Bound<'py, PyAny>,
    ) -> PyResult<Vec<Step<'py>>> {
        let actions = pairs(py, &actions)?;
        let mut room = self.lock();
        let there = room.present().to_vec();
        let transitions = room.step(&actions).map_err(value_error)?.to_vec();
        let mut steps = Vec::new();
        for (agent, transition) in transitions.iter().enumerate().filter(|(agent, _)| there[*agent]) {
            write_row(&observations, agent, room.observation(agent))?;
            let terminated = matches!(transition.end, StepEnd::Terminated(_));
            let truncated = transition.end == StepEnd::Truncated;
            let info = info(py, transition)?;
            steps.push((agent, f64::from(transition.reward), terminated, truncated, info));
        }
        Ok(steps)
    }
}

impl PyRobotRoom {
    fn lock(&self) -> MutexGuard<'_, RobotRoom> {
        self.room.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What Python is told of a robot's step: nothing until its episode ends.
fn info<'py>(py: Python<'py>, transition: &Transition) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    let outcome = match transition.end {
        StepEnd::Running => return Ok(info),
        StepEnd::Terminated(Outcome::Success) => "success",
        StepEnd::Terminated(Outcome::CollisionWall) => "collision_wall",
        StepEnd::Terminated(Outcome::CollisionAgent) => "collision_agent",
        StepEnd::Truncated => "timeout",
    };
    info.set_item("outcome", outcome)?;
    info.set_item("is_success", outcome == "success")?;
    if let Some(episode) = &transition.episode {
        info.set_item("steps", episode.steps)?;
        info.set_item("path_length", episode.path_length)?;
        info.set_item("straight_distance", f64::from(episode.straight_distance))?;
    }
    Ok(info)
}
