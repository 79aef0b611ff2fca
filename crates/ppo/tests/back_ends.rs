//! The fast and the reference back end, side by side through 100 updates' learning.
//!
//! Rollouts of two trainings part ways as soon as one action differs in its last bit, so both sides
//! learn here from the same hundred rollouts, drawn from one stream: Algorithm 1's lines 11–26
//! without the simulator.

use jostle_diversity::{DiscriminatorShape, cross_entropy, discriminator};
use jostle_policy::{Backend, Batch, DiagonalGaussian, Network, NetworkConfig, Parameters, actor, critic};
use jostle_ppo::adam::Adam;
use jostle_ppo::loss::{PolicyLossWeights, PolicyTargets, policy_loss, value_loss};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UPDATES: usize = 100;
const EPOCHS: usize = 3;
const ROWS: usize = 64;
const MINIBATCH: usize = 32;
const M: usize = 5;
const LEARNING_RATE: f64 = 5e-5;
/// Bound on a parameter's travel: Adam moves it by about the learning rate in a step.
const TRAVEL: f64 = LEARNING_RATE * (UPDATES * EPOCHS * ROWS / MINIBATCH) as f64;

/// One rollout's data for all learners.
struct Rollout {
    observations: Vec<f32>,
    tokens: Vec<u32>,
    noise: Vec<[f64; 2]>,
    advantages: Vec<f64>,
    returns: Vec<f64>,
}

fn rollout(config: &NetworkConfig, rng: &mut ChaCha8Rng) -> Rollout {
    let mut value = || f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5;
    let observations: Vec<f32> = (0..ROWS * config.observation_len()).map(|_| value() as f32).collect();
    let tokens = (0..ROWS as u32).map(|row| row % M as u32).collect();
    let noise = (0..ROWS).map(|_| [2.0 * value(), 2.0 * value()]).collect();
    // What is learned has to be there to be learned: both follow from the observation.
    let of_row = |row: usize| f64::from(observations[row * config.observation_len()]);
    let advantages = (0..ROWS).map(|row| 4.0 * of_row(row)).collect();
    let returns = (0..ROWS).map(|row| 10.0 + 20.0 * of_row(row)).collect();
    Rollout { observations, tokens, noise, advantages, returns }
}

/// A network, its optimiser, and the losses of its minibatches.
struct Side {
    network: Box<dyn Network>,
    adam: Adam,
    losses: Vec<f64>,
}

impl Side {
    fn new(mut network: Box<dyn Network>) -> Self {
        let n = network.parameters_and_gradient().0.len();
        Self { network, adam: Adam::new(n, LEARNING_RATE), losses: Vec::new() }
    }

    /// One rollout's epochs; `loss` writes the gradient of the outputs of some rows.
    fn learn(&mut self, batch: &Batch<'_>, mut loss: impl FnMut(&[f32], &[u32], &mut [f32]) -> f64) {
        let rows: Vec<u32> = (0..ROWS as u32).collect();
        for _ in 0..EPOCHS {
            for rows in rows.chunks(MINIBATCH) {
                let mut outputs = vec![0.0; rows.len() * self.network.n_outputs()];
                let mut d_outputs = outputs.clone();
                self.network.forward(Batch::subset(batch.observations, batch.tokens, rows), &mut outputs);
                self.losses.push(loss(&outputs, rows, &mut d_outputs));
                self.network.backward(&d_outputs);
                let (parameters, gradient) = self.network.parameters_and_gradient();
                self.adam.step(parameters, gradient);
                self.network.parameters_changed();
            }
        }
    }

    fn parameters(&mut self) -> Vec<f32> {
        let native = self.network.parameters_and_gradient().0.to_vec();
        self.network.to_canonical(&native)
    }
}

/// Both sides' losses and parameters, held together.
fn assert_together(name: &str, fast: &mut Side, reference: &mut Side) {
    let worst = fast.losses.iter().zip(&reference.losses).map(|(a, b)| (a - b).abs() / (1e-3 + b.abs()));
    let worst = worst.fold(0.0, f64::max);
    let deviations: Vec<f64> = fast
        .parameters()
        .iter()
        .zip(reference.parameters())
        .map(|(a, b)| (f64::from(*a) - f64::from(b)).abs() / TRAVEL)
        .collect();
    let mean = deviations.iter().sum::<f64>() / deviations.len() as f64;
    let largest = deviations.iter().copied().fold(0.0, f64::max);
    eprintln!(
        "{name}: losses {worst:.1e} relative; parameters mean {mean:.1e}, largest {largest:.1e} of the way"
    );
    assert!(worst < LOSS_BOUND, "{name}: losses part by {worst:e}");
    assert!(mean < MEAN_BOUND, "{name}: parameters part by {mean:e} of the way on the mean");
    assert!(largest < LARGEST_BOUND, "{name}: a parameter parts by {largest:e} of the way");
}

/// Relative difference of any loss on the way.
const LOSS_BOUND: f64 = 1e-5;
/// Difference of the parameters in parts of how far they can have gone ([`TRAVEL`]), mean and
/// largest.
const MEAN_BOUND: f64 = 1e-6;
const LARGEST_BOUND: f64 = 1e-3;

#[test]
fn hundred_updates_keep_both_back_ends_together() {
    let config = NetworkConfig {
        beams: 64,
        laser_feature: 64,
        hidden: 64,
        n_behaviours: M,
        log_std_init: -0.5,
        ..NetworkConfig::default()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let theta = Parameters::actor(&config, &mut rng);
    let phi = Parameters::critic(&config, &mut rng);
    let shape = DiscriminatorShape { n_inputs: config.observation_len(), hidden: 64, n_behaviours: M };
    let psi = Parameters::init(shape.layout(), &mut rng);
    let sides = |make: &dyn Fn(Backend) -> Box<dyn Network>| {
        [Backend::Fast, Backend::Reference].map(|backend| Side::new(make(backend)))
    };
    let mut actors = sides(&|backend| actor(&config, backend, &theta).unwrap());
    let mut critics = sides(&|backend| critic(&config, backend, &phi).unwrap());
    let mut discriminators = sides(&|backend| discriminator(shape, backend, &psi).unwrap());
    let log_std = [config.log_std_init; 2];
    let weights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 5e-4 };
    for _ in 0..UPDATES {
        let Rollout { observations, tokens, noise, advantages, returns } = rollout(&config, &mut rng);
        let batch = Batch::new(&observations, &tokens);
        for side in &mut actors {
            // The actions are the side's own means plus common noise, as in a rollout of that side.
            let mut means = vec![[0.0_f32; 2]; ROWS];
            side.network.infer(batch, means.as_flattened_mut());
            let sigma = f64::from(log_std[0]).exp();
            let actions: Vec<[f32; 2]> = means
                .iter()
                .zip(&noise)
                .map(|(mean, noise)| [0, 1].map(|d| (f64::from(mean[d]) + sigma * noise[d]) as f32))
                .collect();
            let old_log_probs: Vec<f64> = means
                .iter()
                .zip(&actions)
                .map(|(&mean, &action)| DiagonalGaussian { mean, log_std }.log_prob(action))
                .collect();
            let targets =
                PolicyTargets { actions: &actions, old_log_probs: &old_log_probs, advantages: &advantages };
            side.learn(&batch, |outputs, rows, d_outputs| {
                let (means, _) = outputs.as_chunks::<2>();
                let (d_means, _) = d_outputs.as_chunks_mut::<2>();
                policy_loss(means, log_std, targets, rows, weights, d_means).loss
            });
        }
        for side in &mut critics {
            side.learn(&batch, |outputs, rows, d_outputs| value_loss(outputs, &returns, rows, d_outputs));
        }
        for side in &mut discriminators {
            side.learn(&batch, |outputs, rows, d_outputs| {
                let tokens: Vec<u32> = rows.iter().map(|&row| tokens[row as usize]).collect();
                cross_entropy::evaluate_with_gradient(outputs, &tokens, d_outputs).loss
            });
        }
    }
    for (name, [fast, reference]) in
        [("actor", &mut actors), ("critic", &mut critics), ("discriminator", &mut discriminators)]
    {
        assert_together(name, fast, reference);
    }
}
