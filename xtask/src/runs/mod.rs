//! `cargo xtask runs`: every training run under a folder, with its state.

pub(crate) mod log;
pub(crate) mod pace;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail};
use clap::Args;

use self::log::{RunLog, State};
use self::pace::Pace;
use crate::output;
use crate::run_folder::is_run_folder;
use crate::ship::curve;
use crate::ship::manifest::{Manifest, RunEntry};
use crate::train::short;

/// How deep folders are searched for runs.
const DEPTH: usize = 5;
/// Updates over which the success of training episodes is taken.
const RECENT: usize = 50;

/// Arguments of `runs`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask runs\n  cargo xtask runs results/table1")]
pub(crate) struct RunsArgs {
    /// Folder to search.
    #[arg(default_value = "runs")]
    folder: PathBuf,
}

/// Lists the runs.
pub(crate) fn run(args: &RunsArgs) -> Result<ExitCode> {
    let mut found = Vec::new();
    search(&args.folder, DEPTH, &mut found)?;
    if found.is_empty() {
        output::note(&format!("no run under {}; `cargo xtask train` makes one", args.folder.display()));
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
    let pace = Pace::of(&log, log.config.updates, RECENT);
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

/// Run folders at or below a folder, in the order of their names.
pub(crate) fn search(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<()> {
    if is_run_folder(folder) {
        found.push(folder.to_owned());
        return Ok(());
    }
    if depth == 0 || !folder.is_dir() {
        return Ok(());
    }
    let cannot_list = || format!("cannot list {}", folder.display());
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .with_context(cannot_list)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_>>()
        .with_context(cannot_list)?;
    entries.sort();
    entries.iter().filter(|path| path.is_dir()).try_for_each(|path| search(path, depth - 1, found))
}

/// The runs at or below folders; a folder of shipped policies has the curves that are shipped with them, in windows of updates.
///
/// # Errors
/// A folder without a run, and runs that cannot be read.
pub(crate) fn logs(folders: &[&PathBuf]) -> Result<Vec<RunLog>> {
    let mut logs = Vec::new();
    for folder in folders {
        let before = logs.len();
        if let Some(manifest) = Manifest::load_optional(folder)? {
            for run in &manifest.runs {
                logs.push(shipped(folder, run)?);
            }
        } else {
            let mut found = Vec::new();
            search(folder, DEPTH, &mut found)?;
            for folder in found {
                logs.push(RunLog::read(&folder)?);
            }
        }
        if logs.len() == before {
            bail!("{} holds no run; name a folder that `train` or `ship` made", folder.display());
        }
    }
    Ok(logs)
}

fn shipped(folder: &Path, run: &RunEntry) -> Result<RunLog> {
    let text = run.curve.read(folder)?;
    let reports = curve::reports(&text, run.config.rollout_len() as u64)
        .with_context(|| format!("{}", folder.join(&run.curve.file).display()))?;
    Ok(RunLog {
        folder: folder.to_owned(),
        name: run.name.clone(),
        config: run.config.clone(),
        reports,
        torn: false,
    })
}

/// Rows of cells as text in columns; a short row fills what it has.
pub(crate) fn columns(rows: &[Vec<String>]) -> String {
    let widest = rows.iter().map(Vec::len).max().unwrap_or(0);
    let complete = |row: &&Vec<String>| row.len() == widest;
    let width = |column: usize| {
        rows.iter().filter(complete).map(|row| row[column].chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..widest).map(width).collect();
    rows.iter()
        .map(|row| {
            let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}"));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::columns;

    #[test]
    fn columns_stand_under_each_other() {
        let rows = [vec!["a".to_owned(), "bb".to_owned()], vec!["ccc".to_owned(), "d".to_owned()]];
        assert_eq!(columns(&rows), "a    bb\nccc  d\n");
    }
}
