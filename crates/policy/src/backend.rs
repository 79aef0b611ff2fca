//! The one place that chooses what computes the networks.
//!
//! The switch is [`Backend`], the field `backend` of a training config. Nothing is chosen in silence: asking for a
//! device that is not there is an error.

use crate::fast::FastNetwork;
use crate::reference::{Actor, CandleNetwork, Critic, default_device};
use crate::{Backend, Network, NetworkConfig, Parameters, PolicyError};

/// An actor: outputs `[B, 2]`, the means of v and ω.
///
/// # Errors
///
/// [`PolicyError::Config`] for sizes out of bounds, [`PolicyError::Parameters`] if the parameters are not an actor's of
/// these sizes, [`PolicyError::Candle`] if the reference back end's device is not there.
pub fn actor(
    config: &NetworkConfig,
    backend: Backend,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    config.validate()?;
    match backend {
        Backend::Fast => Ok(Box::new(FastNetwork::actor(config, parameters)?)),
        Backend::Reference => {
            Ok(Box::new(CandleNetwork::new(Actor::new(config), parameters, default_device()?)?))
        }
    }
}

/// A critic: outputs `[B, 1]`, the value.
///
/// # Errors
///
/// As [`actor`].
pub fn critic(
    config: &NetworkConfig,
    backend: Backend,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, PolicyError> {
    config.validate()?;
    match backend {
        Backend::Fast => Ok(Box::new(FastNetwork::critic(config, parameters)?)),
        Backend::Reference => {
            Ok(Box::new(CandleNetwork::new(Critic::new(config), parameters, default_device()?)?))
        }
    }
}
