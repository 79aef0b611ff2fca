//! The stochastic policy's action distribution: a diagonal Gaussian over (v, ω).
//!
//! Plain functions on two numbers, `f64` inside: they cost nothing beside the network, and the
//! ratio of probabilities in the surrogate is a difference of logarithms that are nearly equal.
//!
//! Actions are scored as they were sampled, before they are clipped to the robot's limits: the
//! clipped copy is executed, but its density would not be that of the sample.
//!
//! # References
//!
//! Schulman et al. 2017, arXiv:1707.06347 (the ratio); Kullback–Leibler divergence of Gaussians:
//! Cover and Thomas, Elements of Information Theory, chapter 8.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// ln(2π) / 2.
const HALF_LN_TAU: f64 = 0.918_938_533_204_672_7;

/// Two independent normal distributions, over v and over ω.
///
/// # Examples
///
/// ```
/// use jostle_policy::DiagonalGaussian;
/// let policy = DiagonalGaussian { mean: [0.5, 0.0], log_std: [0.0, 0.0] };
/// let at_mean = policy.log_prob([0.5, 0.0]);
/// assert!((at_mean + (2.0 * std::f64::consts::PI).ln()).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiagonalGaussian {
    /// Mean of v (behind the sigmoid) and of ω (behind tanh).
    pub mean: [f32; 2],
    /// Natural logarithm of the standard deviations.
    pub log_std: [f32; 2],
}

impl DiagonalGaussian {
    /// Natural logarithm of the density at `action`, summed over both dimensions.
    ///
    /// # Formula
    ///
    /// Σ −½·((a − μ)/σ)² − ln σ − ½·ln 2π
    pub fn log_prob(&self, action: [f32; 2]) -> f64 {
        let term = |i: usize| {
            let deviation = self.standardised(action, i);
            -0.5 * deviation * deviation - f64::from(self.log_std[i]) - HALF_LN_TAU
        };
        term(0) + term(1)
    }

    /// Gradient of [`log_prob`](Self::log_prob) with respect to the mean.
    ///
    /// # Formula
    ///
    /// (a − μ) / σ²
    pub fn d_log_prob_d_mean(&self, action: [f32; 2]) -> [f64; 2] {
        std::array::from_fn(|i| self.standardised(action, i) * (-f64::from(self.log_std[i])).exp())
    }

    /// Gradient of [`log_prob`](Self::log_prob) with respect to the logarithm of the standard
    /// deviation.
    ///
    /// # Formula
    ///
    /// ((a − μ)/σ)² − 1
    pub fn d_log_prob_d_log_std(&self, action: [f32; 2]) -> [f64; 2] {
        std::array::from_fn(|i| self.standardised(action, i).powi(2) - 1.0)
    }

    /// Differential entropy, summed over both dimensions; its gradient with respect to each
    /// `log_std` is 1.
    ///
    /// # Formula
    ///
    /// Σ ½ + ½·ln 2π + ln σ
    pub fn entropy(&self) -> f64 {
        1.0 + 2.0 * HALF_LN_TAU + f64::from(self.log_std[0]) + f64::from(self.log_std[1])
    }

    /// A draw, not clipped: v first, then ω, one standard normal each.
    pub fn sample(&self, rng: &mut impl Rng) -> [f32; 2] {
        std::array::from_fn(|i| {
            let normal: f64 = StandardNormal.sample(rng);
            (f64::from(self.mean[i]) + f64::from(self.log_std[i]).exp() * normal) as f32
        })
    }

    /// Kullback–Leibler divergence KL(self ‖ other), summed over both dimensions; never negative.
    ///
    /// # Formula
    ///
    /// Σ ln(σ₂/σ₁) + (σ₁² + (μ₁ − μ₂)²) / (2σ₂²) − ½
    pub fn kl(&self, other: &Self) -> f64 {
        let term = |i: usize| {
            let log_ratio = f64::from(other.log_std[i]) - f64::from(self.log_std[i]);
            let distance = other.standardised(self.mean, i);
            // exp_m1 keeps the digits where both distributions are nearly the same.
            0.5 * ((-2.0 * log_ratio).exp_m1() + 2.0 * log_ratio + distance * distance)
        };
        (term(0) + term(1)).max(0.0)
    }

    /// (a − μ) / σ in dimension `i`.
    fn standardised(&self, action: [f32; 2], i: usize) -> f64 {
        (f64::from(action[i]) - f64::from(self.mean[i])) * (-f64::from(self.log_std[i])).exp()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    const STEP: f32 = 1e-3;

    fn gaussian() -> impl Strategy<Value = DiagonalGaussian> {
        (prop::array::uniform2(-1.0_f32..1.0), prop::array::uniform2(-2.0_f32..1.0))
            .prop_map(|(mean, log_std)| DiagonalGaussian { mean, log_std })
    }

    #[test]
    fn values_worked_out_by_hand() {
        // σ = (1, e): the deviations of (1.5, −e) from (0.5, 0) are 1 and −1 standard deviations.
        let policy = DiagonalGaussian { mean: [0.5, 0.0], log_std: [0.0, 1.0] };
        let log_prob = policy.log_prob([1.5, -std::f32::consts::E]);
        assert!((log_prob - (-1.0 - 1.0 - 2.0 * HALF_LN_TAU)).abs() < 1e-7, "{log_prob}");
        assert!((policy.entropy() - 3.837_877_066_409_345_3).abs() < 1e-12);
        // Equal widths: ½·(Δμ/σ)²; equal means: ln(σ₂/σ₁) + σ₁²/(2σ₂²) − ½.
        let narrow = DiagonalGaussian { mean: [0.0, 0.0], log_std: [0.0, 0.0] };
        let moved = DiagonalGaussian { mean: [0.0, 2.0], ..narrow };
        assert_eq!(narrow.kl(&moved), 2.0);
        let wide = DiagonalGaussian { log_std: [1.0, 0.0], ..narrow };
        assert!((narrow.kl(&wide) - (0.5 + 0.5 * (-2.0_f64).exp())).abs() < 1e-15);
    }

    #[test]
    fn samples_have_the_mean_and_the_width() {
        let policy = DiagonalGaussian { mean: [0.5, -0.25], log_std: [-1.0, 0.5] };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let n = 40_000;
        let samples: Vec<[f32; 2]> = (0..n).map(|_| policy.sample(&mut rng)).collect();
        for i in 0..2 {
            let std = f64::from(policy.log_std[i]).exp();
            let mean = samples.iter().map(|a| f64::from(a[i])).sum::<f64>() / f64::from(n);
            let variance =
                samples.iter().map(|a| (f64::from(a[i]) - mean).powi(2)).sum::<f64>() / f64::from(n);
            // Five standard errors.
            assert!((mean - f64::from(policy.mean[i])).abs() < 5.0 * std / 200.0, "{mean}");
            assert!((variance.sqrt() / std - 1.0).abs() < 5.0 / 282.0, "{variance}");
        }
    }

    proptest! {
        #[test]
        fn kl_is_positive_and_zero_only_to_itself(p in gaussian(), q in gaussian()) {
            prop_assert_eq!(p.kl(&p), 0.0);
            prop_assert!(p == q || p.kl(&q) > 0.0);
        }

        #[test]
        fn gradients_are_those_of_finite_differences(p in gaussian(), action in prop::array::uniform2(-2.0_f32..2.0)) {
            for i in 0..2 {
                let slope = |change: &dyn Fn(&mut DiagonalGaussian, f32)| {
                    let (mut low, mut high) = (p, p);
                    change(&mut low, -STEP);
                    change(&mut high, STEP);
                    let width = f64::from(high.mean[i] - low.mean[i]) + f64::from(high.log_std[i] - low.log_std[i]);
                    (high.log_prob(action) - low.log_prob(action)) / width
                };
                let by_mean = slope(&|policy, step| policy.mean[i] += step);
                let by_width = slope(&|policy, step| policy.log_std[i] += step);
                let (d_mean, d_width) = (p.d_log_prob_d_mean(action)[i], p.d_log_prob_d_log_std(action)[i]);
                prop_assert!((by_mean - d_mean).abs() < 1e-3 * (1.0 + d_mean.abs()), "{} {}", by_mean, d_mean);
                prop_assert!((by_width - d_width).abs() < 1e-3 * (1.0 + d_width.abs()), "{} {}", by_width, d_width);
            }
        }
    }
}
