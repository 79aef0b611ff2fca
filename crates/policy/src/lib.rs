//! The behaviour-conditioned actor and critic: definition, parameters, inference and gradients.
//!
//! Reading order: [`observation`] (what goes in), [`config`] and [`layout`] (sizes, names, shapes), [`Parameters`],
//! [`Network`] (what every back end does).

#![forbid(unsafe_code)]

pub mod batch;
pub mod config;
pub mod error;
pub mod layout;
pub mod network;
pub mod observation;
pub mod parameters;

pub use batch::Batch;
pub use config::NetworkConfig;
pub use error::PolicyError;
pub use layout::Layout;
pub use network::{Backend, Network};
pub use parameters::Parameters;
