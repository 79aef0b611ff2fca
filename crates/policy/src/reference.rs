//! The reference back end: the networks as candle models, gradients by candle's autograd.
//!
//! This is the definition to read. Start with [`model`] (the actor and the critic, layer by layer),
//! then [`conv`] (why the convolution is written by hand), then [`network`] (the model behind the
//! [`Network`](crate::Network) interface).
//!
//! # Departures
//!
//! - candle's `conv1d` is not used: in 0.11.1 its backward pass on the CPU gives wrong weight
//!   gradients, silently (huggingface/candle #3836). `tests/gradients.rs` shows the fault and pins
//!   our own gradients.
//! - candle's ReLU passes the gradient on where its input is exactly 0; ours, as PyTorch's, does
//!   not ([`layers::relu`]).

pub mod conv;
pub mod layers;
pub mod model;
pub mod network;
pub mod weights;

pub use model::{Actor, Critic, Features, Model};
pub use network::CandleNetwork;
pub use weights::Weights;
