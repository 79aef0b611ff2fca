//! A side of a contest: a process that is warm and waits, and does one round when it is told to.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use crate::Round;
use anyhow::{Context as _, Result, bail};
use serde::Deserialize;

use super::contest::Contest;
use super::peers_folder;

/// Simulated seconds of a round of Stage.
const STAGE_SECONDS: f64 = 120.0;
/// Agent-steps of a round of Stage: five robots, ten steps in a second.
const STAGE_UNITS: f64 = STAGE_SECONDS * 10.0 * 5.0;

/// A process's message when it is ready.
#[derive(Deserialize)]
struct Greeting {
    version: String,
}

/// One side.
pub(super) struct Side {
    version: String,
    kind: Kind,
}

enum Kind {
    /// Speaks the line protocol of `crates/bench/peers/rounds.py`.
    Worker { child: Child, orders: Option<ChildStdin>, answers: BufReader<ChildStdout>, log: Option<PathBuf> },
    /// Is started anew for each round, and timed as a whole.
    Stage { binary: PathBuf, world: PathBuf },
}

impl Side {
    /// Our own: this program again.
    pub(super) fn ours(contest: Contest) -> Result<Self> {
        let mut command = Command::new(std::env::current_exe().context("cannot find this program")?);
        command.args(["bench", "worker"]);
        Self::start(command, contest, None)
    }

    /// One of our Python drivers.
    pub(super) fn python(python: &Path, driver: &str, contest: Contest, logs: &Path) -> Result<Self> {
        let mut command = Command::new(python);
        command.arg(peers_folder().join(driver)).env("PYTHONDONTWRITEBYTECODE", "1");
        Self::program(command, contest, logs)
    }

    /// Any program that speaks the protocol. Its messages go to a file.
    pub(super) fn program(mut command: Command, contest: Contest, logs: &Path) -> Result<Self> {
        // A machine may carry settings for old builds of OpenBLAS that slow a present numpy down.
        for (name, _) in
            std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("OPENBLAS_"))
        {
            command.env_remove(name);
        }
        for name in ["OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"] {
            command.env(name, contest.threads.to_string());
        }
        let log = logs.join(format!("{}-{}-{}.log", contest.peer.name(), contest.work, contest.threads));
        Self::start(command, contest, Some(log))
    }

    fn start(mut command: Command, contest: Contest, log: Option<PathBuf>) -> Result<Self> {
        command.arg(contest.work.to_string()).arg(contest.threads.to_string());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        if let Some(log) = &log {
            let file = File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
            command.stderr(file);
        }
        let mut child = command.spawn().with_context(|| format!("cannot start {command:?}"))?;
        let orders = child.stdin.take();
        let answers = child.stdout.take().map(BufReader::new).context("a process without an output")?;
        let kind = Kind::Worker { child, orders, answers, log };
        let mut side = Self { version: String::new(), kind };
        let greeting: Greeting = serde_json::from_str(&side.line()?).context("a greeting was expected")?;
        side.version = greeting.version;
        Ok(side)
    }

    /// Stage on our world file; `out` gets the file with the simulated time filled in.
    pub(super) fn stage(binary: &Path, out: &Path) -> Result<Self> {
        let template = peers_folder().join("stage_room.world");
        let text =
            fs::read_to_string(&template).with_context(|| format!("cannot read {}", template.display()))?;
        let world = out.join("stage_room.world");
        fs::write(&world, text.replace("SIM_SECONDS", &STAGE_SECONDS.to_string()))
            .with_context(|| format!("cannot write {}", world.display()))?;
        let version = "2 cm cells".to_owned();
        Ok(Self { version, kind: Kind::Stage { binary: binary.to_owned(), world } })
    }

    /// The side's own version text.
    pub(super) fn version(&self) -> &str {
        &self.version
    }

    /// One round.
    pub(super) fn round(&mut self) -> Result<Round> {
        match &mut self.kind {
            Kind::Worker { orders, .. } => {
                let orders = orders.as_mut().context("a process without an input")?;
                orders.write_all(b"\n").and_then(|()| orders.flush()).context("a process ended too early")?;
                serde_json::from_str(&self.line()?).context("a round was expected")
            }
            Kind::Stage { binary, world } => stage_round(binary, world),
        }
    }

    fn line(&mut self) -> Result<String> {
        let Kind::Worker { answers, log, .. } = &mut self.kind else { bail!("Stage answers with no line") };
        let mut line = String::new();
        answers.read_line(&mut line).context("a process's output cannot be read")?;
        if line.is_empty() {
            let place = log.as_ref().map_or_else(String::new, |log| format!(": see {}", log.display()));
            bail!("a process ended without an answer{place}");
        }
        Ok(line)
    }
}

impl Drop for Side {
    /// A worker ends when its input does.
    fn drop(&mut self) {
        if let Kind::Worker { child, orders, .. } = &mut self.kind {
            drop(orders.take());
            // Whether it ended well no longer matters.
            let _ = child.wait();
        }
    }
}

/// Runs the binary until it quits by itself; start-up included, by the wall clock.
fn stage_round(binary: &Path, world: &Path) -> Result<Round> {
    let start = Instant::now();
    let output = Command::new(binary)
        .arg("-g")
        .arg(world)
        .output()
        .with_context(|| format!("cannot start {}", binary.display()))?;
    if !output.status.success() {
        bail!("Stage ended with {}", output.status);
    }
    Ok(Round { seconds: start.elapsed().as_secs_f64(), units: STAGE_UNITS, check: None })
}
