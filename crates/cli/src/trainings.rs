//! Training for `reproduce --train`: the runs of this machine, or the jobs of a cluster.

use std::path::Path;

use anyhow::Result;
use jostle_ppo::Config;
use jostle_study::reproduce::Trainings;

use crate::crew::Crew;
use crate::sweep::{self, slurm_options::SlurmPlan};
use crate::train::{Care, train};

/// Trains in this process, or submits to this machine's Slurm.
pub(crate) struct Here;

impl Trainings for Here {
    fn train(&self, config: &Config, folder: &Path, name: &str) -> Result<()> {
        train(config, folder, true, name, &Care::default(), &Crew::alone()).map(drop)
    }

    fn submit(&self, out: &Path, runs: Vec<(String, Config)>, options: Option<&Path>) -> Result<()> {
        sweep::submit(out, runs, options.map(SlurmPlan::load).transpose()?.unwrap_or_default())
    }
}
