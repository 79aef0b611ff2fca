//! Tests beyond those of all back ends: every instruction set, batches of several chunks,
//! threads, the perceptron.

use jostle_kernels::Isa;

use super::mlp::Mlp;
use super::network::{Activation, FastNetwork};
use crate::batch::Batch;
use crate::config::NetworkConfig;
use crate::layout::Layout;
use crate::network::Network;
use crate::parameters::Parameters;

/// A fixed, irregular sequence in −1 … 1.
pub(super) fn values(len: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    (0..len)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn parameters(layout: Layout) -> Parameters {
    let flat = values(layout.len(), 7).into_iter().map(|value| value * 0.05).collect();
    Parameters::from_flat(layout, flat).unwrap()
}

fn actor(config: &NetworkConfig, isa: Isa) -> FastNetwork {
    let layout = Layout::actor(config);
    let heads = [("mean_v", Activation::Sigmoid), ("mean_w", Activation::Tanh)];
    FastNetwork::new(config, layout.clone(), &heads, &parameters(layout), isa).unwrap()
}

/// Outputs and canonical gradient.
fn run(network: &mut dyn Network, width: usize, n_rows: usize) -> (Vec<f32>, Vec<f32>) {
    let observations = values(n_rows * width, 1);
    let tokens: Vec<u32> = (0..n_rows as u32).map(|row| row % 3).collect();
    let mut outputs = vec![0.0; n_rows * network.n_outputs()];
    network.forward(Batch::new(&observations, &tokens), &mut outputs);
    let d = values(outputs.len(), 2);
    network.backward(&d);
    let gradient = network.parameters_and_gradient().1.to_vec();
    (outputs, network.to_canonical(&gradient))
}

fn assert_near(found: &[f32], expected: &[f32], name: &str) {
    let largest = expected.iter().fold(1e-3_f32, |largest, value| largest.max(value.abs()));
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= 2e-5 * largest, "{name}: {found} {expected} of {largest}");
    }
}

#[test]
fn instruction_sets_agree_and_chunks_do_not_matter() {
    let even = NetworkConfig { beams: 40, frames: 2, laser_feature: 64, hidden: 32, ..Default::default() };
    for config in [even, NetworkConfig { beams: 64, ..Default::default() }] {
        for n_rows in [1, 25, 67, 131] {
            let expected =
                run(&mut actor(&config, Isa::available().pop().unwrap()), config.observation_len(), n_rows);
            for isa in Isa::available() {
                let found = run(&mut actor(&config, isa), config.observation_len(), n_rows);
                assert_near(&found.0, &expected.0, isa.name());
                assert_near(&found.1, &expected.1, isa.name());
            }
        }
    }
}

/// A gradient of many rows is the sum of the gradients of its parts, however each is cut into
/// chunks.
#[test]
fn gradients_of_parts_add_up() {
    let config = NetworkConfig { beams: 64, ..Default::default() };
    let mut network = actor(&config, Isa::detect());
    let (n_rows, width) = (200, config.observation_len());
    let observations = values(n_rows * width, 1);
    let tokens = vec![1; n_rows];
    let mut gradient_of = |rows: &[u32]| {
        let mut outputs = vec![0.0; rows.len() * 2];
        network.forward(Batch::subset(&observations, &tokens, rows), &mut outputs);
        network.backward(&vec![1.0; outputs.len()]);
        network.parameters_and_gradient().1.to_vec()
    };
    let rows: Vec<u32> = (0..200).collect();
    let whole = gradient_of(&rows);
    let mut sum = vec![0.0; whole.len()];
    for part in [&rows[..9], &rows[9..80], &rows[80..]] {
        sum.iter_mut().zip(gradient_of(part)).for_each(|(sum, value)| *sum += value);
    }
    assert_near(&sum, &whole, "sum of the parts");
}

#[test]
fn threads_change_no_bit() {
    let run_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let config = NetworkConfig { beams: 128, ..Default::default() };
            let of_actor = run(&mut actor(&config, Isa::detect()), config.observation_len(), 200);
            let layout = Mlp::layout(515, 128, 5);
            let mut mlp = Mlp::new(515, 128, 5, &parameters(layout)).unwrap();
            (of_actor, run(&mut mlp, 515, 200))
        })
    };
    let one = run_on(1);
    assert!(one == run_on(2) && one == run_on(8), "results depend on the number of threads");
}

/// The perceptron's outputs and gradient in double precision, from the definition.
#[test]
fn the_perceptron_is_its_definition() {
    for (inputs, hidden, outputs) in [(3, 32, 1), (45, 64, 5), (290, 32, 37)] {
        for (isa, n_rows) in Isa::available().into_iter().flat_map(|isa| [(isa, 3), (isa, 30)]) {
            let parameters = parameters(Mlp::layout(inputs, hidden, outputs));
            let mut mlp = Mlp::with_isa(inputs, hidden, outputs, &parameters, isa).unwrap();
            let (found, gradient) = run(&mut mlp, inputs, n_rows);
            let (expected, expected_gradient) = oracle(&parameters, &values(n_rows * inputs, 1), &found);
            assert_near(&found, &expected, isa.name());
            assert_near(&gradient, &expected_gradient, isa.name());
        }
    }
}

/// Outputs and gradient of Σ outputs · d for the d of [`run`].
fn oracle(parameters: &Parameters, observations: &[f32], like: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let layout = parameters.layout();
    let names = ["fc1", "fc2", "out"];
    let tensor =
        |name: &str| -> Vec<f64> { parameters.get(name).unwrap().iter().map(|v| f64::from(*v)).collect() };
    let (inputs, outputs) =
        (layout.entry("fc1.weight").unwrap().shape[1], layout.entry("out.bias").unwrap().len());
    let d_all = values(like.len(), 2);
    let (mut all, mut gradient) = (Vec::new(), vec![0.0_f64; layout.len()]);
    for (x, d) in observations.chunks(inputs).zip(d_all.chunks(outputs)) {
        let mut layers: Vec<Vec<f64>> = vec![x.iter().map(|x| f64::from(*x)).collect()];
        for name in names {
            let (w, b) = (tensor(&format!("{name}.weight")), tensor(&format!("{name}.bias")));
            let x = layers.last().unwrap();
            let dot = |w: &[f64]| w.iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
            let y = w.chunks(x.len()).zip(&b).map(|(w, b)| dot(w) + b);
            let relu = |y: f64| if name == "out" { y } else { y.max(0.0) };
            layers.push(y.map(relu).collect());
        }
        all.extend(layers[3].iter().map(|y| *y as f32));
        let mut d: Vec<f64> = d.iter().map(|d| f64::from(*d)).collect();
        for (layer, name) in names.into_iter().enumerate().rev() {
            let w = tensor(&format!("{name}.weight"));
            let x = &layers[layer];
            let at = layout.range(&format!("{name}.weight")).unwrap().start;
            let bias = layout.range(&format!("{name}.bias")).unwrap().start;
            let mut dx = vec![0.0; x.len()];
            for (o, d) in d.iter().enumerate() {
                gradient[bias + o] += d;
                for (i, x) in x.iter().enumerate() {
                    gradient[at + o * dx.len() + i] += d * x;
                    dx[i] += if *x > 0.0 { d * w[o * dx.len() + i] } else { 0.0 };
                }
            }
            d = dx;
        }
    }
    (all, gradient.into_iter().map(|value| value as f32).collect())
}

#[test]
fn widths_that_fill_no_panel_are_refused() {
    let config = NetworkConfig { hidden: 40, ..Default::default() };
    let message = FastNetwork::critic(&config, &parameters(Layout::critic(&config))).unwrap_err().to_string();
    assert!(
        message.starts_with("network configuration: hidden: found 40, expected a multiple of 32"),
        "{message}"
    );
    assert!(Mlp::new(4, 40, 2, &parameters(Mlp::layout(4, 40, 2))).is_err());
}

#[test]
fn inference_has_the_bits_of_the_forward_pass() {
    let config = NetworkConfig { n_behaviours: 3, ..NetworkConfig::default() };
    let width = config.observation_len();
    for isa in Isa::available() {
        let mut network = actor(&config, isa);
        // Chunks of several sizes, one after the other in the same memory; the last of 67 rows is
        // shorter.
        for n_rows in [5, 67, 24, 130] {
            let observations = values(n_rows * width, n_rows as u32);
            let tokens: Vec<u32> = (0..n_rows as u32).map(|row| row % 3).collect();
            let batch = Batch::new(&observations, &tokens);
            let [mut kept, mut inferred] = [(); 2].map(|()| vec![0.0; n_rows * network.n_outputs()]);
            network.infer(batch, &mut inferred);
            network.forward(batch, &mut kept);
            assert!(kept.iter().all(|value| *value != 0.0), "{kept:?}");
            assert_eq!(inferred, kept, "{n_rows} rows");
        }
    }
}
