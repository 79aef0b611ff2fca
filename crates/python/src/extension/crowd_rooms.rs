//! [`CrowdRooms`] for Python: the core of `RoomEnv` and `VectorRooms`.

use std::sync::{Mutex, MutexGuard, PoisonError};

use jostle_arena::Outcome;
use jostle_arena::room::ArenaRoom;
use jostle_eval::EvalError;
use jostle_sim::Pose;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};

use super::arguments::{
    Keywords, Pixels, check_threads, episode_info, from_bytes, no_row, pairs, pixels, place, to_bytes,
    value_error, write_row,
};
use crate::crowd_rooms::{CrowdRooms, EpisodeEnd, training_seed};

/// Rooms with one robot each among a crowd.
#[pyclass(name = "CrowdRooms", module = "jostle._jostle", frozen)]
pub(super) struct PyCrowdRooms {
    /// From which the same rooms can be made anywhere on this machine.
    keywords: Keywords,
    rooms: Mutex<CrowdRooms>,
}

/// The ended rooms of a step: index and information.
type Ended<'py> = Vec<(usize, Bound<'py, PyDict>)>;

#[pymethods]
impl PyCrowdRooms {
    #[new]
    fn new(py: Python<'_>, keywords: Keywords, n_rooms: usize) -> PyResult<Self> {
        let settings = keywords.settings(&keywords.base()?)?;
        let rooms = py.detach(|| CrowdRooms::new(settings, n_rooms)).map_err(value_error)?;
        Ok(Self { keywords: keywords.absolute()?, rooms: Mutex::new(rooms) })
    }

    /// For `pickle`: keywords and what the rooms have done since their episodes began.
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> (Bound<'py, PyType>, (Keywords, usize), Bound<'py, PyBytes>) {
        let (this, py) = (slf.get(), slf.py());
        let snapshot = this.lock().snapshot();
        let arguments = (this.keywords.clone(), this.lock().rooms().len());
        (slf.get_type(), arguments, to_bytes(py, &snapshot))
    }

    /// Goes to where the pickled rooms were.
    fn __setstate__(&self, py: Python<'_>, state: &[u8]) -> PyResult<()> {
        let snapshot = from_bytes(state)?;
        check_threads(self.lock().needs_threads())?;
        py.detach(|| self.lock().restore(&snapshot)).map_err(value_error)
    }

    /// For `copy.deepcopy`.
    fn __deepcopy__(&self, _memo: Bound<'_, PyAny>) -> PyResult<Self> {
        let rooms = self.lock().try_clone().map_err(value_error)?;
        Ok(Self { keywords: self.keywords.clone(), rooms: Mutex::new(rooms) })
    }

    /// Control period (s).
    #[getter]
    fn dt(&self) -> f64 {
        self.lock().plan().scale.dt
    }

    /// Length of an observation row.
    #[getter]
    fn observation_len(&self) -> usize {
        self.lock().plan().config.sim.observation_len()
    }

    /// Angle of every beam from straight ahead, counter-clockwise (rad).
    #[getter]
    fn beam_angles(&self) -> Vec<f64> {
        self.lock().plan().config.sim.laser.beam_angles().collect()
    }

    /// The robot's largest linear and angular velocity (m/s, rad/s).
    #[getter]
    fn limits(&self) -> [f32; 2] {
        let rooms = self.lock();
        let robot = &rooms.plan().config.sim.robot;
        [robot.v_max, robot.w_max]
    }

    /// Least and largest observation row.
    fn bounds(&self) -> [Vec<f32>; 2] {
        self.lock().bounds()
    }

    /// Starts room i at the first training episode of a seed, or, with `episode`, at that episode
    /// of the test of the seed, and writes its first observation, place and clearance into row i.
    fn begin(
        &self,
        i: usize,
        seed: u64,
        episode: Option<u64>,
        observations: Bound<'_, PyAny>,
        places: Bound<'_, PyAny>,
        clearances: Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (seed, episode) = episode.map_or_else(|| (training_seed(seed), 0), |episode| (seed, episode));
        self.begin_by(i, [&observations, &places, &clearances], |rooms| rooms.begin(i, seed, episode))
    }

    /// Starts the next episode in room i and writes its first observation, place and clearance into
    /// row i.
    fn begin_next(
        &self,
        i: usize,
        observations: Bound<'_, PyAny>,
        places: Bound<'_, PyAny>,
        clearances: Bound<'_, PyAny>,
    ) -> PyResult<()> {
        self.begin_by(i, [&observations, &places, &clearances], |rooms| rooms.begin_next(i))
    }

    /// Steps all rooms, writes into the arrays, and lists the rooms whose episode ended as (i,
    /// info).
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: PyBuffer<f32>,
        observations: Bound<'py, PyAny>,
        rewards: PyBuffer<f64>,
        terminated: PyBuffer<u8>,
        truncated: PyBuffer<u8>,
        places: PyBuffer<f32>,
        clearances: PyBuffer<f64>,
    ) -> PyResult<Ended<'py>> {
        let actions = pairs(py, &actions)?;
        let needs_threads = self.lock().needs_threads();
        check_threads(needs_threads)?;
        let steps = py.detach(|| self.lock().step(&actions)).map_err(value_error)?;
        let mut stands = Vec::with_capacity(steps.len());
        for (i, room) in self.lock().rooms().iter().enumerate() {
            write_row(&observations, i, room.robot_observation())?;
            stands.push(robot_place(room));
        }
        let worth: Vec<f64> = steps.iter().map(|step| f64::from(step.reward)).collect();
        let clear: Vec<f64> = steps.iter().map(|step| f64::from(step.clearance)).collect();
        let timeout = |end: &EpisodeEnd| end.finished.outcome == Outcome::Timeout;
        let cut: Vec<u8> = steps.iter().map(|step| step.end.as_ref().is_some_and(timeout).into()).collect();
        let over: Vec<u8> =
            steps.iter().map(|step| step.end.as_ref().is_some_and(|end| !timeout(end)).into()).collect();
        rewards.copy_from_slice(py, &worth)?;
        places.copy_from_slice(py, stands.as_flattened())?;
        clearances.copy_from_slice(py, &clear)?;
        truncated.copy_from_slice(py, &cut)?;
        terminated.copy_from_slice(py, &over)?;
        let ended = steps.iter().enumerate().filter_map(|(i, step)| Some((i, step.end.as_ref()?)));
        ended.map(|(i, end)| Ok((i, episode_info(py, end)?))).collect()
    }

    /// The bodies of room i, in world coordinates: for each body x, y, heading, velocity x and y,
    /// goal x and y.
    fn state<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Bound<'py, PyDict>> {
        let rooms = self.lock();
        let room = rooms.rooms().get(i).ok_or_else(|| no_row(i))?;
        let body = |p: &jostle_peds::Pedestrian| {
            [p.position.x, p.position.y, p.heading, p.velocity.x, p.velocity.y, p.goal.x, p.goal.y]
        };
        let state = PyDict::new(py);
        state.set_item("robot", body(&room.robot()))?;
        let present = room.pedestrians().iter().enumerate().filter(|(i, _)| room.is_present(*i));
        state.set_item("pedestrians", present.map(|(_, p)| body(p)).collect::<Vec<_>>())?;
        state.set_item("ranges", room.robot_ranges().to_vec())?;
        state.set_item("episode_index", room.episode())?;
        Ok(state)
    }

    /// Room i from above: height, width, pixels.
    fn picture<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Pixels<'py>> {
        Ok(pixels(py, self.lock().picture(i).ok_or_else(|| no_row(i))?))
    }
}

impl PyCrowdRooms {
    fn lock(&self) -> MutexGuard<'_, CrowdRooms> {
        // A panic leaves rooms that can still be begun anew.
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin_by(
        &self,
        i: usize,
        [observations, places, clearances]: [&Bound<'_, PyAny>; 3],
        begin: impl FnOnce(&mut CrowdRooms) -> Result<(), EvalError>,
    ) -> PyResult<()> {
        let mut rooms = self.lock();
        if i >= rooms.rooms().len() {
            return Err(no_row(i));
        }
        begin(&mut rooms).map_err(value_error)?;
        let room = &rooms.rooms()[i];
        write_row(places, i, &robot_place(room))?;
        clearances.set_item(i, f64::from(room.robot_clearance()))?;
        write_row(observations, i, room.robot_observation())
    }
}

/// The robot's place and goal.
fn robot_place(room: &ArenaRoom) -> [f32; 5] {
    let robot = room.robot();
    place(Pose { position: robot.position, heading: robot.heading }, robot.goal)
}
