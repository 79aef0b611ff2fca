//! The driver: a trained policy or a planner that reads observation rows, as the other commands
//! name them.

use std::path::Path;

use jostle_arena::{ArenaError, Driver as Named, RobotPolicy, TrainedRobot};
use jostle_policy::Backend;
use jostle_sim::SimConfig;

use crate::error::RosError;

/// A policy that is ready, with the settings of the world that its rows come from.
pub struct Chosen {
    /// Its name.
    pub name: String,
    /// The policy.
    pub policy: Box<dyn RobotPolicy>,
    /// Its laser, robot and period.
    pub sim: SimConfig,
}

/// The policy that a path or a planner's name means.
///
/// # Errors
///
/// No policy there; a token that it does not know; a planner that knows positions, which no laser
/// tells.
pub fn choose(path: &Path, token: u32) -> Result<Chosen, RosError> {
    let named = jostle_runs::policies::driver(path)?;
    let name = named.identity().name;
    match &named {
        Named::Trained(trained) => {
            let policy = Box::new(TrainedRobot::new(trained, token, Backend::default())?);
            Ok(Chosen { name, policy, sim: trained.sim_config()? })
        }
        Named::Planner(planner) => {
            if token != 0 {
                let expected = format!("0: the planner {planner} knows no behaviours");
                return Err(ArenaError::Setting { field: "token", found: token.to_string(), expected }.into());
            }
            let sim = SimConfig::default();
            Ok(Chosen { name, policy: planner.policy(&sim)?, sim })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(path: &str, token: u32) -> String {
        choose(Path::new(path), token).err().expect("refused").to_string()
    }

    #[test]
    fn planners_of_the_row_drive_and_others_say_why_they_do_not() {
        for name in ["dwa", "goal-seeker", "brake", "straight"] {
            let mut chosen = choose(Path::new(name), 0).unwrap();
            let mut action = [[f32::NAN; 2]];
            let mut row = vec![0.5; chosen.sim.observation_len()];
            row[1536..].copy_from_slice(&[3.0, 0.0, 0.0, 0.0]);
            chosen.policy.act(&row, &mut action);
            assert!(action[0][0] > 0.5, "{name} does not drive to a free goal: {action:?}");
        }
        assert!(
            refusal("orca", 0)
                .starts_with("planner orca: found observation rows, expected everyone's position")
        );
        assert!(refusal("dwa", 1).starts_with("token: found 1, expected 0"));
        assert!(refusal("dwb", 0).ends_with("did you mean dwa?"));
    }

    #[test]
    fn a_shipped_policy_drives_with_its_own_settings() {
        let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/strong-seed1-002035.safetensors");
        let mut chosen = choose(Path::new(shipped), 0).unwrap();
        assert_eq!((chosen.sim.laser.beams, chosen.sim.episode.dt), (512, 0.1));
        let mut action = [[f32::NAN; 2]];
        let mut row = vec![0.5; chosen.sim.observation_len()];
        row[1536..].copy_from_slice(&[5.0, 0.0, 0.5, 0.0]);
        chosen.policy.act(&row, &mut action);
        assert!(action[0][0] > 0.5, "{action:?}");
        assert!(refusal(shipped, 9).starts_with("token: found 9, expected less than"));
    }
}
