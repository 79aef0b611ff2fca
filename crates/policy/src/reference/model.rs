//! The actor and the critic of the paper (section III, "Network"; spec section 3), layer by layer.
//!
//! The same in PyTorch:
//!
//! ```text
//! x = relu(conv1(laser))                # [B, 3, 512] → [B, 32, 255]   kernel 5, stride 2, padding 1
//! x = relu(conv2(x))                    #             → [B, 32, 128]   kernel 3, stride 2, padding 1
//! laser_feature = relu(fc1(x.flatten(1)))           # → [B, 256]
//! hidden = relu(fc2(cat([laser_feature, goal, velocity, embedding(token)], 1)))   # 292 → [B, 128]
//! mean = cat([sigmoid(mean_v(hidden)), tanh(mean_w(hidden))], 1)      # actor  → [B, 2]
//! value = value(hidden)                                               # critic → [B, 1]
//! ```
//!
//! Everything here is made of candle operations, so a loss on the outputs can be differentiated by
//! candle.

use candle_core::{Result, Tensor};

use super::Weights;
use super::conv::conv1d;
use super::layers::{embedding, linear, relu};
use crate::config::NetworkConfig;
use crate::layout::Layout;
use crate::observation::TAIL_LEN;

/// A network as a pure function of its weights.
///
/// The actor and the critic implement it here, the discriminators in their own crate;
/// [`CandleNetwork`] puts any of them behind the [`Network`](crate::Network) interface.
///
/// [`CandleNetwork`]: super::CandleNetwork
pub trait Model: Send {
    /// Names and shapes of the weights.
    fn layout(&self) -> Layout;

    /// Values in one input row (of an actor or critic: what the [encoder](crate::encoder) makes of
    /// an observation row).
    fn observation_len(&self) -> usize;

    /// Tokens must be less than this.
    fn n_behaviours(&self) -> usize;

    /// Values per row of the output.
    fn n_outputs(&self) -> usize;

    /// The outputs.
    ///
    /// # Shapes
    ///
    /// `observations` `[B, observation_len]`, `tokens` `[B]` (U32) → `[B, n_outputs]`
    fn forward(&self, weights: &Weights, observations: &Tensor, tokens: &Tensor) -> Result<Tensor>;
}

/// The two inner layers of a trunk that a comparison may want to see.
#[derive(Debug, Clone)]
pub struct Features {
    /// `[B, 256]`, behind the ReLU of `fc1`.
    pub laser_feature: Tensor,
    /// `[B, 128]`, behind the ReLU of `fc2`.
    pub hidden: Tensor,
}

/// The layers that actor and critic have in common (each with weights of its own).
fn trunk(
    config: &NetworkConfig,
    weights: &Weights,
    observations: &Tensor,
    tokens: &Tensor,
) -> Result<Features> {
    if config.motion.is_some() {
        return perceptron(config, weights, observations, tokens);
    }
    let (batch, _observation_len) = observations.dims2()?;
    let (frames, beams) = (config.frames, config.input_beams());
    let laser = observations.narrow(1, 0, frames * beams)?.reshape((batch, frames, beams))?;
    let goal_and_velocity = observations.narrow(1, frames * beams, TAIL_LEN)?;

    // Channels last from here to the flattening: [B, 3, 512] → [B, 512, 3].
    let xs = laser.transpose(1, 2)?.contiguous()?;
    let xs = relu(&conv1d(&xs, weights, "conv1")?)?;
    let xs = relu(&conv1d(&xs, weights, "conv2")?)?;
    // PyTorch flattens channel by channel: index = channel·128 + position.
    let flat = xs.transpose(1, 2)?.flatten_from(1)?;
    let laser_feature = relu(&linear(&flat, weights, "fc1")?)?;

    let embedding = embedding(tokens, weights, "embedding")?;
    let concat = Tensor::cat(&[&laser_feature, &goal_and_velocity, &embedding], 1)?;
    let hidden = relu(&linear(&concat, weights, "fc2")?)?;
    Ok(Features { laser_feature, hidden })
}

/// The trunk of a network that reads bodies with their velocities ([`crate::encoder::motion`]):
///
/// ```text
/// feature = relu(fc1(cat([inputs, one_hot(token)], 1)))   # [B, inputs + M] → [B, laser_feature]
/// hidden  = relu(fc2(feature))                            #                 → [B, hidden]
/// ```
fn perceptron(
    config: &NetworkConfig,
    weights: &Weights,
    inputs: &Tensor,
    tokens: &Tensor,
) -> Result<Features> {
    let ones = Tensor::eye(config.n_behaviours, inputs.dtype(), inputs.device())?.index_select(tokens, 0)?;
    let laser_feature = relu(&linear(&Tensor::cat(&[inputs, &ones], 1)?, weights, "fc1")?)?;
    let hidden = relu(&linear(&laser_feature, weights, "fc2")?)?;
    Ok(Features { laser_feature, hidden })
}

/// The policy: mean of v through a sigmoid, mean of ω through tanh. Its `log_std` is no function of
/// the input and stays with the caller ([`DiagonalGaussian`](crate::DiagonalGaussian)).
#[derive(Debug, Clone)]
pub struct Actor {
    config: NetworkConfig,
}

impl Actor {
    /// An actor of these sizes.
    pub fn new(config: &NetworkConfig) -> Self {
        Self { config: config.clone() }
    }

    /// The inner layers.
    pub fn features(&self, weights: &Weights, observations: &Tensor, tokens: &Tensor) -> Result<Features> {
        trunk(&self.config, weights, observations, tokens)
    }
}

impl Model for Actor {
    fn layout(&self) -> Layout {
        Layout::actor(&self.config)
    }

    fn observation_len(&self) -> usize {
        self.config.input_len()
    }

    fn n_behaviours(&self) -> usize {
        self.config.n_behaviours
    }

    fn n_outputs(&self) -> usize {
        2
    }

    fn forward(&self, weights: &Weights, observations: &Tensor, tokens: &Tensor) -> Result<Tensor> {
        let hidden = self.features(weights, observations, tokens)?.hidden;
        let mean_v = candle_nn::ops::sigmoid(&linear(&hidden, weights, "mean_v")?)?;
        let mean_w = linear(&hidden, weights, "mean_w")?.tanh()?;
        Tensor::cat(&[&mean_v, &mean_w], 1)
    }
}

/// The value function, in units of the return.
#[derive(Debug, Clone)]
pub struct Critic {
    config: NetworkConfig,
}

impl Critic {
    /// A critic of these sizes.
    pub fn new(config: &NetworkConfig) -> Self {
        Self { config: config.clone() }
    }

    /// The inner layers.
    pub fn features(&self, weights: &Weights, observations: &Tensor, tokens: &Tensor) -> Result<Features> {
        trunk(&self.config, weights, observations, tokens)
    }
}

impl Model for Critic {
    fn layout(&self) -> Layout {
        Layout::critic(&self.config)
    }

    fn observation_len(&self) -> usize {
        self.config.input_len()
    }

    fn n_behaviours(&self) -> usize {
        self.config.n_behaviours
    }

    fn n_outputs(&self) -> usize {
        1
    }

    fn forward(&self, weights: &Weights, observations: &Tensor, tokens: &Tensor) -> Result<Tensor> {
        linear(&self.features(weights, observations, tokens)?.hidden, weights, "value")
    }
}
