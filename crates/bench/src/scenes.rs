//! Rooms of robots with noisy lasers: whole environment steps, and the parts of one.

use std::path::Path;

use glam::Vec2;
use jostle_sim::{
    Dynamics, Laser, Motion, Pose, Rooms, Sensor, Shape, SimConfig, StreamRng, Streams, World, maps,
};

use crate::error::BenchError;

/// The walls, obstacles and bodies of a room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scene {
    /// Robots N.
    pub n_agents: usize,
    /// Fifty convex polygons in a square of 40 m, instead of an empty square of 20 m.
    pub polygons: bool,
    /// Robots that have mass, moved by rapier.
    pub mass: bool,
}

/// The scenes that are measured, each with its name.
pub const SCENES: [(&str, Scene); 4] = [
    ("N = 5", Scene::empty(5)),
    ("N = 20", Scene::empty(20)),
    ("N = 5 and 50 polygons", Scene { polygons: true, ..Scene::empty(5) }),
    ("N = 5 with mass", Scene { mass: true, ..Scene::empty(5) }),
];

impl Scene {
    /// So many robots without mass in the empty square.
    pub const fn empty(n_agents: usize) -> Self {
        Self { n_agents, polygons: false, mass: false }
    }

    fn config(self) -> SimConfig {
        let mut config = SimConfig::default();
        let map = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/fifty_polygons.toml");
        config.room.map = self.polygons.then_some(map);
        config.robot.dynamics = if self.mass { Dynamics::Rapier } else { Dynamics::Kinematic };
        config
    }
}

/// Rooms that are stepped with actions that change all the time.
pub struct Stepping {
    rooms: Rooms,
    actions: Vec<[f32; 2]>,
    step: u32,
}

impl Stepping {
    /// So many rooms of a scene.
    ///
    /// # Errors
    ///
    /// When the simulator refuses the scene.
    pub fn new(scene: Scene, n_rooms: usize) -> Result<Self, BenchError> {
        let rooms = Rooms::new(&scene.config(), n_rooms, scene.n_agents, 5, &Streams::new(1))?;
        let actions = vec![[0.7, 0.0]; rooms.len()];
        Ok(Self { rooms, actions, step: 0 })
    }

    /// One step of all agents: motion, 512 noisy beams each, reward, observation. Returns the
    /// number of agents.
    pub fn step(&mut self) -> usize {
        let turn = f32::sin(self.step as f32 * 0.05);
        for (agent, action) in self.actions.iter_mut().enumerate() {
            action[1] = turn * (agent % 3) as f32;
        }
        self.step += 1;
        self.rooms.step(&self.actions);
        self.rooms.len()
    }
}

/// A room's bodies and one scanner, for the parts of a step.
pub struct Parts {
    world: World,
    laser: Laser,
    motions: Vec<Motion>,
    stalled: Vec<bool>,
    ranges: Vec<f32>,
    next: usize,
}

impl Parts {
    /// The scene with its robots on a grid, each with a heading of its own.
    ///
    /// # Errors
    ///
    /// When the simulator refuses the scene.
    pub fn new(scene: Scene) -> Result<Self, BenchError> {
        let config = scene.config();
        let mut world = maps::scenario(&config.room)?.build()?;
        for agent in 0..scene.n_agents {
            let position = Vec2::new((agent % 5) as f32 * 3.6 - 7.4, (agent / 5) as f32 * 3.5 - 5.2);
            let shape = Shape::Box { length: config.robot.length, width: config.robot.width };
            world.add_body(&shape, Pose::new(position, agent as f32))?;
            if let Some(base) = config.robot.dynamic_base() {
                world.set_base(agent, &base)?;
            }
        }
        let motion =
            |agent: usize| Motion::Drive { v: 0.5, w: if agent.is_multiple_of(2) { 0.6 } else { -0.6 } };
        Ok(Self {
            motions: (0..scene.n_agents).map(motion).collect(),
            stalled: vec![false; scene.n_agents],
            ranges: vec![0.0; config.laser.beams],
            laser: Laser::new(&config.laser)?,
            world,
            next: 0,
        })
    }

    /// Moves every robot for one control period. Returns the number of robots.
    pub fn advance(&mut self) -> usize {
        self.world.advance(&self.motions, 0.1, &mut self.stalled);
        self.motions.len()
    }

    /// One noise-free scan by the next robot. Returns the number of beams.
    pub fn scan(&mut self) -> usize {
        self.next = (self.next + 1) % self.motions.len();
        self.laser.scan(&self.world, Sensor::Body(self.next), |_| true, &mut self.ranges);
        self.ranges.len()
    }
}

/// The stream that this crate's arbitrary numbers are drawn from.
pub(crate) fn stream(name: &str) -> StreamRng {
    Streams::new(1).stream(name, &[])
}
