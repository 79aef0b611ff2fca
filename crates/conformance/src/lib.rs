//! `cargo xtask conformance DIR`: our code against fixtures made by independent software.
//!
//! The formats are those that `docs/conformance.md` describes. A file is known by its content. Each
//! gets one line: PASS or FAIL, the error that came nearest to its tolerance, and how many numbers
//! were compared. A file that cannot be read, one of no known kind, half-planes without their run,
//! a checksum that does not match and an empty folder all fail.

#![forbid(unsafe_code)]

mod discriminator;
mod gae;
mod kind;
mod kl;
mod lidar;
mod metrics;
mod network;
mod ppo;
mod probe;
mod rvo2;
mod rvo2_file;
mod social_force;
mod sums;
mod tensors;
mod verdict;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail};
use clap::{Args, ValueEnum};
use jostle_policy::Backend;
use serde::de::DeserializeOwned;
use serde_json::Value;

use jostle_runs::output;
use kind::Kind;
use verdict::Verdict;

/// Arguments of `conformance`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask conformance ../reference --backend reference")]
pub struct ConformanceArgs {
    /// Folder of fixtures; its subfolders are walked too.
    dir: PathBuf,
    /// The back end that computes the networks.
    #[arg(long, value_enum, default_value = "fast")]
    backend: BackendName,
}

/// The back ends by the names that the configuration uses.
#[derive(Clone, Copy, ValueEnum)]
enum BackendName {
    /// Own CPU kernels.
    Fast,
    /// Plain candle operations.
    Reference,
}

impl From<BackendName> for Backend {
    fn from(name: BackendName) -> Self {
        match name {
            BackendName::Fast => Self::Fast,
            BackendName::Reference => Self::Reference,
        }
    }
}

/// Checks every file under the folder.
pub fn run(args: &ConformanceArgs) -> Result<ExitCode> {
    let mut files = Vec::new();
    let mut empty = Vec::new();
    walk(&args.dir, &mut files, &mut empty)?;
    let sums = sums::read(&args.dir)?;
    let mut tally = Tally::default();
    for path in &files {
        let name = path.strip_prefix(&args.dir).unwrap_or(path).display().to_string();
        tally.add(&name, check(path, args.backend.into(), &sums))?;
    }
    for name in sums.missing(&args.dir) {
        tally.add(&name, Err(anyhow::anyhow!("is listed in SHA256SUMS but is not there")))?;
    }
    for folder in empty {
        tally.add(&format!("{}/", folder.display()), Err(anyhow::anyhow!("is empty")))?;
    }
    if tally.passed + tally.failed == 0 {
        bail!("{} holds no file to check", args.dir.display());
    }
    output::result(&format!("{} passed, {} failed\n", tally.passed, tally.failed))?;
    Ok(if tally.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

#[derive(Default)]
struct Tally {
    passed: u32,
    failed: u32,
}

impl Tally {
    fn add(&mut self, name: &str, outcome: Result<Option<Verdict>>) -> Result<()> {
        let (word, text) = match outcome {
            Ok(None) => return Ok(()),
            Ok(Some(verdict)) if verdict.passed() => ("PASS", verdict.summary()),
            Ok(Some(verdict)) => ("FAIL", verdict.summary()),
            Err(error) => ("FAIL", output::one_line(&error)),
        };
        if word == "PASS" {
            self.passed += 1;
        } else {
            self.failed += 1;
        }
        output::result(&format!("{word}  {name:<44}  {text}\n"))
    }
}

/// Checks one file; `None` for words about the fixtures.
fn check(path: &Path, backend: Backend, sums: &sums::Sums) -> Result<Option<Verdict>> {
    sums.verify(path)?;
    let mut verdict = Verdict::default();
    let v = &mut verdict;
    match kind::detect(path)? {
        Kind::Forward(tensors) => network::check(&tensors, backend, v)?,
        Kind::Ppo(tensors) => ppo::check(&tensors, path, backend, v)?,
        Kind::Discriminator(tensors) => discriminator::check(&tensors, backend, v)?,
        Kind::Gae(json) => gae::check(&typed(json)?, v),
        Kind::Kl(json) => kl::check(&typed(json)?, v)?,
        Kind::Lidar(json) => lidar::check(&typed(json)?, v)?,
        Kind::Forces(json) => social_force::check_forces(&typed(json)?, v)?,
        Kind::Trajectories(json) => social_force::check_trajectories(&typed(json)?, v)?,
        Kind::Episodes(json) => metrics::check_episodes(&typed(json)?, v)?,
        Kind::Intervals(json) => metrics::check_intervals(&typed(json)?, v)?,
        Kind::Rvo2 => rvo2::check_states(path, v)?,
        Kind::Rvo2Lines => rvo2::check_lines(path, v)?,
        Kind::Informational => return Ok(None),
        Kind::Unknown => bail!("is of no known kind"),
    }
    Ok(Some(verdict))
}

fn typed<T: DeserializeOwned>(json: Value) -> Result<T> {
    if json["format"] != 1 {
        bail!("has format {}; 1 is known", json["format"]);
    }
    serde_json::from_value(json).context("is not of its kind's format")
}

/// All files under `folder` in the order of their names, and the folders that hold none.
fn walk(folder: &Path, files: &mut Vec<PathBuf>, empty: &mut Vec<PathBuf>) -> Result<()> {
    let unreadable = || format!("cannot read the folder {}", folder.display());
    let entries = std::fs::read_dir(folder).with_context(unreadable)?;
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>().with_context(unreadable)?;
    if paths.is_empty() {
        empty.push(folder.to_owned());
    }
    paths.sort();
    for path in paths {
        if path.is_dir() {
            walk(&path, files, empty)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}
