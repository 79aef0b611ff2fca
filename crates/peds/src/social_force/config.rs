//! Parameters of the social force model and the variants in which implementations differ.

use rand::Rng;
use rand_distr::{Distribution, Normal};
use serde::{Deserialize, Serialize};

use crate::{PedsError, error::require};

/// The direction that must lie in a pedestrian's view for another to count fully.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViewTest {
    /// Against the force: −f (the article's w(e, −f)).
    Force,
    /// Towards the other's position: −r.
    Position,
}

/// The article, the package socialforce, and the two mixtures of their choices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Step 2 s, view test on the force.
    #[default]
    Paper,
    /// Step 0.4 s, view test on the position.
    Package,
    /// Step 2 s, view test on the position.
    PaperStepPositionView,
    /// Step 0.4 s, view test on the force.
    PackageStepForceView,
}

impl Variant {
    /// All four.
    pub const ALL: [Self; 4] =
        [Self::Paper, Self::Package, Self::PaperStepPositionView, Self::PackageStepForceView];

    /// The name in configs and fixtures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Package => "package",
            Self::PaperStepPositionView => "paper_step_position_view",
            Self::PackageStepForceView => "package_step_force_view",
        }
    }

    /// Δt in b: for how long the other's step is foreseen, s.
    pub fn foresight(self) -> f64 {
        match self {
            Self::Paper | Self::PaperStepPositionView => 2.0,
            Self::Package | Self::PackageStepForceView => 0.4,
        }
    }

    /// The view test.
    pub fn view_test(self) -> ViewTest {
        match self {
            Self::Paper | Self::PackageStepForceView => ViewTest::Force,
            Self::Package | Self::PaperStepPositionView => ViewTest::Position,
        }
    }
}

/// The speed that pedestrians prefer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum DesiredSpeed {
    /// The same for all, m/s.
    Fixed(f64),
    /// Drawn per pedestrian and episode; the article has N(1.34, 0.26).
    Normal {
        /// m/s.
        mean: f64,
        /// m/s.
        std: f64,
    },
}

impl DesiredSpeed {
    /// The article's distribution.
    pub const HELBING: Self = Self::Normal { mean: 1.34, std: 0.26 };

    /// The fixed speed or the mean: what a speed factor multiplies.
    pub fn base(self) -> f64 {
        match self {
            Self::Fixed(speed) => speed,
            Self::Normal { mean, .. } => mean,
        }
    }

    /// A pedestrian's factor on [`Self::base`]; draws that are not positive are drawn again. 1
    /// without a draw if fixed.
    pub fn draw_factor(self, rng: &mut impl Rng) -> f32 {
        let Self::Normal { mean, std } = self else { return 1.0 };
        let normal = Normal::new(1.0, std / mean).expect("a validated standard deviation");
        loop {
            let factor: f64 = normal.sample(rng);
            if factor > 0.0 {
                return factor as f32;
            }
        }
    }

    fn validate(self) -> Result<(), PedsError> {
        let base = self.base();
        require(base > 0.0 && base <= 100.0, "desired_speed", base, "above 0, to 100 m/s")?;
        if let Self::Normal { mean, std } = self {
            require((0.0..=mean).contains(&std), "desired_speed.std", std, "0 to the mean")?;
        }
        Ok(())
    }
}

/// Parameters of the model. Defaults are the article's, but for the desired speed, which is the
/// robot's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SocialForceConfig {
    /// The choices in which implementations differ.
    pub variant: Variant,
    /// Default 1 m/s for all.
    pub desired_speed: DesiredSpeed,
    /// Speed limit as a multiple of the desired speed. Default 1.3.
    pub max_speed_factor: f64,
    /// Relaxation time τ, s. Default 0.5.
    pub tau: f64,
    /// Potential V⁰ between pedestrians, m²/s². Default 2.1.
    pub v0: f64,
    /// Its range σ, m. Default 0.3.
    pub sigma: f64,
    /// Potential U⁰ of borders, m²/s². Default 10.
    pub u0: f64,
    /// Its range R, m. Default 0.2.
    pub r: f64,
    /// Field of view 2φ, degrees. Default 200.
    pub field_of_view_degrees: f64,
    /// Weight c of those out of view. Default 0.5.
    pub out_of_view_weight: f64,
    /// Least b, m. Default 0.001.
    pub b_min: f64,
}

impl Default for SocialForceConfig {
    fn default() -> Self {
        Self {
            variant: Variant::Paper,
            desired_speed: DesiredSpeed::Fixed(1.0),
            max_speed_factor: 1.3,
            tau: 0.5,
            v0: 2.1,
            sigma: 0.3,
            u0: 10.0,
            r: 0.2,
            field_of_view_degrees: 200.0,
            out_of_view_weight: 0.5,
            b_min: 1e-3,
        }
    }
}

impl SocialForceConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// The first field out of its range.
    pub fn validate(&self) -> Result<(), PedsError> {
        let length = |x: f64| (1e-3..=1e3).contains(&x);
        let potential = |x: f64| (0.0..=1e6).contains(&x);
        self.desired_speed.validate()?;
        let limit = self.max_speed_factor;
        require((0.0..=100.0).contains(&limit), "max_speed_factor", limit, "0 to 100")?;
        require(length(self.tau), "tau", self.tau, "0.001 to 1000 s")?;
        require(potential(self.v0), "v0", self.v0, "0 to 1e6 m²/s²")?;
        require(length(self.sigma), "sigma", self.sigma, "0.001 to 1000 m")?;
        require(potential(self.u0), "u0", self.u0, "0 to 1e6 m²/s²")?;
        require(length(self.r), "r", self.r, "0.001 to 1000 m")?;
        let view = self.field_of_view_degrees;
        require((0.0..=360.0).contains(&view), "field_of_view_degrees", view, "0 to 360")?;
        let weight = self.out_of_view_weight;
        require((0.0..=1.0).contains(&weight), "out_of_view_weight", weight, "0 to 1")?;
        require((1e-6..=1.0).contains(&self.b_min), "b_min", self.b_min, "1e-6 to 1 m")
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    use super::*;

    #[test]
    fn the_defaults_are_valid_and_nan_is_not() {
        let config = SocialForceConfig::default();
        assert_eq!(config.validate(), Ok(()));
        assert!(SocialForceConfig { tau: f64::NAN, ..config }.validate().is_err());
        assert!(SocialForceConfig { sigma: 0.0, ..config }.validate().is_err());
        let backwards = DesiredSpeed::Fixed(-1.0);
        assert!(SocialForceConfig { desired_speed: backwards, ..config }.validate().is_err());
    }

    #[test]
    fn variants_are_named_as_they_are_written() {
        for variant in Variant::ALL {
            assert_eq!(serde_json::to_string(&variant).unwrap(), format!("\"{}\"", variant.name()));
        }
        let text = r#"{"desired_speed":{"normal":{"mean":1.34,"std":0.26}}}"#;
        let config: SocialForceConfig = serde_json::from_str(text).unwrap();
        assert_eq!(config.desired_speed, DesiredSpeed::HELBING);
    }

    #[test]
    fn drawn_speeds_have_the_mean_and_deviation_asked_for() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let n = 20_000;
        let draw = |_| f64::from(DesiredSpeed::HELBING.draw_factor(&mut rng)) * 1.34;
        let speeds: Vec<f64> = (0..n).map(draw).collect();
        let mean = speeds.iter().sum::<f64>() / f64::from(n);
        let variance = speeds.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
        assert!((mean - 1.34).abs() < 0.01 && (variance.sqrt() - 0.26).abs() < 0.01, "{mean} {variance}");
    }
    #[test]
    fn ranges_end_where_they_say() {
        let config = SocialForceConfig::default();
        let accepts = |desired_speed| SocialForceConfig { desired_speed, ..config }.validate().is_ok();
        assert!(accepts(DesiredSpeed::Fixed(100.0)) && !accepts(DesiredSpeed::Fixed(100.1)));
        assert!(!accepts(DesiredSpeed::Fixed(0.0)) && !accepts(DesiredSpeed::Fixed(f64::NAN)));
        assert!(accepts(DesiredSpeed::Normal { mean: 1.0, std: 1.0 }));
        assert!(!accepts(DesiredSpeed::Normal { mean: 1.0, std: 1.1 }));
        assert!(!accepts(DesiredSpeed::Normal { mean: 1.0, std: -0.1 }));
        for bad in [
            SocialForceConfig { max_speed_factor: -1.0, ..config },
            SocialForceConfig { v0: -1.0, ..config },
            SocialForceConfig { u0: f64::INFINITY, ..config },
            SocialForceConfig { r: 0.0, ..config },
            SocialForceConfig { field_of_view_degrees: 361.0, ..config },
            SocialForceConfig { out_of_view_weight: 1.5, ..config },
            SocialForceConfig { b_min: 0.0, ..config },
        ] {
            assert!(bad.validate().is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_factor_multiplies_the_base_and_is_never_negative() {
        assert_eq!((DesiredSpeed::Fixed(1.5).base(), DesiredSpeed::HELBING.base()), (1.5, 1.34));
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        assert_eq!(DesiredSpeed::Fixed(1.5).draw_factor(&mut rng), 1.0);
        // A sixth of these draws would be negative.
        let wide = DesiredSpeed::Normal { mean: 2.0, std: 2.0 };
        assert!((0..1000).all(|_| wide.draw_factor(&mut rng) > 0.0));
    }
}
