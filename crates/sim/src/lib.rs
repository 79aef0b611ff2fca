//! A fast, deterministic 2D world of laser robots among people, and the decision process on top of
//! it.
//!
//! Reading order: [`SimConfig`]; [`World`] (poses, motion, overlaps); [`Laser`]; [`Observer`],
//! [`reward`], [`Spawner`]; and [`Rooms`], which puts them together for the learner.
//!
//! Architecture invariants: the world knows no reward; no result depends on the clock, on the
//! number of threads, on CPU features or on the order of a hash map; after construction the hot
//! path neither fails nor allocates.
//!
//! # Features
//!
//! All are on by default. `dynamics` lets rapier's solver move robots that have mass
//! ([`Dynamics::Rapier`]). Each of the others is for a kind of map file: `toml` (polygon maps),
//! `yaml` (ROS occupancy grids) and `png` (their images; PGM and PPM need no feature). Polygon maps
//! as JSON are always read.
//!
//! # Examples
//!
//! A robot drives 4 m, until its laser sees the wall about 1 m ahead.
//!
//! ```
//! use jostle_sim::glam::Vec2;
//! use jostle_sim::{Hit, Laser, LaserConfig, Motion, Pose, Sensor, Shape, World};
//!
//! let mut world = World::new();
//! world.set_walls(Vec2::splat(-5.0), Vec2::splat(5.0))?;
//! let robot = world.add_body(&Shape::square(0.5), Pose::default())?;
//! let mut laser = Laser::new(&LaserConfig::default())?;
//! let mut ranges = vec![0.0; 512];
//! let mut steps = 0;
//! while laser.scan(&world, Sensor::Body(robot), |_| true, &mut ranges).min_range > 1.05 {
//!     world.advance(&[Motion::Drive { v: 1.0, w: 0.0 }], 0.1, &mut [false]);
//!     steps += 1;
//! }
//! assert_eq!(steps, 40);
//! # Ok::<(), jostle_sim::SimError>(())
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]
// `forbid` is not possible here: `laser::dispatch` calls functions compiled for CPU features found
// at run time.
#![deny(unsafe_code)]

mod boundary;
mod config;
mod crash;
#[cfg(test)]
mod crowd_tests;
mod dynamics;
mod episode;
mod error;
mod free_space;
mod geometry;
mod laser;
pub mod maps;
mod motion;
mod observation;
mod renewal;
mod reward;
mod rng;
mod room;
mod rooms;
mod scenario;
mod solid;
mod spawn;
mod state;
mod traits;
mod trig;
mod world;

// Vectors of the interface.
pub use glam;
// Generators of the interface.
pub use rand;

pub use boundary::outline;
pub use config::{
    AccelerationLimits, BaseConfig, Dynamics, EXTRAS, EpisodeConfig, FRAMES, LaserConfig, LaserKernel,
    NamingFolder, OBSERVATION_LEN, RewardConfig, RobotConfig, RoomConfig, SafetyZoneConfig, SimConfig,
    SpawnConfig,
};
pub use crash::{CrashRule, crash};
pub use dynamics::DriveState;
pub use episode::{EpisodeSummary, Outcome, StepEnd, Transition};
pub use error::SimError;
pub use geometry::{Pose, Shape};
pub use laser::{Hit, Laser, NoiseSource, ScanScene, ScanSummary, SceneScan, Sensor};
pub use motion::{Motion, apply_limits, clip_action};
pub use observation::Observer;
pub use reward::{ZoneBody, outcome, reward, safety_zone};
pub use rng::{StreamRng, Streams};
pub use room::Whereabouts;
pub use rooms::{Rooms, RoomsMut};
pub use scenario::{REACH, Scenario, TracedArea};
pub use spawn::Spawner;
pub use state::RoomsState;
pub use traits::{Role, TrainingCrowd};
pub use trig::wrap_angle;
pub use world::{Stop, World};
