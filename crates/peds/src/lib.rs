//! Crowd models: ORCA, social force, learned pedestrians, walkers for validation and recorded
//! people behind one trait.
//!
//! Reading order: `crowd` (the trait and what passes through it), `name`, `kind` (the built-in
//! crowds), `visibility` (who sees whom), `config`, [`orca`], [`social_force`], [`validation`],
//! [`recorded`], `learned`.
//!
//! Architecture invariant: the pure models know neither the simulator nor a network; only the
//! feature `learned` brings in `jostle-policy`.
//!
//! # Features
//!
//! `learned` (off by default): pedestrians driven by trained policies, `LearnedCrowd`.
//!
//! # Examples
//!
//! Two pedestrians that walk towards each other make way by ORCA.
//!
//! ```
//! use std::sync::Arc;
//!
//! use jostle_peds::glam::Vec2;
//! use jostle_peds::orca::{Obstacles, OrcaCrowd};
//! use jostle_peds::{Crowd, CrowdsConfig, Command, Pedestrian, RoomView};
//!
//! let config = CrowdsConfig::default();
//! let mut crowd = OrcaCrowd::new(&config.orca, config.visibility.vo, 0.1, Arc::new(Obstacles::default()))?;
//! let walker = |x: f32, y: f32| Pedestrian {
//!     position: Vec2::new(x, y),
//!     velocity: Vec2::new(-x.signum(), 0.0),
//!     heading: 0.0,
//!     goal: Vec2::new(-x, y),
//! };
//! let room = RoomView {
//!     pedestrians: &[walker(-2.0, 0.0), walker(2.0, 0.1)],
//!     others: &[],
//!     observations: &[],
//!     speed_factor: &[],
//! };
//! let mut commands = [Command::STILL; 2];
//! crowd.decide(&[room], &mut commands)?;
//! let Command::Walk { velocity } = commands[0] else { unreachable!("ORCA walks") };
//! assert!(velocity.x > 0.5 && velocity.y < 0.0, "it goes on, to the right of the other");
//! # Ok::<(), jostle_peds::PedsError>(())
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]
#![forbid(unsafe_code)]

mod config;
mod crowd;
mod error;
mod kind;
#[cfg(feature = "learned")]
mod learned;
mod name;
pub mod orca;
pub mod recorded;
pub mod social_force;
pub mod validation;
mod visibility;

// Vectors of the interface.
pub use glam;
// Generators of the interface.
#[cfg(feature = "learned")]
pub use jostle_policy as policy;
pub use rand;

pub use config::{CrowdsConfig, LearnedConfig};
pub use crowd::{Command, Crowd, Pedestrian, RoomView};
pub use error::{MAGNITUDE_LIMIT, PedsError};
pub use kind::CrowdKind;
#[cfg(feature = "learned")]
pub use learned::LearnedCrowd;
pub use name::{CrowdName, NAME_MAX};
pub use visibility::{Visibility, VisibilityMatrix};
