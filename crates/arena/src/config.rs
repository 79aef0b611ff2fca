//! Settings of a test: the room, the crowds, and how episodes are run.

use jostle_peds::CrowdsConfig;
use jostle_policy::Backend;
use jostle_sim::SimConfig;
use serde::{Deserialize, Serialize};

use crate::error::ArenaError;
use crate::identity::hex_sha256;
use crate::recording::RecordingConfig;
use crate::scene::SceneConfig;

/// Part of the hashes of settings with a map, to be raised whenever an episode on a map may end
/// differently for the same settings. 2: crowds know walls as one area
/// ([`jostle_sim::Scenario::boundary`]), whatever pieces a map has.
pub const MAP_VERSION: u32 = 2;

/// Part of the hashes of settings in which the robot has mass, to be raised whenever such an
/// episode may end differently for the same settings. 2: the robot observes the velocity that it
/// has, not the one that it was told.
pub const DYNAMICS_VERSION: u32 = 2;

/// When a pedestrian counts as crashed and is re-spawned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PedestrianCrash {
    /// Its own noise-free scan of walls, obstacles and pedestrians falls below the robots' crash
    /// range.
    Scan,
    /// Its body was stopped by a wall, an obstacle or another pedestrian.
    Contact,
}

/// Settings of a test. All but `lock_step` decide the result and are part of a cell's hash.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArenaConfig {
    /// Room, robot, laser and episode; a checkpoint's own, so that a policy is tested in the world
    /// it was trained in.
    pub sim: SimConfig,
    /// The built-in crowds and who sees whom.
    pub crowds: CrowdsConfig,
    /// N: one robot and N − 1 pedestrians (paper: 5). With 1 the room is empty.
    pub n_agents: usize,
    /// Root seed of starts, goals, noise and re-spawns.
    pub seed: u64,
    /// Back end that computes the networks of robot and pedestrians.
    pub backend: Backend,
    /// Crash of learned pedestrians. By their scan, as in training.
    pub learned_crash: PedestrianCrash,
    /// Crash of the pedestrians of all other crowds. By contact: ORCA's discs may legally come
    /// nearer than the crash range.
    pub pure_crash: PedestrianCrash,
    /// A re-spawned pedestrian keeps at least this distance from every body's centre (m). Where the
    /// others leave no such place, it gets the one that is farthest from all of them.
    pub respawn_clearance: f32,
    /// Episodes run side by side. Changes speed and memory alone, never a result.
    pub lock_step: usize,
    /// Regions, walls and blocks in place of the room of `sim`. Left out of the written form where
    /// there are none, so that hashes of settings from before them are what they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<SceneConfig>,
    /// The pedestrians of crowd `recorded`; left out of the written form where there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingConfig>,
}

impl Default for ArenaConfig {
    fn default() -> Self {
        Self {
            sim: SimConfig::default(),
            crowds: CrowdsConfig::default(),
            n_agents: 5,
            seed: 0,
            backend: Backend::default(),
            learned_crash: PedestrianCrash::Scan,
            pure_crash: PedestrianCrash::Contact,
            respawn_clearance: 3.0,
            lock_step: 256,
            scene: None,
            recording: None,
        }
    }
}

impl ArenaConfig {
    /// Number of pedestrians in a room.
    pub fn n_pedestrians(&self) -> usize {
        self.n_agents - 1
    }

    /// When a pedestrian of a crowd counts as crashed: `learned_crash` for those that sense by
    /// laser, else `pure_crash`.
    pub fn crash_of(&self, senses_by_laser: bool) -> PedestrianCrash {
        if senses_by_laser { self.learned_crash } else { self.pure_crash }
    }

    /// Checks every range.
    ///
    /// # Errors
    ///
    /// The first field out of its range.
    pub fn validate(&self) -> Result<(), ArenaError> {
        self.sim.validate()?;
        self.crowds.validate()?;
        let refuse = |field, found: String, expected: &str| {
            Err(ArenaError::Setting { field, found, expected: expected.to_owned() })
        };
        if !(1..=1000).contains(&self.n_agents) {
            return refuse("n_agents", self.n_agents.to_string(), "1 to 1000");
        }
        if !(0.0..=1000.0).contains(&self.respawn_clearance) {
            return refuse("respawn_clearance", self.respawn_clearance.to_string(), "0 to 1000 m");
        }
        let least = self.sim.body_clearance_min();
        if self.n_agents > 1 && self.respawn_clearance < least {
            let expected = format!(
                "at least {least} m, a body's radius and the crash range, so that no re-spawn is a crash"
            );
            return refuse("respawn_clearance", self.respawn_clearance.to_string(), &expected);
        }
        if self.lock_step == 0 {
            return refuse("lock_step", "0".to_owned(), "at least 1");
        }
        if let Some(recording) = &self.recording {
            recording.validate(self.n_agents)?;
        }
        if let Some(scene) = &self.scene {
            scene.validate(&self.sim)?;
            let (found, expected) = (self.n_agents, scene.n_pedestrians() + 1);
            if found != expected {
                return refuse("n_agents", found.to_string(), &format!("the scene's {expected}"));
            }
        }
        Ok(())
    }

    /// Refuses a robot that has mass, where another simulator moves it.
    ///
    /// # Errors
    ///
    /// [`ArenaError::Setting`] with `sim.robot.dynamics`.
    pub fn check_robot_moves_elsewhere(&self) -> Result<(), ArenaError> {
        if self.sim.robot.dynamics.is_kinematic() {
            return Ok(());
        }
        let (found, expected) = ("rapier".to_owned(), "kinematic: the robot moves elsewhere".to_owned());
        Err(ArenaError::Setting { field: "sim.robot.dynamics", found, expected })
    }

    /// SHA-256 of everything that decides a result and has no field of its own in a cell's key. Of
    /// a map that is its content, by its hash ([`jostle_sim::maps::sha256`]), and [`MAP_VERSION`];
    /// where it lies is another on each machine. Of a robot that has mass it is also
    /// [`DYNAMICS_VERSION`].
    pub fn settings_hash(&self, map_sha256: Option<&str>) -> String {
        let mut decisive = Self { lock_step: 1, n_agents: 1, seed: 0, ..self.clone() };
        decisive.sim.room.map = map_sha256.map(|hash| format!("{hash}-{MAP_VERSION}").into());
        let mut bytes = serde_json::to_vec(&decisive).expect("plain settings are always JSON");
        if !self.sim.robot.dynamics.is_kinematic() {
            bytes.extend(format!("dynamics {DYNAMICS_VERSION}").bytes());
        }
        hex_sha256(&bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_hash_ignores_the_lock_step_alone() {
        let config = ArenaConfig::default();
        assert!(config.validate().is_ok());
        let wide = ArenaConfig { lock_step: 7, ..config.clone() };
        assert_eq!(wide.settings_hash(None), config.settings_hash(None));
        let mut seen = config.clone();
        seen.crowds.visibility.vo.robot = true;
        let contact = ArenaConfig { learned_crash: PedestrianCrash::Contact, ..config.clone() };
        assert_ne!(seen.settings_hash(None), config.settings_hash(None));
        assert_ne!(contact.settings_hash(None), config.settings_hash(None));
        assert_ne!(config.settings_hash(Some("a")), config.settings_hash(Some("b")));
        let mut map = config.clone();
        map.sim.room.map = Some("m.toml".into());
        assert_eq!(map.settings_hash(Some("a")), config.settings_hash(Some("a")));
    }

    /// The hash that the cells of `results/cells` were stored under.
    #[test]
    fn the_hash_of_the_default_settings_stays() {
        assert_eq!(
            ArenaConfig::default().settings_hash(None),
            "7764dab4fc3e7892a7a527188225d466e1fd483316fb5cb1e155c87d6b07f94a"
        );
    }

    #[test]
    fn out_of_range_is_named() {
        let check = |config: ArenaConfig, message: &str| {
            assert_eq!(config.validate().unwrap_err().to_string(), message);
        };
        let config = ArenaConfig::default();
        check(ArenaConfig { n_agents: 0, ..config.clone() }, "n_agents: found 0, expected 1 to 1000");
        check(ArenaConfig { lock_step: 0, ..config.clone() }, "lock_step: found 0, expected at least 1");
        check(
            ArenaConfig { respawn_clearance: f32::NAN, ..config },
            "respawn_clearance: found NaN, expected 0 to 1000 m",
        );
    }
}
