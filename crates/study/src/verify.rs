//! `cargo xtask verify`: what is shipped is what it says it is.

use std::fmt::Write as _;
use std::iter;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use clap::{Args, Subcommand};
use jostle_arena::Planner;
use jostle_arena::identity::short;
use jostle_eval::compact::CompactCell;
use jostle_ppo::{Config, Trainer};

use crate::leaderboard;
use crate::reproduce::plan::Plan;
use crate::ship::curve::{first_difference, without_clock};
use crate::ship::manifest::{self, FOLDER_MAX, MANIFEST, Manifest};
use jostle_runs::output;
use jostle_runs::progress::Progress;
use jostle_runs::provenance::workspace;

/// Arguments of `verify`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask verify checkpoints\n  cargo xtask verify curve m5-seed1 --updates 50\n  \
    cargo xtask verify results"
)]
pub struct VerifyArgs {
    #[command(subcommand)]
    what: What,
    /// Folder of shipped policies (default: `checkpoints/` of this repository).
    #[arg(long, value_name = "DIR", global = true)]
    checkpoints: Option<PathBuf>,
    /// Base setting of all rows (default: configs/headline.toml).
    #[arg(long, value_name = "FILE", global = true)]
    base: Option<PathBuf>,
}

#[derive(Subcommand)]
enum What {
    /// Every file of the manifest: hash, shape, provenance, setting; and the folder's size.
    Checkpoints,
    /// Train with a shipped configuration and seed and compare with the shipped curve, byte for
    /// byte.
    Curve {
        /// Name of a shipped run.
        name: String,
        /// Updates to make and to compare.
        #[arg(long, value_name = "N", default_value_t = crate::ship::curve::FIRST)]
        updates: usize,
    },
    /// Every stored cell: that it can be read, stands under its own hash, and is of shipped
    /// policies alone; and every entry of the leaderboard.
    Results {
        /// Folder of results (default: `results/` of this repository).
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// Verifies what the arguments name.
pub fn run(args: &VerifyArgs) -> Result<ExitCode> {
    jostle_runs::shipped::checkout()?;
    let folder = args.checkpoints.clone().unwrap_or_else(manifest::default_folder);
    match &args.what {
        What::Checkpoints => {
            let plan = Plan::new(&args.base.clone().unwrap_or_else(Plan::default_base))?;
            checkpoints(&folder, &plan)?;
        }
        What::Curve { name, updates } => curve(&folder, name, *updates)?,
        What::Results { out } => {
            results(&out.clone().unwrap_or_else(|| workspace().join("results")), &folder)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn checkpoints(folder: &std::path::Path, plan: &Plan) -> Result<()> {
    let manifest = Manifest::load(folder)?;
    // Printed at the end alone: half a list would look like a whole one.
    let mut text = String::new();
    for run in &manifest.runs {
        let (name, found) = (&run.name, &run.variant);
        let variant = plan.variant_of(&run.config).with_context(|| format!("run {name}"))?;
        ensure!(variant.name == found, "run {name}: variant: found {found}, its setting is {}", variant.name);
        run.curve.read(folder)?;
        let lines = run.first_updates.read(folder)?.lines().count();
        let same = run.config.hash() == run.config_hash;
        let note = if same { "" } else { "; the configuration has got keys since it was trained" };
        writeln!(text, "{name}: {} updates, {lines} of them to the byte{note}", run.updates)?;
    }
    for policy in &manifest.policies {
        let loaded = policy.load(folder, manifest.run(&policy.run)?)?;
        let sha256 = short(&loaded.identity.sha256);
        writeln!(text, "{}: sha256 {sha256}, {}", policy.name, policy.serves.join("; "))?;
    }
    let (listed, total, shown) = (manifest.bytes(), bytes_of(folder)?, folder.display());
    ensure!(
        total == listed,
        "{shown}: found {total} bytes, the manifest lists {listed}: it does not know all files"
    );
    ensure!(total <= FOLDER_MAX, "{shown}: found {total} bytes, expected at most {FOLDER_MAX}");
    let (n, megabytes) = (manifest.policies.len(), total as f64 / 1e6);
    writeln!(text, "{n} policies, {megabytes:.1} MB of at most {} MB", FOLDER_MAX / 1_000_000)?;
    output::result(&text)
}

/// Bytes of the files of a folder of policies, without the manifest.
fn bytes_of(folder: &std::path::Path) -> Result<u64> {
    let mut total = 0;
    for below in [folder.to_owned(), folder.join("curves")] {
        for entry in std::fs::read_dir(&below).with_context(|| format!("cannot list {}", below.display()))? {
            let entry = entry?;
            let about = entry.metadata()?;
            if about.is_file() && entry.file_name() != MANIFEST {
                total += about.len();
            }
        }
    }
    Ok(total)
}

fn curve(folder: &std::path::Path, name: &str, updates: usize) -> Result<()> {
    let manifest = Manifest::load(folder)?;
    let run = manifest.run(name)?;
    let shipped = run.first_updates.read(folder)?;
    let lines: Vec<&str> = shipped.lines().collect();
    ensure!(
        (1..=lines.len()).contains(&updates),
        "--updates: found {updates}, expected 1 to {} (what is shipped)",
        lines.len()
    );
    // As `train` does, through the text of the configuration.
    let none: &[&str] = &[];
    let text = toml::to_string(&run.config).context("a configuration that is no TOML")?;
    let mut trainer = Trainer::new(Config::parse(&text, name, none)?)?;
    let mut progress = Progress::new(name, updates as u64, 0);
    for (i, line) in lines.iter().take(updates).enumerate() {
        let report = serde_json::to_string(&trainer.update()?).context("a report that is no JSON")?;
        if let Some(difference) = first_difference(line, &without_clock(&report)?)? {
            bail!("{name}: update {} is not the shipped one: {difference}", i + 1);
        }
        progress.set(i as u64 + 1, "");
    }
    progress.finish("");
    output::result(&format!("{name}: the first {updates} updates are the shipped ones, byte for byte\n"))
}

fn results(folder: &std::path::Path, checkpoints: &std::path::Path) -> Result<()> {
    let cells = folder.join("cells");
    let manifest = Manifest::load(checkpoints)?;
    let planners = Planner::ALL.map(|planner| planner.identity().sha256);
    let is_shipped = |sha256: &String| {
        planners.contains(sha256) || manifest.policies.iter().any(|policy| policy.sha256 == *sha256)
    };
    let (mut count, mut episodes, mut elsewhere) = (0, 0, 0);
    for entry in std::fs::read_dir(&cells).with_context(|| format!("cannot list {}", cells.display()))? {
        let path = entry?.path();
        let cell = CompactCell::read(&path)?;
        let key = &cell.head.key;
        let expected = format!("{}-z{}-{}", key.crowd, key.token, short(&key.hash()));
        let found = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        ensure!(found == expected, "{}: name: found {found}, expected {expected}", path.display());
        ensure!(
            key.policy == cell.head.policy.sha256,
            "{}: policy: found {}, its key has {}",
            path.display(),
            cell.head.policy.sha256,
            key.policy
        );
        // What a run that was replaced left behind.
        if let Some(unknown) = iter::once(&key.policy).chain(&key.pool).find(|sha256| !is_shipped(sha256)) {
            bail!(
                "{}: policy {}: found none in {}; the cell serves no row, remove it",
                path.display(),
                short(unknown),
                checkpoints.join(MANIFEST).display()
            );
        }
        count += 1;
        episodes += cell.head.episodes;
        elsewhere += usize::from(cell.head.simulator.is_some());
    }
    let others =
        if elsewhere > 0 { format!(" (with --mujoco also {elsewhere} of MuJoCo)") } else { String::new() };
    output::result(&format!(
        "{count} cells, {episodes} episodes; `{} reproduce all --fresh` runs them again and compares{others}\n",
        output::program()
    ))?;
    let board = leaderboard::default_folder(folder);
    if board.is_dir() {
        output::result(&format!("{}\n", leaderboard::check(&board, checkpoints)?))?;
    }
    Ok(())
}
