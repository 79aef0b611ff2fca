//! [`PeerRoom`] for Python.

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::Vec2;
use jostle_peds::Pedestrian;
use jostle_sim::{Pose, Shape};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;

use super::arguments::{Keywords, check_threads, value_error, write_row};
use crate::peer_room::PeerRoom;

/// Episodes for a robot that another simulator moves.
#[pyclass(name = "PeerRoom", module = "jostle._jostle", frozen)]
pub(super) struct PyPeerRoom {
    room: Mutex<PeerRoom>,
}

/// Kind and numbers of an obstacle.
type Obstacle = (&'static str, Vec<Vec<f32>>);

/// The robot's pose and goal, and the pedestrians, at the start of an episode.
type Start = ([f32; 3], [f32; 2], Vec<[f32; 7]>);

#[pymethods]
impl PyPeerRoom {
    #[new]
    fn new(py: Python<'_>, keywords: Keywords, respawn_clearance: Option<f32>) -> PyResult<Self> {
        let settings = keywords.settings(&keywords.base()?)?;
        let room = py.detach(|| PeerRoom::new(settings, respawn_clearance)).map_err(value_error)?;
        Ok(Self { room: Mutex::new(room) })
    }

    /// Control period (s).
    #[getter]
    fn dt(&self) -> f64 {
        self.lock().plan().scale.dt
    }

    /// Steps after which an episode is cut off.
    #[getter]
    fn step_limit(&self) -> u32 {
        self.lock().plan().config.sim.episode.step_limit
    }

    /// Distance below which the goal is reached (m).
    #[getter]
    fn goal_radius(&self) -> f32 {
        self.lock().plan().config.sim.episode.goal_radius
    }

    /// Range below which the robot has crashed (m).
    #[getter]
    fn crash_range(&self) -> f32 {
        self.lock().plan().config.sim.episode.crash_range
    }

    /// The laser's range (m).
    #[getter]
    fn laser_range(&self) -> f32 {
        self.lock().plan().config.sim.laser.range
    }

    /// Angle of every beam from straight ahead, counter-clockwise (rad).
    #[getter]
    fn beam_angles(&self) -> Vec<f64> {
        self.lock().plan().config.sim.laser.beam_angles().collect()
    }

    /// The robot's largest linear and angular velocity (m/s, rad/s).
    #[getter]
    fn limits(&self) -> [f32; 2] {
        let room = self.lock();
        let robot = &room.plan().config.sim.robot;
        [robot.v_max, robot.w_max]
    }

    /// Length and width of robot and pedestrians (m).
    #[getter]
    fn body(&self) -> [f32; 2] {
        let room = self.lock();
        let robot = &room.plan().config.sim.robot;
        [robot.length, robot.width]
    }

    /// Length of an observation row.
    #[getter]
    fn observation_len(&self) -> usize {
        self.lock().plan().config.sim.observation_len()
    }

    /// Hash of all settings that decide an episode.
    #[getter]
    fn settings_hash(&self) -> String {
        self.lock().settings_hash()
    }

    /// Least and largest corner of the room (m).
    #[getter]
    fn walls(&self) -> [[f32; 2]; 2] {
        let (min, max) = self.lock().plan().scenario.walls;
        [min.to_array(), max.to_array()]
    }

    /// The obstacles in world coordinates.
    #[getter]
    fn obstacles(&self) -> Vec<Obstacle> {
        self.lock().plan().scenario.obstacles.iter().map(|(shape, pose)| obstacle(shape, *pose)).collect()
    }

    /// Goes to the start of an episode of the test: the robot's pose, its goal, the pedestrians.
    fn begin(&self, seed: u64, episode: u64) -> PyResult<Start> {
        let mut room = self.lock();
        room.begin(seed, episode).map_err(value_error)?;
        let robot = room.room().robot();
        let start = [robot.position.x, robot.position.y, robot.heading];
        Ok((start, robot.goal.to_array(), bodies(&room)))
    }

    /// The pedestrians as they are now: x, y, heading, velocity x and y, goal x and y.
    fn pedestrians(&self) -> Vec<[f32; 7]> {
        bodies(&self.lock())
    }

    /// Moves the pedestrians for a control period.
    fn walk(&self, py: Python<'_>) -> PyResult<Vec<[f32; 7]>> {
        check_threads(self.lock().plan().senses_by_laser)?;
        let walked = py.detach(|| {
            let mut room = self.lock();
            room.walk().map(|()| bodies(&room))
        });
        walked.map_err(value_error)
    }

    /// Takes over the robot's pose, velocity and ranges, and writes its observation.
    fn observe(
        &self,
        py: Python<'_>,
        pose: [f32; 3],
        velocity: [f32; 2],
        ranges: PyBuffer<f32>,
        observations: Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let ranges = ranges.to_vec(py)?;
        let [x, y, heading] = pose;
        let pose = Pose { position: Vec2::new(x, y), heading };
        let mut room = self.lock();
        room.observe(pose, velocity, &ranges).map_err(value_error)?;
        write_row(&observations, 0, room.room().robot_observation())
    }
}

impl PyPeerRoom {
    fn lock(&self) -> MutexGuard<'_, PeerRoom> {
        // A panic leaves a room that can still be begun anew.
        self.room.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn bodies(room: &PeerRoom) -> Vec<[f32; 7]> {
    let present = room.room().pedestrians().iter().enumerate().filter(|(i, _)| room.room().is_present(*i));
    let body = |p: &Pedestrian| {
        [p.position.x, p.position.y, p.heading, p.velocity.x, p.velocity.y, p.goal.x, p.goal.y]
    };
    present.map(|(_, pedestrian)| body(pedestrian)).collect()
}

fn obstacle(shape: &Shape, pose: Pose) -> Obstacle {
    let in_world = |point: Vec2| pose.point_in_world(point).to_array().to_vec();
    let [x, y] = pose.position.to_array();
    match shape {
        Shape::Circle { radius } => ("circle", vec![vec![x, y, *radius]]),
        Shape::Box { length, width } => ("box", vec![vec![x, y, pose.heading, *length, *width]]),
        Shape::Segment { a, b } => ("segment", vec![in_world(*a), in_world(*b)]),
        Shape::Polygon { vertices } => ("polygon", vertices.iter().map(|v| in_world(*v)).collect()),
    }
}
