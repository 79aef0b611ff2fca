//! The losses of Algorithm 1 with their gradients in closed form (lines 14–15 and 19).
//!
//! The networks give means and values; these pure functions give the loss and its derivative with
//! respect to them. Sums are f64 in row order; gradients leave as f32.

use jostle_policy::DiagonalGaussian;

/// Number of action dimensions: linear velocity v and angular velocity ω.
pub const N_ACTIONS: usize = 2;

/// The part of one rollout that the policy's loss needs, in rollout order.
#[derive(Debug, Clone, Copy)]
pub struct PolicyTargets<'a> {
    /// Sampled, unclipped actions.
    pub actions: &'a [[f32; N_ACTIONS]],
    /// `log π_old(a|s, z)`, from the rollout.
    pub old_log_probs: &'a [f64],
    /// Advantages as they are to be used (normalised by the caller).
    pub advantages: &'a [f64],
}

/// Weights of the policy's loss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyLossWeights {
    /// Half-width ε of the ratio's trust interval.
    pub clip_coef: f64,
    /// Weight of the entropy bonus.
    pub ent_coef: f64,
}

/// The policy's loss on one minibatch, and what is worth watching about it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PolicyLoss {
    /// `surrogate − ent_coef · entropy`: what is minimised.
    pub loss: f64,
    /// −mean(min(k·A, clip(k, 1 − ε, 1 + ε)·A)).
    pub surrogate: f64,
    /// Entropy of the policy in one state (equal for all).
    pub entropy: f64,
    /// mean((k − 1) − ln k), Schulman's low-variance estimate of `KL(π_old ‖ π)`.
    pub approx_kl: f64,
    /// Share of rows whose ratio k lies outside 1 ± ε.
    pub clip_fraction: f64,
    /// Largest |k − 1|: 0 before the first step on a rollout.
    pub ratio_deviation: f64,
    /// ∂loss/∂`log_std`.
    pub d_log_std: [f64; N_ACTIONS],
}

/// Clipped surrogate with entropy bonus over the minibatch `rows`; writes ∂loss/∂means to
/// `d_means`.
///
/// The gradient of a row is 0 where clipping is active; a ratio exactly on the edge counts as
/// unclipped.
///
/// # Shapes
///
/// `means` and `d_means` are `[B]` for the B entries of `rows`, which index the rollout's
/// `targets`.
///
/// # Formula
///
/// With `k = exp(log π − log π_old)`: `∂(k·A)/∂μ_d = k·A·(a_d − μ_d)/σ_d²` and
/// `∂(k·A)/∂ln σ_d = k·A·(((a_d − μ_d)/σ_d)² − 1)`.
///
/// # Panics
///
/// When the lengths differ or `rows` is empty.
///
/// # References
///
/// Schulman et al.: Proximal Policy Optimization Algorithms, arXiv:1707.06347, Eq. 7.
pub fn policy_loss(
    means: &[[f32; N_ACTIONS]],
    log_std: [f32; N_ACTIONS],
    targets: PolicyTargets<'_>,
    rows: &[u32],
    weights: PolicyLossWeights,
    d_means: &mut [[f32; N_ACTIONS]],
) -> PolicyLoss {
    assert!(!rows.is_empty(), "all are [B]");
    let mut loss = policy_loss_of_part(means, log_std, targets, (rows, rows.len()), weights, d_means);
    loss.add_entropy(log_std, weights);
    loss
}

impl PolicyLoss {
    /// Adds the entropy bonus to what the rows have given.
    pub(crate) fn add_entropy(&mut self, log_std: [f32; N_ACTIONS], weights: PolicyLossWeights) {
        self.entropy = DiagonalGaussian { mean: [0.0; N_ACTIONS], log_std }.entropy();
        self.d_log_std.iter_mut().for_each(|d| *d -= weights.ent_coef);
        self.loss = self.surrogate - weights.ent_coef * self.entropy;
    }
}

/// The part of some `rows` in the loss of a minibatch of `n` rows, without the entropy bonus, which
/// belongs to no row.
///
/// # Panics
///
/// When the lengths differ.
pub(crate) fn policy_loss_of_part(
    means: &[[f32; N_ACTIONS]],
    log_std: [f32; N_ACTIONS],
    targets: PolicyTargets<'_>,
    (rows, n): (&[u32], usize),
    weights: PolicyLossWeights,
    d_means: &mut [[f32; N_ACTIONS]],
) -> PolicyLoss {
    assert!(means.len() == rows.len() && d_means.len() == rows.len(), "all are [B]");
    let n = n as f64;
    let (low, high) = (1.0 - weights.clip_coef, 1.0 + weights.clip_coef);
    let mut result = PolicyLoss::default();
    for ((&row, &mean), d_mean) in rows.iter().zip(means).zip(d_means) {
        let row = row as usize;
        let (action, advantage) = (targets.actions[row], targets.advantages[row]);
        let policy = DiagonalGaussian { mean, log_std };
        let log_ratio = policy.log_prob(action) - targets.old_log_probs[row];
        let ratio = log_ratio.exp();
        result.surrogate -= (ratio * advantage).min(ratio.clamp(low, high) * advantage) / n;
        result.approx_kl += (log_ratio.exp_m1() - log_ratio) / n;
        result.clip_fraction += if ratio < low || ratio > high { 1.0 / n } else { 0.0 };
        result.ratio_deviation = result.ratio_deviation.max(log_ratio.exp_m1().abs());
        // The unclipped branch is the smaller one, or both are the same.
        let flows = if advantage >= 0.0 { ratio <= high } else { ratio >= low };
        let d_log_prob = if flows { -ratio * advantage / n } else { 0.0 };
        *d_mean = policy.d_log_prob_d_mean(action).map(|d| (d_log_prob * d) as f32);
        let d_log_std = policy.d_log_prob_d_log_std(action);
        result.d_log_std.iter_mut().zip(d_log_std).for_each(|(sum, d)| *sum += d_log_prob * d);
    }
    result
}

/// mean((V − target)²) over the minibatch `rows`, without a factor ½; writes ∂loss/∂V to
/// `d_values`.
///
/// # Shapes
///
/// `values` and `d_values` are `[B]` for the B entries of `rows`, which index the rollout's
/// `returns`.
///
/// # Panics
///
/// When the lengths differ or `rows` is empty.
pub fn value_loss(values: &[f32], returns: &[f64], rows: &[u32], d_values: &mut [f32]) -> f64 {
    assert!(!rows.is_empty(), "all are [B]");
    value_loss_of_part(values, returns, (rows, rows.len()), d_values)
}

/// The part of some `rows` in the loss of a minibatch of `n` rows.
///
/// # Panics
///
/// When the lengths differ.
pub(crate) fn value_loss_of_part(
    values: &[f32],
    returns: &[f64],
    (rows, n): (&[u32], usize),
    d_values: &mut [f32],
) -> f64 {
    assert!(values.len() == rows.len() && d_values.len() == rows.len(), "all are [B]");
    let n = n as f64;
    let mut loss = 0.0;
    for ((&row, &value), d_value) in rows.iter().zip(values).zip(d_values) {
        let error = f64::from(value) - returns[row as usize];
        loss += error * error / n;
        *d_value = (2.0 * error / n) as f32;
    }
    loss
}

/// 1 − Var(returns − values)/Var(returns), by the two variances: 1 for a perfect critic, 0 for one
/// that predicts a constant; 0 when the returns do not vary.
pub(crate) fn explained_variance(of_errors: f64, of_returns: f64) -> f64 {
    if of_returns > 0.0 { 1.0 - of_errors / of_returns } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn log_prob(action: [f32; 2], mean: [f32; 2], log_std: [f32; 2]) -> f64 {
        DiagonalGaussian { mean, log_std }.log_prob(action)
    }

    /// Step of finite differences.
    const H: f32 = 1e-3;
    const WEIGHTS: PolicyLossWeights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 5e-4 };

    /// Loss of one row with the old log-probability chosen so that the ratio is `ratio`.
    fn one_row(ratio: f64, advantage: f64) -> (PolicyLoss, [f32; 2]) {
        let (action, mean, log_std) = ([0.7, -0.2], [0.5, 0.1], [0.0, -0.5]);
        let old = [log_prob(action, mean, log_std) - ratio.ln()];
        let targets = PolicyTargets { actions: &[action], old_log_probs: &old, advantages: &[advantage] };
        let mut d_means = [[0.0; 2]];
        let weights = PolicyLossWeights { ent_coef: 0.0, ..WEIGHTS };
        let loss = policy_loss(&[mean], log_std, targets, &[0], weights, &mut d_means);
        (loss, d_means[0])
    }

    #[test]
    fn the_clip_binds_only_where_it_lowers_the_objective() {
        assert!((one_row(1.5, 2.0).0.surrogate + 2.2).abs() < 1e-12);
        assert_eq!(one_row(1.5, 2.0).1, [0.0; 2]);
        assert!((one_row(0.5, -2.0).0.surrogate - 1.8).abs() < 1e-12);
        assert_eq!(one_row(0.5, -2.0).1, [0.0; 2]);
        assert!((one_row(0.5, 2.0).0.surrogate + 1.0).abs() < 1e-12);
        assert_ne!(one_row(0.5, 2.0).1, [0.0; 2]);
        assert!((one_row(1.5, -2.0).0.surrogate - 3.0).abs() < 1e-12);
        assert_ne!(one_row(1.5, -2.0).1, [0.0; 2]);
    }

    #[test]
    fn an_unchanged_policy_has_ratio_one_to_the_bit() {
        let (action, mean, log_std) = ([0.7, -0.2], [0.5, 0.1], [0.0, -0.5]);
        let old = [log_prob(action, mean, log_std)];
        let targets = PolicyTargets { actions: &[action], old_log_probs: &old, advantages: &[1.25] };
        let loss = policy_loss(&[mean], log_std, targets, &[0], WEIGHTS, &mut [[0.0; 2]]);
        assert_eq!((loss.ratio_deviation, loss.approx_kl, loss.clip_fraction), (0.0, 0.0, 0.0));
        assert_eq!(loss.surrogate, -1.25);
    }

    #[test]
    fn two_rows_by_hand() {
        // Ratios 1.5 (advantage 2, clipped at 1.1) and 0.95 (advantage −4, inside).
        let (action, mean, log_std) = ([0.7, -0.2], [0.5, 0.1], [0.0, -0.5]);
        let now = log_prob(action, mean, log_std);
        let old = [now - 1.5_f64.ln(), now - 0.95_f64.ln()];
        let targets = PolicyTargets { actions: &[action; 2], old_log_probs: &old, advantages: &[2.0, -4.0] };
        let weights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 0.25 };
        let mut d_means = [[0.0; 2]; 2];
        let loss = policy_loss(&[mean; 2], log_std, targets, &[0, 1], weights, &mut d_means);
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        near(loss.surrogate, -(1.1 * 2.0 - 0.95 * 4.0) / 2.0);
        let kl = |ratio: f64| ratio - 1.0 - ratio.ln();
        near(loss.approx_kl, 0.5 * kl(1.5) + 0.5 * kl(0.95));
        near(loss.clip_fraction, 0.5);
        near(loss.ratio_deviation, 0.5);
        // ln σ sums to −0.5, and each dimension adds ½·ln(2πe).
        let entropy = (2.0 * std::f64::consts::PI * std::f64::consts::E).ln() - 0.5;
        near(loss.entropy, entropy);
        near(loss.loss, loss.surrogate - 0.25 * entropy);
        // The first row is clipped; the second has weight 0.95·4/2 and a slope of (a − μ)/σ² or ((a
        // − μ)/σ)² − 1.
        let variance = (-1.0_f64).exp();
        assert_eq!(d_means[0], [0.0; 2]);
        assert!((f64::from(d_means[1][0]) - 1.9 * 0.2).abs() < 1e-6, "{d_means:?}");
        assert!((f64::from(d_means[1][1]) + 1.9 * 0.3 / variance).abs() < 1e-6, "{d_means:?}");
        let slope = |distance: f64, variance: f64| 1.9 * (distance * distance / variance - 1.0) - 0.25;
        assert!((loss.d_log_std[0] - slope(0.2, 1.0)).abs() < 1e-6, "{loss:?}");
        assert!((loss.d_log_std[1] - slope(0.3, variance)).abs() < 1e-6, "{loss:?}");
    }

    #[test]
    fn a_ratio_on_the_edge_counts_as_unclipped() {
        // A trust interval of no width has its edges at the ratio of an unchanged policy, exactly
        // 1.
        let (action, mean, log_std) = ([0.7, -0.2], [0.5, 0.1], [0.0, -0.5]);
        let old = [log_prob(action, mean, log_std)];
        for advantage in [2.0, -2.0] {
            let targets = PolicyTargets { actions: &[action], old_log_probs: &old, advantages: &[advantage] };
            let weights = PolicyLossWeights { clip_coef: 0.0, ent_coef: 0.0 };
            let mut d_means = [[0.0; 2]];
            let loss = policy_loss(&[mean], log_std, targets, &[0], weights, &mut d_means);
            assert_eq!(loss.clip_fraction, 0.0);
            assert!(d_means[0].iter().all(|d| *d != 0.0), "{d_means:?}");
        }
    }

    /// Calls the loss with so many means, rows and gradients of one target.
    fn policy_loss_of(means: usize, rows: usize, gradients: usize) {
        let targets = PolicyTargets { actions: &[[0.0; 2]], old_log_probs: &[0.0], advantages: &[1.0] };
        let (means, rows, mut gradients) = (vec![[0.0; 2]; means], vec![0; rows], vec![[0.0; 2]; gradients]);
        policy_loss(&means, [0.0; 2], targets, &rows, WEIGHTS, &mut gradients);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn no_rows_are_refused() {
        policy_loss_of(0, 0, 0);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn means_of_another_length_are_refused() {
        policy_loss_of(2, 1, 1);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn gradients_of_another_length_are_refused() {
        policy_loss_of(1, 1, 2);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn no_values_are_refused() {
        value_loss(&[], &[], &[], &mut []);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn values_of_another_length_are_refused() {
        value_loss(&[0.0; 2], &[0.0], &[0], &mut [0.0]);
    }

    #[test]
    #[should_panic(expected = "all are [B]")]
    fn value_gradients_of_another_length_are_refused() {
        value_loss(&[0.0], &[0.0], &[0], &mut [0.0; 2]);
    }

    #[test]
    fn value_loss_by_hand() {
        let mut d_values = [0.0; 2];
        let loss = value_loss(&[1.0, 5.0], &[9.0, 3.0, 4.0], &[1, 2], &mut d_values);
        // ((5 − 4)² + (1 − 3)²) / 2
        assert_eq!(loss, 2.5);
        assert_eq!(d_values, [-2.0, 1.0]);
    }

    #[test]
    fn explained_variance_of_simple_critics() {
        assert_eq!(explained_variance(0.0, 2.0), 1.0);
        assert_eq!(explained_variance(2.0, 2.0), 0.0);
        assert_eq!(explained_variance(1.0, 0.0), 0.0);
        assert_eq!(explained_variance(0.5, 2.0), 0.75);
    }

    proptest! {
        #[test]
        fn gradients_are_finite_differences(
            data in proptest::collection::vec((-1.0..1.0_f32, -1.0..1.0_f32, -1.0..1.0_f32, -0.5..0.5_f64, -2.0..2.0_f64), 4),
            log_std in proptest::array::uniform2(-1.0..0.5_f32),
        ) {
            let mut means: Vec<[f32; 2]> = data.iter().map(|d| [d.0, d.1]).collect();
            let actions: Vec<[f32; 2]> = data.iter().map(|d| [d.2, d.0 * 0.5]).collect();
            let advantages: Vec<f64> = data.iter().map(|d| d.4).collect();
            let old: Vec<f64> =
                (0..4).map(|i| log_prob(actions[i], means[i], log_std) + data[i].3).collect();
            // A finite difference means nothing across the clip's kink.
            prop_assume!(data.iter().all(|d| [0.9_f64, 1.1].iter().all(|edge| ((-d.3).exp() - edge).abs() > 0.02)));
            let targets = PolicyTargets { actions: &actions, old_log_probs: &old, advantages: &advantages };
            let rows = [2, 0, 3, 1];
            let picked = |means: &[[f32; 2]]| rows.map(|r| means[r as usize]);
            let mut d_means = [[0.0; 2]; 4];
            let loss = policy_loss(&picked(&means), log_std, targets, &rows, WEIGHTS, &mut d_means);
            let at = |means: &[[f32; 2]], log_std| policy_loss(&picked(means), log_std, targets, &rows, WEIGHTS, &mut [[0.0; 2]; 4]).loss;
            for d in 0..2 {
                for (b, &row) in rows.iter().enumerate() {
                    let kept = means[row as usize][d];
                    let mut value = |x: f32| { means[row as usize][d] = x; at(&means, log_std) };
                    let (up, down) = (value(kept + H), value(kept - H));
                    means[row as usize][d] = kept;
                    let difference = (up - down) / f64::from((kept + H) - (kept - H));
                    prop_assert!((difference - f64::from(d_means[b][d])).abs() < 1e-3 * (1.0 + difference.abs()));
                }
                let moved = |h: f32| { let mut l = log_std; l[d] += h; (at(&means, l), f64::from(l[d])) };
                let ((up, x_up), (down, x_down)) = (moved(H), moved(-H));
                let difference = (up - down) / (x_up - x_down);
                prop_assert!((difference - loss.d_log_std[d]).abs() < 1e-3 * (1.0 + difference.abs()));
            }
        }
    }
}
