//! `cargo xtask behaviours`: what each behaviour of a run does in the training world, and what it
//! is paid for it.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_ppo::{BehaviourReport, Trainer};

use crate::milestones::{share, success};
use jostle_runs::log::short;
use jostle_runs::output;
use jostle_runs::policies::checkpoint;

/// Arguments of `behaviours`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask behaviours runs/ours\n  \
    cargo xtask behaviours runs/ours/checkpoints/002500.safetensors --rollouts 400")]
pub struct BehavioursArgs {
    /// A run folder for its newest checkpoint, or a checkpoint that training can go on from.
    checkpoint: PathBuf,
    /// Rollouts, each as long as an update's.
    #[arg(long, value_name = "N", default_value_t = 200)]
    rollouts: usize,
}

/// Prints a Markdown table, one line for each behaviour.
pub(crate) fn run(args: &BehavioursArgs) -> Result<ExitCode> {
    ensure!(args.rollouts > 0, "--rollouts: found 0, expected at least 1");
    let given = &args.checkpoint;
    ensure!(given.exists(), "{}: found nothing, expected a run folder or a checkpoint", given.display());
    let path = checkpoint(given)?;
    let trainer = Trainer::resume(&path).with_context(|| format!("cannot look at {}", path.display()))?;
    let (updates, config) = (trainer.updates_done(), trainer.config().clone());
    let reports = trainer.behaviours(args.rollouts)?;
    let text = format!(
        "{}, update {updates}, config {}: {} rollouts of {} transitions without learning; α = {}, weighs the {}.\n\n{}",
        path.display(),
        short(&config.hash()),
        args.rollouts,
        config.rollout_len(),
        config.alpha,
        config.alpha_weighs.name(),
        grid(&reports).markdown()
    );
    output::result(&text)?;
    Ok(ExitCode::SUCCESS)
}

fn grid(reports: &[BehaviourReport]) -> Grid {
    let mut grid = Grid::new([
        "z",
        "episodes",
        "success",
        "collision",
        "timeout",
        "speed (m/s)",
        "turn rate (rad/s)",
        "task reward",
        "intrinsic reward",
        "log q(z|s,a)",
        "log q(z|s)",
    ]);
    for (token, report) in reports.iter().enumerate() {
        let episodes = &report.episodes;
        grid.push(
            false,
            vec![
                token.to_string(),
                episodes.ended.to_string(),
                success(episodes, 2),
                share(episodes.collision_wall + episodes.collision_agent, episodes),
                share(episodes.timeout, episodes),
                format!("{:.2}", report.speed),
                format!("{:.2}", report.turn_rate),
                format!("{:.3}", report.task_reward),
                format!("{:.3}", report.intrinsic_reward),
                format!("{:.2}", report.log_q_state_action),
                format!("{:.2}", report.log_q_state),
            ],
        );
    }
    grid
}
