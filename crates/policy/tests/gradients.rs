//! The gradients of the candle models, parameter tensor by parameter tensor, against central
//! differences; and the fault of candle's own convolution that makes this test necessary.

use crate::common::oracle::{Head, Oracle};
use crate::common::{noise, observations, parameters, small, tokens};
use candle_core::{Device, Tensor, Var};
use jostle_policy::{Backend, Batch, actor, critic};

/// Central differences of the oracle's outputs (`f64`, so that the step can be small) against both
/// gradients.
#[test]
fn every_parameter_against_finite_differences() {
    const STEP: f64 = 1e-6;
    let config = small();
    let (n_rows, xs, zs) = (3, observations(&config, 3, 5), tokens(&config, 3));
    for head in [Head::Actor, Head::Critic] {
        let parameters = parameters(head.layout(&config), 6);
        let d: Vec<f32> = (0..n_rows * head.n_outputs()).map(|idx| noise(7, idx as u64) as f32).collect();
        let mut oracle = Oracle::new(&config, head, &parameters);
        let weighted = |oracle: &Oracle| -> f64 {
            oracle.forward_all(&xs, &zs).iter().zip(&d).map(|(output, d)| output * f64::from(*d)).sum()
        };

        let mut network = match head {
            Head::Actor => actor(&config, Backend::Reference, &parameters).unwrap(),
            Head::Critic => critic(&config, Backend::Reference, &parameters).unwrap(),
        };
        network.forward(Batch::new(&xs, &zs), &mut vec![0.0; d.len()]);
        network.backward(&d);
        let gradient = network.parameters_and_gradient().1.to_vec();
        for entry in network.layout().entries() {
            let largest =
                gradient[entry.range()].iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
            for idx in entry.range() {
                let weight = oracle.weights[idx];
                oracle.weights[idx] = weight + STEP;
                let high = weighted(&oracle);
                oracle.weights[idx] = weight - STEP;
                let low = weighted(&oracle);
                oracle.weights[idx] = weight;
                let slope = (high - low) / (2.0 * STEP);
                let deviation = (slope - f64::from(gradient[idx])).abs();
                let bound = 1e-7 + 1e-4 * f64::from(largest);
                assert!(deviation < bound, "{head:?} {}: {deviation:e} of {largest:e}", entry.name);
            }
        }
    }
}

/// candle 0.11.1's CPU `conv1d`: the weight gradient of Σ y·d differs from its definition
/// (huggingface/candle #3836).
///
/// If this test fails, candle was repaired and the departure in `reference/conv.rs` can be
/// reconsidered.
#[test]
fn candle_conv1d_still_has_wrong_weight_gradients() {
    let (batch, inputs, outputs, len, kernel) = (2, 3, 4, 16, 5);
    let windows = (len + 2 - kernel) / 2 + 1;
    let draw = |seed, n: usize| -> Vec<f32> { (0..n as u64).map(|idx| noise(seed, idx) as f32).collect() };
    let xs = draw(1, batch * inputs * len);
    let d = draw(2, batch * outputs * windows);
    let weight =
        Var::from_vec(draw(3, outputs * inputs * kernel), (outputs, inputs, kernel), &Device::Cpu).unwrap();

    let xs_tensor = Tensor::from_slice(&xs, (batch, inputs, len), &Device::Cpu).unwrap();
    let d_tensor = Tensor::from_slice(&d, (batch, outputs, windows), &Device::Cpu).unwrap();
    let ys = xs_tensor.conv1d(&weight, 1, 2, 1, 1).unwrap();
    let gradients = (ys * d_tensor).unwrap().sum_all().unwrap().backward().unwrap();
    let found = gradients.get(&weight).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();

    let definition = |o: usize, i: usize, k: usize| -> f32 {
        let mut sum = 0.0;
        for (row, window) in (0..batch).flat_map(|row| (0..windows).map(move |window| (row, window))) {
            if let Some(at) = (2 * window + k).checked_sub(1).filter(|at| *at < len) {
                sum += xs[(row * inputs + i) * len + at] * d[(row * outputs + o) * windows + window];
            }
        }
        sum
    };
    let expected = |idx: usize| definition(idx / (inputs * kernel), idx / kernel % inputs, idx % kernel);
    let worst = (0..found.len()).map(|idx| (found[idx] - expected(idx)).abs()).fold(0.0, f32::max);
    assert!(worst > 0.1, "candle's gradient is right now: {worst:e}");
}
