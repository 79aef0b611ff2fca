//! The policies of a study: shipped ones, or those of run folders that `--train` has filled.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use jostle_arena::crowds::Pools;
use jostle_arena::loaded::LoadedPolicy;
use jostle_eval::report::Source;
use jostle_sim::SimConfig;

use super::plan::{POOL, Plan};
use crate::ship::manifest::{Manifest, PolicyEntry, RunEntry};
use jostle_runs::folder::{checkpoint_path, is_run_folder};
use jostle_runs::log::RunLog;

/// A policy that serves a row.
#[derive(Clone, Debug)]
pub(crate) struct Found {
    pub(crate) policy: LoadedPolicy,
    /// Its file.
    pub(crate) path: PathBuf,
    pub(crate) seed: u64,
    /// Updates that it has seen.
    pub(crate) updates: u64,
    /// Seconds that they took.
    wall_seconds: f64,
}

impl Found {
    /// The policy as reports name it.
    pub(crate) fn source(&self) -> Source {
        Source { policy: self.policy.identity.clone(), wall_seconds: Some(self.wall_seconds) }
    }
}

/// The source of policies.
pub(crate) struct Policies {
    plan: Plan,
    checkpoints: PathBuf,
    /// `None` where nothing is shipped.
    manifest: Option<Manifest>,
    /// Folder of run folders named after variant and seed.
    runs: PathBuf,
    /// Variants whose policies come from there.
    trained: BTreeSet<&'static str>,
}

/// True if a policy that has seen some updates may stand in a row that wants others, where rows of
/// these lengths are tested: a shorter one may, but not the one of another row, which would be
/// printed twice.
fn stands_for(trained: u64, wanted: u64, lengths: &[u64]) -> bool {
    trained == wanted || (trained < wanted && !lengths.contains(&trained))
}

/// Folder of a run of a variant, below the folder of all runs.
pub(crate) fn run_folder(runs: &Path, variant: &str, seed: u64) -> PathBuf {
    runs.join(format!("{variant}-seed{seed}"))
}

impl Policies {
    /// The shipped policies of `checkpoints`, but the variants in `trained` from `runs`.
    ///
    /// # Errors
    /// A manifest that is missing although all policies should come from it, or is damaged.
    pub(crate) fn new(
        plan: Plan,
        checkpoints: &Path,
        runs: &Path,
        trained: BTreeSet<&'static str>,
    ) -> Result<Self> {
        let manifest = if trained.is_empty() {
            Some(Manifest::load(checkpoints)?)
        } else {
            Manifest::load_optional(checkpoints)?
        };
        Ok(Self { plan, checkpoints: checkpoints.to_owned(), manifest, runs: runs.to_owned(), trained })
    }

    /// The room, robot and laser of the base setting.
    pub(crate) fn sim(&self) -> SimConfig {
        self.plan.run(POOL, 0).sim
    }

    /// The policies of a variant at a number of updates, by training seed. Where there is none that
    /// long, the longest that is shorter and has no row of its own.
    pub(crate) fn of(&self, variant: &str, updates: u64) -> Result<Vec<Found>> {
        if self.trained.contains(variant) {
            return self.of_runs(variant, updates);
        }
        let Some(manifest) = &self.manifest else { return Ok(Vec::new()) };
        let lengths = self.plan.variant(variant).updates;
        let mut found = Vec::new();
        for run in manifest.runs.iter().filter(|run| run.variant == variant) {
            self.check_setting(run)?;
            let of_run = manifest
                .policies
                .iter()
                .filter(|policy| policy.run == run.name && stands_for(policy.updates, updates, lengths));
            if let Some(entry) = of_run.max_by_key(|policy| policy.updates) {
                found.push((entry.updates, run, entry));
            }
        }
        // Policies of one row have one length: the longest that there is.
        let longest = found.iter().map(|(updates, ..)| *updates).max();
        found.retain(|(updates, ..)| Some(*updates) == longest);
        found.sort_by_key(|(_, run, _)| run.seed);
        found.into_iter().map(|(_, run, entry)| self.load(run, entry)).collect()
    }

    fn load(&self, run: &RunEntry, entry: &PolicyEntry) -> Result<Found> {
        let policy = entry.load(&self.checkpoints, run)?;
        let path = self.checkpoints.join(&entry.file);
        Ok(Found { policy, path, seed: run.seed, updates: entry.updates, wall_seconds: entry.wall_seconds })
    }

    /// Refuses a shipped run whose setting is no longer the plan's.
    fn check_setting(&self, run: &RunEntry) -> Result<()> {
        let found = self.plan.variant_of(&run.config).map(|variant| variant.name);
        let found =
            found.with_context(|| format!("the shipped run {} does not fit the base setting", run.name))?;
        anyhow::ensure!(found == run.variant, "the shipped run {} is {found}, not {}", run.name, run.variant);
        Ok(())
    }

    fn of_runs(&self, variant: &str, updates: u64) -> Result<Vec<Found>> {
        let mut found = Vec::new();
        for &seed in self.plan.variant(variant).seeds {
            let folder = run_folder(&self.runs, variant, seed);
            let path = checkpoint_path(&folder, updates);
            if !is_run_folder(&folder) || !path.is_file() {
                continue;
            }
            let mut policy = LoadedPolicy::load(&path)?;
            policy.identity.name = format!("{variant}-seed{seed}-{updates:06}");
            let reports = RunLog::read(&folder)?.reports;
            let wall_seconds = reports.iter().take(updates as usize).map(|report| report.clock.total).sum();
            found.push(Found { policy, path, seed, updates, wall_seconds });
        }
        Ok(found)
    }

    /// The pedestrians' policies: whole training, and half of it.
    pub(crate) fn pools(&self) -> Result<Pools> {
        let whole = self.of(POOL, self.plan.variant(POOL).length())?;
        let half = whole.iter().map(|policy| policy.updates / 2).max().unwrap_or(0);
        let half = self.of(POOL, half)?;
        let policies = |found: Vec<Found>| found.into_iter().map(|found| found.policy).collect();
        Ok(Pools { full: policies(whole), half: policies(half) })
    }

    /// The curves of the shipped runs of a variant: seed and CSV.
    pub(crate) fn curves(&self, variant: &str) -> Result<Vec<(u64, String)>> {
        let Some(manifest) = self.manifest.as_ref().filter(|_| !self.trained.contains(variant)) else {
            let runs = self
                .plan
                .variant(variant)
                .seeds
                .iter()
                .map(|&seed| (seed, run_folder(&self.runs, variant, seed)));
            return runs
                .filter(|(_, folder)| is_run_folder(folder))
                .map(|(seed, folder)| {
                    Ok((seed, crate::ship::curve::windows(&RunLog::read(&folder)?.reports)))
                })
                .collect();
        };
        let runs = manifest.runs.iter().filter(|run| run.variant == variant);
        runs.map(|run| Ok((run.seed, run.curve.read(&self.checkpoints)?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::stands_for;

    #[test]
    fn a_shorter_policy_stands_in_where_it_has_no_row_of_its_own() {
        let lengths = [5_000, 10_000];
        assert!(stands_for(10_000, 10_000, &lengths) && stands_for(5_000, 5_000, &lengths));
        assert!(stands_for(4, 5_000, &lengths) && stands_for(7_000, 10_000, &lengths));
        assert!(!stands_for(5_000, 10_000, &lengths), "printed twice");
        assert!(!stands_for(10_000, 5_000, &lengths), "too long");
    }
}
