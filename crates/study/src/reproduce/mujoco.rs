//! Table 5's episodes in MuJoCo, a peer in three dimensions: `crates/bench/peers/mujoco_driver.py`,
//! run in an environment of its own.
//!
//! Reading order: [`Mujoco::install`], [`Mujoco::run`] (one cell); [`key`] (the name that its cell
//! is stored under).

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail, ensure};
use jostle_arena::identity::{PolicyIdentity, hex_sha256, short};
use jostle_arena::metrics::EpisodeMetrics;
use jostle_arena::room::metric_scale;
use jostle_arena::{Outcome, Planner};
use jostle_eval::cell::CellKey;
use jostle_eval::compact::{CompactCell, CompactEpisode, Simulator};
use jostle_eval::protocol::Protocol;
use jostle_ppo::Config;
use jostle_runs::output::note;
use jostle_runs::progress::Progress;
use jostle_runs::provenance::workspace;
use jostle_runs::python::{environment, in_environment, pip};
use jostle_runs::run_folder::write_atomically;
use jostle_runs::tools::target_folder;
use serde::Deserialize;

/// The version that cells are made with.
const VERSION: &str = "4.0.0";
/// The driver's `MODEL`: what it makes of an episode.
const MODEL: u32 = 1;
/// The driver, below the root of a checkout.
const DRIVER: &str = "crates/bench/peers/mujoco_driver.py";
/// The environment, below `target/`.
const ENVIRONMENT: &str = "mujoco";

/// MuJoCo, installed.
pub(crate) struct Mujoco {
    python: PathBuf,
}

/// Who drives.
#[derive(Clone, Copy)]
pub(crate) enum Pilot<'a> {
    /// A policy by its file.
    Policy(&'a Path),
    /// A planner.
    Planner(Planner),
}

/// The driver's first line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    simulator: String,
    version: String,
    model: u32,
    driver: String,
    numpy: String,
    python: String,
    settings: String,
    policy: String,
}

/// One of its other lines.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    episode: u64,
    outcome: Outcome,
    steps: u64,
    path_length: f64,
    straight_distance: f64,
}

impl Mujoco {
    /// Makes an environment below `target/` with MuJoCo and this checkout's Python package.
    ///
    /// # Errors
    /// No Python; what pip cannot install.
    pub(crate) fn install() -> Result<Self> {
        let folder = environment(ENVIRONMENT)?;
        note(&format!("MuJoCo: installing it and this checkout's Python package into {}", folder.display()));
        let mujoco = format!("mujoco=={VERSION}");
        let packages = [mujoco.as_str(), "numpy>=1.23", "gymnasium>=1.1"];
        ensure!(pip(&folder, &packages)?, "pip cannot install {}", packages.join(", "));
        let checkout = workspace().to_str().context("a path that is no UTF-8")?;
        // The same version may be there with other code.
        let package = ["--force-reinstall", "--no-deps", checkout];
        ensure!(pip(&folder, &package)?, "pip cannot install {checkout}");
        Ok(Self { python: in_environment(&folder, "python") })
    }

    /// Runs the episodes of a cell.
    ///
    /// # Errors
    /// A driver that does not run, or that runs other settings or another policy than it was told
    /// to.
    pub(crate) fn run(
        &self,
        protocol: &Protocol,
        pilot: Pilot<'_>,
        of: (&CellKey, &PolicyIdentity),
        episodes: u64,
    ) -> Result<CompactCell> {
        let (own, identity) = of;
        let label = format!("{}, MuJoCo", identity.name);
        let mut child = self.start(protocol, pilot, own, episodes)?;
        let output = child.stdout.take().context("a driver without an output")?;
        let mut progress = Progress::new(&label, episodes, 0);
        let lines = BufReader::new(output).lines();
        let ran = episodes_of(lines, own, protocol, episodes, |done| progress.set(done, ""));
        if ran.is_err() {
            // It has ended, or would go on for nobody.
            child.kill().ok();
        }
        let status = child.wait().context("cannot wait for the driver")?;
        let (simulator, ran) = ran.with_context(|| format!("{DRIVER}, whose message may be above"))?;
        ensure!(status.success(), "{DRIVER}: {status}");
        let scale = metric_scale(protocol.config());
        let cell = CompactCell::simulated(key(own), identity.clone(), scale, simulator, &ran);
        let episodes = cell.episodes(cell.head.episodes as usize);
        let successes = episodes.iter().filter(|episode| episode.outcome == Outcome::Success).count();
        progress.finish(&format!("success {:.2}", successes as f64 / episodes.len() as f64));
        Ok(cell)
    }

    fn start(&self, protocol: &Protocol, pilot: Pilot<'_>, own: &CellKey, episodes: u64) -> Result<Child> {
        let config = protocol.config();
        let sim = config.sim.clone();
        // Nothing is learned: a minibatch of one fits to any number of agents.
        let written = Config { sim, n_agents: config.n_agents, minibatch: 1, ..Config::default() };
        let file = target_folder().join(ENVIRONMENT).join(format!("{}.toml", short(&own.settings)));
        write_atomically(&file, &written.canonical_toml())?;
        let mut command = Command::new(&self.python);
        command.arg("-P").arg(workspace().join(DRIVER)).arg("--config").arg(std::path::absolute(&file)?);
        command.args(["--pedestrians", &config.n_pedestrians().to_string()]);
        command.args(["--episodes", &episodes.to_string()]);
        command.args(["--respawn-clearance", &config.respawn_clearance.to_string()]);
        match pilot {
            Pilot::Policy(path) => command.arg("--policy").arg(std::path::absolute(path)?),
            Pilot::Planner(planner) => command.args(["--planner", planner.name()]),
        };
        command.stdin(Stdio::null()).stdout(Stdio::piped());
        command.spawn().with_context(|| format!("cannot start {}", self.python.display()))
    }
}

/// What the driver prints: who it is, then episodes, each with its number of steps.
fn episodes_of(
    mut lines: impl Iterator<Item = std::io::Result<String>>,
    own: &CellKey,
    protocol: &Protocol,
    episodes: u64,
    mut progress: impl FnMut(u64),
) -> Result<(Simulator, Vec<(CompactEpisode, u64)>)> {
    let scale = metric_scale(protocol.config());
    let head: Head = parse(&lines.next().context("found no line")??)?;
    let simulator = head.checked(own)?;
    let mut ran = Vec::new();
    for line in lines {
        let Line { episode, outcome, steps, path_length, straight_distance } = parse(&line?)?;
        ensure!(episode == ran.len() as u64, "found episode {episode}, expected {}", ran.len());
        let metrics = EpisodeMetrics::from_totals(&scale, outcome, steps, path_length, straight_distance);
        ran.push((CompactEpisode { outcome, metrics, driving: None }, steps));
        progress(ran.len() as u64);
    }
    ensure!(ran.len() as u64 == episodes, "found {} episodes, expected {episodes}", ran.len());
    Ok((simulator, ran))
}

impl Head {
    /// The simulator, if it runs what it was told to.
    fn checked(self, own: &CellKey) -> Result<Simulator> {
        let Self { simulator: name, version, model, driver, numpy, python, settings, policy } = self;
        for (field, found, expected) in [
            ("simulator", name.as_str(), "mujoco"),
            ("version", version.as_str(), VERSION),
            ("model", model.to_string().as_str(), MODEL.to_string().as_str()),
            ("settings", settings.as_str(), own.settings.as_str()),
            ("policy", policy.as_str(), own.policy.as_str()),
        ] {
            if found != expected {
                bail!("{field}: found {found}, expected {expected}");
            }
        }
        Ok(Simulator { name, version, model, driver, numpy, python })
    }
}

fn parse<'a, T: Deserialize<'a>>(line: &'a str) -> Result<T> {
    serde_json::from_str(line).with_context(|| format!("line {:?}", jostle_policy::excerpt(line)))
}

/// The key of a cell in MuJoCo: that of the same episodes here, with what differs in its settings.
pub(crate) fn key(own: &CellKey) -> CellKey {
    let settings = hex_sha256(format!("{} in mujoco {VERSION}, model {MODEL}", own.settings).as_bytes());
    CellKey { settings, ..own.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn own() -> CellKey {
        CellKey {
            protocol_version: 1,
            policy: "p".into(),
            token: 0,
            crowd: jostle_peds::CrowdKind::Sf.into(),
            pool: Vec::new(),
            n_agents: 4,
            seed: 0,
            settings: "s".into(),
        }
    }

    #[test]
    fn the_driver_is_of_this_model() {
        let text = std::fs::read_to_string(workspace().join(DRIVER)).unwrap();
        assert!(text.contains(&format!("\nMODEL = {MODEL}\n")));
        let project = std::fs::read_to_string(workspace().join("pyproject.toml")).unwrap();
        assert!(project.contains(&format!("\"mujoco=={VERSION}\"")), "the tests' version");
    }

    #[test]
    fn a_driver_that_runs_something_else_is_refused() {
        let head = |settings: &str| Head {
            simulator: "mujoco".into(),
            version: VERSION.into(),
            model: MODEL,
            driver: "d".into(),
            numpy: "2".into(),
            python: "3".into(),
            settings: settings.into(),
            policy: "p".into(),
        };
        assert_eq!(head("s").checked(&own()).unwrap().model, MODEL);
        let error = head("t").checked(&own()).unwrap_err().to_string();
        assert_eq!(error, "settings: found t, expected s");
        let error = Head { policy: "q".into(), ..head("s") }.checked(&own()).unwrap_err().to_string();
        assert_eq!(error, "policy: found q, expected p");
        assert_ne!(key(&own()).hash(), own().hash());
    }
}
