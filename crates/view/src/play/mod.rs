//! `cargo xtask play`: a page on this machine in which a policy drives among a crowd in real time.
//!
//! Reading order: this file (what can be chosen), `session` (a room; no clock, no socket),
//! `message` (what page and server say), `visit` (a visitor and the clock), `server` and `http`
//! (connections), `page`; `live.js` is the page, and `scene.js` of the replay draws it.
//!
//! Every visitor has a room of their own, so that a second window starts anew and disturbs nobody.

mod http;
mod message;
mod page;
mod server;
mod session;
mod visit;

use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use jostle_arena::Planner;
use jostle_arena::crowds::Pools;
use jostle_peds::CrowdKind;

use self::message::Setup;
use self::server::{Server, listen};
use self::session::{Catalogue, Session};
use crate::demo;
use crate::replay::driver::Driver;
use jostle_runs::output;
use jostle_runs::policies;

/// Arguments of `play`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask play\n  cargo xtask play runs/ours runs/baseline --crowd VO --pedestrians 8\n  \
    cargo xtask play runs/ours --pool runs/pool --crowd IN --port 8080\n\nCtrl-C ends it."
)]
pub struct PlayArgs {
    /// Checkpoint files, run folders or planners to choose from (default: the shipped ones).
    /// Planners that are not named come last.
    policy: Vec<PathBuf>,
    /// Crowd at the start: SF, VO, straight, stop-and-go; with --pool also NH, IN, VA, SO,
    /// cross-play.
    #[arg(long, default_value = "SF")]
    crowd: CrowdKind,
    /// Pedestrians at the start.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pedestrians: usize,
    /// Behaviour token of the robot at the start.
    #[arg(long, value_name = "Z", default_value_t = 0)]
    token: u32,
    /// Seed of starts, goals and noise: the same seed and the same actions of yours give the same
    /// episode.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Policies that drive learned pedestrians: files, run folders, or a folder of either; may be
    /// repeated.
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool: Vec<PathBuf>,
    /// The same at half their training, for crowd SO.
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool_half: Vec<PathBuf>,
    /// Port of the loopback interface (default: any that is free).
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Do not open the page in a browser.
    #[arg(long)]
    no_open: bool,
}

/// Serves the page until the process is ended.
pub fn run(args: &PlayArgs) -> Result<ExitCode> {
    let catalogue = catalogue(args)?;
    for policy in catalogue.drivers.iter().filter_map(Driver::policy) {
        jostle_runs::maps::tell(&policy.sim_config()?.room)?;
    }
    let (crowd, pedestrians) = (args.crowd, args.pedestrians);
    let first = Setup { crowd, pedestrians, policy: 0, token: args.token, seed: args.seed, episode: 0 };
    // What cannot be played is said here, not to the first visitor.
    Session::new(&catalogue, first.clone())?;
    let (listener, address) = listen(args.port)?;
    let url = format!("http://{address}/");
    output::result(&format!("{url}\n"))?;
    output::note("open this page in a browser; Ctrl-C ends it");
    if !args.no_open && std::io::stdout().is_terminal() && !demo::open(url.as_ref()) {
        output::note("no browser could be started; open the page yourself");
    }
    Arc::new(Server::new(catalogue, first)).serve(&listener, address);
    Ok(ExitCode::SUCCESS)
}

/// Serves a planner on a free port for as long as the process lives.
///
/// # Errors
/// No free port.
pub fn serve_in_background() -> Result<SocketAddr> {
    let crowds = playable().filter(|crowd| !crowd.is_learned()).collect();
    let catalogue =
        Catalogue { drivers: vec![Driver::planner(Planner::GoalSeeker)], pools: Pools::default(), crowds };
    let first = Setup { crowd: CrowdKind::Sf, pedestrians: 4, policy: 0, token: 0, seed: 0, episode: 0 };
    let (listener, address) = listen(0)?;
    std::thread::spawn(move || Arc::new(Server::new(catalogue, first)).serve(&listener, address));
    Ok(address)
}

/// The crowds that can be played with: recorded people do not change with the visitor's wishes.
fn playable() -> impl Iterator<Item = CrowdKind> {
    CrowdKind::built_in().filter(|crowd| *crowd != CrowdKind::Recorded)
}

/// The policies and crowds to choose from.
fn catalogue(args: &PlayArgs) -> Result<Catalogue> {
    let paths = if args.policy.is_empty() { demo::shipped()? } else { args.policy.clone() };
    let mut drivers = paths.iter().map(|path| Driver::open(path, 0)).collect::<Result<Vec<_>>>()?;
    for planner in Planner::ALL {
        if drivers.iter().all(|driver| driver.name != planner.name()) {
            drivers.push(Driver::planner(planner));
        }
    }
    let pools = if args.pool.is_empty() { Pools::default() } else { learned(args)? };
    let has = |crowd: &CrowdKind| !crowd.is_learned() || !pools.drivers(*crowd, 1).is_empty();
    let crowds = playable().filter(has).collect();
    Ok(Catalogue { drivers, pools, crowds })
}

/// The pools, with the half-trained policies where they can be had.
fn learned(args: &PlayArgs) -> Result<Pools> {
    let with_half = !args.pool_half.is_empty() || args.crowd == CrowdKind::So;
    let crowds: &[CrowdKind] = if with_half { &CrowdKind::PAPER } else { &[CrowdKind::Nh] };
    Ok(policies::pools(&args.pool, &args.pool_half, crowds, "--pool-half")?)
}
