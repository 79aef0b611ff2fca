//! One update's learning on two engines, side by side: the losses of every minibatch of actor,
//! critic and a discriminator.
//!
//! Both sides learn from the same rows, drawn from one stream: rollouts of two engines would part
//! ways as soon as one action differed in its last bit.

use jostle_diversity::{DiscriminatorShape, cross_entropy, discriminator};
use jostle_policy::backend::{actor_of_inputs, critic_of_inputs};
use jostle_policy::{
    Backend, Batch, Device, DiagonalGaussian, Engine, Network, NetworkConfig, Parameters, PolicyError,
};
use jostle_ppo::adam::Adam;
use jostle_ppo::loss::{PolicyLossWeights, PolicyTargets, policy_loss, value_loss};
use rand::Rng;

use crate::error::BenchError;
use crate::scenes::stream;

const EPOCHS: usize = 3;
const LEARNING_RATE: f64 = 5e-5;
const LOG_STD: [f32; 2] = [-0.5; 2];
const HIDDEN: usize = 128;

/// How far the losses of a network are apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Parity {
    /// The network.
    pub network: &'static str,
    /// Minibatches of the update.
    pub minibatches: usize,
    /// Largest relative difference of a loss.
    pub worst: f64,
}

/// A loss of outputs for some rows; writes the gradient of the outputs.
type Loss<'a> = dyn Fn(&[f32], &[u32], &mut [f32]) -> f64 + 'a;

/// The rows of an update, with what a rollout would have made of them.
struct Rows {
    inputs: Vec<f32>,
    tokens: Vec<u32>,
    actions: Vec<[f32; 2]>,
    old_log_probs: Vec<f64>,
    advantages: Vec<f64>,
    returns: Vec<f64>,
}

impl Rows {
    fn new(config: &NetworkConfig, n: usize, rng: &mut impl Rng) -> Self {
        let width = config.input_len();
        let mut value = || f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5;
        let inputs: Vec<f32> = (0..n * width).map(|_| value() as f32).collect();
        let actions: Vec<[f32; 2]> = (0..n).map(|_| [0; 2].map(|_| 2.0 * value() as f32)).collect();
        let old_log_probs = actions
            .iter()
            .map(|&action| DiagonalGaussian { mean: [0.0; 2], log_std: LOG_STD }.log_prob(action))
            .collect();
        // What is learned has to be there to be learned: both follow from the inputs.
        let of_row = |row: usize| f64::from(inputs[row * width]);
        let advantages = (0..n).map(|row| 4.0 * of_row(row)).collect();
        let returns = (0..n).map(|row| 10.0 + 20.0 * of_row(row)).collect();
        let tokens = (0..n).map(|row| (row % config.n_behaviours) as u32).collect();
        Self { inputs, tokens, actions, old_log_probs, advantages, returns }
    }

    /// The losses of all minibatches while a network learns.
    fn learn(&self, mut network: Box<dyn Network>, minibatch: usize, loss: &Loss<'_>) -> Vec<f64> {
        let mut adam = Adam::new(network.parameters_and_gradient().0.len(), LEARNING_RATE);
        let rows: Vec<u32> = (0..self.tokens.len() as u32).collect();
        let mut losses = Vec::new();
        for rows in (0..EPOCHS).flat_map(|_| rows.chunks(minibatch)) {
            let mut outputs = vec![0.0; rows.len() * network.n_outputs()];
            let mut d_outputs = outputs.clone();
            network.forward(Batch::subset(&self.inputs, &self.tokens, rows), &mut outputs);
            losses.push(loss(&outputs, rows, &mut d_outputs));
            network.backward(&d_outputs);
            let (parameters, gradient) = network.parameters_and_gradient();
            adam.step(parameters, gradient);
            network.parameters_changed();
        }
        losses
    }
}

/// Lets both engines learn from `n` rows in minibatches.
///
/// # Errors
///
/// When an engine's device is not there.
pub fn one_update(
    config: &NetworkConfig,
    n: usize,
    minibatch: usize,
    engines: [Engine; 2],
) -> Result<[Parity; 3], BenchError> {
    let rng = &mut stream("parity");
    let rows = Rows::new(config, n, rng);
    let shape = DiscriminatorShape {
        n_inputs: config.input_len(),
        hidden: HIDDEN,
        n_behaviours: config.n_behaviours,
    };
    let (theta, phi) = (Parameters::actor(config, rng), Parameters::critic(config, rng));
    let psi = Parameters::init(shape.layout(), rng);
    let of_policy = |outputs: &[f32], chosen: &[u32], d_outputs: &mut [f32]| {
        let Rows { actions, old_log_probs, advantages, .. } = &rows;
        let targets = PolicyTargets { actions, old_log_probs, advantages };
        let weights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 5e-4 };
        let ((means, _), (d_means, _)) = (outputs.as_chunks::<2>(), d_outputs.as_chunks_mut::<2>());
        policy_loss(means, LOG_STD, targets, chosen, weights, d_means).loss
    };
    let of_values = |outputs: &[f32], chosen: &[u32], d_outputs: &mut [f32]| {
        value_loss(outputs, &rows.returns, chosen, d_outputs)
    };
    let of_tokens = |outputs: &[f32], chosen: &[u32], d_outputs: &mut [f32]| {
        let tokens: Vec<u32> = chosen.iter().map(|&row| rows.tokens[row as usize]).collect();
        cross_entropy::evaluate_with_gradient(outputs, &tokens, d_outputs).loss
    };
    let side = |engine: Engine| -> Result<[Vec<f64>; 3], BenchError> {
        let actor = actor_of_inputs(config, engine, &theta)?;
        let critic = critic_of_inputs(config, engine, &phi)?;
        let q = discriminator(shape, engine, &psi)?;
        Ok([
            rows.learn(actor, minibatch, &of_policy),
            rows.learn(critic, minibatch, &of_values),
            rows.learn(q, minibatch, &of_tokens),
        ])
    };
    let [found, expected] = [side(engines[0])?, side(engines[1])?];
    let names = ["actor", "critic", "discriminator"];
    Ok(std::array::from_fn(|i| {
        let apart = found[i].iter().zip(&expected[i]).map(|(a, b)| (a - b).abs() / b.abs().max(1e-3));
        Parity { network: names[i], minibatches: found[i].len(), worst: apart.fold(0.0, f64::max) }
    }))
}

/// The engines of a device and of this processor's reference.
///
/// # Errors
///
/// When the device is not there, or this build has none of its kind.
pub fn engines(device: Device) -> Result<[Engine; 2], PolicyError> {
    device.open()?;
    Ok([device, Device::Cpu].map(|device| Engine { backend: Backend::Reference, device }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_back_ends_have_the_same_losses_on_the_processor() {
        let config = NetworkConfig { beams: 64, n_behaviours: 5, ..NetworkConfig::default() };
        let of = |backend, device| Engine { backend, device };
        let fast_and_reference = [of(Backend::Fast, Device::Cpu), of(Backend::Reference, Device::Cpu)];
        for parity in one_update(&config, 64, 16, fast_and_reference).unwrap() {
            assert_eq!(parity.minibatches, 12);
            assert!(parity.worst < 1e-4, "{parity:?}");
        }
        let [device, processor] = engines(Device::Cpu).unwrap();
        assert!(one_update(&config, 32, 16, [device, processor]).unwrap().iter().all(|p| p.worst == 0.0));
    }
}
