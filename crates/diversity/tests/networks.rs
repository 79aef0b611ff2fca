//! Both back ends of a discriminator: gradients against finite differences, and against each other.

use jostle_diversity::cross_entropy::{evaluate, evaluate_with_gradient};
use jostle_diversity::{DiscriminatorShape, discriminator};
use jostle_policy::{Backend, Batch, Network, Parameters};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const SHAPE: DiscriminatorShape = DiscriminatorShape { n_inputs: 7, hidden: 32, n_behaviours: 3 };

fn network(shape: DiscriminatorShape, backend: Backend) -> Box<dyn Network> {
    let parameters = Parameters::init(shape.layout(), &mut ChaCha8Rng::seed_from_u64(5));
    discriminator(shape, backend, &parameters).expect("the shape fits")
}

fn rows(shape: DiscriminatorShape, n: usize) -> (Vec<f32>, Vec<u32>) {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let rows = (0..n * shape.n_inputs).map(|_| StandardNormal.sample(&mut rng)).collect();
    (rows, (0..n).map(|i| (i % shape.n_behaviours) as u32).collect())
}

/// Loss, gradient and logits at the network's present parameters.
fn loss_and_gradient(network: &mut dyn Network, batch: Batch<'_>) -> (f64, Vec<f32>, Vec<f32>) {
    let mut logits = vec![0.0; batch.len() * network.n_outputs()];
    let mut d_logits = logits.clone();
    network.forward(batch, &mut logits);
    let tokens: Vec<u32> = (0..batch.len()).map(|i| batch.token(i)).collect();
    let loss = evaluate_with_gradient(&logits, &tokens, &mut d_logits).loss;
    network.backward(&d_logits);
    let gradient = network.parameters_and_gradient().1.to_vec();
    (loss, gradient, logits)
}

#[test]
fn gradients_are_finite_differences() {
    for backend in [Backend::Fast, Backend::Reference] {
        let mut network = network(SHAPE, backend);
        let (rows, tokens) = rows(SHAPE, 5);
        let batch = Batch::new(&rows, &tokens);
        let (_, gradient, _) = loss_and_gradient(&mut *network, batch);
        let mut logits = vec![0.0; 15];
        let kept_all = network.parameters_and_gradient().0.to_vec();
        for (k, &g) in gradient.iter().enumerate() {
            let mut at = |x: f32| {
                network.parameters_and_gradient().0[k] = x;
                network.parameters_changed();
                network.infer(batch, &mut logits);
                evaluate(&logits, &tokens).loss
            };
            let kept = kept_all[k];
            let (x_up, x_down) = (kept + 2e-3, kept - 2e-3);
            let (up, down, here) = (at(x_up), at(x_down), at(kept));
            // A ReLU that opens within the step spoils one side; the other must then agree.
            let sides = [
                (up - down) / f64::from(x_up - x_down),
                (up - here) / f64::from(x_up - kept),
                (here - down) / f64::from(kept - x_down),
            ];
            let close = sides.iter().any(|side| (side - f64::from(g)).abs() < 5e-4 + 2e-3 * side.abs());
            assert!(close, "{backend:?}, parameter {k}: {sides:?} against {g}");
        }
    }
}

#[test]
fn both_back_ends_agree_at_the_size_of_the_paper() {
    let shape = DiscriminatorShape { n_inputs: 1542, hidden: 128, n_behaviours: 5 };
    let (rows, tokens) = rows(shape, 64);
    let picked: Vec<u32> = (0..64).rev().step_by(3).collect();
    let batch = Batch::subset(&rows, &tokens, &picked);
    let mut fast_network = network(shape, Backend::Fast);
    let (fast_loss, fast, fast_logits) = loss_and_gradient(&mut *fast_network, batch);
    let fast = fast_network.to_canonical(&fast);
    let (loss, reference, logits) = loss_and_gradient(&mut *network(shape, Backend::Reference), batch);
    assert!((fast_loss - loss).abs() < 1e-5);
    let peak = reference.iter().fold(0.0_f32, |peak, g| peak.max(g.abs()));
    assert!(fast.iter().zip(&reference).all(|(a, b)| (a - b).abs() < 1e-6 + 1e-4 * peak));
    assert!(fast_logits.iter().zip(&logits).all(|(a, b)| (a - b).abs() < 1e-5 + 1e-5 * b.abs()));
}

#[test]
fn a_row_does_not_depend_on_its_neighbours() {
    let shape = DiscriminatorShape { n_inputs: 40, hidden: 32, n_behaviours: 4 };
    let (rows, tokens) = rows(shape, 33);
    let mut network = network(shape, Backend::Fast);
    let mut all = vec![0.0; 33 * 4];
    network.infer(Batch::new(&rows, &tokens), &mut all);
    let mut one = vec![0.0; 4];
    network.infer(Batch::subset(&rows, &tokens, &[17]), &mut one);
    assert!(one.iter().zip(&all[68..72]).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn parameters_of_another_shape_are_refused() {
    let parameters = Parameters::init(SHAPE.layout(), &mut ChaCha8Rng::seed_from_u64(5));
    let other = DiscriminatorShape { hidden: 64, ..SHAPE };
    for backend in [Backend::Fast, Backend::Reference] {
        assert!(discriminator(other, backend, &parameters).is_err());
    }
}
