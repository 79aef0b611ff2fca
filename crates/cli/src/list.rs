//! `cargo xtask runs`: every training run under a folder, with its state.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use jostle_runs::log::{DEPTH, RunLog, State, search, short};
use jostle_runs::output::{self, columns};
use jostle_runs::pace::Pace;

/// Updates over which the success of training episodes is taken.
const RECENT: usize = 50;

/// Arguments of `runs`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask runs\n  cargo xtask runs results/table1")]
pub struct RunsArgs {
    /// Folder to search.
    #[arg(default_value = "runs")]
    folder: PathBuf,
}

/// Lists the runs.
pub(crate) fn run(args: &RunsArgs) -> Result<ExitCode> {
    let mut found = Vec::new();
    search(&args.folder, DEPTH, &mut found)?;
    if found.is_empty() {
        output::note(&format!(
            "no run under {}; `{} train` makes one",
            args.folder.display(),
            output::program()
        ));
        return Ok(ExitCode::SUCCESS);
    }
    let mut rows = vec![HEADS.map(str::to_owned).to_vec()];
    for folder in &found {
        // One folder that cannot be read must not hide the others.
        rows.push(row(folder).unwrap_or_else(|error| {
            vec![folder.display().to_string(), format!("unreadable: {}", output::one_line(&error))]
        }));
    }
    output::result(&columns(&rows))?;
    Ok(ExitCode::SUCCESS)
}

const HEADS: [&str; 12] =
    ["run", "state", "host", "updates", "transitions/s", "left", "success", "D", "M", "N", "seed", "config"];

fn row(folder: &Path) -> Result<Vec<String>> {
    let log = RunLog::read(folder)?;
    let state = log.state()?;
    let running = state == State::Running;
    let pace = Pace::new(&log, log.config.updates, RECENT);
    let state = match state {
        State::Finished => "finished",
        State::Running => "running",
        State::Stopped => "stopped",
    };
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"));
    Ok(vec![
        folder.display().to_string(),
        state.to_owned(),
        pace.host_if(running),
        format!("{}/{}", log.reports.len(), log.config.updates),
        pace.rate(),
        pace.left_if(running),
        number(log.success(log.reports.len(), RECENT)),
        number(log.mean(log.reports.len(), RECENT, |report| Some(report.diversity))),
        log.config.n_behaviours.to_string(),
        log.config.n_agents.to_string(),
        log.config.seed.to_string(),
        short(&log.config.hash()).to_owned(),
    ])
}
