//! What a Python caller may set: a training file, keys of it, the crowd, the number of pedestrians, who sees the robot.

use std::path::Path;

use jostle_eval::{EvalConfig, EvalError, Pools};
use jostle_peds::CrowdKind;
use jostle_ppo::{Config, PpoError};

/// Everything that a room among a crowd is made from.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Room, robot, laser, crowds, number of agents.
    pub config: EvalConfig,
    /// The crowd.
    pub crowd: CrowdKind,
    /// The pedestrians' policies, for crowds that need them.
    pub pools: Pools,
}

impl Settings {
    /// Settings for a crowd.
    ///
    /// `base` is the training configuration, of which the simulator and the number of agents are taken;
    /// `n_pedestrians` and `robot_visible` override its number and the crowd's row of the visibility matrix. `pools` drive
    /// the pedestrians.
    ///
    /// # Errors
    ///
    /// A setting out of range.
    pub fn new(
        base: &Config,
        crowd: CrowdKind,
        n_pedestrians: Option<usize>,
        robot_visible: Option<bool>,
        pools: Pools,
    ) -> Result<Self, EvalError> {
        let mut config =
            EvalConfig { sim: base.sim.clone(), n_agents: base.n_agents, ..EvalConfig::default() };
        if let Some(n_pedestrians) = n_pedestrians {
            config.n_agents = n_pedestrians.saturating_add(1);
        }
        if let Some(robot) = robot_visible {
            let refused = || EvalError::Setting {
                field: "robot_visible",
                found: format!("{robot} for crowd {crowd}"),
                expected: "nothing: its pedestrians see nobody".to_owned(),
            };
            config.crowds.visibility.row_mut(crowd).ok_or_else(refused)?.robot = robot;
        }
        config.validate()?;
        Ok(Self { config, crowd, pools })
    }
}

/// Reads a training configuration, or the paper's where there is no file, and applies `key=value` overrides.
///
/// # Errors
///
/// As [`Config::load`].
pub fn base(file: Option<&Path>, overrides: &[String]) -> Result<Config, PpoError> {
    match file {
        Some(path) => Config::load(path, overrides),
        None => Config::parse("", "settings", overrides),
    }
}

#[cfg(test)]
mod tests {
    use jostle_peds::Visibility;

    use super::*;

    fn sf(n_pedestrians: Option<usize>, robot_visible: Option<bool>) -> Settings {
        let base = base(None, &["n_agents=4".to_owned()]).unwrap();
        Settings::new(&base, CrowdKind::Sf, n_pedestrians, robot_visible, Pools::default()).unwrap()
    }

    #[test]
    fn what_is_not_given_is_the_configurations() {
        assert_eq!(sf(None, None).config.n_pedestrians(), 3);
        assert_eq!(sf(Some(7), None).config.n_pedestrians(), 7);
        assert_eq!(sf(None, None).config.crowds, EvalConfig::default().crowds);
        for crowd in CrowdKind::PAPER {
            let base = base(None, &[]).unwrap();
            for robot in [false, true] {
                let settings = Settings::new(&base, crowd, None, Some(robot), Pools::default()).unwrap();
                assert_eq!(
                    settings.config.crowds.visibility.of(crowd),
                    Some(Visibility { pedestrians: true, robot })
                );
            }
        }
    }

    #[test]
    fn mistakes_are_one_line() {
        let error = base(None, &["sim.laser.beam=3".to_owned()]).unwrap_err().to_string();
        assert_eq!(error, "--set sim.laser.beam=3: sim.laser.beam: found an unknown key, expected beams");
        let base = base(None, &[]).unwrap();
        let error = Settings::new(&base, CrowdKind::Sf, Some(usize::MAX), None, Pools::default())
            .unwrap_err()
            .to_string();
        assert!(error.starts_with("n_agents: found") && error.lines().count() == 1, "{error}");
        let error = Settings::new(&base, CrowdKind::Straight, None, Some(true), Pools::default())
            .unwrap_err()
            .to_string();
        let expected = "found true for crowd straight, expected nothing: its pedestrians see nobody";
        assert_eq!(error, format!("robot_visible: {expected}"));
    }
}
