//! Changes of a training room every now and then: in its number of agents, and in the obstacles
//! between them.
//!
//! Every `renew_steps` steps a room draws both from its own stream `training_crowd.room`; the first
//! time comes earlier by a random part, so that rooms do not change together. Obstacles go and come
//! at once, none near a body or a goal, and all goals stay within reach; one that finds no such
//! place is left out. Agents beyond the number leave as their episodes end, and return with a new
//! one when the number allows it. The first agent of a room never leaves.

use crate::config::SimConfig;
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::maps;
use crate::rng::StreamRng;
use crate::scenario::Scenario;
use crate::spawn::Spawner;
use crate::traits::TrainingCrowd;
use crate::world::World;
use glam::Vec2;
use rand::RngExt;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Places tried for one obstacle.
const TRIES: u32 = 64;

/// The common part of all rooms with the same walls: the empty room, from which each is furnished.
pub(crate) struct Plan {
    pub(crate) scenario: Scenario,
    /// The configuration as far as starts and goals go: with the clearances that the largest member
    /// of the crowd needs.
    pub(crate) roomy: SimConfig,
    /// The spawner of the room without obstacles of the crowd.
    pub(crate) spawner: Spawner,
    n_agents: usize,
}

impl Plan {
    /// The plans of rooms of so many agents: one for each map of the crowd, else that of the room.
    ///
    /// # Errors
    ///
    /// When a room has no place for them, or a map is none.
    pub(crate) fn all(
        config: &SimConfig,
        crowd: &TrainingCrowd,
        n_agents: usize,
    ) -> Result<Vec<Arc<Self>>, SimError> {
        if crowd.maps.is_empty() {
            let plan = Self::new(maps::scenario(&config.room)?, config, crowd, n_agents)?;
            return Ok(vec![Arc::new(plan)]);
        }
        let of_map = |map: PathBuf| {
            let plan = Self::new(maps::load(&map)?, config, crowd, n_agents);
            // Which of the maps it is has to be said.
            plan.map(Arc::new).map_err(|error| match error.setting() {
                Some((field, found, expected)) => SimError::file(&map, field, found, expected),
                None => error,
            })
        };
        crowd.map_files().into_iter().map(of_map).collect()
    }

    /// The plan of rooms of so many agents.
    ///
    /// # Errors
    ///
    /// When the room has no place for them.
    fn new(
        scenario: Scenario,
        config: &SimConfig,
        crowd: &TrainingCrowd,
        n_agents: usize,
    ) -> Result<Self, SimError> {
        let roomy = crowd.roomy(config);
        let spawner = Spawner::new(&roomy, &scenario.build()?)?;
        spawner.check_room(n_agents)?;
        if crowd.agents_min as usize > n_agents {
            let expected = format!("at most {n_agents}, the number of agents");
            return Err(SimError::field("agents_min", crowd.agents_min, expected));
        }
        Ok(Self { scenario, roomy, spawner, n_agents })
    }

    /// The room with obstacles, without bodies, and where starts and goals can be in it.
    ///
    /// # Errors
    ///
    /// When an obstacle is no shape, or too few places are left.
    pub(crate) fn furnish(&self, obstacles: &[(Shape, Pose)]) -> Result<(World, Spawner), SimError> {
        let mut world = self.scenario.build()?;
        if obstacles.is_empty() {
            return Ok((world, self.spawner.clone()));
        }
        for (shape, pose) in obstacles {
            world.add_obstacle(shape, *pose)?;
        }
        let spawner = Spawner::new(&self.roomy, &world)?;
        spawner.check_room(self.n_agents)?;
        Ok((world, spawner))
    }
}

/// The draws of a room.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Renewal {
    /// Agents 0 up to this are in the room, others leave it.
    pub(crate) n_present: usize,
    pub(crate) obstacles: Vec<(Shape, Pose)>,
    /// Steps until the next draw.
    pub(crate) steps_left: u32,
    pub(crate) rng: StreamRng,
}

/// A [`Renewal`] as a snapshot keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RenewalState {
    pub(crate) n_present: usize,
    pub(crate) obstacles: Vec<(Shape, Pose)>,
    pub(crate) steps_left: u32,
    pub(crate) position: u64,
}

impl Renewal {
    /// A room that is to be drawn before its first step.
    pub(crate) fn new(n_agents: usize, rng: StreamRng) -> Self {
        Self { n_present: n_agents, obstacles: Vec::new(), steps_left: 0, rng }
    }

    /// Has the first draw after the one of the beginning come earlier than the others.
    pub(crate) fn stagger(&mut self, crowd: &TrainingCrowd) {
        self.steps_left = self.rng.random_range(1..=crowd.renew_steps);
    }

    pub(crate) fn state(&self) -> RenewalState {
        RenewalState {
            n_present: self.n_present,
            obstacles: self.obstacles.clone(),
            steps_left: self.steps_left,
            position: self.rng.get_word_pos() as u64,
        }
    }

    /// Draws the number of agents and obstacles for a room with such bodies and goals; returns the
    /// room without bodies.
    ///
    /// `in_the_way` are the places to keep clear of, each with the distance that an obstacle keeps
    /// from it; `ways` are the ways from agents to their goals that stay open.
    pub(crate) fn draw(
        &mut self,
        plan: &Plan,
        crowd: &TrainingCrowd,
        in_the_way: &[(Vec2, f32)],
        ways: &[(Vec2, Vec2)],
    ) -> (World, Spawner) {
        self.steps_left = crowd.renew_steps;
        if crowd.agents_min > 0 {
            self.n_present = self.rng.random_range(crowd.agents_min as usize..=plan.n_agents);
        }
        self.obstacles.clear();
        for _ in 0..self.rng.random_range(crowd.obstacles_min..=crowd.obstacles_max) {
            let obstacle = self.draw_obstacle(plan, crowd, in_the_way);
            self.obstacles.extend(obstacle);
        }
        loop {
            let furnished = plan.furnish(&self.obstacles);
            let open = |spawner: &Spawner| ways.iter().all(|(start, goal)| spawner.connects(*start, *goal));
            match furnished {
                Ok((world, spawner)) if self.obstacles.is_empty() || open(&spawner) => {
                    return (world, spawner);
                }
                _ => drop(self.obstacles.pop()),
            }
        }
    }

    /// A disc or a box that keeps its distance; `None` where none of the tries does.
    fn draw_obstacle(
        &mut self,
        plan: &Plan,
        crowd: &TrainingCrowd,
        in_the_way: &[(Vec2, f32)],
    ) -> Option<(Shape, Pose)> {
        let (min, max) = plan.scenario.walls;
        let rng = &mut self.rng;
        let mut side = || rng.random_range(crowd.obstacle_size_min..=crowd.obstacle_size_max);
        let (length, width) = (side(), side());
        let shape =
            if rng.random() { Shape::Circle { radius: length / 2.0 } } else { Shape::Box { length, width } };
        let heading = rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
        let reach = shape.circumradius();
        let far = |point: Vec2| in_the_way.iter().all(|(place, room)| place.distance(point) >= room + reach);
        let mut points = (0..TRIES).map(|_| {
            let x = rng.random_range(min.x..max.x);
            Vec2::new(x, rng.random_range(min.y..max.y))
        });
        points.find(|point| far(*point)).map(|point| (shape, Pose::new(point, heading)))
    }
}
