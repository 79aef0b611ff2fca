//! `cargo xtask replay`: episodes of a policy as one page that a browser plays, alone or beside
//! another policy.
//!
//! Reading order: this file (which episodes), [`driver`] (who drives the robot), [`page`] (the file
//! that is written); `scene.js` draws a moment, `player.js` is the page around it, `parts.js` what
//! it shares with the live page. [`gif`] (one episode as a moving picture) and [`mcap`] (all of
//! them for the tools of ROS 2) are written where they are asked for.

pub mod driver;
pub mod gif;
pub mod mcap;
pub mod page;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use clap::{Args, ValueEnum};
use glam::Vec2;
use jostle_arena::Outcome;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::{Pools, check_observation};
use jostle_arena::replay::{EpisodeTrace, trace_episodes};
use jostle_arena::room::RoomPlan;
use jostle_arena::site::polygons;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;

use self::driver::Driver;
use self::page::{Page, Scene};
use crate::recording::RecordingArgs;
use jostle_runs::changed::changed;
use jostle_runs::output;
use jostle_runs::policies;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::threads;

/// Beams of the laser that a page keeps at most.
pub const BEAMS: usize = 128;
/// Episodes that are traced side by side.
const CHUNK: u64 = 32;

/// Arguments of `replay`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask replay runs/ours --crowd SF --episodes 20\n  \
    cargo xtask replay runs/ours --against runs/baseline --crowd SF,VO --out runs/replay\n  \
    cargo xtask replay runs/ours --crowd IN --pool runs/pool --outcome collision --episodes 20\n  \
    cargo xtask replay dwa --crowd VO --agents 10\n  \
    cargo xtask replay runs/ours --against dwa --pick 7 --gif runs/seven.gif --mcap runs/seven.mcap\n  \
    cargo xtask replay goal-seeker --recording recordings/sample.txt")]
pub struct ReplayArgs {
    /// Checkpoint file, run folder, or a planner: straight, brake, goal-seeker, dwa.
    policy: PathBuf,
    /// Another policy on the same episodes, side by side; may be repeated.
    #[arg(long, value_name = "POLICY")]
    against: Vec<PathBuf>,
    /// Crowds, separated by commas: SF, VO, straight, stop-and-go; with --pool also NH, IN, VA, SO,
    /// cross-play.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "CROWDS",
        default_value = "SF",
        conflicts_with = "recording"
    )]
    crowd: Vec<String>,
    /// Episodes per crowd.
    #[arg(long, value_name = "N", default_value_t = 20)]
    episodes: usize,
    /// Only episodes that end so for the (first) policy.
    #[arg(long, value_enum, default_value_t = Wanted::Any)]
    outcome: Wanted,
    /// These episodes only, by their indices, separated by commas.
    #[arg(long, value_delimiter = ',', value_name = "INDICES", conflicts_with_all = ["episodes", "outcome", "search"])]
    pick: Vec<u64>,
    /// Number of episodes to search for them.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    search: u64,
    /// Policies that drive learned pedestrians: files, run folders, or a folder of either; may be
    /// repeated.
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool: Vec<PathBuf>,
    /// The same at half their training, for crowd SO (default: from the runs of --pool).
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool_half: Vec<PathBuf>,
    /// Behaviour token of the robot.
    #[arg(long, value_name = "Z", default_value_t = 0)]
    token: u32,
    /// Behaviour token of the robot of --against; repeated as that is (default: 0).
    #[arg(long, value_name = "Z", requires = "against")]
    against_token: Vec<u32>,
    /// Agents in a room, the robot among them (default: as in training, else 5).
    #[arg(long, value_name = "N", conflicts_with = "recording")]
    agents: Option<usize>,
    /// Change a key of the room that the policy was trained in, such as
    /// `sim.robot.dynamics=rapier`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    changes: Vec<String>,
    #[command(flatten)]
    recording: RecordingArgs,
    /// Seed of starts, goals and noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for the page.
    #[arg(long, value_name = "DIR", default_value = "runs/replay")]
    out: PathBuf,
    /// Also writes the first episode as an animated GIF, at twice the speed of life.
    #[arg(long, value_name = "FILE")]
    gif: Option<PathBuf>,
    /// Also writes all episodes as an MCAP file: scans, odometry, transforms and markers as ROS 2
    /// has them.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Worker threads (default: all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

/// The kind of episodes that is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Wanted {
    /// All of them.
    Any,
    /// Those that reach the goal.
    Success,
    /// Those that hit a wall or a pedestrian.
    Collision,
    /// Those that hit a pedestrian.
    Pedestrian,
    /// Those that hit a wall.
    Wall,
    /// Those that run out of time.
    Timeout,
}

impl Wanted {
    fn fits(self, outcome: Outcome) -> bool {
        let pedestrian = outcome == Outcome::CollisionPedestrian;
        let wall = outcome == Outcome::CollisionWall;
        match self {
            Self::Any => true,
            Self::Success => outcome == Outcome::Success,
            Self::Collision => pedestrian || wall,
            Self::Pedestrian => pedestrian,
            Self::Wall => wall,
            Self::Timeout => outcome == Outcome::Timeout,
        }
    }
}

/// Writes the page that the arguments ask for.
pub fn run(args: &ReplayArgs) -> Result<ExitCode> {
    ensure!(args.episodes > 0, "--episodes: found 0, expected at least 1");
    let crowds = match args.recording.recording {
        Some(_) => vec![CrowdKind::Recorded],
        None => args.crowd.iter().map(|name| name.parse()).collect::<Result<Vec<CrowdKind>, _>>()?,
    };
    threads::set(args.threads)?;
    let (others, tokens) = (args.against.len(), args.against_token.len());
    ensure!(tokens <= others, "--against-token: found {tokens}, expected at most one for each --against");
    let mut drivers = vec![Driver::open(&args.policy, args.token)?];
    for (k, path) in args.against.iter().enumerate() {
        drivers.push(Driver::open(path, args.against_token.get(k).copied().unwrap_or(0))?);
    }
    let mut config = ArenaConfig { seed: args.seed, ..config_of(&drivers, args.agents)? };
    config.sim = changed(config.sim, &args.changes)?;
    jostle_runs::maps::tell(&config.sim.room)?;
    let config = args.recording.config(config)?;
    let protocol = Protocol::new(config, pools(args, &crowds)?)?;
    let wish = Wish {
        wanted: args.outcome,
        episodes: args.episodes,
        search: args.search,
        pick: args.pick.clone(),
        // A recording has what the laser measured, a page a picture of it.
        beams: if args.mcap.is_some() { usize::MAX } else { BEAMS },
    };
    let recorded = record(&protocol, &drivers, &crowds, &wish)?;
    let mut written = vec![write(&recorded.page, &args.out)?];
    written.extend(export(args, &recorded, &drivers, &protocol)?);
    let paths: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    output::result(&format!("{}\n{}\n", recorded.page.summary(), paths.join("\n")))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes the files that are asked for beside the page; gives their paths.
fn export(
    args: &ReplayArgs,
    recorded: &Recorded,
    drivers: &[Driver],
    protocol: &Protocol,
) -> Result<Vec<PathBuf>> {
    let (config, site) = (protocol.config(), &recorded.site);
    let mut written = Vec::new();
    if let Some(file) = &args.gif {
        let first = recorded.runs(drivers).next().context("--gif: no episode was found to be drawn")?;
        gif::write(file, &first, config, site)?;
        written.push(file.clone());
    }
    if let Some(file) = &args.mcap {
        let all: Vec<_> = recorded.runs(drivers).flatten().collect();
        mcap::write(file, &all, config, site)?;
        written.push(file.clone());
    }
    Ok(written)
}

/// The room of the first driver that was trained in one, with as many agents as asked for or as it
/// was trained with.
///
/// # Errors
/// Two policies that read different observations.
pub fn config_of(drivers: &[Driver], agents: Option<usize>) -> Result<ArenaConfig> {
    let mut config = ArenaConfig::default();
    if let Some(policy) = drivers.iter().find_map(|driver| driver.policy()) {
        config.sim = policy.sim_config()?;
        config.n_agents = policy.file.provenance.n_agents as usize;
    }
    for policy in drivers.iter().filter_map(|driver| driver.policy()) {
        check_observation(&config, policy)?;
    }
    config.n_agents = agents.unwrap_or(config.n_agents);
    Ok(config)
}

/// The episodes that are recorded, and how much of them.
#[derive(Clone, Debug)]
pub struct Wish {
    /// The end that the episodes must have.
    pub wanted: Wanted,
    /// For each crowd.
    pub episodes: usize,
    /// Episodes to look through.
    pub search: u64,
    /// Where there are any, these indices only, and nothing is searched.
    pub pick: Vec<u64>,
    /// Beams of a scan that are kept at most.
    pub beams: usize,
}

impl Wish {
    /// The first episodes, for a page.
    pub fn first(episodes: usize) -> Self {
        Self { wanted: Wanted::Any, episodes, search: 0, pick: Vec::new(), beams: BEAMS }
    }
}

/// What was recorded.
pub struct Recorded {
    /// The page that shows it.
    pub page: Page,
    /// By crowd, then by driver; each driver has the same episodes.
    pub traces: Vec<Vec<Vec<EpisodeTrace>>>,
    /// Walls, then obstacles, as polygons.
    pub site: Vec<Vec<Vec2>>,
}

impl Recorded {
    /// The episodes of all crowds, each with every driver's name and trace of it.
    pub fn runs<'a>(
        &'a self,
        drivers: &'a [Driver],
    ) -> impl Iterator<Item = Vec<(&'a str, &'a EpisodeTrace)>> {
        self.traces.iter().flat_map(move |columns| {
            let episodes = columns.first().map_or(0, Vec::len);
            (0..episodes).map(move |row| {
                let run =
                    |(driver, column): (&'a Driver, &'a Vec<EpisodeTrace>)| (&*driver.name, &column[row]);
                drivers.iter().zip(columns).map(run).collect()
            })
        })
    }
}

/// Walls, then obstacles, as polygons; the same for every crowd.
fn site(config: &ArenaConfig) -> Result<Vec<Vec<Vec2>>> {
    let crowd = if config.recording.is_some() { CrowdKind::Recorded } else { CrowdKind::Sf };
    Ok(polygons(&RoomPlan::new(config, crowd)?.scenario))
}

/// Runs the drivers through the wanted episodes of each crowd.
pub fn record(
    protocol: &Protocol,
    drivers: &[Driver],
    crowds: &[CrowdKind],
    wish: &Wish,
) -> Result<Recorded> {
    let site = site(protocol.config())?;
    let mut page = Page::new(Scene::new(protocol.config(), &site)?, drivers, protocol);
    let mut traces = Vec::new();
    for &crowd in crowds {
        let plan = RoomPlan::new(protocol.config(), crowd)?;
        let first = search(protocol, &plan, &drivers[0], wish)?;
        if first.len() < wish.episodes && wish.wanted != Wanted::Any {
            output::note(&format!("{crowd}: {} such episodes among the first {}", first.len(), wish.search));
        }
        let episodes: Vec<u64> = first.iter().map(|trace| trace.finished.episode).collect();
        let mut columns = vec![first];
        for driver in &drivers[1..] {
            columns.push(trace(protocol, &plan, driver, (&episodes, wish.beams))?);
        }
        page.add(&columns);
        traces.push(columns);
    }
    Ok(Recorded { page, traces, site })
}

/// The first episodes that end as wished, or those that were picked.
fn search(protocol: &Protocol, plan: &RoomPlan, driver: &Driver, wish: &Wish) -> Result<Vec<EpisodeTrace>> {
    if !wish.pick.is_empty() {
        return trace(protocol, plan, driver, (&wish.pick, wish.beams));
    }
    let limit = if wish.wanted == Wanted::Any { wish.episodes as u64 } else { wish.search };
    let mut found = Vec::new();
    for start in (0..limit).step_by(CHUNK as usize) {
        let episodes: Vec<u64> = (start..limit.min(start + CHUNK)).collect();
        let traces = trace(protocol, plan, driver, (&episodes, wish.beams))?;
        found.extend(traces.into_iter().filter(|trace| wish.wanted.fits(trace.finished.outcome)));
        if found.len() >= wish.episodes {
            found.truncate(wish.episodes);
            break;
        }
    }
    Ok(found)
}

fn trace(
    protocol: &Protocol,
    plan: &RoomPlan,
    driver: &Driver,
    (episodes, beams): (&[u64], usize),
) -> Result<Vec<EpisodeTrace>> {
    let mut robot = driver.robot(plan)?;
    let mut crowd = protocol.crowd(plan)?;
    Ok(trace_episodes(plan, &mut *robot, &mut *crowd, episodes, beams)?)
}

/// Writes the page as `index.html` and gives its path.
pub fn write(page: &Page, folder: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let path = folder.join("index.html");
    write_atomically(&path, &page.html()?)?;
    Ok(path)
}

/// The pedestrians' policies, as far as the crowds ask for them.
fn pools(args: &ReplayArgs, crowds: &[CrowdKind]) -> Result<Pools> {
    if args.pool.is_empty()
        && let Some(crowd) = crowds.iter().find(|crowd| crowd.is_learned())
    {
        bail!(
            "crowd {crowd} needs --pool: policies that drive its pedestrians; SF, VO, straight and stop-and-go need none"
        );
    }
    Ok(policies::pools(&args.pool, &args.pool_half, crowds, "--pool-half")?)
}
