//! The laser scanner: beams from one point, all round or over a sector, against walls, obstacles
//! and those bodies it may see.
//!
//! Reading order: this file (what a scan is), [`targets`] (shapes in the sensor's frame), [`span`]
//! (the beams that each can cover), [`analytic`] (closed forms, eight beams at a time),
//! [`dispatch`] (the same code per CPU feature), [`oracle`] (parry's casts), [`nearest`] (what is
//! near on the sides that a sector does not see), [`noise`].
//!
//! Ranges are noise-free here; noise belongs to the observation. A sensor inside a shape, or beyond
//! a wall, reads 0.

mod analytic;
mod dispatch;
mod nearest;
mod noise;
mod oracle;
mod scene;
mod span;
mod targets;

pub(crate) use dispatch::noisy_frame;
pub use noise::NoiseSource;
pub use scene::{ScanScene, SceneScan};

use crate::config::{LaserConfig, LaserKernel};
use crate::error::SimError;
use crate::geometry::Pose;
use crate::trig::sin_cos;
use crate::world::World;
use glam::Vec2;
use std::sync::Arc;
use targets::Targets;

/// Beams that one step of the kernels handles.
pub(crate) const LANES: usize = 8;
/// One number for each of eight neighbouring beams.
pub(crate) type Chunk = [f32; LANES];

/// The first thing that a beam meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hit {
    /// Nothing within range.
    None,
    /// The room's walls; they are one thing, index 0.
    Wall(usize),
    /// An obstacle, by its index.
    Obstacle(usize),
    /// A body, by its index.
    Body(usize),
}

/// The place that a scan is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sensor {
    /// The centre of a body, which is not seen by itself.
    Body(usize),
    /// A free-standing sensor.
    Free(Pose),
}

/// The nearest thing to a sensor all round, by which crashes are judged.
///
/// A full circle of beams sees it: it is the scan's least range. A sector does not, and yet a robot
/// whose laser looks ahead can be hit from behind: there it is the distance to the nearest surface
/// of all walls, obstacles and bodies that exist for the sensor, on whichever side they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanSummary {
    /// Least noise-free distance, m; the laser's range where nothing is nearer.
    pub min_range: f32,
    /// The thing at that distance: the one that the first beam with that range meets, or the first
    /// of the nearest around a sector.
    pub nearest: Hit,
}

/// Beam directions in the sensor's frame, in chunks; beams that only fill the last chunk up have no
/// direction.
pub(crate) struct Directions {
    pub(crate) x: Vec<Chunk>,
    pub(crate) y: Vec<Chunk>,
}

impl Directions {
    fn new(laser: &LaserConfig) -> Self {
        let component = |f: fn(f64) -> f64| {
            let mut chunks = vec![[0.0; LANES]; laser.beams.div_ceil(LANES)];
            for (k, value) in chunks.as_flattened_mut()[..laser.beams].iter_mut().enumerate() {
                *value = f(laser.beam_angle(k)) as f32;
            }
            chunks
        };
        Self { x: component(libm::cos), y: component(libm::sin) }
    }
}

/// A scanner with its beam directions and its working memory.
///
/// # Examples
///
/// ```
/// use glam::Vec2;
/// use jostle_sim::{Hit, Laser, LaserConfig, Pose, Sensor, World};
/// let mut world = World::new();
/// world.set_walls(Vec2::splat(-10.0), Vec2::splat(10.0))?;
/// let mut laser = Laser::new(&LaserConfig::default())?;
/// let mut ranges = vec![0.0; 512];
/// let sensor = Sensor::Free(Pose::new(Vec2::new(7.0, 0.0), 0.0));
/// let summary = laser.scan(&world, sensor, |_| true, &mut ranges);
/// assert_eq!((summary.min_range, summary.nearest, ranges[256]), (3.0, Hit::Wall(0), 10.0));
/// # Ok::<(), jostle_sim::SimError>(())
/// ```
pub struct Laser {
    config: LaserConfig,
    directions: Arc<Directions>,
    targets: Targets,
    ranges: Vec<Chunk>,
    codes: Vec<[u32; LANES]>,
}

/// [`Laser::sibling`]: a scanner remembers nothing from scan to scan.
impl Clone for Laser {
    fn clone(&self) -> Self {
        self.sibling()
    }
}

impl Laser {
    /// A scanner of the given kind.
    ///
    /// # Errors
    ///
    /// When a field of the configuration is out of range.
    pub fn new(config: &LaserConfig) -> Result<Self, SimError> {
        config.validate()?;
        Ok(Self {
            config: config.clone(),
            directions: Arc::new(Directions::new(config)),
            targets: Targets::default(),
            ranges: vec![[config.range; LANES]; config.beams.div_ceil(LANES)],
            codes: Vec::new(),
        })
    }

    /// Another scanner of the same kind that shares the beam directions.
    #[must_use]
    pub fn sibling(&self) -> Self {
        Self {
            config: self.config.clone(),
            directions: Arc::clone(&self.directions),
            targets: Targets::default(),
            ranges: self.ranges.clone(),
            codes: Vec::new(),
        }
    }

    /// The configuration.
    pub fn config(&self) -> &LaserConfig {
        &self.config
    }

    /// Takes a noise-free scan. `visible` says which bodies exist for this sensor (who sees whom).
    ///
    /// # Shapes
    ///
    /// `ranges`: one per beam, counter-clockwise; exactly the laser's range where nothing is met.
    ///
    /// # Panics
    ///
    /// When `ranges` is not one per beam.
    pub fn scan(
        &mut self,
        world: &World,
        sensor: Sensor,
        visible: impl Fn(usize) -> bool,
        ranges: &mut [f32],
    ) -> ScanSummary {
        assert_eq!(ranges.len(), self.config.beams, "one range per beam");
        let (pose, sees) = view(world, sensor, visible);
        match self.config.kernel {
            LaserKernel::Analytic => {
                self.targets.collect(world, pose, &sees, &self.config);
                let min_range = dispatch::cast(&self.directions, &self.targets, &mut self.ranges);
                ranges.copy_from_slice(&self.ranges.as_flattened()[..ranges.len()]);
                if !self.config.is_full_circle() {
                    return nearest::around(world, pose.position, &sees, self.config.range);
                }
                let beam = ranges.iter().position(|r| *r == min_range).unwrap_or(0);
                let nearest = analytic::identify(&self.directions, &self.targets, beam);
                ScanSummary { min_range, nearest }
            }
            LaserKernel::Parry => {
                oracle::cast(world, pose, &sees, &self.config, &self.directions, ranges, &mut [])
            }
        }
    }

    /// As [`Laser::scan`], and tells for every beam what it meets.
    ///
    /// # Panics
    ///
    /// When `ranges` or `hits` is not one per beam.
    pub fn scan_hits(
        &mut self,
        world: &World,
        sensor: Sensor,
        visible: impl Fn(usize) -> bool,
        ranges: &mut [f32],
        hits: &mut [Hit],
    ) -> ScanSummary {
        assert_eq!(hits.len(), self.config.beams, "one hit per beam");
        if self.config.kernel == LaserKernel::Parry {
            assert_eq!(ranges.len(), self.config.beams, "one range per beam");
            let (pose, sees) = view(world, sensor, visible);
            return oracle::cast(world, pose, &sees, &self.config, &self.directions, ranges, hits);
        }
        let summary = self.scan(world, sensor, visible, ranges);
        self.codes.clear();
        self.codes.resize(self.ranges.len(), [targets::NOTHING; LANES]);
        analytic::cast_codes(&self.directions, &self.targets, &mut self.ranges, &mut self.codes);
        for (hit, code) in hits.iter_mut().zip(self.codes.as_flattened()) {
            *hit = targets::decode(*code);
        }
        summary
    }
}

/// The sensor's pose, and a test of which bodies it sees: never the one that carries it.
fn view(world: &World, sensor: Sensor, visible: impl Fn(usize) -> bool) -> (Pose, impl Fn(usize) -> bool) {
    let (pose, own) = match sensor {
        Sensor::Body(body) => (world.pose(body), Some(body)),
        Sensor::Free(pose) => (pose, None),
    };
    (pose, move |body| Some(body) != own && visible(body))
}

/// (cos, sin) of a heading.
fn rotation(heading: f32) -> Vec2 {
    let (sin, cos) = sin_cos(heading);
    Vec2::new(cos, sin)
}
