//! `cargo xtask plot`: learning curves of runs, or the bars of a table, as SVG.
//!
//! Reading order: this file (what is asked for), [`curves`] (what is measured and smoothed), [`draw`] (the pictures; the
//! only place that knows the plotting library).

mod curves;
mod draw;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use clap::Args;
use jostle_eval::report::SuccessTable;

use self::curves::{groups, panels};
use crate::output;
use crate::run_folder::write_atomically;
use crate::runs::log::RunLog;
use crate::runs::search;

/// How deep a folder is searched for runs.
const DEPTH: usize = 5;

/// Arguments of `plot`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask plot runs/ours runs/baseline\n  \
    cargo xtask plot runs --window 200 --out figures\n  cargo xtask plot results/table1/table1.json\n\n\
    Runs that differ in their seed alone are one curve: the mean, in a band from the least to the greatest.")]
pub(crate) struct PlotArgs {
    /// Run folders, folders of run folders, or the JSON file of a table of success rates.
    #[arg(required = true)]
    what: Vec<PathBuf>,
    /// Updates over which curves are smoothed; 1 shows every update as it was.
    #[arg(long, value_name = "N", default_value_t = 50)]
    window: usize,
    /// Folder for the pictures.
    #[arg(long, value_name = "DIR", default_value = "runs/plots")]
    out: PathBuf,
}

/// Draws what the arguments name.
pub(crate) fn run(args: &PlotArgs) -> Result<ExitCode> {
    ensure!(args.window > 0, "--window: found 0, expected at least 1");
    let (tables, folders): (Vec<&PathBuf>, Vec<&PathBuf>) =
        args.what.iter().partition(|path| path.extension().is_some_and(|extension| extension == "json"));
    let mut pictures = Vec::new();
    for path in tables {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        pictures.push((format!("{stem}.svg"), draw::bars(&table(path)?)?));
    }
    if !folders.is_empty() {
        pictures
            .push(("curves.svg".to_owned(), draw::curves(&panels(&groups(&runs(&folders)?), args.window))?));
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    for (name, picture) in pictures {
        let path = args.out.join(name);
        write_atomically(&path, &picture)?;
        output::result(&format!("{}\n", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The runs at or below the folders that have made an update.
fn runs(folders: &[&PathBuf]) -> Result<Vec<RunLog>> {
    let mut found = Vec::new();
    for folder in folders {
        let before = found.len();
        search(folder, DEPTH, &mut found)?;
        if found.len() == before {
            bail!("{} holds no run; name a folder that `train` made", folder.display());
        }
    }
    let mut runs = Vec::new();
    for folder in found {
        let run = RunLog::read(&folder)?;
        if run.reports.is_empty() {
            output::note(&format!("{}: no update was made yet; left out", folder.display()));
        } else {
            runs.push(run);
        }
    }
    ensure!(!runs.is_empty(), "no run has made an update yet");
    Ok(runs)
}

fn table(path: &Path) -> Result<SuccessTable> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_str(&text)
        .with_context(|| format!("{} is no table of success rates (such as table1.json)", path.display()))
}
