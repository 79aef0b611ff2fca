//! Polygon maps: walls and obstacles as TOML or JSON of the same structure.
//!
//! ```toml
//! walls = { min = [-10.0, -10.0], max = [10.0, 10.0] }
//! [[obstacle]]
//! polygon = [[1.0, 0.0], [2.0, 0.0], [1.5, 1.0]]      # convex, counter-clockwise
//! [[obstacle]]
//! segment = [[-3.0, 0.0], [-3.0, 4.0]]
//! [[obstacle]]
//! circle = { centre = [5.0, 5.0], radius = 0.4 }
//! [[obstacle]]
//! box = { centre = [0.0, -5.0], heading = 0.3, length = 2.0, width = 0.5 }
//! ```

use super::read_text;
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::scenario::Scenario;
use glam::Vec2;
use serde::Deserialize;
use std::path::Path;

/// Most obstacles that one map may have.
pub(super) const OBSTACLES_MAX: usize = 20_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MapFile {
    walls: WallsEntry,
    #[serde(default)]
    obstacle: Vec<ObstacleEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WallsEntry {
    min: Vec2,
    max: Vec2,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum ObstacleEntry {
    Polygon(Vec<Vec2>),
    Segment([Vec2; 2]),
    Circle {
        centre: Vec2,
        radius: f32,
    },
    Box {
        centre: Vec2,
        #[serde(default)]
        heading: f32,
        length: f32,
        width: f32,
    },
}

#[cfg(feature = "toml")]
pub(super) fn from_toml(path: &Path) -> Result<Scenario, SimError> {
    let parsed = toml::from_str::<MapFile>(&read_text(path)?);
    scenario(path, parsed.map_err(|error| without_picture(&error.to_string())))
}

pub(super) fn from_json(path: &Path) -> Result<Scenario, SimError> {
    let parsed = serde_json::from_str::<MapFile>(&read_text(path)?);
    scenario(path, parsed.map_err(|error| without_picture(&error.to_string())))
}

/// A parser's message without its picture of the place.
fn without_picture(message: &str) -> String {
    let lines = message.lines().map(str::trim).filter(|line| !line.is_empty() && !line.contains('|'));
    lines.collect::<Vec<_>>().join(": ")
}

fn scenario(path: &Path, parsed: Result<MapFile, String>) -> Result<Scenario, SimError> {
    let expected = "a polygon map: walls with min and max, obstacles";
    let map = parsed.map_err(|found| SimError::file(path, "content", found, expected))?;
    if map.obstacle.len() > OBSTACLES_MAX {
        let found = map.obstacle.len();
        return Err(SimError::file(path, "obstacle", found, format!("at most {OBSTACLES_MAX}")));
    }
    let obstacles = map.obstacle.into_iter().map(place).collect();
    Ok(Scenario { walls: (map.walls.min, map.walls.max), obstacles, traced: None })
}

fn place(entry: ObstacleEntry) -> (Shape, Pose) {
    let at = |position: Vec2| Pose { position, heading: 0.0 };
    match entry {
        ObstacleEntry::Polygon(vertices) => (Shape::Polygon { vertices }, Pose::default()),
        ObstacleEntry::Segment([a, b]) => (Shape::Segment { a, b }, Pose::default()),
        ObstacleEntry::Circle { centre, radius } => (Shape::Circle { radius }, at(centre)),
        ObstacleEntry::Box { centre, heading, length, width } => {
            (Shape::Box { length, width }, Pose::new(centre, heading))
        }
    }
}
