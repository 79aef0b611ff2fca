//! `--train`: the runs that a target needs, one after the other, each resumed where it stopped.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use jostle_ppo::Config;

use super::Trainings;
use super::hours::Rate;
use super::plan::{POOL, Plan, VARIANTS, row_spec};
use super::policies::run_folder;
use jostle_runs::folder::{is_run_folder, latest_checkpoint};
use jostle_runs::output::note;

/// The variants to be trained: those named, or all that the rows need and the pedestrians'.
///
/// # Errors
/// A name that is no variant's.
pub(super) fn chosen(rows: &[&'static str], named: &[String]) -> Result<BTreeSet<&'static str>> {
    if named.is_empty() {
        return Ok(rows.iter().map(|row| row_spec(row).variant).chain([POOL]).collect());
    }
    let known = |name: &String| VARIANTS.iter().map(|variant| variant.name).find(|known| known == name);
    let names = || VARIANTS.map(|variant| variant.name).join(", ");
    named
        .iter()
        .map(|name| match known(name) {
            Some(name) => Ok(name),
            None => bail!("--rows: found {name}, expected some of {}", names()),
        })
        .collect()
}

/// Trains what is missing under `runs`, after it has said how long that takes.
pub(super) fn run(
    plan: &Plan,
    variants: &BTreeSet<&'static str>,
    runs: &Path,
    threads: usize,
    trainings: &dyn Trainings,
) -> Result<()> {
    let mut jobs = Vec::new();
    for (name, config) in wanted(plan, variants, threads) {
        let folder = run_folder(runs, &name, config.seed);
        let done = if is_run_folder(&folder) { updates_done(&folder)? } else { 0 };
        jobs.push((config, folder, done));
    }
    ensure!(!jobs.is_empty(), "nothing is to be trained");
    let left: Vec<_> = jobs.iter().filter(|(config, _, done)| *done < config.updates).collect();
    if !left.is_empty() {
        let rate = Rate::measure(plan, threads)?;
        let hours = |(config, _, done): &&&(Config, std::path::PathBuf, u64)| {
            rate.hours(config, config.updates.saturating_sub(*done))
        };
        for job in &left {
            note(&format!(
                "{}: {} of {} updates to make, about {:.1} h",
                job.1.display(),
                job.0.updates - job.2,
                job.0.updates,
                hours(&job)
            ));
        }
        let total: f64 = left.iter().map(|job| hours(&job)).sum();
        note(&format!(
            "{} runs, about {total:.1} h together; an interrupted one goes on where it stopped",
            left.len()
        ));
    }
    for (config, folder, _) in &jobs {
        let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
        trainings.train(config, folder, &name)?;
    }
    Ok(())
}

/// Submits what is missing under `runs` to Slurm.
pub(super) fn submit(
    plan: &Plan,
    variants: &BTreeSet<&'static str>,
    runs: &Path,
    threads: usize,
    options: Option<&Path>,
    trainings: &dyn Trainings,
) -> Result<()> {
    trainings.submit(runs, wanted(plan, variants, threads), options)
}

/// Every run of these variants: the variant's name, and its configuration for a seed.
fn wanted(plan: &Plan, variants: &BTreeSet<&'static str>, threads: usize) -> Vec<(String, Config)> {
    let mut wanted = Vec::new();
    for variant in VARIANTS.iter().filter(|variant| variants.contains(variant.name)) {
        for &seed in variant.seeds {
            let config = Config { threads, ..plan.run(variant.name, seed) };
            wanted.push((variant.name.to_owned(), config));
        }
    }
    wanted
}

/// Updates of a run's newest checkpoint, by its name.
fn updates_done(folder: &Path) -> Result<u64> {
    let newest = latest_checkpoint(folder)?;
    Ok(newest.file_stem().and_then(|stem| stem.to_str()).and_then(|stem| stem.parse().ok()).unwrap_or(0))
}
