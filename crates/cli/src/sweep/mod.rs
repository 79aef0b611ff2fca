//! `cargo xtask sweep`: many training runs by one plan, each in its own run folder, with one table
//! of results.
//!
//! A run is a process of its own (`sweep task PLAN NAME`), started here some at a time or by
//! something else: a line of a shell, GNU parallel. It trains what is missing in its folder, then
//! tests what the plan asks for; what is done is left alone. So a sweep may be killed at any
//! moment, started again, and started twice.
//!
//! ```text
//! OUT/m5-seed1/                  a run folder (jostle_runs::run_folder)
//! OUT/m5-seed1/evaluation/       what `[evaluate]` asked for, a folder for each policy
//! OUT/logs/m5-seed1.txt          what its processes said, a line every few seconds
//! OUT/planners/dwa/              planners to compare with, in the same episodes
//! OUT/results.csv, results.md    the table
//! OUT/summary.md                 means over seeds, variant by variant
//! OUT/results.svg                success against transitions
//! OUT/slurm/                     what was submitted to a cluster
//! ```
//!
//! Reading order: [`plan`] (the file; [`section`] reads it key by key), [`spec`] and [`task`] (one
//! run), [`local`] (processes on this machine), [`slurm`] (jobs of a cluster), [`status`],
//! [`collect`] (the table; [`stored`] is what an earlier one remembers), [`evaluation`].

mod collect;
mod evaluation;
mod local;
mod plan;
mod section;
mod slurm;
pub(crate) mod slurm_options;
mod spec;
mod status;
mod stored;
mod tally;
mod task;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use jostle_ppo::Config;

use self::plan::Plan;
use self::slurm_options::SlurmPlan;
use jostle_runs::output;

/// Arguments of `sweep`.
#[derive(Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  cargo xtask sweep plan.toml --jobs 2\n  cargo xtask sweep status plan.toml\n  \
    cargo xtask sweep collect plan.toml\n  cargo xtask sweep plan.toml --print | parallel --jobs 2\n  \
    cargo xtask sweep plan.toml --slurm\n\n\
    The plan's keys are explained in docs/how-to-train.md. A second call goes on where the first one stopped."
)]
pub struct SweepArgs {
    #[command(subcommand)]
    action: Option<Action>,
    /// The plan: base configuration, variants, seeds, output folder.
    #[arg(required = true)]
    plan: Option<PathBuf>,
    /// Runs at a time.
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: NonZeroUsize,
    /// Start nothing; print a shell line for each run that is not done, for GNU parallel and its
    /// like.
    #[arg(long, conflicts_with = "slurm")]
    print: bool,
    /// Submit the runs that are not done as one job array of Slurm.
    #[arg(long)]
    slurm: bool,
}

#[derive(Subcommand)]
enum Action {
    /// Print how far each run is.
    Status {
        /// The plan.
        plan: PathBuf,
    },
    /// Print the table of results so far, and write it beside the runs with a figure.
    Collect {
        /// The plan.
        plan: PathBuf,
        /// Folder for results.csv, results.md, summary.md and results.svg (default: the plan's
        /// `out`). What it holds of runs that are not on this machine stays in the table.
        #[arg(long, value_name = "DIR")]
        store: Option<PathBuf>,
    },
    /// Do one run of the plan in this process.
    Task(task::TaskArgs),
}

/// Submits runs to Slurm, which are not those of a plan's file: each a variant's name and its
/// configuration for a seed. The plan that they make up is written to `OUT/plan/`.
pub(crate) fn submit(out: &Path, runs: Vec<(String, Config)>, slurm: SlurmPlan) -> Result<()> {
    let folder = out.join("plan");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let plan = Plan::of_runs(out, runs, slurm);
    let plan = Plan::load(&slurm::store_plan(&plan, &folder)?)?;
    output::result(&slurm::submit(&plan)?)
}

/// Does what the arguments say.
pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    match &args.action {
        Some(Action::Status { plan }) => output::result(&status::table(&Plan::load(plan)?)?)?,
        Some(Action::Collect { plan, store }) => {
            output::result(&collect::store(&Plan::load(plan)?, store.as_deref())?)?;
        }
        Some(Action::Task(args)) => task::run(args)?,
        None => {
            // clap asks for it; its own words for a missing one are better than ours.
            let plan = Plan::load(args.plan.as_ref().context("a plan is missing")?)?;
            if args.slurm {
                output::result(&slurm::submit(&plan)?)?;
            } else if args.print {
                output::result(&local::lines(&plan)?)?;
            } else {
                return local::run(&plan, args.jobs.get());
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}
