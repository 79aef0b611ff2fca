//! Crowd models: ORCA, social force and learned pedestrians behind one trait.
//!
//! Reading order: `crowd` (the trait and what passes through it), `visibility` (who sees whom), `config`, [`orca`], [`social_force`], `learned`.
//!
//! Architecture invariant: the pure models know neither the simulator nor a network; only the feature `learned` brings in
//! `jostle-policy`.

#![forbid(unsafe_code)]

mod config;
mod crowd;
mod error;
#[cfg(feature = "learned")]
mod learned;
pub mod orca;
pub mod social_force;
mod visibility;

pub use config::{CrowdsConfig, LearnedConfig};
pub use crowd::{Crowd, CrowdKind, Motion, Pedestrian, RoomView};
pub use error::{MAGNITUDE_LIMIT, PedsError};
#[cfg(feature = "learned")]
pub use learned::LearnedCrowd;
pub use visibility::{Visibility, VisibilityMatrix};
