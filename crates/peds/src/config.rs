//! One config section for all crowds.

use rand::Rng;
use rand_distr::{Distribution, Uniform};
use serde::{Deserialize, Serialize};

use crate::{
    CrowdKind, PedsError, VisibilityMatrix, error::require, orca::OrcaConfig,
    social_force::SocialForceConfig, validation::WalkersConfig,
};

/// Limits of the commands of learned pedestrians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LearnedConfig {
    /// Linear velocity is clipped to [0, `v_max`], m/s. Default 1, the robot's.
    pub v_max: f32,
    /// Angular velocity is clipped to ±`w_max`, rad/s. Default 1, the robot's.
    pub w_max: f32,
}

impl Default for LearnedConfig {
    fn default() -> Self {
        Self { v_max: 1.0, w_max: 1.0 }
    }
}

impl LearnedConfig {
    /// Checks both limits.
    ///
    /// # Errors
    /// A limit that is negative, not finite, or above 100.
    pub fn validate(&self) -> Result<(), PedsError> {
        let limit = |x: f32| (0.0..=100.0).contains(&x);
        require(limit(self.v_max), "v_max", self.v_max.into(), "0 to 100 m/s")?;
        require(limit(self.w_max), "w_max", self.w_max.into(), "0 to 100 rad/s")
    }
}

/// Parameters of the built-in crowds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CrowdsConfig {
    /// Range of VA's speed factors, drawn uniformly per pedestrian and episode. Default 0.5 to 1.5
    /// (paper, Sect. V).
    pub speed_factor: [f32; 2],
    /// Crowds NH, IN, VA, SO and cross-play.
    pub learned: LearnedConfig,
    /// Crowd VO.
    pub orca: OrcaConfig,
    /// Crowd SF.
    pub social_force: SocialForceConfig,
    /// The matrix of who sees whom.
    pub visibility: VisibilityMatrix,
    /// Validation crowds `straight` and `stop-and-go`. Left out of the written form at its default,
    /// so that the hashes of settings from before it are what they were.
    #[serde(skip_serializing_if = "WalkersConfig::is_default")]
    pub walkers: WalkersConfig,
}

impl Default for CrowdsConfig {
    fn default() -> Self {
        Self {
            speed_factor: [0.5, 1.5],
            learned: LearnedConfig::default(),
            orca: OrcaConfig::default(),
            social_force: SocialForceConfig::default(),
            visibility: VisibilityMatrix::default(),
            walkers: WalkersConfig::default(),
        }
    }
}

impl CrowdsConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// The first field out of its range.
    pub fn validate(&self) -> Result<(), PedsError> {
        let [low, high] = self.speed_factor;
        require((0.0..=100.0).contains(&low), "speed_factor[0]", low.into(), "0 to 100")?;
        require((low..=100.0).contains(&high), "speed_factor[1]", high.into(), "speed_factor[0] to 100")?;
        self.learned.validate()?;
        self.orca.validate()?;
        self.social_force.validate()?;
        self.walkers.validate()
    }

    /// A pedestrian's speed factor for an episode. VA draws it from [`Self::speed_factor`], SF from
    /// its desired speed if that is a distribution, the walkers from their speeds; elsewhere it is
    /// 1 and nothing is drawn. The config must be valid.
    pub fn draw_speed_factor(&self, kind: CrowdKind, rng: &mut impl Rng) -> f32 {
        let [low, high] = self.speed_factor;
        match kind {
            CrowdKind::Va => Uniform::new_inclusive(low, high).expect("a validated range").sample(rng),
            CrowdKind::Sf => self.social_force.desired_speed.draw_factor(rng),
            CrowdKind::Straight | CrowdKind::StopAndGo => self.walkers.draw_speed(rng),
            CrowdKind::Nh
            | CrowdKind::In
            | CrowdKind::So
            | CrowdKind::Vo
            | CrowdKind::CrossPlay
            | CrowdKind::Recorded => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    use super::*;

    #[test]
    fn only_va_draws_by_default() {
        let config = CrowdsConfig::default();
        assert_eq!(config.validate(), Ok(()));
        for kind in CrowdKind::PAPER {
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let factors: Vec<f32> = (0..200).map(|_| config.draw_speed_factor(kind, &mut rng)).collect();
            if kind == CrowdKind::Va {
                assert!(factors.iter().all(|f| (0.5..=1.5).contains(f)));
                assert!(factors.iter().any(|f| *f < 0.6) && factors.iter().any(|f| *f > 1.4));
            } else {
                assert!(factors.iter().all(|f| *f == 1.0));
                assert_eq!(rng, ChaCha8Rng::seed_from_u64(3), "nothing may be drawn");
            }
        }
    }

    #[test]
    fn a_reversed_range_is_refused() {
        let config = CrowdsConfig { speed_factor: [1.5, 0.5], ..CrowdsConfig::default() };
        assert!(config.validate().is_err());
    }
    #[test]
    fn every_part_is_checked() {
        let config = CrowdsConfig::default();
        let learned =
            |v_max, w_max| CrowdsConfig { learned: LearnedConfig { v_max, w_max }, ..config.clone() };
        assert_eq!(learned(100.0, 100.0).validate(), Ok(()));
        let orca = OrcaConfig { robot_radius: -1.0, ..config.orca };
        let social_force = SocialForceConfig { tau: 0.0, ..config.social_force };
        for bad in [
            learned(-1.0, 1.0),
            learned(1.0, 101.0),
            CrowdsConfig { orca, ..config.clone() },
            CrowdsConfig { social_force, ..config.clone() },
            CrowdsConfig { speed_factor: [-0.5, 1.0], ..config.clone() },
            CrowdsConfig { walkers: WalkersConfig { speed: [2.0, 1.0], ..config.walkers }, ..config.clone() },
        ] {
            assert!(bad.validate().is_err(), "{bad:?}");
        }
    }

    #[test]
    fn walkers_draw_their_speeds_and_are_left_out_at_their_defaults() {
        let mut config = CrowdsConfig::default();
        assert!(!serde_json::to_string(&config).unwrap().contains("walkers"));
        for kind in [CrowdKind::Straight, CrowdKind::StopAndGo] {
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let speeds: Vec<f32> = (0..200).map(|_| config.draw_speed_factor(kind, &mut rng)).collect();
            assert!(speeds.iter().all(|speed| (0.5..=1.5).contains(speed)));
            assert!(speeds.iter().any(|f| *f < 0.6) && speeds.iter().any(|f| *f > 1.4));
        }
        config.walkers.stand_time = [0.5, 2.0];
        let text = serde_json::to_string(&config).unwrap();
        assert_eq!(serde_json::from_str::<CrowdsConfig>(&text).unwrap(), config);
    }

    #[test]
    fn sf_draws_where_its_desired_speed_is_a_distribution() {
        let mut config = CrowdsConfig::default();
        config.social_force.desired_speed = crate::social_force::DesiredSpeed::HELBING;
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let factors: Vec<f32> = (0..50).map(|_| config.draw_speed_factor(CrowdKind::Sf, &mut rng)).collect();
        assert!(factors.iter().any(|f| *f > 1.1) && factors.iter().any(|f| *f < 0.9), "{factors:?}");
    }
}
