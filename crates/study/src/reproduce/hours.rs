//! Training time on this machine: a few updates are made and timed, never guessed.

use std::time::Instant;

use anyhow::Result;
use jostle_ppo::{Config, Trainer};

use super::plan::Plan;
use jostle_runs::output::note;

/// Updates that are timed, after one that is not.
const TIMED: u32 = 3;

/// Seconds of training for each transition, on the base setting.
pub(super) struct Rate(f64);

impl Rate {
    /// Makes a few updates of the setting with five behaviours.
    pub(super) fn measure(plan: &Plan, threads: usize) -> Result<Self> {
        note("measuring how long an update takes here");
        let config = Config { threads, ..plan.run("m5", 1) };
        let transitions = config.rollout_len() as f64 * f64::from(TIMED);
        let mut trainer = Trainer::new(config)?;
        trainer.update()?;
        let started = Instant::now();
        for _ in 0..TIMED {
            trainer.update()?;
        }
        Ok(Self(started.elapsed().as_secs_f64() / transitions))
    }

    /// Hours that a number of updates of a configuration takes.
    pub(super) fn hours(&self, config: &Config, updates: u64) -> f64 {
        self.0 * config.rollout_len() as f64 * updates as f64 / 3600.0
    }
}
