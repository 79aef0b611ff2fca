//! Adam with moments that can be saved and restored to the bit.
//!
//! The loop itself is `jostle_policy`'s fused kernel. No weight decay; ε stands outside the square
//! root; bias corrections are computed in f64 from the step count.
//!
//! # References
//!
//! Kingma and Ba: Adam: A Method for Stochastic Optimization, arXiv:1412.6980, Algorithm 1.

use jostle_kernels::{AdamStep, Isa, adam_step};

/// Decay of the first moment, β₁ (the article's default).
pub const BETA_1: f64 = 0.9;
/// Decay of the second moment, β₂ (the article's default).
pub const BETA_2: f64 = 0.999;
/// ε (the article's default).
pub const EPSILON: f64 = 1e-8;

/// One network's optimiser: step size, step count and both moments, in the order of the parameters
/// it steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    isa: Isa,
    learning_rate: f64,
    steps: u64,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Adam {
    /// Fresh moments for `n_parameters`.
    pub fn new(n_parameters: usize, learning_rate: f64) -> Self {
        Self::resume(learning_rate, 0, vec![0.0; n_parameters], vec![0.0; n_parameters])
    }

    /// An optimiser that goes on where another stopped.
    ///
    /// # Panics
    ///
    /// When the moments differ in length.
    pub fn resume(learning_rate: f64, steps: u64, first: Vec<f32>, second: Vec<f32>) -> Self {
        assert_eq!(first.len(), second.len(), "one pair of moments for each parameter");
        Self { isa: Isa::detect(), learning_rate, steps, first, second }
    }

    /// Step size.
    pub fn learning_rate(&self) -> f64 {
        self.learning_rate
    }

    /// Changes the step size of the steps to come.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.learning_rate = learning_rate;
    }

    /// Number of steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// First moments m, in the order of the parameters.
    pub fn first_moments(&self) -> &[f32] {
        &self.first
    }

    /// Second moments v, in the order of the parameters.
    pub fn second_moments(&self) -> &[f32] {
        &self.second
    }

    /// One step down the gradient, in place.
    ///
    /// # Formula
    ///
    /// m ← β₁m + (1 − β₁)g; v ← β₂v + (1 − β₂)g²; θ ← θ − lr·(m/(1 − β₁ᵗ)) / (√(v/(1 − β₂ᵗ)) + ε)
    ///
    /// # Panics
    ///
    /// When a length differs from the number of moments.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32]) {
        assert!(
            parameters.len() == self.first.len() && gradient.len() == self.first.len(),
            "one for each moment"
        );
        self.steps += 1;
        let constants = AdamStep {
            learning_rate: self.learning_rate,
            beta1: BETA_1,
            beta2: BETA_2,
            epsilon: EPSILON,
            step: self.steps,
        };
        adam_step(self.isa, parameters, gradient, &mut self.first, &mut self.second, &constants);
    }
}

/// Scales `gradient` down to the L2 norm `max_norm` when it is longer; 0 turns this off. Returns
/// the norm before.
pub fn clip_norm(gradient: &mut [f32], max_norm: f64) -> f64 {
    let norm = gradient.iter().map(|&g| f64::from(g) * f64::from(g)).sum::<f64>().sqrt();
    if max_norm > 0.0 && norm > max_norm {
        let scale = (max_norm / norm) as f32;
        for g in gradient {
            *g *= scale;
        }
    }
    norm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_learning_rate() {
        let mut adam = Adam::new(3, 0.01);
        let mut theta = [1.0, 2.0, 3.0];
        adam.step(&mut theta, &[5.0, -0.2, 0.0]);
        assert!((theta[0] - 0.99).abs() < 1e-6 && (theta[1] - 2.01).abs() < 1e-6 && theta[2] == 3.0);
    }

    #[test]
    fn two_steps_by_hand() {
        // g = 1, then −1: m = 0.1, then −0.01; v = 1e-3, then 1.999e-3; corrections 0.19 and
        // 1.999e-3.
        let mut adam = Adam::new(1, 0.1);
        let mut theta = [0.0];
        adam.step(&mut theta, &[1.0]);
        adam.step(&mut theta, &[-1.0]);
        let expected = -0.1 + 0.1 * (0.01 / 0.19);
        assert!((f64::from(theta[0]) - expected).abs() < 1e-7, "{theta:?}");
    }

    #[test]
    fn a_resumed_optimiser_takes_the_same_steps() {
        let gradient = |t: usize| [(t as f32).sin(), 0.3 - t as f32 * 0.1];
        let mut whole = (Adam::new(2, 1e-3), [0.5, -0.5]);
        (0..6).for_each(|t| whole.0.step(&mut whole.1, &gradient(t)));
        let mut first = (Adam::new(2, 1e-3), [0.5, -0.5]);
        (0..3).for_each(|t| first.0.step(&mut first.1, &gradient(t)));
        let (m, v) = (first.0.first_moments().to_vec(), first.0.second_moments().to_vec());
        let mut second = (Adam::resume(1e-3, first.0.steps(), m, v), first.1);
        (3..6).for_each(|t| second.0.step(&mut second.1, &gradient(t)));
        assert_eq!(whole, second);
    }

    #[test]
    fn what_was_given_is_what_is_told() {
        let mut adam = Adam::resume(0.25, 7, vec![0.5, -0.5], vec![0.125, 2.0]);
        assert_eq!((adam.learning_rate(), adam.steps()), (0.25, 7));
        assert_eq!((adam.first_moments(), adam.second_moments()), (&[0.5, -0.5][..], &[0.125, 2.0][..]));
        adam.step(&mut [0.0; 2], &[1.0; 2]);
        assert_eq!(adam.steps(), 8);
    }

    #[test]
    #[should_panic(expected = "one for each moment")]
    fn parameters_of_another_length_are_refused() {
        Adam::new(2, 0.1).step(&mut [0.0; 3], &[0.0; 2]);
    }

    #[test]
    #[should_panic(expected = "one for each moment")]
    fn a_gradient_of_another_length_is_refused() {
        Adam::new(2, 0.1).step(&mut [0.0; 2], &[0.0; 3]);
    }

    #[test]
    fn clipping_keeps_the_direction() {
        let mut gradient = [3.0, -4.0];
        assert_eq!(clip_norm(&mut gradient, 0.0), 5.0);
        assert_eq!(gradient, [3.0, -4.0]);
        assert_eq!(clip_norm(&mut gradient, 10.0), 5.0);
        assert_eq!(gradient, [3.0, -4.0]);
        assert_eq!(clip_norm(&mut gradient, 1.0), 5.0);
        assert!((gradient[0] - 0.6).abs() < 1e-7 && (gradient[1] + 0.8).abs() < 1e-7);
    }
}
