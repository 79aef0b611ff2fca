//! The static part of a world: walls and obstacles.
//!
//! Architecture invariant: a scenario is data. [`maps`](crate::maps) makes it from a configuration
//! or a file.

use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::world::World;
use glam::{DVec2, Vec2};

/// Largest coordinate of a wall or an obstacle, m. At twice this, neighbouring f32 are 0.1 mm
/// apart, a thousandth of a control step of the paper's robot; farther out steps are rounded away
/// and driven ways no longer add up.
pub const REACH: f32 = 1000.0;

/// Walls and obstacles without any body.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Inner corners of the walls, least and largest.
    pub walls: (Vec2, Vec2),
    /// Obstacles with their poses.
    pub obstacles: Vec<(Shape, Pose)>,
    /// The free area of an occupancy grid, traced; `None` for walls and polygons.
    pub traced: Option<TracedArea>,
}

/// The outline of an occupancy grid's free area: what `boundary` starts from.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedArea {
    /// Closed lines in the world, m: clockwise around free areas, counter-clockwise around the
    /// solid in them.
    pub rings: Vec<Vec<DVec2>>,
    /// Number of the scenario's obstacles, from the first on, that are the grid's own boxes and so
    /// within the rings already.
    pub n_obstacles: usize,
}

impl Scenario {
    /// A rectangular room centred on the origin, without obstacles.
    ///
    /// `size`: extents along x and y, m.
    pub fn rectangle(size: Vec2) -> Self {
        Self { walls: (-size / 2.0, size / 2.0), obstacles: Vec::new(), traced: None }
    }

    /// A world with these walls and obstacles.
    ///
    /// # Errors
    ///
    /// When a wall or an obstacle is refused by the world or lies farther than [`REACH`] from the
    /// origin.
    pub fn build(&self) -> Result<World, SimError> {
        let mut world = World::new();
        world.set_walls(self.walls.0, self.walls.1)?;
        within_reach("walls", [self.walls.0, self.walls.1])?;
        for (shape, pose) in &self.obstacles {
            let index = world.add_obstacle(shape, *pose)?;
            let field = || format!("obstacle {index}");
            match shape {
                Shape::Circle { .. } | Shape::Box { .. } => within_reach(field(), [pose.position])?,
                Shape::Segment { a, b } => within_reach(field(), [*a, *b].map(|v| pose.point_in_world(v)))?,
                Shape::Polygon { vertices } => {
                    within_reach(field(), vertices.iter().map(|v| pose.point_in_world(*v)))?;
                }
            }
        }
        Ok(world)
    }
}

fn within_reach(field: impl Into<String>, points: impl IntoIterator<Item = Vec2>) -> Result<(), SimError> {
    match points.into_iter().find(|point| point.abs().max_element() > REACH) {
        None => Ok(()),
        Some(point) => Err(SimError::field(
            field,
            point,
            format!(
                "coordinates within ±{REACH} m, where f32 resolves a robot's steps; move the map's origin"
            ),
        )),
    }
}
