//! `cargo xtask evaluate`: a policy or a planner among crowds that it never met.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail};
use clap::Args;
use jostle_arena::config::ArenaConfig;
use jostle_arena::room::RoomPlan;
use jostle_eval::protocol::Protocol;
use jostle_eval::report::{CellTiming, Evaluation, timings_csv};
use jostle_peds::CrowdKind;
use jostle_sim::SimConfig;

use crate::suite::{self, Asked};
use jostle_runs::changed::changed;
use jostle_runs::maps;
use jostle_runs::output;
use jostle_runs::policies;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::threads;
use jostle_study::cell::Cell;
use jostle_view::recording::RecordingArgs;

/// Arguments of `evaluate`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask evaluate runs/ours --crowds VO,SF --episodes 100\n  \
    cargo xtask evaluate runs/ours --crowds NH,IN,VA,SO --pool runs/pool --out results/ours\n  \
    cargo xtask evaluate dwa --crowds VO,SF\n  \
    cargo xtask evaluate runs/ours/checkpoints/002500.safetensors --crowds SF --token 3\n  \
    cargo xtask evaluate runs/ours --crowds straight,stop-and-go,cross-play --pool runs/seed2 runs/seed3\n  \
    cargo xtask evaluate runs/ours --suite standard --crowds VO,SF --episodes 200\n  \
    cargo xtask evaluate runs/ours --crowds VO,SF --set sim.robot.dynamics=rapier --out results/rapier\n  \
    cargo xtask evaluate runs/ours --recording recordings/sample.txt --episodes 200")]
pub struct EvaluateArgs {
    /// Checkpoint file, run folder for its newest checkpoint, or a planner that was not learned:
    /// straight, brake, goal-seeker, dwa, orca, social-force.
    policy: PathBuf,
    /// Crowds, separated by commas: NH, IN, VA, SO (these need --pool), VO, SF; to choose settings
    /// by, without spending the six: straight, stop-and-go, cross-play (the last with --pool).
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "CROWDS",
        default_value = "NH,IN,VA,SO,VO,SF",
        conflicts_with = "recording"
    )]
    crowds: Vec<String>,
    /// Episodes per crowd; episode k is the same for every policy.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    episodes: u64,
    /// Policies that drive learned pedestrians: files, run folders, or a folder of either; may be
    /// repeated.
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool: Vec<PathBuf>,
    /// The same at half their training, for crowd SO (default: from the runs of --pool).
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pool_half: Vec<PathBuf>,
    /// Harder places in place of the usual room: `standard`, or a TOML file of scenes. Every crowd
    /// is tested in each.
    #[arg(long, value_name = "NAME", conflicts_with = "recording")]
    suite: Option<String>,
    /// Behaviour token of the robot.
    #[arg(long, value_name = "Z", default_value_t = 0)]
    token: u32,
    /// Agents in a room, the robot among them (default: as in training, for a planner 5).
    #[arg(long, value_name = "N", conflicts_with_all = ["suite", "recording"])]
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
    /// Folder for records and reports; records that are there already are used again.
    #[arg(long, value_name = "DIR", default_value = "runs/evaluation")]
    out: PathBuf,
    /// Worker threads (default: all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

/// Tests as the arguments say and prints the result.
pub(crate) fn run(args: &EvaluateArgs) -> Result<ExitCode> {
    threads::set(args.threads)?;
    if let Some(name) = &args.suite {
        return run_suite(args, name);
    }
    let evaluation = evaluate(args)?;
    output::note(&format!("records and reports: {}", args.out.display()));
    output::result(&evaluation.text())?;
    Ok(ExitCode::SUCCESS)
}

/// Tests on the scenes of a suite and prints the result.
fn run_suite(args: &EvaluateArgs, name: &str) -> Result<ExitCode> {
    let crowds = args.crowds()?;
    let driver = policies::driver(&args.policy)?;
    let ArenaConfig { sim, n_agents, .. } = driver.config()?;
    let base = args.protocol(sim, n_agents, &crowds)?;
    let asked = Asked {
        suite: suite::open(name)?,
        driver: &driver,
        token: args.token,
        crowds: &crowds,
        episodes: args.episodes,
        out: &args.out,
    };
    suite::run(&asked, base.config(), base.pools())?;
    Ok(ExitCode::SUCCESS)
}

/// Tests as the arguments say, on the threads that there are, and writes records and reports.
pub(crate) fn evaluate(args: &EvaluateArgs) -> Result<Evaluation> {
    let crowds = args.crowds()?;
    let driver = policies::driver(&args.policy)?;
    let ArenaConfig { sim, n_agents, .. } = driver.config()?;
    let protocol = args.protocol(sim, n_agents, &crowds)?;
    let cell = |crowd| Cell { protocol: &protocol, driver: &driver, token: args.token, crowd };
    for &crowd in &crowds {
        cell(crowd).check()?;
    }
    let records = args.out.join("records");
    std::fs::create_dir_all(&records).with_context(|| format!("cannot create {}", records.display()))?;
    let mut timings = Vec::new();
    let mut cells = Vec::new();
    for &crowd in &crowds {
        let (run, timing) = cell(crowd).run(args.episodes, &records)?;
        timings.extend(timing);
        cells.push(run.result);
    }
    let n_agents = protocol.config().n_agents;
    let changes = args.changes.join(", ");
    let room = (!changes.is_empty()).then(|| format!("Changed in the room: {changes}."));
    let remarks: Vec<String> = driver.remark().into_iter().chain(room).collect();
    let remark = (!remarks.is_empty()).then(|| remarks.join(" "));
    let evaluation = Evaluation { policy: driver.identity(), token: args.token, n_agents, cells, remark };
    store(args, &evaluation, &timings)?;
    Ok(evaluation)
}

impl EvaluateArgs {
    /// Refuses what would stop the evaluation of a policy that is trained with these settings.
    pub(crate) fn check(&self, sim: &SimConfig, trained_with: usize) -> Result<()> {
        if self.suite.is_some() {
            bail!("--suite: found in a plan, expected a call of `evaluate` of its own");
        }
        let crowds = self.crowds()?;
        let protocol = self.protocol(sim.clone(), trained_with, &crowds)?;
        crowds.iter().try_for_each(|&crowd| {
            protocol.crowd(&RoomPlan::new(protocol.config(), crowd)?)?;
            Ok(())
        })
    }

    fn crowds(&self) -> Result<Vec<CrowdKind>> {
        if self.episodes == 0 {
            bail!("--episodes: found 0, expected at least 1");
        }
        if self.recording.recording.is_some() {
            return Ok(vec![CrowdKind::Recorded]);
        }
        Ok(self.crowds.iter().map(|name| name.parse()).collect::<Result<_, _>>()?)
    }

    /// The episodes for a policy that was trained in rooms like `sim` with so many agents.
    fn protocol(&self, sim: SimConfig, trained_with: usize, crowds: &[CrowdKind]) -> Result<Protocol> {
        let config = ArenaConfig {
            sim: changed(sim, &self.changes)?,
            n_agents: self.agents.unwrap_or(trained_with),
            seed: self.seed,
            ..ArenaConfig::default()
        };
        maps::tell(&config.sim.room)?;
        let config = self.recording.config(config)?;
        Ok(Protocol::new(config, policies::pools(&self.pool, &self.pool_half, crowds, "--pool-half")?)?)
    }
}

/// Writes the evaluation beside its records.
fn store(args: &EvaluateArgs, evaluation: &Evaluation, timings: &[CellTiming]) -> Result<()> {
    let name = format!("{}-z{}", evaluation.policy.name, evaluation.token);
    let path = |extension: &str| args.out.join(format!("{name}.{extension}"));
    write_atomically(&path("md"), &evaluation.markdown())?;
    write_atomically(&path("csv"), &evaluation.csv())?;
    write_atomically(&path("json"), &evaluation.json())?;
    if !timings.is_empty() {
        write_atomically(&path("seconds.csv"), &timings_csv(timings))?;
    }
    Ok(())
}
