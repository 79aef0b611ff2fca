//! Both discriminators: logits, log q, losses, gradients, and the intrinsic reward.

use anyhow::{Context as _, Result, ensure};
use jostle_diversity::cross_entropy::{evaluate_with_gradient, log_softmax_at};
use jostle_diversity::{DiscriminatorShape, IntrinsicReward, discriminator};
use jostle_policy::{Backend, Batch};

use super::network::{compare, parameters, wide};
use super::tensors::Tensors;
use super::verdict::Verdict;

/// Checks the discriminators that the fixture holds.
pub(crate) fn check(tensors: &Tensors, backend: Backend, verdict: &mut Verdict) -> Result<()> {
    let batch = tensors.observations()?;
    let width = batch.rows.len() / batch.batch.max(1);
    let state = check_one(tensors, "state", width, &batch.rows, backend, verdict)?;
    let actions = tensors.pairs("action", batch.batch)?;
    let rows: Vec<f32> = batch
        .rows
        .chunks_exact(width)
        .zip(&actions)
        .flat_map(|(row, a)| row.iter().chain(a).copied())
        .collect();
    let state_action = check_one(tensors, "state_action", width + 2, &rows, backend, verdict)?;
    if let (Some(state), Some(state_action)) = (state, state_action) {
        let reward = |(sa, s): (&f64, &f64)| IntrinsicReward::Difference.value(*sa, *s, false, 1) as f32;
        let rewards: Vec<f32> = state_action.iter().zip(&state).map(reward).collect();
        compare(tensors, "intrinsic_reward", &rewards, verdict)?;
    }
    Ok(())
}

/// Checks the network `q` on its input rows; gives log q of each row, or `None` where the fixture
/// does not hold it.
fn check_one(
    tensors: &Tensors,
    q: &str,
    width: usize,
    rows: &[f32],
    backend: Backend,
    verdict: &mut Verdict,
) -> Result<Option<Vec<f64>>> {
    let out = format!("{q}.out.weight");
    if !tensors.has(&out) {
        return Ok(None);
    }
    let shape = &tensors.get(&out)?.shape;
    let &[n_behaviours, hidden] = shape.as_slice() else { anyhow::bail!("{out} has shape {shape:?}") };
    let shape = DiscriminatorShape { n_inputs: width, hidden, n_behaviours };
    let parameters = parameters(tensors, &format!("{q}."), shape.layout())?;
    let tokens = tensors.tokens(n_behaviours)?;
    ensure!(tokens.len() * width == rows.len(), "token has {} entries", tokens.len());
    let mut network = discriminator(shape, backend, &parameters)?;
    let mut logits = vec![0.0; tokens.len() * n_behaviours];
    network.forward(Batch::new(rows, &tokens), &mut logits);
    let mut d_logits = vec![0.0; logits.len()];
    let loss = evaluate_with_gradient(&logits, &tokens, &mut d_logits).loss;
    network.backward(&d_logits);

    let log_q: Vec<f64> = logits
        .chunks_exact(n_behaviours)
        .zip(&tokens)
        .map(|(row, &token)| log_softmax_at(row, token))
        .collect();
    compare(tensors, &format!("{q}.logits"), &logits, verdict)?;
    compare(tensors, &format!("{q}.log_q"), &log_q.iter().map(|&x| x as f32).collect::<Vec<_>>(), verdict)?;
    compare(tensors, &format!("{q}.loss"), &[loss as f32], verdict)?;
    let native = network.parameters_and_gradient().1.to_vec();
    let gradient = network.to_canonical(&native);
    let layout = network.layout();
    for name in tensors.names_under(&format!("grad.{q}.")) {
        let range = layout.range(name).with_context(|| format!("grad.{q}.{name} belongs to no parameter"))?;
        gradient_close(&gradient[range], tensors.f32(&format!("grad.{q}.{name}"))?, name, verdict);
    }
    Ok(Some(log_q))
}

/// Compares a gradient tensor: its tolerance follows its largest entry.
pub(crate) fn gradient_close(actual: &[f32], expected: &[f32], name: &str, verdict: &mut Verdict) {
    let largest = expected.iter().fold(0.0_f64, |largest, &g| largest.max(f64::from(g).abs()));
    let tolerance = (1e-6 + 1e-4 * largest, 0.0);
    verdict.all_close(wide(actual), wide(expected), tolerance, &format!("gradient {name}"));
}
