//! `cargo xtask bench`: what the figures of `docs/performance.md` are made by.
//!
//! Reading order: `machine` (under what conditions), `update`, `simulator`, `rollout`, `learning`
//! and `evaluation` (ours alone), `ranks` (one run in several processes), `gpu` (a GPU beside the
//! processor), `peers` (ours and other software, taking turns), `worker` (our side of that).

mod evaluation;
mod gpu;
mod learning;
mod machine;
mod peers;
mod ranks;
mod rollout;
mod simulator;
mod table;
mod update;
mod worker;

use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use rayon::ThreadPool;

/// Arguments of `bench`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask bench peers --rvo2 ../RVO2 --only update,forward-5")]
pub struct BenchArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Time of an update by its parts, and each part's distance from the machine's matrix product.
    Update(update::UpdateArgs),
    /// Agent-steps per second of the simulator.
    Simulator(simulator::SimulatorArgs),
    /// Inference and simulation in turn, or overlapped.
    Rollout(rollout::RolloutArgs),
    /// Transitions per second of training, and the time to a share of successes among its own kind.
    Learning(learning::LearningArgs),
    /// A GPU beside the processor of this machine: equal losses, and transitions per second.
    Gpu(gpu::GpuArgs),
    /// One run in two processes beside one in one, and a model of many machines.
    Ranks(ranks::RanksArgs),
    /// Time of cells of a table.
    Evaluation(evaluation::EvaluationArgs),
    /// Ours and other software on the same work, taking turns: PyTorch, IR-SIM, VMAS, RVO2, Stage.
    Peers(peers::PeersArgs),
    /// One side of a comparison: a round for each line of standard input.
    #[command(hide = true)]
    Worker(worker::WorkerArgs),
}

/// Measures as the arguments say; Markdown on standard output.
pub fn run(args: &BenchArgs) -> Result<ExitCode> {
    match &args.what {
        What::Update(args) => update::run(args),
        What::Simulator(args) => simulator::run(args),
        What::Rollout(args) => rollout::run(args),
        What::Learning(args) => learning::run(args),
        What::Gpu(args) => gpu::run(args),
        What::Ranks(args) => ranks::run(args),
        What::Evaluation(args) => evaluation::run(args),
        What::Peers(args) => peers::run(args),
        What::Worker(args) => worker::run(args),
    }
    .map(|()| ExitCode::SUCCESS)
}

/// A pool of so many threads.
fn pool(threads: usize) -> Result<ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .with_context(|| format!("cannot start {threads} threads"))
}

/// The settings of these names, in their order; all of them where none is named.
fn chosen<'a, T>(settings: &'a [T], name: fn(&T) -> &'static str, only: &[String]) -> Result<Vec<&'a T>> {
    let names = || settings.iter().map(name).collect::<Vec<_>>().join(", ");
    let find = |wanted: &String| {
        let found = settings.iter().find(|setting| name(setting) == wanted);
        found.with_context(|| format!("--only: found {wanted}, expected some of {}", names()))
    };
    if only.is_empty() { Ok(settings.iter().collect()) } else { only.iter().map(find).collect() }
}
