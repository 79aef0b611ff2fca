//! The settings of a Python caller: a training file, keys of it, the crowd, the number of
//! pedestrians, who sees the robot.

use std::path::{Path, PathBuf};

use jostle_arena::recording::RecordingConfig;
use jostle_arena::room::metric_scale;
use jostle_arena::{ArenaConfig, Pools};
use jostle_eval::EvalError;
use jostle_peds::CrowdKind;
use jostle_ppo::{Config, PpoError};
use jostle_sim::{SimConfig, SimError};

/// People to play back, as a file and how it is to be understood.
#[derive(Clone, Debug, Default)]
pub struct RecordingFile {
    /// The file.
    pub path: PathBuf,
    /// Time between two annotated frames of a person (s); that of the file, else 0.4, where it is
    /// absent.
    pub interval: Option<f64>,
    /// Longest gap that is bridged (s); none where it is absent.
    pub max_gap: Option<f64>,
}

/// Everything that a room among a crowd is made from.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Room, robot, laser, crowds, number of agents.
    pub config: ArenaConfig,
    /// The crowd.
    pub crowd: CrowdKind,
    /// The pedestrians' policies, for crowds that need them.
    pub pools: Pools,
}

impl Settings {
    /// Settings for a crowd.
    ///
    /// `base` is the training configuration, of which the simulator and the number of agents are
    /// taken; `n_pedestrians` and `robot_visible` override its number and the crowd's row of the
    /// visibility matrix. `pools` drive the pedestrians.
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
            ArenaConfig { sim: base.sim.clone(), n_agents: base.n_agents, ..ArenaConfig::default() };
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

    /// The settings with the people of a file in them, who take the room and its number of
    /// pedestrians with them.
    ///
    /// # Errors
    ///
    /// Another crowd than the recorded one; a number of pedestrians; a file that is no recording; a
    /// room without a place for the robot.
    pub fn with_recording(
        mut self,
        file: &RecordingFile,
        n_pedestrians: Option<usize>,
    ) -> Result<Self, EvalError> {
        let refuse = |field, found: String, expected: &str| {
            Err(EvalError::Setting { field, found, expected: expected.to_owned() })
        };
        if self.crowd != CrowdKind::Recorded {
            let found = format!("{} for crowd {}", file.path.display(), self.crowd);
            return refuse("recording", found, "it for crowd recorded only");
        }
        if let Some(n) = n_pedestrians {
            return refuse("n_pedestrians", n.to_string(), "None: the recording says who is there");
        }
        let dt = metric_scale(&self.config).dt;
        let recording = RecordingConfig::read(&file.path, file.interval, file.max_gap, dt)?;
        self.config = recording.config(&self.config)?;
        Ok(self)
    }
}

/// Reads a training configuration, or the paper's where there is no file, and applies `key=value`
/// overrides.
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

/// The rooms that a policy was trained in, with `key=value` overrides applied to them.
///
/// # Errors
///
/// As [`Config::parse`].
pub fn trained(mut sim: SimConfig, n_agents: usize, overrides: &[String]) -> Result<Config, PpoError> {
    // The text that the overrides are applied to lies in no folder, from which a relative path
    // could start.
    let absolute = |map: PathBuf| std::path::absolute(&map).unwrap_or(map);
    sim.room.map = sim.room.map_file().map(absolute);
    // Nothing is learned here: a minibatch of one fits to any number of agents.
    let config = Config { sim, n_agents, minibatch: 1, ..Config::default() };
    Config::parse(&config.canonical_toml(), "settings", overrides)
}

/// The keys of a configuration's map that are not read, one line each.
///
/// # Errors
///
/// A map that cannot be read.
pub fn notes(config: &Config) -> Result<Vec<String>, SimError> {
    config.sim.room.map_file().map_or_else(|| Ok(Vec::new()), |map| jostle_sim::maps::notes(&map))
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
        assert_eq!(sf(None, None).config.crowds, ArenaConfig::default().crowds);
        for crowd in CrowdKind::PAPER {
            let base = base(None, &[]).unwrap();
            for robot in [false, true] {
                let settings = Settings::new(&base, crowd, None, Some(robot), Pools::default()).unwrap();
                assert_eq!(
                    settings.config.crowds.visibility.row(crowd),
                    Visibility { pedestrians: true, robot }
                );
            }
        }
    }

    #[test]
    fn overrides_of_a_trained_policys_rooms_leave_the_rest_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        let text = "n_agents = 1\nminibatch = 128\n[sim.room]\nmap = \"m.toml\"\n[sim.laser]\nfov = 3.0\nangle_min = -1.5\n";
        std::fs::write(&file, text).unwrap();
        std::fs::write(folder.path().join("m.toml"), "").unwrap();
        let trained_with = base(Some(&file), &[]).unwrap();
        let sim = || trained_with.sim.clone();
        let same = trained(sim(), 1, &[]).unwrap();
        assert_eq!((same.sim.laser.fov, same.n_agents), (3.0, 1));
        let other =
            trained(sim(), 1, &["sim.laser.noise_std=0.0".to_owned(), "n_agents=7".to_owned()]).unwrap();
        assert_eq!((other.sim.laser.noise_std, other.n_agents), (0.0, 7));
        assert_eq!((other.sim.laser.fov, other.sim.laser.angle_min), (3.0, -1.5));
        let map = folder.path().canonicalize().unwrap().join("m.toml");
        assert_eq!(other.sim.room.map_file(), Some(map));
        let error = trained(sim(), 1, &["sim.laser.fov=270".to_owned()]).unwrap_err().to_string();
        assert!(error.starts_with("--set sim.laser.fov=270: sim.laser.fov: found 270"), "{error}");
    }

    #[test]
    fn a_recording_brings_its_people_and_its_room() {
        let base = base(None, &[]).unwrap();
        let settings = |crowd| Settings::new(&base, crowd, None, None, Pools::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("three.txt");
        std::fs::write(&path, "0 1 0 0\n10 1 1 0\n0 2 0 6\n10 2 0 6\n0 3 8 3\n10 3 8 3\n").unwrap();
        let file = RecordingFile { path, ..RecordingFile::default() };
        let found = settings(CrowdKind::Recorded).with_recording(&file, None).unwrap().config;
        // 8 m by 6 m of people and 2 m on each side.
        assert_eq!((found.n_pedestrians(), found.sim.room.width, found.sim.room.height), (3, 12.0, 10.0));
        let refused = |crowd, n| settings(crowd).with_recording(&file, n).unwrap_err().to_string();
        assert!(refused(CrowdKind::Sf, None).ends_with("for crowd SF, expected it for crowd recorded only"));
        let expected = "n_pedestrians: found 2, expected None: the recording says who is there";
        assert_eq!(refused(CrowdKind::Recorded, Some(2)), expected);
        let gap = RecordingFile { interval: Some(-1.0), ..file.clone() };
        let error = settings(CrowdKind::Recorded).with_recording(&gap, None).unwrap_err().to_string();
        assert_eq!(error, "interval = -1; expected 0.001 to 60 s");
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
