//! `cargo xtask plot`: learning curves of runs, the bars of a table, the tokens of a policy, as SVG
//! and PNG.
//!
//! Reading order: this file (what is asked for), [`curves`] (what is measured and smoothed),
//! [`tokens`] (a policy's evaluations as a grid), [`draw`] (the pictures; the only place that knows
//! the plotting library), [`picture`] (files).

mod tokens;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_eval::report::{Evaluation, SuccessTable};

use jostle_runs::log::RunLog;
use jostle_runs::output;
use jostle_study::ship::logs;
use jostle_view::curves::{groups, panels};
use jostle_view::draw::paths::PathFigure;

/// Arguments of `plot`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask plot runs/ours runs/baseline\n  \
    cargo xtask plot runs --window 200 --out figures --png\n  cargo xtask plot checkpoints --window 100\n  \
    cargo xtask plot results/table1/table1.json\n  \
    cargo xtask plot runs/evaluation/ours-z0.json runs/evaluation/ours-z1.json\n\n\
    Runs that differ in their seed alone are one curve: the mean, in a band from the least to the greatest.")]
pub struct PlotArgs {
    /// Run folders, folders of run folders, the folder of shipped policies, or JSON files: a table
    /// of success rates, what `evaluate` wrote for the tokens of a policy, the ways of a robot.
    #[arg(required = true)]
    what: Vec<PathBuf>,
    /// Updates over which curves are smoothed; 1 shows every update as it was.
    #[arg(long, value_name = "N", default_value_t = 50)]
    window: usize,
    /// Folder for the pictures.
    #[arg(long, value_name = "DIR", default_value = "runs/plots")]
    out: PathBuf,
    /// Write each picture as PNG, too.
    #[arg(long)]
    png: bool,
}

/// Draws what the arguments name.
pub(crate) fn run(args: &PlotArgs) -> Result<ExitCode> {
    ensure!(args.window > 0, "--window: found 0, expected at least 1");
    let (files, folders): (Vec<&PathBuf>, Vec<&PathBuf>) =
        args.what.iter().partition(|path| path.extension().is_some_and(|extension| extension == "json"));
    let mut pictures = Vec::new();
    let mut evaluations = Vec::new();
    for path in files {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match report(path)? {
            Report::Table(table) => pictures.push((stem, jostle_view::draw::bars::bars(&table)?)),
            Report::Paths(figure) => pictures.push((stem, jostle_view::draw::paths::paths(&figure)?)),
            Report::Evaluation(evaluation) => evaluations.push(evaluation),
        }
    }
    for (name, map) in tokens::heat_maps(&evaluations)? {
        pictures.push((format!("{name}-tokens"), jostle_view::draw::heat::heat_map(&map)?));
    }
    if !folders.is_empty() {
        let panels = panels(&groups(&runs(&folders)?), args.window);
        pictures.push(("curves".to_owned(), jostle_view::draw::panels::curves(&panels)?));
    }
    for (name, picture) in pictures {
        for path in jostle_view::picture::write(&args.out, &name, &picture, args.png)? {
            output::result(&format!("{}\n", path.display()))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The runs at or below the folders that have made an update.
fn runs(folders: &[&PathBuf]) -> Result<Vec<RunLog>> {
    let mut runs = logs(folders)?;
    runs.retain(|run| {
        if run.reports.is_empty() {
            output::note(&format!("{}: no update was made yet; left out", run.folder.display()));
        }
        !run.reports.is_empty()
    });
    ensure!(!runs.is_empty(), "no run has made an update yet");
    Ok(runs)
}

/// The reports that a JSON file may hold.
enum Report {
    Table(SuccessTable),
    Evaluation(Evaluation),
    Paths(PathFigure),
}

fn report(path: &Path) -> Result<Report> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    if let Ok(evaluation) = serde_json::from_str(&text) {
        return Ok(Report::Evaluation(evaluation));
    }
    if let Ok(figure) = serde_json::from_str(&text) {
        return Ok(Report::Paths(figure));
    }
    let table = serde_json::from_str(&text).with_context(|| {
        format!(
            "{} is neither a table of success rates (such as table1.json) nor what `evaluate` wrote nor a robot's ways",
            path.display()
        )
    })?;
    Ok(Report::Table(table))
}
