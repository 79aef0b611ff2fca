//! The behaviour-conditioned actor and critic: definition, parameters, inference and gradients.
//!
//! Reading order: [`observation`] (the input row), [`encoder`] (fixed maps before a network),
//! [`config`] and [`layout`] (sizes, names, shapes), [`Parameters`], [`reference::model`] (the
//! networks, layer by layer), [`Network`] (the interface of every back end), [`backend`] (the one
//! place that chooses one, by an [`Engine`]), [`DiagonalGaussian`] (the distribution over actions),
//! [`PolicyFile`] (a trained policy on disk).

#![forbid(unsafe_code)]

pub mod backend;
pub mod batch;
mod checksum;
pub mod config;
pub mod device;
pub mod encoder;
pub mod error;
pub mod fast;
pub mod file;
pub mod gaussian;
pub mod layout;
pub mod names;
pub mod network;
pub mod observation;
pub mod parameters;
pub mod provenance;
pub mod reference;
pub mod tensor_file;
pub mod tensor_write;

pub use backend::{actor, critic};
pub use batch::Batch;
pub use checksum::hex;
pub use config::NetworkConfig;
pub use device::{Device, Engine};
pub use encoder::Encoder;
pub use error::PolicyError;
pub use file::{PolicyFile, Precision};
pub use gaussian::DiagonalGaussian;
pub use layout::Layout;
pub use names::{did_you_mean, nearest, offer};
pub use network::{Backend, Network};
pub use parameters::Parameters;
pub use provenance::Provenance;
pub use tensor_file::{TensorFile, excerpt};
pub use tensor_write::{TensorOut, Values, write_tensors};
