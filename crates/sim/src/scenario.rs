//! The static part of a world: walls and obstacles, from the configuration's rectangle or from a map file.

use crate::config::RoomConfig;
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::maps;
use crate::world::World;
use glam::Vec2;

/// Walls and obstacles without any body.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Inner corners of the walls, least and largest.
    pub walls: (Vec2, Vec2),
    /// Obstacles with their poses.
    pub obstacles: Vec<(Shape, Pose)>,
}

impl Scenario {
    /// The scenario of a configuration.
    ///
    /// # Errors
    ///
    /// When the map file cannot be read or does not describe a map.
    pub fn new(config: &RoomConfig) -> Result<Self, SimError> {
        if let Some(path) = &config.map {
            return maps::load(path);
        }
        let half = Vec2::new(config.width, config.height) / 2.0;
        Ok(Self { walls: (-half, half), obstacles: Vec::new() })
    }

    /// A world with these walls and obstacles.
    ///
    /// # Errors
    ///
    /// When a wall or an obstacle is refused by the world.
    pub fn build(&self) -> Result<World, SimError> {
        let mut world = World::new();
        world.set_walls(self.walls.0, self.walls.1)?;
        for (shape, pose) in &self.obstacles {
            world.add_obstacle(shape, *pose)?;
        }
        Ok(world)
    }
}
