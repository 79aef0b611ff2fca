//! The inputs of a discriminator: observation rows, with the action behind them for q(z | s, a),
//! and training noise.
//!
//! The paper: "Adding one standard deviation of Gaussian noise to discriminator inputs helps
//! prevent overfitting" (section "Training Procedure"). One standard deviation of *what* is left
//! open; here it is each feature's own over the rollout, with the other readings in [`InputNoise`].

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::{DiscriminatorConfig, InputNoise};

/// Number of action values that q(z | s, a) reads behind the observation.
pub const ACTION_LEN: usize = 2;

/// Writes rows [observation | `action_scale` · action] into `rows`, which is resized.
///
/// # Shapes
///
/// `observations` `[B, width]`, `actions` `[B]`; `rows` becomes `[B, width + 2]`.
///
/// # Panics
///
/// When `observations` is not `[B, width]`.
pub fn state_action_rows(
    observations: &[f32],
    actions: &[[f32; ACTION_LEN]],
    action_scale: f64,
    rows: &mut Vec<f32>,
) {
    let width = observations.len() / actions.len().max(1);
    assert_eq!(width * actions.len(), observations.len(), "one action for each observation");
    rows.clear();
    for (observation, action) in observations.chunks_exact(width.max(1)).zip(actions) {
        rows.extend_from_slice(observation);
        rows.extend(action.iter().map(|&a| (f64::from(a) * action_scale) as f32));
    }
}

/// The standard deviation of the training noise on each input feature.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseLevels {
    sigma: Vec<f32>,
}

impl NoiseLevels {
    /// The levels that `config` asks for on `rows` `[B, width]`, the whole rollout; `None` when
    /// noise is off.
    ///
    /// The last `n_action` features are the action; with `noise_on_action = false` they stay clean.
    /// A feature that is constant over the rollout receives none under [`InputNoise::FeatureStd`].
    ///
    /// # Panics
    ///
    /// When `rows` is not a positive whole number of rows.
    pub fn new(config: &DiscriminatorConfig, rows: &[f32], width: usize, n_action: usize) -> Option<Self> {
        let n = (rows.len() / width) as f64;
        assert!(n > 0.0 && n as usize * width == rows.len(), "rows are [B, width]");
        let variance = || {
            let mean: Vec<f64> = column_sums(rows, width).iter().map(|sum| sum / n).collect();
            column_squares(rows, &mean).iter().map(|sum| sum / n).collect()
        };
        Self::of_variance(config, variance, width, n_action)
    }

    /// As [`Self::new`], from the variance of each feature, which is asked for only where the
    /// levels follow from it: for rollouts that lie in several parts.
    pub fn of_variance(
        config: &DiscriminatorConfig,
        variance: impl FnOnce() -> Vec<f64>,
        width: usize,
        n_action: usize,
    ) -> Option<Self> {
        let scale = config.noise_scale;
        let mut sigma: Vec<f32> = match config.noise {
            InputNoise::FeatureStd => variance().iter().map(|v| (v.sqrt() * scale) as f32).collect(),
            InputNoise::Absolute => vec![scale as f32; width],
            InputNoise::Off => return None,
        };
        if !config.noise_on_action {
            sigma[width - n_action..].fill(0.0);
        }
        Some(Self { sigma })
    }

    /// Writes `row` plus fresh noise to `noised`. One normal number is drawn for each feature, also
    /// where it is unused.
    pub fn add(&self, row: &[f32], noised: &mut [f32], rng: &mut impl Rng) {
        for ((noised, &clean), &sigma) in noised.iter_mut().zip(row).zip(&self.sigma) {
            let normal: f32 = StandardNormal.sample(rng);
            *noised = clean + sigma * normal;
        }
    }
}

/// Sum of each column of `rows` `[B, width]`, in f64 and in row order.
pub fn column_sums(rows: &[f32], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0_f64; width];
    for row in rows.chunks_exact(width) {
        sums.iter_mut().zip(row).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    sums
}

/// Sum of the squared distances of each column from its `mean`, in f64 and in row order.
pub fn column_squares(rows: &[f32], mean: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0_f64; mean.len()];
    for row in rows.chunks_exact(mean.len()) {
        for ((sum, mean), &x) in sums.iter_mut().zip(mean).zip(row) {
            *sum += (f64::from(x) - mean) * (f64::from(x) - mean);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn actions_stand_behind_the_observation() {
        let mut rows = vec![9.0; 3];
        state_action_rows(&[1.0, 2.0, 3.0, 4.0], &[[0.5, -0.5], [1.0, 0.25]], 2.0, &mut rows);
        assert_eq!(rows, [1.0, 2.0, 1.0, -1.0, 3.0, 4.0, 2.0, 0.5]);
    }

    #[test]
    fn levels_by_hand() {
        // Column 0: 1, 3 (std 1); column 1: constant; column 2, the action: 0, 4 (std 2).
        let rows = [1.0, 5.0, 0.0, 3.0, 5.0, 4.0];
        let default = DiscriminatorConfig::default;
        let levels = |config| NoiseLevels::new(&config, &rows, 3, 1).map(|levels| levels.sigma);
        assert_eq!(levels(default()), Some(vec![1.0, 0.0, 2.0]));
        assert_eq!(levels(DiscriminatorConfig { noise_scale: 0.5, ..default() }), Some(vec![0.5, 0.0, 1.0]));
        assert_eq!(
            levels(DiscriminatorConfig { noise_on_action: false, ..default() }),
            Some(vec![1.0, 0.0, 0.0])
        );
        let absolute = DiscriminatorConfig { noise: InputNoise::Absolute, noise_scale: 0.3, ..default() };
        assert_eq!(levels(absolute), Some(vec![0.3; 3]));
        assert_eq!(levels(DiscriminatorConfig { noise: InputNoise::Off, ..default() }), None);
    }

    #[test]
    fn noise_has_the_level_that_was_asked_for() {
        let levels = NoiseLevels { sigma: vec![0.0, 0.5, 2.0] };
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut noised = [0.0; 3];
        let mut squares = [0.0_f64; 3];
        let n = 20_000;
        for _ in 0..n {
            levels.add(&[1.0, 1.0, 1.0], &mut noised, &mut rng);
            squares.iter_mut().zip(noised).for_each(|(s, x)| *s += f64::from(x - 1.0).powi(2));
        }
        let std = squares.map(|s| (s / f64::from(n)).sqrt());
        assert_eq!(std[0], 0.0);
        assert!((std[1] - 0.5).abs() < 0.01 && (std[2] - 2.0).abs() < 0.04, "{std:?}");
    }
}
