//! Work U: one update's learning at the size of the paper's runs, and each network's part of it.
//!
//! 640 transitions in one full batch; three epochs each of actor, critic and both discriminators:
//! forward, backward and Adam. The loss is the mean of the squared outputs, so that other software
//! can do the same without the rest of PPO.

use jostle_diversity::{DiscriminatorShape, discriminator};
use jostle_policy::{Backend, Batch, Network, NetworkConfig, Parameters, actor, critic};
use jostle_ppo::adam::Adam;
use jostle_sim::OBSERVATION_LEN;
use rand::Rng;

use crate::clock::Stopwatch;
use crate::error::BenchError;
use crate::scenes::stream;

/// Transitions of an update: a horizon of 128 steps, five agents.
pub const TRANSITIONS: usize = 640;
/// Passes of each network over them.
pub const EPOCHS: usize = 3;
/// Behaviours M.
pub const N_BEHAVIOURS: usize = 5;
/// Multiply-adds for one sample of conv1, conv2, fc1 and fc2; the heads are left out.
pub const TRUNK: [f64; 4] = [255.0 * 480.0, 128.0 * 3072.0, 4096.0 * 256.0, 292.0 * 128.0];
/// Units of a discriminator's hidden layers.
const HIDDEN: usize = 128;
const LEARNING_RATE: f64 = 5e-5;

/// Seconds of one epoch.
#[derive(Debug, Clone, Copy, Default)]
pub struct EpochSeconds {
    /// The outputs.
    pub forward: f64,
    /// The gradient.
    pub backward: f64,
    /// The step of Adam, and what the network makes ready from the new parameters.
    pub step: f64,
}

/// A network, its optimiser and its inputs.
pub struct Learner {
    name: &'static str,
    network: Box<dyn Network>,
    adam: Adam,
    width: usize,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    outputs: Vec<f32>,
    d_outputs: Vec<f32>,
    /// Multiply-adds of one sample's forward and backward pass.
    multiply_adds: [f64; 2],
}

impl Learner {
    fn new(
        name: &'static str,
        mut network: Box<dyn Network>,
        width: usize,
        multiply_adds: [f64; 2],
        rng: &mut impl Rng,
    ) -> Self {
        let n_parameters = network.parameters_and_gradient().0.len();
        let n_outputs = TRANSITIONS * network.n_outputs();
        let mut value = || rng.next_u32() as f32 / u32::MAX as f32 - 0.5;
        Self {
            name,
            adam: Adam::new(n_parameters, LEARNING_RATE),
            network,
            width,
            observations: (0..TRANSITIONS * width).map(|_| value()).collect(),
            tokens: (0..TRANSITIONS as u32).map(|row| row % N_BEHAVIOURS as u32).collect(),
            outputs: vec![0.0; n_outputs],
            d_outputs: vec![0.0; n_outputs],
            multiply_adds,
        }
    }

    /// Its name in tables.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Operations of an epoch's forward and backward pass; a multiply-add counts as two.
    pub fn flop(&self) -> [f64; 2] {
        self.multiply_adds.map(|count| 2.0 * count * TRANSITIONS as f64)
    }

    /// One epoch over the whole batch.
    pub fn epoch(&mut self, threads: usize) -> EpochSeconds {
        let watch = Stopwatch::start(threads);
        self.network.forward(Batch::new(&self.observations, &self.tokens), &mut self.outputs);
        let forward = watch.seconds();
        let scale = 2.0 / self.outputs.len() as f32;
        self.d_outputs.iter_mut().zip(&self.outputs).for_each(|(d, output)| *d = scale * output);
        self.network.backward(&self.d_outputs);
        let backward = watch.seconds();
        let (parameters, gradient) = self.network.parameters_and_gradient();
        self.adam.step(parameters, gradient);
        self.network.parameters_changed();
        EpochSeconds { forward, backward: backward - forward, step: watch.seconds() - backward }
    }

    fn epochs(&mut self, threads: usize) {
        for _ in 0..EPOCHS {
            self.epoch(threads);
        }
    }

    /// Inference of the first `batch` rows, without a gradient.
    ///
    /// # Panics
    ///
    /// When `batch` is above [`TRANSITIONS`].
    pub fn infer(&mut self, batch: usize) {
        let outputs = &mut self.outputs[..batch * self.network.n_outputs()];
        let observations = &self.observations[..batch * self.width];
        self.network.infer(Batch::new(observations, &self.tokens[..batch]), outputs);
    }
}

/// The four learners of an update.
pub struct WorkU {
    /// Policy π(a | o, z).
    pub actor: Learner,
    /// Value function V(o, z).
    pub critic: Learner,
    /// Discriminator q(z | s, a).
    pub q_state_action: Learner,
    /// Discriminator q(z | s).
    pub q_state: Learner,
}

impl WorkU {
    /// Fresh networks of the fast back end at the paper's sizes.
    ///
    /// # Errors
    ///
    /// None that a build for this workspace's sizes can show; the networks' constructors could
    /// refuse.
    pub fn new() -> Result<Self, BenchError> {
        let config = NetworkConfig { n_behaviours: N_BEHAVIOURS, ..NetworkConfig::default() };
        let rng = &mut stream("work.u");
        let of_actor = actor(&config, Backend::Fast, &Parameters::actor(&config, rng))?;
        let of_critic = critic(&config, Backend::Fast, &Parameters::critic(&config, rng))?;
        let forward: f64 = TRUNK.iter().sum();
        // The gradient of the observation is not needed, so conv1 has half a backward pass.
        let trunk = [forward, 2.0 * forward - TRUNK[0]];
        Ok(Self {
            actor: Learner::new("actor", of_actor, OBSERVATION_LEN, trunk, rng),
            critic: Learner::new("critic", of_critic, OBSERVATION_LEN, trunk, rng),
            q_state_action: q("q(z given s, a)", OBSERVATION_LEN + 2, rng)?,
            q_state: q("q(z given s)", OBSERVATION_LEN, rng)?,
        })
    }

    /// All four, one after the other in the list.
    pub fn each(&mut self) -> [&mut Learner; 4] {
        [&mut self.actor, &mut self.critic, &mut self.q_state_action, &mut self.q_state]
    }

    /// The whole work: the networks side by side, as the trainer runs them.
    pub fn run(&mut self, threads: usize) {
        let Self { actor, critic, q_state_action, q_state } = self;
        rayon::join(
            || rayon::join(|| actor.epochs(threads), || critic.epochs(threads)),
            || rayon::join(|| q_state_action.epochs(threads), || q_state.epochs(threads)),
        );
    }

    /// Operations of the whole work.
    pub fn flop(&mut self) -> f64 {
        self.each().iter().flat_map(|learner| learner.flop()).sum::<f64>() * EPOCHS as f64
    }
}

fn q(name: &'static str, n_inputs: usize, rng: &mut impl Rng) -> Result<Learner, BenchError> {
    let shape = DiscriminatorShape { n_inputs, hidden: HIDDEN, n_behaviours: N_BEHAVIOURS };
    let network = discriminator(shape, Backend::Fast, &Parameters::init(shape.layout(), rng))?;
    let input = (n_inputs * HIDDEN) as f64;
    let forward = input + (HIDDEN * HIDDEN) as f64;
    Ok(Learner::new(name, network, n_inputs, [forward, 2.0 * forward - input], rng))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_u_is_39_gflop_and_runs() {
        let mut work = WorkU::new().expect("the paper's sizes");
        assert!((work.flop() / 39.4e9 - 1.0).abs() < 0.01, "{}", work.flop());
        let before = work.actor.outputs.clone();
        work.actor.infer(5);
        assert_ne!(before, work.actor.outputs);
    }
}
