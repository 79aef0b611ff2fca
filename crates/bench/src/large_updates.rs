//! A learner's work in a large update, all of it but the simulator: actions step by step, values of
//! the rollout, and shuffled minibatches for actor and critic.
//!
//! As in work U the loss is the mean of the squared outputs, so that other software can do the same
//! without the rest of PPO, which costs both sides a few percent. There is one behaviour, so nobody
//! asks a discriminator.

use jostle_policy::backend::{actor_of_inputs, critic_of_inputs};
use jostle_policy::encoder::motion::MotionInputs;
use jostle_policy::{Backend, Batch, Network, NetworkConfig, Parameters};
use jostle_ppo::adam::Adam;
use jostle_ppo::minibatch::shuffle;
use rand::Rng;

use crate::error::BenchError;
use crate::scenes::stream;

const LEARNING_RATE: f64 = 5e-4;

/// Sizes of an update and its networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// The paper's network; 80 agents, 100 steps, minibatches of 1,000, three epochs.
    Paper,
    /// The paper's network over 128 pooled beams; 160 agents, 64 steps, minibatches of 512, one
    /// epoch.
    Pooled,
    /// Bodies with their velocities into a perceptron of 256 and 128 units; 384 agents, 64 steps,
    /// minibatches of 1,024, two epochs: `configs/strong.toml`.
    Motion,
}

impl Shape {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Pooled, Self::Motion];

    /// Its name in `learner-NAME`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Pooled => "pooled",
            Self::Motion => "motion",
        }
    }

    fn sizes(self) -> Sizes {
        let network = NetworkConfig { n_behaviours: 1, ..NetworkConfig::default() };
        match self {
            Self::Paper => Sizes { network, n_agents: 80, n_steps: 100, minibatch: 1000, n_epochs: 3 },
            Self::Pooled => {
                let network = NetworkConfig { scan_pool: 4, ..network };
                Sizes { network, n_agents: 160, n_steps: 64, minibatch: 512, n_epochs: 1 }
            }
            Self::Motion => {
                let motion = Some(MotionInputs { dt: 0.1, v_max: 1.0, w_max: 1.0 });
                let network = NetworkConfig { motion, ..network };
                Sizes { network, n_agents: 384, n_steps: 64, minibatch: 1024, n_epochs: 2 }
            }
        }
    }
}

struct Sizes {
    network: NetworkConfig,
    n_agents: usize,
    n_steps: usize,
    minibatch: usize,
    n_epochs: usize,
}

/// Actor and critic with a rollout of input rows.
pub struct LargeUpdate {
    sizes: Sizes,
    inputs: Vec<f32>,
    tokens: Vec<u32>,
    /// The rows in a shuffled order.
    order: Vec<u32>,
    actor: Half,
    critic: Half,
}

/// A network with its optimiser.
struct Half {
    network: Box<dyn Network>,
    adam: Adam,
    outputs: Vec<f32>,
    d_outputs: Vec<f32>,
}

impl Half {
    fn new(mut network: Box<dyn Network>, n_rows: usize) -> Self {
        let adam = Adam::new(network.parameters_and_gradient().0.len(), LEARNING_RATE);
        let outputs = vec![0.0; n_rows * network.n_outputs()];
        Self { network, adam, d_outputs: outputs.clone(), outputs }
    }

    fn infer(&mut self, batch: Batch<'_>) {
        let n = batch.len() * self.network.n_outputs();
        self.network.infer(batch, &mut self.outputs[..n]);
    }

    fn learn(&mut self, batch: Batch<'_>) {
        let n = batch.len() * self.network.n_outputs();
        let (outputs, d_outputs) = (&mut self.outputs[..n], &mut self.d_outputs[..n]);
        self.network.forward(batch, outputs);
        let scale = 2.0 / n as f32;
        d_outputs.iter_mut().zip(outputs).for_each(|(d, output)| *d = scale * *output);
        self.network.backward(d_outputs);
        let (parameters, gradient) = self.network.parameters_and_gradient();
        self.adam.step(parameters, gradient);
        self.network.parameters_changed();
    }
}

impl LargeUpdate {
    /// Fresh networks of the fast back end and a rollout of random rows.
    ///
    /// # Errors
    ///
    /// None that a build for this workspace's sizes can show; the networks' constructors could
    /// refuse.
    pub fn new(shape: Shape) -> Result<Self, BenchError> {
        let sizes = shape.sizes();
        let rng = &mut stream("large_update");
        let n = sizes.n_agents * sizes.n_steps;
        let actor = actor_of_inputs(&sizes.network, Backend::Fast, &Parameters::actor(&sizes.network, rng))?;
        let critic =
            critic_of_inputs(&sizes.network, Backend::Fast, &Parameters::critic(&sizes.network, rng))?;
        let mut order = Vec::new();
        shuffle(&mut order, n, rng);
        let mut value = || rng.next_u32() as f32 / u32::MAX as f32 - 0.5;
        Ok(Self {
            inputs: (0..n * sizes.network.input_len()).map(|_| value()).collect(),
            tokens: vec![0; n],
            order,
            actor: Half::new(actor, n),
            critic: Half::new(critic, n),
            sizes,
        })
    }

    /// Transitions of an update.
    pub fn transitions(&self) -> usize {
        self.tokens.len()
    }

    /// One update: actor and critic learn side by side, as in the trainer.
    pub fn run(&mut self) {
        let Self { sizes, inputs, tokens, order, actor, critic } = self;
        let Sizes { network, n_agents, minibatch, n_epochs, .. } = sizes;
        let (width, n_agents) = (network.input_len(), *n_agents);
        for (rows, tokens) in inputs.chunks(n_agents * width).zip(tokens.chunks(n_agents)) {
            actor.infer(Batch::new(rows, tokens));
        }
        critic.infer(Batch::new(inputs, tokens));
        let learn = |half: &mut Half| {
            for _ in 0..*n_epochs {
                for rows in order.chunks(*minibatch) {
                    half.learn(Batch::subset(inputs, tokens, rows));
                }
            }
        };
        rayon::join(|| learn(actor), || learn(critic));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_side_has_rows_of_the_same_width() {
        let driver = include_str!("../peers/torch_driver.py");
        let width = Shape::Motion.sizes().network.input_len();
        assert!(driver.contains(&format!("\nMOTION_INPUTS = {width}\n")));
        for shape in Shape::ALL {
            let Sizes { n_agents, n_steps, minibatch, n_epochs, .. } = shape.sizes();
            let sizes =
                format!("    \"{}\": ({n_agents}, {n_steps}, {minibatch}, {n_epochs}, ", shape.name());
            assert!(driver.contains(&sizes), "{sizes}");
        }
    }

    #[test]
    fn every_row_is_learned_from_in_each_epoch() {
        for shape in Shape::ALL {
            let mut update = LargeUpdate::new(shape).expect("valid sizes");
            let expected = match shape {
                Shape::Paper => 8_000,
                Shape::Pooled => 10_240,
                Shape::Motion => 24_576,
            };
            assert_eq!(update.transitions(), expected);
            let mut rows = update.order.clone();
            rows.sort_unstable();
            assert!(rows.into_iter().eq(0..expected as u32));
            if shape == Shape::Pooled {
                let before = update.critic.network.parameters_and_gradient().0.to_vec();
                update.run();
                assert_ne!(before, update.critic.network.parameters_and_gradient().0);
                assert_eq!(update.critic.adam.steps(), 20);
            }
        }
    }
}
