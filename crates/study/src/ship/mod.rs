//! `cargo xtask ship`: finished training runs become small policies in `checkpoints/`, with a
//! manifest that says where each comes from.
//!
//! A run's configuration decides the row that it serves (`crate::reproduce::plan`). A policy is the
//! actor alone, by default in half precision; the success rates that are reported are those of the
//! shipped form.

pub(crate) mod curve;
mod logs;
pub(crate) mod manifest;

pub use self::logs::logs;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use clap::{Args, ValueEnum};
use jostle_arena::identity::hex_sha256;
use jostle_policy::{PolicyFile, Precision};

use self::curve::FIRST;
use self::manifest::{FOLDER_MAX, FileEntry, Manifest, PolicyEntry, RunEntry};
use crate::reproduce::plan::{POOL, Plan, ROWS, Variant};
use jostle_runs::folder::checkpoint_path;
use jostle_runs::log::RunLog;
use jostle_runs::output;
use jostle_runs::run_folder::write_atomically;

/// Arguments of `ship`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask ship runs/paper/m1-seed1 runs/paper/m5-seed1\n  \
    cargo xtask ship runs/paper/pool-seed101 --replace")]
pub struct ShipArgs {
    /// Run folders. Which rows each serves follows from its configuration.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Folder for policies and manifest (default: `checkpoints/` of this repository).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Precision of the stored weights.
    #[arg(long, value_enum, default_value = "f16")]
    precision: Stored,
    /// Base setting of all rows (default: configs/headline.toml).
    #[arg(long, value_name = "FILE")]
    base: Option<PathBuf>,
    /// Replace what is shipped already under the same name.
    #[arg(long)]
    replace: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Stored {
    F16,
    F32,
}

impl Stored {
    fn name(self) -> &'static str {
        match self {
            Self::F16 => "f16",
            Self::F32 => "f32",
        }
    }

    fn precision(self) -> Precision {
        match self {
            Self::F16 => Precision::F16,
            Self::F32 => Precision::F32,
        }
    }
}

/// Folder below `checkpoints/` for curves.
const CURVES: &str = "curves";
/// Folder in which files wait until all of them are written.
const WAITING: &str = "waiting.tmp";

/// Ships the runs, or nothing.
pub fn run(args: &ShipArgs) -> Result<ExitCode> {
    jostle_runs::shipped::checkout()?;
    let plan = Plan::new(&args.base.clone().unwrap_or_else(Plan::default_base))?;
    let folder = args.out.clone().unwrap_or_else(manifest::default_folder);
    let mut manifest = Manifest::load_optional(&folder)?.unwrap_or_else(Manifest::empty);
    let waiting = folder.join(WAITING);
    // What a killed command left behind.
    if waiting.exists() {
        std::fs::remove_dir_all(&waiting).with_context(|| format!("cannot remove {}", waiting.display()))?;
    }
    let curves = waiting.join(CURVES);
    std::fs::create_dir_all(&curves).with_context(|| format!("cannot create {}", curves.display()))?;
    let outcome = args
        .runs
        .iter()
        .try_for_each(|path| {
            add_run(&plan, path, args, &waiting, &mut manifest)
                .with_context(|| format!("{} cannot be shipped", path.display()))
        })
        .and_then(|()| {
            let bytes = manifest.bytes();
            ensure!(bytes <= FOLDER_MAX, "the folder would hold {bytes} bytes, more than {FOLDER_MAX}");
            settle(&waiting, &folder)
        });
    std::fs::remove_dir_all(&waiting).with_context(|| format!("cannot remove {}", waiting.display()))?;
    outcome?;
    manifest.store(&folder)?;
    for policy in &manifest.policies {
        output::result(&format!("{}  {}  {}\n", policy.name, policy.precision, policy.serves.join("; ")))?;
    }
    let (n, megabytes) = (manifest.policies.len(), manifest.bytes() as f64 / 1e6);
    output::note(&format!(
        "{}: {n} policies, {megabytes:.1} MB of at most {} MB",
        folder.display(),
        FOLDER_MAX / 1_000_000
    ));
    Ok(ExitCode::SUCCESS)
}

/// Writes what is shipped of a run to the waiting folder and enters it in the manifest.
fn add_run(plan: &Plan, path: &Path, args: &ShipArgs, waiting: &Path, manifest: &mut Manifest) -> Result<()> {
    let log = RunLog::read(path)?;
    let variant = plan.variant_of(&log.config)?;
    let made = log.reports.len() as u64;
    ensure!(
        made >= log.config.updates,
        "it holds {made} of {} updates; finish it with --resume",
        log.config.updates
    );
    let name = format!("{}-seed{}", variant.name, log.config.seed);
    let lengths = lengths(variant, log.config.updates);
    let mut commit = String::new();
    let mut policies = Vec::new();
    for updates in &lengths {
        let file = PolicyFile::load(checkpoint_path(path, *updates))?;
        commit.clone_from(&file.provenance.commit);
        let policy_name = format!("{name}-{updates:06}");
        let file_name = format!("{policy_name}.safetensors");
        let target = waiting.join(&file_name);
        file.write(&target, args.precision.precision())?;
        let bytes = std::fs::read(&target).with_context(|| format!("cannot read {}", target.display()))?;
        let seconds =
            |n: u64| log.reports.iter().take(n as usize).map(|report| report.clock.total).sum::<f64>();
        policies.push(PolicyEntry {
            name: policy_name,
            run: name.clone(),
            updates: *updates,
            transitions: file.provenance.transitions,
            wall_seconds: seconds(*updates),
            precision: args.precision.name().to_owned(),
            file: file_name,
            sha256: hex_sha256(&bytes),
            bytes: bytes.len() as u64,
            serves: serves(variant, *updates, Some(updates) == lengths.last()),
        });
    }
    let last = policies.last().context("a run of no update")?;
    let (first, whole) = (first_lines(path, FIRST)?, curve::windows(&log.reports));
    let entry = |suffix: &str, text: &str| -> Result<FileEntry> {
        let file = format!("{CURVES}/{name}.{suffix}");
        write_atomically(&waiting.join(&file), text)?;
        Ok(FileEntry::of(file, text))
    };
    let run = RunEntry {
        variant: variant.name.to_owned(),
        seed: log.config.seed,
        config_hash: PolicyFile::load(checkpoint_path(path, last.updates))?.provenance.config_hash,
        commit,
        updates: last.updates,
        transitions: last.transitions,
        wall_seconds: last.wall_seconds,
        first_updates: entry("first.ndjson", &first)?,
        curve: entry("csv", &whole)?,
        config: log.config,
        name: name.clone(),
    };
    enter(manifest, run, policies, args.replace)
}

/// Puts a run into the manifest.
fn enter(manifest: &mut Manifest, run: RunEntry, policies: Vec<PolicyEntry>, replace: bool) -> Result<()> {
    if let Some(known) = manifest.runs.iter().find(|known| known.name == run.name) {
        let hashes = |policies: &[PolicyEntry]| -> Vec<String> {
            policies
                .iter()
                .filter(|policy| policy.run == run.name)
                .map(|policy| policy.sha256.clone())
                .collect()
        };
        let same = *known == run && hashes(&manifest.policies) == hashes(&policies);
        if !same && !replace {
            bail!("{} is shipped already and is another run; pass --replace to replace it", run.name);
        }
    }
    manifest.runs.retain(|known| known.name != run.name);
    manifest.policies.retain(|known| known.run != run.name);
    manifest.runs.push(run);
    manifest.policies.extend(policies);
    Ok(())
}

/// The numbers of updates at which a run is shipped: those at which its variant is tested, as far
/// as it got, and its end. A shorter run of the pedestrians is shipped at its half, for the crowd
/// of half-trained ones.
fn lengths(variant: &Variant, updates: u64) -> Vec<u64> {
    let mut lengths: Vec<u64> = variant.updates.iter().copied().filter(|length| *length <= updates).collect();
    if variant.name == POOL {
        lengths = vec![updates / 2];
    }
    lengths.push(updates);
    lengths.sort_unstable();
    lengths.dedup();
    lengths
}

/// The rows that a policy serves; `whole` where it is the end of its run.
fn serves(variant: &Variant, updates: u64, whole: bool) -> Vec<String> {
    if variant.name == POOL {
        return vec![if whole { "crowds NH, IN, VA" } else { "crowd SO" }.to_owned()];
    }
    let rows = ROWS.iter().filter(|row| row.variant == variant.name);
    let exact: Vec<String> = rows
        .clone()
        .filter(|row| row.updates == updates)
        .flat_map(|row| row.serves.iter().map(|place| (*place).to_owned()))
        .collect();
    if !exact.is_empty() {
        return exact;
    }
    let shorter = |place: &&str| format!("{place} (trained for {updates} updates only)");
    rows.filter(|row| row.updates > updates).flat_map(|row| row.serves.iter().map(&shorter)).collect()
}

/// The first lines of a run's log without their clock.
fn first_lines(path: &Path, count: usize) -> Result<String> {
    let path = path.join("log.ndjson");
    let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    text.lines().take(count).map(|line| Ok(curve::without_clock(line)? + "\n")).collect()
}

/// Moves everything from the waiting folder to its place.
fn settle(waiting: &Path, folder: &Path) -> Result<()> {
    let curves = folder.join(CURVES);
    std::fs::create_dir_all(&curves).with_context(|| format!("cannot create {}", curves.display()))?;
    for (from, to) in [(waiting.to_owned(), folder.to_owned()), (waiting.join(CURVES), curves)] {
        for entry in std::fs::read_dir(&from).with_context(|| format!("cannot list {}", from.display()))? {
            let path = entry?.path();
            if let (true, Some(name)) = (path.is_file(), path.file_name()) {
                std::fs::rename(&path, to.join(name))
                    .with_context(|| format!("cannot move {}", path.display()))?;
            }
        }
    }
    Ok(())
}
