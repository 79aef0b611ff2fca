//! Behaviour discriminators, intrinsic rewards and the diversity metric D.
#![forbid(unsafe_code)]

mod config;
pub mod covariance;
pub mod cross_entropy;
pub mod divergence;
mod error;
pub mod input;
mod intrinsic;
mod layout;
pub mod principal;
pub mod reference;

pub use config::{ActionInput, DiscriminatorConfig, InputNoise};
pub use divergence::BehaviourActions;
pub use error::DiversityError;
pub use intrinsic::IntrinsicReward;
pub use layout::{DiscriminatorShape, discriminator};
