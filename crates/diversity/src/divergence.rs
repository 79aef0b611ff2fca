//! KL divergence between diagonal Gaussians and the diversity metric D, in closed form and f64.
//!
//! The paper measures action diversity as the mean Kullback–Leibler divergence between the action
//! distributions of pairs of behaviours, over the states of a trajectory (section "Intrinsic
//! Rewards", the metric of Table 3).

use crate::DiversityError;

/// KL(p ‖ q) of two one-dimensional Gaussians, given their means and log standard deviations, in
/// nats.
///
/// Never negative, and exactly 0 for identical arguments.
///
/// # Formula
///
/// With `r = ln σ_p − ln σ_q`: `(e^{2r} − 1 − 2r)/2 + (μ_p − μ_q)²/(2σ_q²)`. Written with `expm1`,
/// so that nearly equal spreads do not cancel.
pub fn kl_normal(mean_p: f64, log_std_p: f64, mean_q: f64, log_std_q: f64) -> f64 {
    let log_ratio = log_std_p - log_std_q;
    let spread = (2.0 * log_ratio).exp_m1() - 2.0 * log_ratio;
    let shift = (mean_p - mean_q) / log_std_q.exp();
    0.5 * (spread + shift * shift)
}

/// Diagonal Gaussians over actions for several behaviours in several states.
///
/// # Shapes
///
/// `mean` and `log_std` are row-major [states, behaviours, dims].
#[derive(Debug, Clone, Copy)]
pub struct BehaviourActions<'a> {
    mean: &'a [f64],
    log_std: &'a [f64],
    n_states: usize,
    n_behaviours: usize,
    n_dims: usize,
}

impl<'a> BehaviourActions<'a> {
    /// Views `mean` and `log_std` as [states, `n_behaviours`, `n_dims`]; the number of states
    /// follows from the length.
    ///
    /// # Errors
    ///
    /// [`DiversityError::Shape`] when a length is not a positive multiple of `n_behaviours ·
    /// n_dims`, or the two differ.
    pub fn new(
        mean: &'a [f64],
        log_std: &'a [f64],
        n_behaviours: usize,
        n_dims: usize,
    ) -> Result<Self, DiversityError> {
        let row = (n_behaviours * n_dims).max(1);
        let n_states = mean.len() / row;
        if n_behaviours * n_dims == 0 || n_states == 0 || mean.len() != n_states * row {
            let expected = n_states.max(1) * row;
            return Err(DiversityError::Shape { name: "mean", expected, found: mean.len() });
        }
        if log_std.len() != mean.len() {
            let (expected, found) = (mean.len(), log_std.len());
            return Err(DiversityError::Shape { name: "log_std", expected, found });
        }
        Ok(Self { mean, log_std, n_states, n_behaviours, n_dims })
    }

    /// KL(π(·|s, i) ‖ π(·|s, j)): the sum over the dimensions, which are independent.
    fn kl(&self, state: usize, i: usize, j: usize) -> f64 {
        let start = |behaviour: usize| (state * self.n_behaviours + behaviour) * self.n_dims;
        let (p, q) = (start(i), start(j));
        (0..self.n_dims)
            .map(|d| kl_normal(self.mean[p + d], self.log_std[p + d], self.mean[q + d], self.log_std[q + d]))
            .sum()
    }

    /// Mean over the states of `KL(π_i ‖ π_j)`.
    ///
    /// # Shapes
    ///
    /// Row-major [behaviours, behaviours]; entry (i, j) is `KL(π_i ‖ π_j)`, the diagonal is 0.
    pub fn pairwise(&self) -> Vec<f64> {
        let m = self.n_behaviours;
        let mut matrix = vec![0.0; m * m];
        for i in 0..m {
            for j in (0..m).filter(|&j| j != i) {
                let sum: f64 = (0..self.n_states).map(|state| self.kl(state, i, j)).sum();
                matrix[i * m + j] = sum / self.n_states as f64;
            }
        }
        matrix
    }

    /// The metric D: the mean of [`Self::pairwise`] over the M(M − 1) ordered pairs i ≠ j, in nats.
    ///
    /// 0 for one behaviour: there is no pair.
    pub fn diversity(&self) -> f64 {
        let m = self.n_behaviours;
        if m < 2 {
            return 0.0;
        }
        self.pairwise().iter().sum::<f64>() / (m * (m - 1)) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn hand_derived_divergences() {
        // Same spread 0.5, means 1 apart: 1²/(2·0.25) = 2.
        assert!((kl_normal(1.0, 0.5_f64.ln(), 0.0, 0.5_f64.ln()) - 2.0).abs() < 1e-15);
        // Same mean, σ_p = 2σ_q: (4 − 1)/2 − ln 2.
        assert!((kl_normal(0.3, 2.0_f64.ln(), 0.3, 0.0) - (1.5 - 2.0_f64.ln())).abs() < 1e-15);
    }

    #[test]
    fn one_behaviour_has_no_diversity() {
        let actions = BehaviourActions::new(&[0.1, 0.2, 0.3, 0.4], &[0.0; 4], 1, 2).unwrap();
        assert_eq!(actions.diversity(), 0.0);
        assert_eq!(actions.pairwise(), vec![0.0]);
    }

    #[test]
    fn wrong_lengths_are_refused() {
        assert!(BehaviourActions::new(&[0.0; 5], &[0.0; 5], 2, 2).is_err());
        assert!(BehaviourActions::new(&[0.0; 4], &[0.0; 8], 2, 2).is_err());
        assert!(BehaviourActions::new(&[], &[], 2, 2).is_err());
        assert!(BehaviourActions::new(&[0.0; 4], &[0.0; 4], 0, 2).is_err());
    }

    #[test]
    fn a_refusal_names_the_length_that_would_fit() {
        let refused = |mean: usize, log_std: usize| match BehaviourActions::new(
            &vec![0.0; mean],
            &vec![0.0; log_std],
            3,
            2,
        ) {
            Err(DiversityError::Shape { name, expected, found }) => (name, expected, found),
            other => panic!("{other:?}"),
        };
        assert_eq!(refused(13, 13), ("mean", 12, 13));
        assert_eq!(refused(5, 5), ("mean", 6, 5));
        assert_eq!(refused(12, 6), ("log_std", 12, 6));
    }

    #[test]
    fn two_states_three_behaviours_by_hand() {
        // One dimension, σ = 1: KL is half the squared distance of the means. Distances 1, 3, 2
        // and then 2, 0, 2, of which the means are (½ + 2)/2, (4½ + 0)/2 and (2 + 2)/2.
        let mean = [0.0, 1.0, 3.0, 0.0, 2.0, 0.0];
        let actions = BehaviourActions::new(&mean, &[0.0; 6], 3, 1).unwrap();
        let (ab, ac, bc) = (1.25, 2.25, 2.0);
        assert_eq!(actions.pairwise(), [0.0, ab, ac, ab, 0.0, bc, ac, bc, 0.0]);
        assert!((actions.diversity() - 2.0 * (ab + ac + bc) / 6.0).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn divergence_is_not_negative_and_zero_only_for_equals(
            mean_p in -3.0..3.0_f64, mean_q in -3.0..3.0_f64, ls_p in -3.0..1.0_f64, ls_q in -3.0..1.0_f64,
        ) {
            prop_assert!(kl_normal(mean_p, ls_p, mean_q, ls_q) >= 0.0);
            prop_assert_eq!(kl_normal(mean_p, ls_p, mean_p, ls_p), 0.0);
        }

        #[test]
        fn the_mean_over_pairs_does_not_depend_on_the_order_of_behaviours(
            mean in proptest::collection::vec(-1.0..1.0_f64, 12), ls in proptest::collection::vec(-1.0..0.5_f64, 12),
        ) {
            // Two states, three behaviours, two dimensions; the behaviours turned by one.
            let turned = |xs: &[f64]| -> Vec<f64> {
                xs.chunks(6).flat_map(|state| [&state[2..], &state[..2]].concat()).collect()
            };
            let d = BehaviourActions::new(&mean, &ls, 3, 2).unwrap().diversity();
            let t = BehaviourActions::new(&turned(&mean), &turned(&ls), 3, 2).map(|a| a.diversity()).unwrap();
            prop_assert!((d - t).abs() <= 1e-12 * (1.0 + d));
        }
    }
}
