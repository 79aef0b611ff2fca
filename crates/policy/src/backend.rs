//! The one place that chooses the back end of a network.
//!
//! The switch is an [`Engine`]: the fields `backend` and `device` of a training config, or a
//! [`Backend`] alone for the CPU. Nothing is chosen in silence: asking for a device that is not
//! there is an error.
//!
//! [`actor`] and [`critic`] take observation rows. [`actor_of_inputs`] and [`critic_of_inputs`] are
//! the same networks behind the [encoder](crate::encoder): a learner encodes a row once and reads
//! it many times.

use crate::config::NetworkConfig;
use crate::device::Engine;
use crate::encoder::Encoder;
use crate::encoder::encoded::EncodedNetwork;
use crate::error::PolicyError;
use crate::fast::{FastNetwork, Mlp};
use crate::network::{Backend, Network};
use crate::parameters::Parameters;
use crate::reference::{Actor, CandleNetwork, Critic};

/// An actor: outputs `[B, 2]`, the means of v and ω, of observation rows.
///
/// # Errors
///
/// [`PolicyError::Config`] for sizes out of bounds and for a device that this build or this machine
/// lacks or the back end does not know, [`PolicyError::Parameters`] if the parameters are not an
/// actor's of these sizes, [`PolicyError::Candle`] if the reference back end's device refuses an
/// operation.
pub fn actor(
    config: &NetworkConfig,
    engine: impl Into<Engine>,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    Ok(behind_encoder(config, actor_of_inputs(config, engine, parameters)?))
}

/// A critic: outputs `[B, 1]`, the value, of observation rows.
///
/// # Errors
///
/// As [`actor`].
pub fn critic(
    config: &NetworkConfig,
    engine: impl Into<Engine>,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    Ok(behind_encoder(config, critic_of_inputs(config, engine, parameters)?))
}

/// An actor that takes input rows of [`NetworkConfig::input_len`] values.
///
/// # Errors
///
/// As [`actor`].
pub fn actor_of_inputs(
    config: &NetworkConfig,
    engine: impl Into<Engine>,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    config.validate()?;
    let engine = engine.into();
    engine.validate()?;
    Ok(match engine.backend {
        Backend::Fast if config.motion.is_some() => Box::new(Mlp::actor(config, parameters)?),
        Backend::Fast => Box::new(FastNetwork::actor(config, parameters)?),
        Backend::Reference => {
            Box::new(CandleNetwork::new(Actor::new(config), parameters, engine.device.open()?)?)
        }
    })
}

/// A critic that takes input rows of [`NetworkConfig::input_len`] values.
///
/// # Errors
///
/// As [`actor`].
pub fn critic_of_inputs(
    config: &NetworkConfig,
    engine: impl Into<Engine>,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    config.validate()?;
    let engine = engine.into();
    engine.validate()?;
    Ok(match engine.backend {
        Backend::Fast if config.motion.is_some() => Box::new(Mlp::critic(config, parameters)?),
        Backend::Fast => Box::new(FastNetwork::critic(config, parameters)?),
        Backend::Reference => {
            Box::new(CandleNetwork::new(Critic::new(config), parameters, engine.device.open()?)?)
        }
    })
}

fn behind_encoder(config: &NetworkConfig, network: Box<dyn Network>) -> Box<dyn Network> {
    let encoder = Encoder::new(config);
    if encoder.is_identity() { network } else { Box::new(EncodedNetwork::new(encoder, network)) }
}
