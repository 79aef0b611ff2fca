//! Where policies are found: `jostle-runs`, with the options of the command line.

use std::path::{Path, PathBuf};

use anyhow::Result;
use jostle_arena::{Driver, LoadedPolicy, Pools};
use jostle_peds::CrowdKind;

/// The checkpoint that a path means: the file itself, or a run's newest.
pub(crate) fn checkpoint(path: &Path) -> Result<PathBuf> {
    Ok(jostle_runs::policies::checkpoint(path)?)
}

/// Who drives the robot: a planner by its name, or the checkpoint that a path means.
pub(crate) fn driver(path: &Path) -> Result<Driver> {
    Ok(jostle_runs::policies::driver(path)?)
}

/// Reads a checkpoint; a run's is called by its folder.
pub(crate) fn load(path: &Path) -> Result<LoadedPolicy> {
    Ok(jostle_runs::policies::load(path)?)
}

/// The pedestrians' policies, as far as the crowds ask for them; `--pool-half` names half-trained ones.
pub(crate) fn pools(full: &[PathBuf], half: &[PathBuf], crowds: &[CrowdKind]) -> Result<Pools> {
    Ok(jostle_runs::policies::pools(full, half, crowds, "--pool-half")?)
}
