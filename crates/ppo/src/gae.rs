//! Generalised advantage estimation over agents' own episodes (Algorithm 1, line 9), and advantage
//! normalisation.
//!
//! Arithmetic is f64. An episode's end stops the sum, whether it was terminated or truncated; the
//! two differ only in the value that stands behind the last step. A rollout's end that cuts a
//! running episode is neither: it bootstraps.
//!
//! # Departures
//!
//! The paper's line 9 sums the undelayed `δ_t`; the sum meant, here and in its source, is over
//! `δ_{t+l}` (Schulman et al., arXiv:1506.02438, Eq. 16).

/// A step's relation to its episode, with the value behind the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepFate {
    /// The episode goes on.
    Running,
    /// Goal or crash: nothing stands behind this step.
    Terminated,
    /// The time limit cut the episode. `bootstrap_value` is V of its last observation, or 0 where
    /// truncation is not bootstrapped.
    Truncated {
        /// The value behind the cut.
        bootstrap_value: f64,
    },
}

/// Advantages of one agent's consecutive steps, written to `advantages`.
///
/// `last_value` is V of the observation after the last step; it has no effect when that step ends
/// an episode.
///
/// # Formula
///
/// `δ_t = r_t + γ·V_next − V_t` and `A_t = δ_t + γλ·A_{t+1}`, where `A_{t+1}` is dropped at an
/// episode's end and `V_next` is 0 (terminated), the bootstrap value (truncated), else `V_{t+1}` or
/// `last_value`.
///
/// # Shapes
///
/// `rewards`, `values`, `fates` and `advantages` are `[T]`.
///
/// # Panics
///
/// When the lengths differ.
///
/// # References
///
/// Schulman, Moritz, Levine, Jordan, Abbeel: High-Dimensional Continuous Control Using Generalized
/// Advantage Estimation, arXiv:1506.02438.
pub fn advantages(
    rewards: &[f64],
    values: &[f64],
    fates: &[StepFate],
    last_value: f64,
    (gamma, gae_lambda): (f64, f64),
    advantages: &mut [f64],
) {
    let n = rewards.len();
    assert!(values.len() == n && fates.len() == n && advantages.len() == n, "all are [T]");
    let (mut next_value, mut next_advantage) = (last_value, 0.0);
    for t in (0..n).rev() {
        let (behind, carried) = match fates[t] {
            StepFate::Running => (next_value, next_advantage),
            StepFate::Terminated => (0.0, 0.0),
            StepFate::Truncated { bootstrap_value } => (bootstrap_value, 0.0),
        };
        let delta = rewards[t] + gamma * behind - values[t];
        advantages[t] = delta + gamma * gae_lambda * carried;
        (next_value, next_advantage) = (values[t], advantages[t]);
    }
}

/// Shifts and scales `advantages` to mean 0 and population standard deviation 1, over the whole
/// rollout.
///
/// # Formula
///
/// (A − mean) / (population std + 1e-8)
pub fn normalise(advantages: &mut [f64]) {
    let n = advantages.len() as f64;
    let mean = advantages.iter().sum::<f64>() / n;
    let variance = squares(advantages, mean) / n;
    shift_and_scale(advantages, mean, variance);
}

/// Σ (x − mean)².
pub(crate) fn squares(values: &[f64], mean: f64) -> f64 {
    values.iter().map(|x| (x - mean) * (x - mean)).sum()
}

/// As [`normalise`], by a mean and a variance that were taken over more than these.
pub(crate) fn shift_and_scale(advantages: &mut [f64], mean: f64, variance: f64) {
    let scale = variance.sqrt() + 1e-8;
    for a in advantages {
        *a = (*a - mean) / scale;
    }
}

#[cfg(test)]
mod tests {
    use super::StepFate::{Running, Terminated, Truncated};
    use super::*;
    use proptest::prelude::*;

    fn of(
        rewards: &[f64],
        values: &[f64],
        fates: &[StepFate],
        last: f64,
        gamma: f64,
        lambda: f64,
    ) -> Vec<f64> {
        let mut result = vec![0.0; rewards.len()];
        advantages(rewards, values, fates, last, (gamma, lambda), &mut result);
        result
    }

    #[test]
    fn three_steps_by_hand() {
        // γ = λ = 0.5. δ_2 = 1 + 0.5·4 − 2 = 1; δ_1 = 0 + 0.5·2 − 1 = 0; δ_0 = 2 + 0.5·1 − 3 =
        // −0.5. A_2 = 1, A_1 = 0 + 0.25·1, A_0 = −0.5 + 0.25·0.25.
        let result = of(&[2.0, 0.0, 1.0], &[3.0, 1.0, 2.0], &[Running; 3], 4.0, 0.5, 0.5);
        assert_eq!(result, [-0.4375, 0.25, 1.0]);
    }

    #[test]
    fn truncation_differs_from_termination_by_its_bootstrap_alone() {
        let case = |fate| of(&[1.0, 1.0], &[0.5, 2.0], &[fate, Running], 3.0, 0.9, 0.8);
        assert_eq!(case(Terminated), case(Truncated { bootstrap_value: 0.0 }));
        let (cut, bootstrapped) = (case(Terminated), case(Truncated { bootstrap_value: 10.0 }));
        assert_eq!(bootstrapped[0] - cut[0], 9.0);
        assert_eq!(bootstrapped[1], cut[1]);
    }

    #[test]
    fn normalised_advantages_by_hand() {
        let mut a = [1.0, 3.0];
        normalise(&mut a);
        assert!((a[0] + 1.0).abs() < 1e-7 && (a[1] - 1.0).abs() < 1e-7);
        let mut equal = [2.5; 4];
        normalise(&mut equal);
        assert_eq!(equal, [0.0; 4]);
        // The standard deviation is 1e-8, as large as what is added to it.
        let mut tiny = [-1e-8, 1e-8];
        normalise(&mut tiny);
        assert!((tiny[0] + 0.5).abs() < 1e-12 && (tiny[1] - 0.5).abs() < 1e-12, "{tiny:?}");
    }

    #[test]
    #[should_panic(expected = "all are [T]")]
    fn fates_of_another_length_are_refused() {
        advantages(&[0.0; 2], &[0.0; 2], &[Running; 3], 0.0, (0.9, 0.9), &mut [0.0; 2]);
    }

    #[test]
    #[should_panic(expected = "all are [T]")]
    fn values_of_another_length_are_refused() {
        advantages(&[0.0; 2], &[0.0; 3], &[Running; 2], 0.0, (0.9, 0.9), &mut [0.0; 2]);
    }

    #[test]
    #[should_panic(expected = "all are [T]")]
    fn an_output_of_another_length_is_refused() {
        advantages(&[0.0; 2], &[0.0; 2], &[Running; 2], 0.0, (0.9, 0.9), &mut [0.0; 3]);
    }

    fn steps() -> impl Strategy<Value = (Vec<f64>, Vec<f64>, Vec<StepFate>)> {
        let fate = prop_oneof![
            4 => Just(Running), 1 => Just(Terminated),
            1 => (-5.0..5.0_f64).prop_map(|bootstrap_value| Truncated { bootstrap_value }),
        ];
        proptest::collection::vec((-2.0..2.0_f64, -3.0..3.0_f64, fate), 1..24).prop_map(|steps| {
            let rewards = steps.iter().map(|s| s.0).collect();
            let values = steps.iter().map(|s| s.1).collect();
            (rewards, values, steps.iter().map(|s| s.2).collect())
        })
    }

    proptest! {
        #[test]
        fn lambda_zero_is_the_temporal_difference((r, v, f) in steps(), last in -3.0..3.0_f64) {
            let a = of(&r, &v, &f, last, 0.9, 0.0);
            for t in 0..r.len() {
                let behind = match f[t] {
                    Running => v.get(t + 1).copied().unwrap_or(last),
                    Terminated => 0.0,
                    Truncated { bootstrap_value } => bootstrap_value,
                };
                prop_assert!((a[t] - (r[t] + 0.9 * behind - v[t])).abs() < 1e-12);
            }
        }

        #[test]
        fn lambda_one_is_the_discounted_return_minus_the_value((r, v, f) in steps(), last in -3.0..3.0_f64) {
            let a = of(&r, &v, &f, last, 0.9, 1.0);
            let mut ret = last;
            for t in (0..r.len()).rev() {
                ret = r[t] + 0.9 * match f[t] {
                    Running => ret,
                    Terminated => 0.0,
                    Truncated { bootstrap_value } => bootstrap_value,
                };
                prop_assert!((a[t] - (ret - v[t])).abs() < 1e-10);
            }
        }

        #[test]
        fn gamma_zero_sees_one_reward((r, v, f) in steps(), last in -3.0..3.0_f64) {
            let a = of(&r, &v, &f, last, 0.0, 0.95);
            prop_assert!((0..r.len()).all(|t| a[t] == r[t] - v[t]));
        }

        #[test]
        fn nothing_leaks_back_over_an_episode_end((r, v, f) in steps(), cut in 0..24_usize, noise in 1.0..9.0_f64) {
            let cut = cut % r.len();
            let mut f = f;
            f[cut] = Terminated;
            let before = of(&r, &v, &f, 0.3, 0.99, 0.95);
            let (mut r, mut v) = (r, v);
            r[cut + 1..].iter_mut().chain(&mut v[cut + 1..]).for_each(|x| *x += noise);
            let after = of(&r, &v, &f, 0.3 + noise, 0.99, 0.95);
            prop_assert_eq!(&before[..=cut], &after[..=cut]);
        }
    }
}
