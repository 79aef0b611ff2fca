//! Configuration of the two discriminators: section `[discriminator]` of a training configuration.

use serde::{Deserialize, Serialize};

use crate::DiversityError;

/// Gaussian noise on a discriminator's inputs while it is trained (never when a reward is
/// computed).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum InputNoise {
    /// `noise_scale` standard deviations of each feature over the rollout.
    #[default]
    FeatureStd,
    /// The same standard deviation `noise_scale` on every feature, in the feature's own unit.
    Absolute,
    /// None.
    Off,
}

/// Form of the action that q(z | s, a) is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ActionInput {
    /// The clipped copy that the robot executed.
    #[default]
    Executed,
    /// The sample as it was drawn.
    Raw,
}

/// Both discriminators' shape, input and training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct DiscriminatorConfig {
    /// Units of each of the two hidden layers; ≥ 1. Default 128 (the paper: "two-layer feed-forward
    /// network with 128 hidden units").
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536, "origin" = "the paper: \"two-layer feed-forward network with 128 hidden units\"")))]
    pub hidden: usize,
    /// Adam's step size; > 0. Default 5e-5 (the paper's table of hyper-parameters).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "origin" = "the paper's table of hyper-parameters")))]
    pub learning_rate: f64,
    /// Kind of input noise while training. Default `feature_std` ("one standard deviation of
    /// Gaussian noise").
    #[cfg_attr(feature = "schema", schemars(extend("origin" = "\"one standard deviation of Gaussian noise\"")))]
    pub noise: InputNoise,
    /// Multiple of each feature's standard deviation (`feature_std`), or the standard deviation
    /// itself (`absolute`); ≥ 0. Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0)))]
    pub noise_scale: f64,
    /// Noise on the two action inputs of q(z | s, a), too. Default true.
    pub noise_on_action: bool,
    /// Form of the action that is shown to q(z | s, a). Default `executed`.
    pub action: ActionInput,
    /// Factor on the two action inputs of q(z | s, a), which stand against 1,540 others; > 0.
    /// Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0)))]
    pub action_scale: f64,
}

impl Default for DiscriminatorConfig {
    fn default() -> Self {
        Self {
            hidden: 128,
            learning_rate: 5e-5,
            noise: InputNoise::default(),
            noise_scale: 1.0,
            noise_on_action: true,
            action: ActionInput::default(),
            action_scale: 1.0,
        }
    }
}

impl DiscriminatorConfig {
    /// Checks every value's range.
    ///
    /// # Errors
    ///
    /// [`DiversityError::Config`] naming the first key that is out of range.
    pub fn validate(&self) -> Result<(), DiversityError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let check = |ok: bool, field, expected, found: String| {
            if ok { Ok(()) } else { Err(DiversityError::Config { field, expected, found }) }
        };
        check((1..=65_536).contains(&self.hidden), "hidden", "1 to 65536", self.hidden.to_string())?;
        let rate = self.learning_rate;
        check(positive(rate), "learning_rate", "a finite number > 0", rate.to_string())?;
        let noise = self.noise_scale;
        check(noise.is_finite() && noise >= 0.0, "noise_scale", "a finite number ≥ 0", noise.to_string())?;
        let scale = self.action_scale;
        check(positive(scale), "action_scale", "a finite number > 0", scale.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_bad_values_are_named() {
        DiscriminatorConfig::default().validate().unwrap();
        let field_of = |config: DiscriminatorConfig| match config.validate() {
            Err(DiversityError::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let default = DiscriminatorConfig::default;
        assert_eq!(field_of(DiscriminatorConfig { hidden: 0, ..default() }), "hidden");
        assert_eq!(field_of(DiscriminatorConfig { learning_rate: -1.0, ..default() }), "learning_rate");
        assert_eq!(field_of(DiscriminatorConfig { noise_scale: f64::NAN, ..default() }), "noise_scale");
        assert_eq!(field_of(DiscriminatorConfig { action_scale: 0.0, ..default() }), "action_scale");
    }
}
