//! `cargo xtask demo`: a moving picture within a minute.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use jostle_arena::Planner;
use jostle_arena::crowds::Pools;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;

use crate::replay::driver::Driver;
use crate::replay::{Wanted, Wish, config_of, record, write};
use jostle_runs::output;
use jostle_runs::provenance::workspace;

/// Folders of shipped policies.
const SHIPPED: [&str; 2] = ["checkpoints", "policies"];
/// The planner that drives beside a policy.
const PLANNER: Planner = Planner::Dwa;
/// Episodes in each crowd.
const EPISODES: usize = 10;

/// Arguments of `demo`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask demo\n  cargo xtask demo --policy runs/ours --out /tmp/demo --no-open"
)]
pub struct DemoArgs {
    /// Checkpoint file, run folder or planner (default: the first of those shipped in `checkpoints/`); the planner dwa drives
    /// beside it.
    #[arg(long, value_name = "POLICY")]
    policy: Option<PathBuf>,
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
    let mut drivers = Vec::new();
    match args.policy.clone().or_else(|| shipped().into_iter().next()) {
        Some(path) => drivers.push(Driver::open(&path, 0)?),
        None => output::note(&format!(
            "no trained policy is shipped here: the robot is driven by a planner only; after `{} train`, show yours with --policy",
            output::program()
        )),
    }
    if drivers.iter().all(|driver| driver.name != PLANNER.name()) {
        drivers.push(Driver::planner(PLANNER));
    }
    let protocol = Protocol::new(config_of(&drivers, None)?, Pools::default())?;
    let wish = Wish { wanted: Wanted::Any, episodes: EPISODES, search: 0 };
    let page = record(&protocol, &drivers, &[CrowdKind::Sf, CrowdKind::Vo], wish)?;
    let path = write(&page, &args.out)?;
    output::result(&format!("{}\n{}\n", page.summary(), path.display()))?;
    output::note(&format!("made in {:.1} s", started.elapsed().as_secs_f64()));
    if !args.no_open && std::io::stdout().is_terminal() && !open(&path) {
        output::note("no browser could be started; open the page yourself");
    }
    Ok(ExitCode::SUCCESS)
}

/// The policies that the checkout ships, by name.
pub fn shipped() -> Vec<PathBuf> {
    let folders = SHIPPED.iter().filter_map(|name| std::fs::read_dir(workspace().join(name)).ok());
    let entries = folders.flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut paths: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "safetensors")).collect();
    paths.sort();
    paths
}

/// Hands a page, a file or an address, to the desktop's browser; whether a program for that was found.
pub fn open(page: &Path) -> bool {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let quiet = Command::new(program).arg(page).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    quiet.is_ok()
}
