//! The closed-form gradients of the losses against candle's autograd.

use candle_core::{Device, Result, Tensor, Var};
use jostle_policy::DiagonalGaussian;
use jostle_ppo::loss::{PolicyLossWeights, PolicyTargets, policy_loss, value_loss};

const MEANS: [[f32; 2]; 5] = [[0.5, 0.1], [0.2, -0.4], [0.9, 0.6], [0.4, 0.0], [0.6, -0.9]];
const ACTIONS: [[f32; 2]; 5] = [[0.9, -0.2], [0.1, -0.9], [1.4, 0.2], [-0.3, 0.8], [0.5, -1.3]];
/// ln(ratio) of each row: both signs of the advantage meet both sides of the clip.
const LOG_RATIOS: [f64; 5] = [0.0, 0.4, -0.3, 0.3, -0.4];
const ADVANTAGES: [f64; 5] = [1.2, 0.7, 0.9, -1.1, -0.4];
const LOG_STD: [f32; 2] = [-0.2, 0.3];
const WEIGHTS: PolicyLossWeights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 0.01 };

fn old_log_probs() -> Vec<f64> {
    let log_prob = |i: usize| DiagonalGaussian { mean: MEANS[i], log_std: LOG_STD }.log_prob(ACTIONS[i]);
    (0..5).map(|i| log_prob(i) - LOG_RATIOS[i]).collect()
}

#[track_caller]
fn assert_close(found: &[f32], expected: &[f32]) {
    assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 2e-6), "{found:?} against {expected:?}");
}

/// The loss as one would write it in PyTorch.
fn candle_loss(means: &Tensor, log_std: &Tensor) -> Result<Tensor> {
    let column =
        |xs: &[f64]| Tensor::from_vec(xs.iter().map(|&x| x as f32).collect(), xs.len(), &Device::Cpu);
    let actions = Tensor::from_slice(ACTIONS.as_flattened(), (5, 2), &Device::Cpu)?;
    let z = (actions - means)?.broadcast_div(&log_std.exp()?)?;
    let half_ln_tau = 0.5 * (2.0 * std::f64::consts::PI).ln();
    let log_prob = (z.sqr()? * -0.5)?.broadcast_sub(log_std)?.sum(1)?;
    let log_prob = (log_prob - 2.0 * half_ln_tau)?;
    let ratio = (log_prob - column(&old_log_probs())?)?.exp()?;
    let advantage = column(&ADVANTAGES)?;
    let clipped = ratio.clamp(0.9_f32, 1.1_f32)?;
    let surrogate = (&ratio * &advantage)?.minimum(&(clipped * &advantage)?)?.mean_all()?.neg()?;
    let entropy = (log_std.sum_all()? + (1.0 + 2.0 * half_ln_tau))?;
    surrogate - (entropy * WEIGHTS.ent_coef)?
}

#[test]
fn policy_gradients_are_those_of_autograd() -> Result<()> {
    let means = Var::from_slice(MEANS.as_flattened(), (5, 2), &Device::Cpu)?;
    let log_std = Var::from_slice(&LOG_STD, 2, &Device::Cpu)?;
    let loss = candle_loss(&means, &log_std)?;
    let gradients = loss.backward()?;
    let of = |var: &Var| gradients.get(var).expect("the loss depends on it").flatten_all()?.to_vec1::<f32>();

    let old = old_log_probs();
    let targets = PolicyTargets { actions: &ACTIONS, old_log_probs: &old, advantages: &ADVANTAGES };
    let mut d_means = [[0.0; 2]; 5];
    let ours = policy_loss(&MEANS, LOG_STD, targets, &[0, 1, 2, 3, 4], WEIGHTS, &mut d_means);
    assert!((ours.loss - f64::from(loss.to_scalar::<f32>()?)).abs() < 1e-6);
    // Row 0 has ratio 1, where both branches of the minimum are equal and autograd may share the
    // gradient between them.
    assert_close(d_means.as_flattened(), &of(&means)?);
    assert_close(&ours.d_log_std.map(|d| d as f32), &of(&log_std)?);
    Ok(())
}

#[test]
fn value_gradients_are_those_of_autograd() -> Result<()> {
    let (values, returns) = ([0.5_f32, -1.0, 2.0], [1.0_f64, -1.5, 4.0]);
    let var = Var::from_slice(&values, 3, &Device::Cpu)?;
    let target = Tensor::from_slice(&returns.map(|r| r as f32), 3, &Device::Cpu)?;
    let loss = (var.as_tensor() - target)?.sqr()?.mean_all()?;
    let gradients = loss.backward()?;
    let mut d_values = [0.0; 3];
    let ours = value_loss(&values, &returns, &[0, 1, 2], &mut d_values);
    assert!((ours - f64::from(loss.to_scalar::<f32>()?)).abs() < 1e-6);
    assert_close(&d_values, &gradients.get(&var).expect("the loss depends on it").to_vec1::<f32>()?);
    Ok(())
}
