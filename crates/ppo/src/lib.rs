//! Algorithm 1: proximal policy optimisation with a diversity reward, resumable to the bit.
//!
//! Reading order: [`algorithm1`] (the paper from top to bottom), then its pure leaves [`gae`],
//! [`loss`], [`adam`] and [`minibatch`], the data they work on ([`rollout`]), what an update tells
//! ([`report`]), what each behaviour does ([`behaviours`]), frozen policies among the agents
//! ([`population`]), one run in several processes ([`ranks`]), the [`config`] and the
//! [`checkpoint`].
//!
//! Architecture invariant: nothing here logs, prints or reads a clock for a result. Seconds are
//! measured, and kept apart in [`Clock`]. Every random number comes from a stream named after the
//! root seed, the purpose and the update, so that a resumed run needs no generator's state of this
//! crate.
#![forbid(unsafe_code)]

pub mod adam;
pub mod algorithm1;
pub mod behaviours;
pub mod checkpoint;
pub mod config;
mod constraint;
mod error;
pub mod gae;
mod learner;
pub mod loss;
pub mod minibatch;
pub mod population;
pub mod ranks;
pub mod report;
pub mod rollout;
mod shard;

pub use algorithm1::Trainer;
pub use behaviours::BehaviourReport;
pub use config::{AlphaWeighs, Config, NetworkSection, PopulationConfig};
pub use error::PpoError;
pub use population::OpponentRecord;
pub use report::{Clock, UpdateReport};
