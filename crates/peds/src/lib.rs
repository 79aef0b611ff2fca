//! Crowd models: ORCA, social force, learned pedestrians and walkers for validation behind one trait.
//!
//! Reading order: `crowd` (the trait and what passes through it), `kind` (names), `visibility` (who sees whom), `config`, [`orca`],
//! [`social_force`], [`validation`], `learned`.
//!
//! Architecture invariant: the pure models know neither the simulator nor a network; only the feature `learned` brings in
//! `jostle-policy`.

#![forbid(unsafe_code)]

mod config;
mod crowd;
mod error;
mod kind;
#[cfg(feature = "learned")]
mod learned;
pub mod orca;
pub mod social_force;
pub mod validation;
mod visibility;

pub use config::{CrowdsConfig, LearnedConfig};
pub use crowd::{Crowd, Motion, Pedestrian, RoomView};
pub use error::{MAGNITUDE_LIMIT, PedsError};
pub use kind::{CrowdKind, CrowdName, NAME_MAX};
#[cfg(feature = "learned")]
pub use learned::LearnedCrowd;
pub use visibility::{Visibility, VisibilityMatrix};
