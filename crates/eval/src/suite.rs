//! Suites: several scenes on which one policy is tested among several crowds, with one score.
//!
//! A suite is a TOML file: a list of scenes, each the usual room with a number of agents or a
//! layout of its own ([`jostle_arena::scene`]). [`Suite::standard`] comes with the crate; others
//! are read from files of the same form.

use std::path::Path;

use jostle_policy::excerpt;
use jostle_sim::RoomConfig;
use serde::Deserialize;

use crate::error::EvalError;
use jostle_arena::config::ArenaConfig;
use jostle_arena::scene::SceneConfig;

/// The standard suite's file.
const STANDARD: &str = include_str!("../suites/standard.toml");
/// Largest suite file that is read, in bytes.
const FILE_MAX: u64 = 1 << 20;

/// Several scenes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Its name.
    pub name: String,
    /// Its scenes, in their order.
    #[serde(rename = "scene")]
    pub scenes: Vec<SuiteScene>,
}

/// One scene of a suite.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuiteScene {
    /// Its name.
    pub name: String,
    /// One line that says what it is.
    pub about: String,
    /// Number of agents in the usual room, the robot among them; absent where there is a layout.
    #[serde(default)]
    pub agents: Option<usize>,
    /// Walls, blocks and regions; absent for the usual room.
    #[serde(default)]
    pub layout: Option<SceneConfig>,
}

impl Suite {
    /// The standard suite: density (N = 5, 10, 20), corridor, doorway, crossing streams, blind
    /// corner, standing group, and a pedestrian that stops dead.
    ///
    /// # Panics
    ///
    /// Never: a test reads the file that is compiled in.
    pub fn standard() -> Self {
        toml::from_str(STANDARD).expect("the file that is compiled in is a suite")
    }

    /// Reads a suite from a file.
    ///
    /// # Errors
    ///
    /// [`EvalError::Io`] if it cannot be read, [`EvalError::Suite`] if it is no suite: unknown
    /// keys, a name that is no file's, no scene, two scenes of one name, a scene with both a number
    /// of agents and a layout, or with neither.
    pub fn read(path: &Path) -> Result<Self, EvalError> {
        let refuse = |problem: String| EvalError::Suite { file: path.to_path_buf(), problem };
        let about = std::fs::metadata(path).map_err(EvalError::io(path, "read"))?;
        if !about.is_file() || about.len() > FILE_MAX {
            return Err(refuse(format!("{} bytes, expected a file of at most {FILE_MAX}", about.len())));
        }
        let text = std::fs::read_to_string(path).map_err(EvalError::io(path, "read"))?;
        Self::parse(&text).map_err(refuse)
    }

    fn parse(text: &str) -> Result<Self, String> {
        let suite: Self = toml::from_str(text).map_err(|error| excerpt(&error.to_string()))?;
        // Reports are files of this name.
        let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if suite.name.is_empty() || !suite.name.chars().all(fits) {
            return Err(format!(
                "name: found {:?}, expected lower-case letters, digits and hyphens",
                suite.name
            ));
        }
        if suite.scenes.is_empty() {
            return Err("found no [[scene]], expected at least one".to_owned());
        }
        for (i, scene) in suite.scenes.iter().enumerate() {
            if suite.scenes[..i].iter().any(|other| other.name == scene.name) {
                return Err(format!("found two scenes called {:?}, expected one", scene.name));
            }
            if scene.agents.is_some() == scene.layout.is_some() {
                let found = if scene.agents.is_some() { "both" } else { "neither" };
                return Err(format!(
                    "scene {:?}: found {found}, expected either agents or layout",
                    scene.name
                ));
            }
        }
        Ok(suite)
    }
}

impl SuiteScene {
    /// The settings of the scene's cells. Robot, laser, episode, crowds and seed are those of
    /// `base`; room and number of agents are the scene's, so that a cell in the usual room has the
    /// same key as one that was run without a suite.
    ///
    /// # Errors
    ///
    /// The layout or the number of agents of the scene, where it breaks a rule.
    pub fn config(&self, base: &ArenaConfig) -> Result<ArenaConfig, EvalError> {
        let mut config = base.clone();
        config.sim.room = RoomConfig::default();
        config.n_agents = self
            .layout
            .as_ref()
            .map_or(self.agents.unwrap_or(base.n_agents), |scene| scene.n_pedestrians() + 1);
        config.scene.clone_from(&self.layout);
        config.validate()?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use jostle_peds::CrowdKind;
    use jostle_sim::Laser;

    use super::*;
    use jostle_arena::room::{ArenaRoom, RoomPlan};

    #[test]
    fn the_standard_suite_has_what_it_says() {
        let suite = Suite::standard();
        assert_eq!(Suite::parse(STANDARD).unwrap(), suite);
        let names: Vec<&str> = suite.scenes.iter().map(|scene| scene.name.as_str()).collect();
        let expected = ["density-5", "density-10", "density-20", "corridor", "doorway", "crossing"];
        assert_eq!(names[..6], expected);
        assert_eq!(names[6..], ["blind-corner", "standing-group", "stops-dead"]);
    }

    #[test]
    fn every_scene_can_be_started_with_room_for_everyone() {
        let base = ArenaConfig::default();
        let laser = Laser::new(&base.sim.laser).unwrap();
        for scene in Suite::standard().scenes {
            let config = scene.config(&base).unwrap();
            let plan = RoomPlan::new(&config, CrowdKind::Sf).unwrap();
            for episode in 0..20 {
                let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
                let still = vec![jostle_peds::Command::STILL; config.n_pedestrians()];
                let end = room.step(&plan, [0.0; 2], &still).unwrap();
                assert!(end.is_none(), "{}: episode {episode} ends at its start: {end:?}", scene.name);
                assert_eq!(room.pedestrians().len() + 1, config.n_agents);
            }
        }
    }

    #[test]
    fn a_usual_room_is_the_cell_that_it_was() {
        let base = ArenaConfig::default();
        let suite = Suite::standard();
        assert_eq!(suite.scenes[0].config(&base).unwrap(), base);
        let corridor = suite.scenes[3].config(&base).unwrap();
        assert_ne!(corridor.settings_hash(None), base.settings_hash(None));
        assert_eq!(corridor.n_agents, 4);
    }

    #[test]
    fn what_is_no_suite_is_named() {
        let check = |text: &str, message: &str| {
            let found = Suite::parse(text).unwrap_err();
            assert!(found.contains(message) && found.lines().count() == 1, "{found}");
        };
        check("name = 'x'\nscene = []", "found no [[scene]]");
        check("name = 'x'\nscenes = []", "scenes");
        check("name = '../x'\nscene = []", "name: found");
        let scene = "[[scene]]\nname = 'a'\nabout = ''\n";
        check(&format!("name = 'x'\n{scene}"), "scene \"a\": found neither");
        check(&format!("name = 'x'\n{scene}agents = 5\n{scene}agents = 6\n"), "two scenes called \"a\"");
        let missing = Suite::read(Path::new("/nonexistent/suite.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("/nonexistent/suite.toml: cannot read"), "{missing}");
    }
}
