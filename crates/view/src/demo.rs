//! `cargo xtask demo`: a moving picture within a minute.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_arena::Planner;
use jostle_arena::crowds::Pools;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;

use crate::replay::driver::Driver;
use crate::replay::{Wish, config_of, record, write};
use jostle_runs::output;

/// The folder of shipped policies.
const POLICIES: &str = "checkpoints";
/// The beginning of the names of the policies that drive best.
const STRONG: &str = "strong-";
/// The same of the paper's row that drives beside them: M = 5.
const PAPERS_ROW: &str = "m5-";
/// The planner that drives beside a policy.
const PLANNER: Planner = Planner::Dwa;
/// The robot and so many pedestrians less one.
const AGENTS: usize = 8;
/// Arguments of `demo`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask demo\n  cargo xtask demo --policy runs/ours --out /tmp/demo --no-open"
)]
pub struct DemoArgs {
    /// Checkpoint file, run folder or planner; the planner dwa drives beside it (default: the
    /// strong policy, dwa and the paper's M = 5).
    #[arg(long, value_name = "POLICY")]
    policy: Option<PathBuf>,
    /// Episodes in each of the two crowds.
    #[arg(long, value_name = "N", default_value_t = 10)]
    episodes: usize,
    /// Folder for the page.
    #[arg(long, value_name = "DIR", default_value = "runs/demo")]
    out: PathBuf,
    /// Do not open the page in a browser.
    #[arg(long)]
    no_open: bool,
}

/// Runs a policy among the two crowds that need no training, and names the page that shows it.
pub fn run(args: &DemoArgs) -> Result<ExitCode> {
    let started = Instant::now();
    ensure!(args.episodes > 0, "--episodes: found 0, expected at least 1");
    let shown: Vec<PathBuf> = if let Some(path) = &args.policy {
        vec![path.clone()]
    } else {
        let all = shipped()?;
        all.first().into_iter().chain(all.iter().find(|path| is_of(path, PAPERS_ROW))).cloned().collect()
    };
    let mut drivers = shown.iter().map(|path| Driver::open(path, 0)).collect::<Result<Vec<_>>>()?;
    if drivers.is_empty() {
        output::note(&format!(
            "no trained policy is shipped here: the robot is driven by a planner only; after `{} train`, show yours with --policy",
            output::program()
        ));
    }
    if drivers.iter().all(|driver| driver.name != PLANNER.name()) {
        drivers.insert(drivers.len().min(1), Driver::planner(PLANNER));
    }
    let protocol = Protocol::new(config_of(&drivers, Some(AGENTS))?, Pools::default())?;
    let wish = Wish::first(args.episodes);
    let page = record(&protocol, &drivers, &[CrowdKind::Sf, CrowdKind::Vo], &wish)?.page;
    let path = write(&page, &args.out)?;
    output::result(&format!("{}\n{}\n", page.summary(), path.display()))?;
    output::note(&format!("made in {:.1} s", started.elapsed().as_secs_f64()));
    if !args.no_open && std::io::stdout().is_terminal() && !open(&path) {
        output::note("no browser could be started; open the page yourself");
    }
    Ok(ExitCode::SUCCESS)
}

/// The policies that are shipped: the strong ones first, then by name; none where neither a
/// checkout nor the program has any.
///
/// # Errors
/// A folder that cannot be listed or, without a checkout, not be made.
pub fn shipped() -> Result<Vec<PathBuf>> {
    if !jostle_runs::shipped::is_shipped(POLICIES) {
        return Ok(Vec::new());
    }
    let folder = jostle_runs::shipped::shipped(POLICIES)?;
    let cannot_list = || format!("cannot list {}", folder.display());
    let entries = std::fs::read_dir(&folder).with_context(cannot_list)?;
    let is_policy = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "safetensors");
    let mut paths =
        entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>().with_context(cannot_list)?;
    paths.retain(is_policy);
    paths.sort_by_key(|path| (!is_of(path, STRONG), path.clone()));
    Ok(paths)
}

/// True if a policy is of the row whose names begin so.
fn is_of(path: &Path, row: &str) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(row))
}

/// Hands a page, a file or an address, to the desktop's browser; whether a program for that was
/// found.
pub fn open(page: &Path) -> bool {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let quiet = Command::new(program).arg(page).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    quiet.is_ok()
}
