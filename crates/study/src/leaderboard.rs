//! `cargo xtask leaderboard`: robots on the standard suite, as entries of which each runs again to
//! the bit from its own line.
//!
//! Reading order: [`run`], `enter` (a robot is run, and compared where it is stored),
//! `store_pages`, `check` (what is stored is what it says; `verify results` asks for it, too).
//! An entry is `NAME.json` in the folder; `leaderboard.md` and `index.html` beside them are made of
//! the entries.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use clap::Args;
use jostle_arena::config::ArenaConfig;
use jostle_arena::identity::short;
use jostle_arena::{Driver, LoadedPolicy, Planner};
use jostle_eval::board::{Board, BoardEntry, Entrant, EntryKind};
use jostle_eval::suite::Suite;
use jostle_peds::CrowdKind;
use jostle_sim::SimConfig;
use jostle_view::board;

use crate::reproduce::plan::Plan;
use crate::reproduce::policies::Policies;
use crate::ship::manifest::{self, Manifest};
use jostle_runs::folder;
use jostle_runs::output::{self, PROGRAM_OF_CHECKOUT, note};
use jostle_runs::policies;
use jostle_runs::progress::Progress;
use jostle_runs::provenance::workspace;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::threads;

/// Root seed of all entries.
const SEED: u64 = 0;
/// The files that are made of the entries.
const TABLE: &str = "leaderboard.md";
const PAGE: &str = "index.html";

/// Arguments of `leaderboard`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask leaderboard\n  cargo xtask leaderboard --sort VO\n  cargo xtask leaderboard dwa\n  \
    cargo xtask leaderboard runs/ours --name ours --folder runs/board\n  cargo xtask leaderboard --check"
)]
pub struct LeaderboardArgs {
    /// Robots to run on all cells: checkpoint files, run folders or planners. One that is stored is
    /// run again and compared, bit for bit; without a robot nothing is run and the pages are made.
    robot: Vec<PathBuf>,
    /// Name of the robot on the board (default: the policy's own).
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Behaviour token of the robots.
    #[arg(long, value_name = "Z", default_value_t = 0)]
    token: u32,
    /// Episodes of a cell.
    #[arg(long, value_name = "N", default_value_t = 100)]
    episodes: u64,
    /// Store an entry that comes out otherwise instead of failing.
    #[arg(long)]
    replace: bool,
    /// Column by which the printed table is sorted, such as mean, worst, VO, doorway, SPL.
    #[arg(long, value_name = "COLUMN", default_value = "mean")]
    sort: String,
    /// Check the stored entries and pages, and run nothing.
    #[arg(long, conflicts_with_all = ["robot", "name", "replace"])]
    check: bool,
    /// Folder of the entries (default: `results/leaderboard/` of this repository).
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Folder of shipped policies, whose pool drives learned pedestrians (default: `checkpoints/`
    /// of this repository).
    #[arg(long, value_name = "DIR")]
    checkpoints: Option<PathBuf>,
    /// Worker threads (default: all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

/// The folder of the entries below that of the results.
pub(crate) fn default_folder(results: &Path) -> PathBuf {
    results.join("leaderboard")
}

/// Does what the arguments ask for and prints the table.
pub fn run(args: &LeaderboardArgs) -> Result<ExitCode> {
    jostle_runs::shipped::checkout()?;
    threads::set(args.threads)?;
    ensure!(args.episodes > 0, "--episodes: found 0, expected at least 1");
    ensure!(
        args.name.is_none() || args.robot.len() == 1,
        "--name: found it for {} robots, expected one robot",
        args.robot.len()
    );
    let folder = args.folder.clone().unwrap_or_else(|| default_folder(&workspace().join("results")));
    let checkpoints = args.checkpoints.clone().unwrap_or_else(manifest::default_folder);
    if args.check {
        output::result(&format!("{}\n", check(&folder, &checkpoints)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    // A slip in the last name is found before the first robot has run for minutes.
    let drivers = args.robot.iter().map(|path| policies::driver(path)).collect::<Result<Vec<_>, _>>()?;
    let board = standard(&checkpoints, args.episodes)?;
    for (path, driver) in args.robot.iter().zip(&drivers) {
        enter(args, &board, path, driver, &folder)?;
        store_pages(&folder)?;
    }
    let entries = stored(&folder)?;
    let sorted = board::sorted(&entries, &args.sort).map_err(|expected| {
        anyhow::anyhow!("--sort: found {}, expected one of {}", args.sort, expected.join(", "))
    })?;
    if args.robot.is_empty() {
        store_pages(&folder)?;
    }
    output::result(&board::text(&sorted))?;
    note(&format!("{}: the page of {} entries", folder.join(PAGE).display(), entries.len()));
    Ok(ExitCode::SUCCESS)
}

/// The suite and the crowds of every entry, with the shipped pool.
fn standard(checkpoints: &Path, episodes: u64) -> Result<Board> {
    let plan = Plan::new(&Plan::default_base())?;
    let pools = Policies::new(plan, checkpoints, Path::new(""), BTreeSet::new())?.pools()?;
    Ok(Board { suite: Suite::standard(), crowds: CrowdKind::PAPER.to_vec(), episodes, seed: SEED, pools })
}

/// Runs a robot on all cells. Its entry is stored; where it is stored already, both are compared.
fn enter(args: &LeaderboardArgs, board: &Board, path: &Path, driver: &Driver, folder: &Path) -> Result<()> {
    let entrant = entrant(args, path, driver)?;
    let file = folder.join(format!("{}.json", entrant.name));
    let old = file.exists().then(|| BoardEntry::read(&file)).transpose()?;
    if let Some(old) = old.as_ref().filter(|old| old.episodes != args.episodes && !args.replace) {
        bail!(
            "{}: has {} episodes a cell, found --episodes {}; its line is `{}`",
            file.display(),
            old.episodes,
            args.episodes,
            old.command
        );
    }
    let cells = (board.suite.scenes.len() * board.crowds.len()) as u64;
    let mut progress = Progress::new(&entrant.name, cells * board.episodes, 0);
    let (mut place, mut before) = (None, 0);
    let entry =
        board.run(&entrant, &mut |plan| driver.robot(args.token, plan), &mut |scene, crowd, done| {
            let here = Some((scene.to_owned(), crowd));
            if place != here {
                before += if place.is_some() { board.episodes } else { 0 };
                place = here;
            }
            progress.set(before + done, &format!("{scene}, {crowd}"));
        })?;
    progress.finish(&format!("mean success {:.3}", entry.score.mean));
    match old.as_ref().map(|old| (old, old.difference(&entry))) {
        Some((_, None)) => {
            note(&format!("{}: {cells} cells run again with the same bits", entry.name));
            return Ok(());
        }
        Some((_, Some(difference))) if !args.replace => {
            bail!("{}: {difference}; --replace stores what was found", file.display());
        }
        _ => {}
    }
    write_atomically(&file, &entry.text())
}

fn entrant(args: &LeaderboardArgs, path: &Path, driver: &Driver) -> Result<Entrant> {
    let policy = driver.identity();
    let name = args.name.clone().unwrap_or_else(|| policy.name.clone());
    let (kind, about) = match driver {
        Driver::Planner(planner) => (kind_of(*planner), planner.description().to_owned()),
        Driver::Trained(_) => {
            let transitions = policy.transitions.unwrap_or_default();
            let config = policy.config_hash.as_deref().map_or("unknown", short);
            (EntryKind::Learned, format!("learned in {transitions} transitions, config {config}"))
        }
    };
    let ArenaConfig { sim, .. } = driver.config()?;
    Ok(Entrant { command: command(args, path), name, kind, about, policy, token: args.token, sim })
}

fn kind_of(planner: Planner) -> EntryKind {
    if planner.knows_positions() { EntryKind::KnowsPositions } else { EntryKind::Planner }
}

/// The line that runs an entry again, from the root of a checkout.
fn command(args: &LeaderboardArgs, path: &Path) -> String {
    let below = path.strip_prefix(workspace()).unwrap_or(path);
    let name = args.name.as_ref().map_or_else(String::new, |name| format!(" --name {name}"));
    let token = if args.token == 0 { String::new() } else { format!(" --token {}", args.token) };
    let robot = below.display();
    format!("{PROGRAM_OF_CHECKOUT} leaderboard {robot}{name}{token} --episodes {}", args.episodes)
}

/// The entries of a folder by the names of their files.
fn stored(folder: &Path) -> Result<Vec<BoardEntry>> {
    let mut files = folder::sorted(folder)?;
    files.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    let read = |path: &PathBuf| {
        let entry = BoardEntry::read(path)?;
        let found = path.file_stem().unwrap_or_default().to_string_lossy();
        ensure!(found == entry.name, "{}: name: found {}, expected {found}", path.display(), entry.name);
        Ok(entry)
    };
    files.iter().map(read).collect()
}

/// Makes the table and the page of a folder's entries.
fn store_pages(folder: &Path) -> Result<()> {
    let entries = stored(folder)?;
    write_atomically(&folder.join(TABLE), &board::markdown(&entries))?;
    write_atomically(&folder.join(PAGE), &board::html(&entries))
}

/// Checks the entries of a folder: that each fits together, is of a robot that this program can
/// make unless it is the user's own, and is of the present scenes, settings and pedestrians; and
/// that the table and the page are what the entries say. Gives a line about them.
///
/// # Errors
/// The first entry, cell or page that is not as it should be.
pub(crate) fn check(folder: &Path, checkpoints: &Path) -> Result<String> {
    let entries = stored(folder)?;
    let manifest = Manifest::load(checkpoints)?;
    let mut board = standard(checkpoints, 1)?;
    let mut own = 0;
    for entry in &entries {
        let file = folder.join(format!("{}.json", entry.name));
        let refuse = |what: &str, found: &str, expected: &str| {
            bail!(
                "{}: {what}: found {found}, expected {expected}; `{}` runs it again",
                file.display(),
                entry.command
            )
        };
        if entry.suite != board.suite.name || entry.seed != SEED {
            let found = format!("suite {}, seed {}", entry.suite, entry.seed);
            refuse("run", &found, &format!("suite {}, seed {SEED}", board.suite.name))?;
        }
        board.episodes = entry.episodes;
        let Some(sim) = world_of(entry, &manifest, checkpoints)? else {
            own += 1;
            continue;
        };
        let keys = board.keys(&entry.policy, entry.token, &sim)?;
        if keys.len() != entry.cells.len() {
            refuse("cells", &entry.cells.len().to_string(), &keys.len().to_string())?;
        }
        for (cell, (scene, crowd, key)) in entry.cells.iter().zip(&keys) {
            if (&cell.scene, &cell.crowd, &cell.cell) != (scene, crowd, key) {
                let found = format!("{}, {} {}", cell.scene, cell.crowd, short(&cell.cell));
                refuse("cell", &found, &format!("{scene}, {crowd} {}", short(key)))?;
            }
        }
    }
    for (name, text) in [(TABLE, board::markdown(&entries)), (PAGE, board::html(&entries))] {
        let path = folder.join(name);
        let found =
            std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        ensure!(
            found == text,
            "{}: found another text than the entries make; `{} leaderboard` makes it",
            path.display(),
            output::program()
        );
    }
    let episodes: u64 = entries.iter().map(|entry| entry.episodes * entry.cells.len() as u64).sum();
    Ok(format!(
        "{} entries of the leaderboard, {episodes} episodes, {own} of the user's own; `{} leaderboard ROBOT` runs one again and compares",
        entries.len(),
        output::program()
    ))
}

/// The world of an entry's robot; `None` for the user's own.
fn world_of(entry: &BoardEntry, manifest: &Manifest, checkpoints: &Path) -> Result<Option<SimConfig>> {
    let sha256 = &entry.policy.sha256;
    match entry.kind {
        EntryKind::Own => Ok(None),
        EntryKind::Planner | EntryKind::KnowsPositions => {
            let planner = Planner::ALL.into_iter().find(|planner| planner.identity().sha256 == *sha256);
            let planner = planner.with_context(|| {
                format!("{}: planner {}: found none of this version and settings", entry.name, short(sha256))
            })?;
            let expected = kind_of(planner);
            ensure!(
                entry.kind == expected,
                "{}: kind: found {:?}, expected {expected:?}",
                entry.name,
                entry.kind
            );
            Ok(Some(SimConfig::default()))
        }
        EntryKind::Learned => {
            let policy = manifest.policies.iter().find(|policy| policy.sha256 == *sha256);
            let policy = policy.with_context(|| {
                format!("{}: policy {}: found none in the manifest", entry.name, short(sha256))
            })?;
            Ok(Some(LoadedPolicy::load(&checkpoints.join(&policy.file))?.sim_config()?))
        }
    }
}
