//! One run of a plan.

use std::path::PathBuf;

use jostle_ppo::Config;

/// A run: a variant of the plan with one seed.
#[derive(Debug, Clone)]
pub(super) struct Task {
    /// Such as `m5-seed1`: the name of its folder.
    pub(super) name: String,
    pub(super) variant: String,
    pub(super) config: Config,
    pub(super) folder: PathBuf,
    /// Transitions after which its policy is kept.
    pub(super) milestones: Vec<u64>,
}
