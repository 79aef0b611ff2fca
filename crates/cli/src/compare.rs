//! `cargo xtask compare`: what two training runs have in different, in their settings and in their
//! curves.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use jostle_eval::statistics::wilson;
use jostle_ppo::UpdateReport;
use jostle_ppo::report::EpisodeCounts;

use jostle_runs::keys::settings;
use jostle_runs::log::RunLog;
use jostle_runs::output;
use jostle_runs::output::columns;

/// Arguments of `compare`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask compare runs/ours runs/baseline --window 200")]
pub struct CompareArgs {
    /// A run folder.
    first: PathBuf,
    /// Another.
    second: PathBuf,
    /// Updates over which measures are taken: the last ones that both runs have made.
    #[arg(long, value_name = "N", default_value_t = 100)]
    window: usize,
}

/// A measure with its name.
type Measure = (&'static str, fn(&UpdateReport) -> Option<f64>);

const MEASURES: [Measure; 9] = [
    ("return of an episode", |r| r.episode_return),
    ("length of an episode (steps)", |r| r.episode_length),
    ("task reward of a step", |r| Some(r.task_reward)),
    ("intrinsic reward of a step", |r| Some(r.intrinsic_reward)),
    ("D", |r| Some(r.diversity)),
    ("entropy", |r| Some(r.entropy)),
    ("value loss", |r| Some(r.value_loss)),
    ("explained variance", |r| Some(r.explained_variance)),
    ("seconds of an update", |r| Some(r.clock.total)),
];

/// Prints the comparison.
pub(crate) fn run(args: &CompareArgs) -> Result<ExitCode> {
    let runs = [RunLog::read(&args.first)?, RunLog::read(&args.second)?];
    let common = runs[0].reports.len().min(runs[1].reports.len());
    let mut rows = vec![vec![String::new(), runs[0].name.clone(), runs[1].name.clone()]];
    let [first, second] = [settings(&runs[0].config)?, settings(&runs[1].config)?];
    let keys: Vec<&String> =
        first.keys().chain(second.keys().filter(|key| !first.contains_key(*key))).collect();
    for key in keys {
        let (a, b) = (first.get(key), second.get(key));
        if a != b {
            let shown = |value: Option<&String>| value.cloned().unwrap_or_else(|| "–".to_owned());
            rows.push(vec![key.clone(), shown(a), shown(b)]);
        }
    }
    let made = |run: &RunLog| format!("{}/{}", run.reports.len(), run.config.updates);
    rows.push(vec!["updates made".to_owned(), made(&runs[0]), made(&runs[1])]);
    rows.push(vec![
        "success".to_owned(),
        success(&runs[0], common, args.window),
        success(&runs[1], common, args.window),
    ]);
    for (name, measure) in MEASURES {
        let mean = |run: &RunLog| {
            run.mean(common, args.window, measure).map_or_else(|| "–".to_owned(), |mean| format!("{mean:.4}"))
        };
        rows.push(vec![name.to_owned(), mean(&runs[0]), mean(&runs[1])]);
    }
    let from = common.saturating_sub(args.window) + 1;
    output::result(&format!(
        "Settings that differ, then means over updates {from} to {common}:\n{}",
        columns(&rows)
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// The rate with its 95 % interval.
fn success(run: &RunLog, end: usize, window: usize) -> String {
    let EpisodeCounts { success, ended, .. } = run.episodes(end, window);
    match wilson(success, ended) {
        Some(interval) => format!(
            "{:.3} [{:.3}, {:.3}] of {ended}",
            success as f64 / ended as f64,
            interval.low,
            interval.high
        ),
        None => "–".to_owned(),
    }
}
