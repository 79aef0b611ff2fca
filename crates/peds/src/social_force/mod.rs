//! The social force model in double precision.
//!
//! A pedestrian is a point that accelerates towards its goal and away from others and from walls;
//! those out of its view count less. Reading order: `config` (parameters and variants), `border`
//! (what walls are), `forces` (the four terms), `model` (their sum and the Euler step), `crowd`
//! (crowd SF on top).
//!
//! # Departures
//! - The semi-minor axis b is floored at [`SocialForceConfig::b_min`]: the article's gradient is
//!   unbounded at b = 0.
//! - At the nearest point of a border (distance 0) its repulsion has no direction and is 0.
//!
//! # References
//! D. Helbing, P. Molnár, "Social force model for pedestrian dynamics", Phys. Rev. E 51 (1995)
//! 4282, doi:10.1103/PhysRevE.51.4282. Where the article leaves a choice, the variants are those of
//! the Python package socialforce.

mod border;
mod config;
mod crowd;
mod forces;
mod model;

pub use border::Border;
pub use config::{DesiredSpeed, SocialForceConfig, Variant, ViewTest};
pub use crowd::SocialForceCrowd;
pub use model::{Forces, SocialForce, Walker};
