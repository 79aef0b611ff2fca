//! A scan of a free-standing scene given in f64: what a conformance fixture or a measurement of
//! one's own needs.

use super::{Hit, Laser, Sensor};
use crate::config::LaserConfig;
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::trig::wrap_angle;
use crate::world::World;
use glam::DVec2;

/// A scene around one sensor, every number in f64 and in world coordinates.
///
/// Bodies may overlap one another, stick through walls or lie outside the room; headings may be any
/// finite number. The scene is moved to the sensor and its headings are wrapped before anything is
/// rounded to f32, so that a room far from the origin or a heading of many turns costs no accuracy.
#[derive(Clone, Debug, Default)]
pub struct ScanScene {
    /// Inner corners (least, largest) of an axis-parallel room.
    pub room: Option<([f64; 2], [f64; 2])>,
    /// The sensor: x, y, heading.
    pub sensor: [f64; 3],
    /// Bodies, each x, y, heading; the one that carries the sensor is not among them.
    pub bodies: Vec<[f64; 3]>,
    /// Side of the bodies' squares, m.
    pub body_side: f64,
    /// Indices of bodies that the sensor does not see.
    pub invisible: Vec<usize>,
    /// Convex polygons, vertices counter-clockwise.
    pub polygons: Vec<Vec<[f64; 2]>>,
}

/// The result of [`ScanScene::scan`]; [`Hit::Obstacle`] is a polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneScan {
    /// One range per beam, m.
    pub ranges: Vec<f32>,
    /// The thing that each beam meets, in the order of the beams.
    pub hits: Vec<Hit>,
    /// Least range, m.
    pub min_range: f32,
}

impl ScanScene {
    /// Takes a noise-free scan with per-beam hits.
    ///
    /// # Errors
    ///
    /// When the laser's configuration, the room or a shape is refused, naming it.
    pub fn scan(&self, laser: &LaserConfig) -> Result<SceneScan, SimError> {
        let world = self.world()?;
        let mut laser = Laser::new(laser)?;
        let beams = laser.config().beams;
        let (mut ranges, mut hits) = (vec![0.0; beams], vec![Hit::None; beams]);
        let sensor = Sensor::Free(Pose { heading: wrap_angle(self.sensor[2]), ..Pose::default() });
        let visible = |body: usize| !self.invisible.contains(&body);
        let summary = laser.scan_hits(&world, sensor, visible, &mut ranges, &mut hits);
        Ok(SceneScan { ranges, hits, min_range: summary.min_range })
    }

    /// The scene as a world whose origin is the sensor.
    fn world(&self) -> Result<World, SimError> {
        let origin = DVec2::new(self.sensor[0], self.sensor[1]);
        if !(origin.is_finite() && self.sensor[2].is_finite()) {
            return Err(SimError::field("sensor", format!("{:?}", self.sensor), "finite numbers"));
        }
        let mut world = World::new();
        if let Some((min, max)) = self.room {
            let corner = |c: [f64; 2]| (DVec2::from(c) - origin).as_vec2();
            world.set_walls(corner(min), corner(max))?;
        }
        for [x, y, heading] in &self.bodies {
            let position = (DVec2::new(*x, *y) - origin).as_vec2();
            let pose = Pose { position, heading: wrap_angle(*heading) };
            world.add_body(&Shape::square(self.body_side as f32), pose)?;
        }
        for polygon in &self.polygons {
            // Around its own middle, so that a small polygon far away keeps its form.
            let points = || polygon.iter().map(|p| DVec2::from(*p) - origin);
            let centre = (points().sum::<DVec2>() / polygon.len().max(1) as f64).as_vec2();
            let vertices = points().map(|p| (p - centre.as_dvec2()).as_vec2()).collect();
            let pose = Pose { position: centre, heading: 0.0 };
            world.add_obstacle(&Shape::Polygon { vertices }, pose)?;
        }
        Ok(world)
    }
}
