//! The plan of the small Table 1: the runs, their seeds, and the checkpoint that each row is tested
//! at.

use crate::paper::{BehavioursRow, TABLE_1};
use jostle_diversity::IntrinsicReward;
use jostle_ppo::Config;

/// Training seed of the table's rows.
const ROW_SEED: u64 = 1;
/// Training seeds of the policies that drive the pedestrians; no row uses them.
const POOL_SEEDS: [u64; 4] = [101, 102, 103, 104];
/// Updates of a pedestrian's policy in the paper.
const POOL_UPDATES: u64 = 5_000;

/// The paper's updates, divided by this, are ours.
const DIVISOR: u64 = 100;
/// Updates between two checkpoints: what an interruption can cost.
const CHECKPOINT_EVERY: u64 = 25;
/// Episodes of one cell.
pub(crate) const EPISODES: u64 = 50;

/// Our number of updates for a number of the paper's.
pub(crate) fn updates(of_paper: u64) -> u64 {
    of_paper / DIVISOR
}

/// The note on a row's training.
pub(crate) fn note(row: &BehavioursRow) -> String {
    format!("{} updates stand for the paper's {}", updates(row.updates.into()), row.updates)
}

/// One training run of the plan.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Run {
    /// Folder below the output folder.
    pub(crate) folder: String,
    pub(crate) config: Config,
}

/// The run that serves the table's rows with this many behaviours; the longest of them decides its
/// length.
pub(crate) fn row_run(n_behaviours: u32) -> Run {
    let rows = TABLE_1.iter().filter(|row| row.n_behaviours == n_behaviours);
    let updates = rows.map(|row| u64::from(row.updates)).max().unwrap_or(0);
    run(format!("policies/m{n_behaviours}"), n_behaviours, ROW_SEED, updates)
}

/// The runs of all rows, each once, in the order of the table.
pub(crate) fn row_runs() -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for row in &TABLE_1 {
        let run = row_run(row.n_behaviours);
        if !runs.contains(&run) {
            runs.push(run);
        }
    }
    runs
}

/// The runs of the pedestrians' policies.
pub(crate) fn pool_runs() -> Vec<Run> {
    POOL_SEEDS.map(|seed| run(format!("pool/seed{seed}"), 1, seed, POOL_UPDATES)).to_vec()
}

fn run(folder: String, n_behaviours: u32, seed: u64, updates_of_paper: u64) -> Run {
    let mut config = Config {
        seed,
        updates: updates(updates_of_paper),
        checkpoint_every: CHECKPOINT_EVERY,
        n_behaviours: n_behaviours as usize,
        ..Config::default()
    };
    if n_behaviours == 1 {
        // With one behaviour there is nothing to tell apart.
        config.intrinsic_reward = IntrinsicReward::None;
        config.alpha = 0.0;
    }
    Run { folder, config }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundredth_of_the_papers_updates() {
        let lengths = |runs: Vec<Run>| -> Vec<(usize, u64)> {
            runs.iter().map(|run| (run.config.n_behaviours, run.config.updates)).collect()
        };
        assert_eq!(lengths(row_runs()), [(1, 50), (5, 50), (10, 100), (20, 200)]);
        assert_eq!(lengths(pool_runs()), [(1, 50); 4]);
    }

    #[test]
    fn the_shipped_configurations_are_the_plans() {
        let none: &[&str] = &[];
        for (n_behaviours, name) in [(1, "baseline_m1.toml"), (5, "diversity_m5.toml")] {
            let shipped =
                Config::load(&jostle_runs::provenance::workspace().join("configs").join(name), none).unwrap();
            assert_eq!(shipped.hash(), row_run(n_behaviours).config.hash(), "{name}");
        }
    }

    #[test]
    fn no_two_runs_share_a_folder_or_a_curve() {
        let runs = [row_runs(), pool_runs()].concat();
        for (i, a) in runs.iter().enumerate() {
            for b in &runs[..i] {
                assert_ne!(a.folder, b.folder);
                assert_ne!(a.config.hash(), b.config.hash());
            }
        }
    }
}
