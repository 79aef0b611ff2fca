//! `cargo xtask compare`: what two training runs have in different, in their settings and in their curves.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::Args;
use jostle_eval::statistics::wilson;
use jostle_ppo::report::EpisodeCounts;
use jostle_ppo::{Config, UpdateReport};

use crate::config::unstored_defaults;
use crate::output;
use crate::runs::columns;
use crate::runs::log::RunLog;

/// Arguments of `compare`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask compare runs/ours runs/baseline --window 200")]
pub(crate) struct CompareArgs {
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

/// Every setting by its dotted key, those that are not stored because they have their default among them.
pub(crate) fn settings(config: &Config) -> Result<BTreeMap<String, String>> {
    let table = toml::Table::try_from(config).context("a configuration that is no TOML")?;
    let mut all = BTreeMap::from_iter(unstored_defaults());
    all.extend(flat(&table));
    Ok(all)
}

/// As [`settings`], of any table.
pub(crate) fn flat(table: &toml::Table) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    flatten("", table, &mut flat);
    flat
}

fn flatten(prefix: &str, table: &toml::Table, flat: &mut BTreeMap<String, String>) {
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => flatten(&format!("{prefix}{key}."), inner, flat),
            value => drop(flat.insert(format!("{prefix}{key}"), shown(value))),
        }
    }
}

/// A value as it was written: a number of single precision in its own digits.
fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(number) if f64::from(*number as f32) == *number => format!("{:?}", *number as f32),
        _ => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::settings;

    #[test]
    fn settings_are_flat_and_dotted() {
        let flat = settings(&jostle_ppo::Config::default()).unwrap();
        assert_eq!(flat["sim.laser.beams"], "512");
        assert_eq!((flat["gamma"].as_str(), flat["sim.laser.noise_std"].as_str()), ("0.99", "0.02"));
        // Not in the file that a run keeps, unless the laser sees a sector.
        assert_eq!(
            (flat["sim.laser.fov"].as_str(), flat["sim.laser.angle_min"].as_str()),
            ("6.2831855", "0.0")
        );
    }
}
