//! `cargo xtask milestones`: training measures of runs at chosen updates, side by side: what a
//! setting is picked by.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_eval::statistics::wilson;
use jostle_ppo::report::EpisodeCounts;
use jostle_ppo::{Config, UpdateReport};

use jostle_runs::keys::settings;
use jostle_runs::log::RunLog;
use jostle_runs::log::short;
use jostle_runs::output;
use jostle_study::ship::logs;

/// Keys that say nothing about the curve's shape, or that the run's own columns show.
const LEFT_OUT: [&str; 5] = ["seed", "updates", "checkpoint_every", "threads", "n_behaviours"];

/// Arguments of `milestones`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask milestones runs --at 250,500,1000 --window 100\n  \
    cargo xtask milestones checkpoints --at 1000,5000")]
pub struct MilestonesArgs {
    /// Run folders, folders of run folders, or the folder of shipped policies.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Updates to report.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "100,250,500,1000")]
    at: Vec<usize>,
    /// Updates, up to and with each of these, over which measures are taken.
    #[arg(long, value_name = "N", default_value_t = 100)]
    window: usize,
}

/// Prints two Markdown tables: what the runs vary, and their measures.
pub(crate) fn run(args: &MilestonesArgs) -> Result<ExitCode> {
    let runs = logs(&args.runs.iter().collect::<Vec<_>>())?;
    let text = format!(
        "{}\nMeans over the {} updates up to the one named; success with its 95 % interval.\n\n{}",
        settings_grid(&runs)?.markdown(),
        args.window,
        measures_grid(&runs, &args.at, args.window).markdown()
    );
    output::result(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Each run with the settings that are not the defaults.
fn settings_grid(runs: &[RunLog]) -> Result<Grid> {
    let defaults = settings(&Config::default())?;
    let mut grid = Grid::new(["run", "M", "seed", "updates", "config", "settings that are not the defaults"]);
    for run in runs {
        let changed: Vec<String> = settings(&run.config)?
            .into_iter()
            .filter(|(key, value)| !LEFT_OUT.contains(&key.as_str()) && defaults.get(key) != Some(value))
            .map(|(key, value)| format!("`{key}={value}`"))
            .collect();
        grid.push(
            false,
            vec![
                run.name.clone(),
                run.config.n_behaviours.to_string(),
                run.config.seed.to_string(),
                run.reports.len().to_string(),
                short(&run.config.hash()).to_owned(),
                if changed.is_empty() { "–".to_owned() } else { changed.join(", ") },
            ],
        );
    }
    Ok(grid)
}

type Measure = (&'static str, usize, fn(&UpdateReport) -> f64);

/// Name, digits, measure.
const MEASURES: [Measure; 8] = [
    ("intrinsic", 3, |r| r.intrinsic_reward),
    ("loss q(z|s,a)", 3, |r| r.discriminator_state_action.loss),
    ("loss q(z|s)", 3, |r| r.discriminator_state.loss),
    ("accuracy q(z|s,a)", 2, |r| r.discriminator_state_action.accuracy),
    ("accuracy q(z|s)", 2, |r| r.discriminator_state.accuracy),
    ("D", 3, |r| r.diversity),
    ("log σ of v", 2, |r| f64::from(r.log_std[0])),
    ("log σ of ω", 2, |r| f64::from(r.log_std[1])),
];

/// The measures of each run at each update that it has reached.
fn measures_grid(runs: &[RunLog], at: &[usize], window: usize) -> Grid {
    let names = MEASURES.map(|(name, ..)| name);
    let mut grid = Grid::new(["run", "update", "success", "timeout"].into_iter().chain(names));
    for run in runs {
        for &end in at.iter().filter(|&&end| end <= run.reports.len()) {
            let counts = run.episodes(end, window);
            let mut row =
                vec![run.name.clone(), end.to_string(), success(&counts, 3), share(counts.timeout, &counts)];
            for (_, digits, measure) in MEASURES {
                let mean = run.mean(end, window, |report| Some(measure(report)));
                row.push(mean.map_or_else(|| "–".to_owned(), |mean| format!("{mean:.digits$}")));
            }
            grid.push(false, row);
        }
    }
    grid
}

/// Share of the ended episodes that reached their goal, with its 95 % interval.
pub(crate) fn success(counts: &EpisodeCounts, digits: usize) -> String {
    wilson(counts.success, counts.ended).map_or_else(
        || "–".to_owned(),
        |interval| {
            let rate = counts.success as f64 / counts.ended as f64;
            format!("{rate:.digits$} [{:.digits$}, {:.digits$}]", interval.low, interval.high)
        },
    )
}

/// Share of so many of the ended episodes.
pub(crate) fn share(of: u64, counts: &EpisodeCounts) -> String {
    if counts.ended == 0 {
        return "–".to_owned();
    }
    format!("{:.2}", of as f64 / counts.ended as f64)
}
