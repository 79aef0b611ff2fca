//! [`RobotRoom`] for Python: the core of `parallel_env`.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use jostle_arena::ArenaConfig;
use jostle_arena::metrics::EpisodeMetrics;
use jostle_arena::room::metric_scale;
use jostle_sim::{Outcome, Transition};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};

use super::arguments::{
    Pixels, absolute, base, check_threads, from_bytes, measures, notes, pairs, pixels, place, to_bytes,
    value_error, write_row,
};
use crate::robot_rooms::RobotRoom;

/// A room of robots whose episodes begin together.
#[pyclass(name = "RobotRoom", module = "jostle._jostle", frozen)]
pub(super) struct PyRobotRoom {
    file: Option<PathBuf>,
    overrides: Vec<String>,
    config: jostle_ppo::Config,
    n_behaviours: u32,
    room: Mutex<RobotRoom>,
}

/// Index, reward, terminated, truncated, information.
type Step<'py> = (usize, f64, bool, bool, Bound<'py, PyDict>);
/// A robot's place: x, y, heading, goal x, goal y, and its clearance.
type Stands = ([f32; 5], f64);
/// The constructor's arguments.
type Arguments = (Option<PathBuf>, Vec<String>, Option<usize>, u32);

#[pymethods]
impl PyRobotRoom {
    #[new]
    fn new(
        config: Option<PathBuf>,
        overrides: Vec<String>,
        n_agents: Option<usize>,
        n_behaviours: u32,
    ) -> PyResult<Self> {
        let file = config.as_ref().map(absolute).transpose()?;
        let mut config = base(config, &overrides)?;
        config.n_agents = n_agents.unwrap_or(config.n_agents);
        check_threads(false)?;
        let room = RobotRoom::new(&config.sim, config.n_agents, n_behaviours, 0).map_err(value_error)?;
        Ok(Self { file, overrides, config, n_behaviours, room: Mutex::new(room) })
    }

    /// For `pickle`: arguments and what the robots have done since their episodes began.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyType>, Arguments, Bound<'py, PyBytes>) {
        let this = slf.get();
        let n_agents = Some(this.config.n_agents);
        let arguments = (this.file.clone(), this.overrides.clone(), n_agents, this.n_behaviours);
        let snapshot = this.lock().snapshot(this.config.hash());
        (slf.get_type(), arguments, to_bytes(slf.py(), &snapshot))
    }

    /// Goes to where the pickled room was.
    fn __setstate__(&self, state: &[u8]) -> PyResult<()> {
        let (snapshot, numbers) = (from_bytes(state)?, (self.config.n_agents, self.n_behaviours));
        let room = RobotRoom::from_snapshot(&self.config.sim, numbers, &self.config.hash(), &snapshot);
        *self.lock() = room.map_err(value_error)?;
        Ok(())
    }

    /// For `copy.deepcopy`.
    fn __deepcopy__(&self, _memo: Bound<'_, PyAny>) -> Self {
        let room = self.lock().clone();
        Self {
            file: self.file.clone(),
            overrides: self.overrides.clone(),
            config: self.config.clone(),
            n_behaviours: self.n_behaviours,
            room: Mutex::new(room),
        }
    }

    /// The keys of the room's map that are not read, one line each.
    fn notes(&self) -> PyResult<Vec<String>> {
        notes(&self.config)
    }

    /// Control period (s).
    #[getter]
    fn dt(&self) -> f32 {
        self.config.sim.episode.dt
    }

    /// The place of every robot, or its place when its episode ended in the last step; of one that
    /// left before it means nothing.
    fn whereabouts(&self) -> Vec<Stands> {
        let room = self.lock();
        let stands = |agent| {
            let at = room.whereabouts(agent);
            (place(at.pose, at.goal), f64::from(at.clearance))
        };
        (0..self.config.n_agents).map(stands).collect()
    }

    /// The room from above: height, width, pixels.
    fn picture<'py>(&self, py: Python<'py>) -> Pixels<'py> {
        pixels(py, self.lock().picture())
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
    fn bounds(&self) -> [Vec<f32>; 2] {
        self.lock().bounds()
    }

    /// Places all robots by a seed, writes their first observations, and tells their behaviour
    /// tokens.
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

    /// Steps the robots that are there and lists (index, reward, terminated, truncated, info) of
    /// each.
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
            let terminated = transition.end.is_terminated();
            let truncated = transition.end.is_truncated();
            let info = self.info(py, transition, room.min_clearance(agent))?;
            steps.push((agent, f64::from(transition.reward), terminated, truncated, info));
        }
        Ok(steps)
    }
}

impl PyRobotRoom {
    fn lock(&self) -> MutexGuard<'_, RobotRoom> {
        self.room.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Python's dictionary of a robot's step beside its place: empty until its episode ends.
    fn info<'py>(
        &self,
        py: Python<'py>,
        transition: &Transition,
        min_clearance: f32,
    ) -> PyResult<Bound<'py, PyDict>> {
        let info = PyDict::new(py);
        let Some(outcome) = transition.end.outcome() else { return Ok(info) };
        // Those whom a robot meets here are agents like itself.
        let is_agent = outcome == Outcome::CollisionPedestrian;
        let name = if is_agent { "collision_agent".to_owned() } else { outcome.to_string() };
        info.set_item("outcome", name)?;
        info.set_item("is_success", outcome == Outcome::Success)?;
        if let Some(episode) = &transition.episode {
            let scale = metric_scale(&ArenaConfig { sim: self.config.sim.clone(), ..ArenaConfig::default() });
            let (steps, straight) = (u64::from(episode.steps), f64::from(episode.straight_distance));
            let metrics = EpisodeMetrics::from_totals(&scale, outcome, steps, episode.path_length, straight);
            measures(&info, steps, &metrics, min_clearance)?;
        }
        Ok(info)
    }
}
