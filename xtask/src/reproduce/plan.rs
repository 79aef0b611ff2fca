//! What Table 1 needs: the runs, their seeds, and the checkpoint that each row is tested at.

use clap::ValueEnum;
use jostle_diversity::IntrinsicReward;
use jostle_eval::paper::{BehavioursRow, TABLE_1};
use jostle_ppo::Config;

/// Training seed of the table's rows.
const ROW_SEED: u64 = 1;
/// Training seeds of the policies that drive the pedestrians; no row uses them.
const POOL_SEEDS: [u64; 4] = [101, 102, 103, 104];
/// Updates of a pedestrian's policy in the paper.
const POOL_UPDATES: u64 = 5_000;

/// How much of the paper's effort is spent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// A hundredth of the paper's updates, 50 episodes a cell: shows that everything works, not who is right.
    Small,
    /// The paper's updates, 1000 episodes a cell: 60,000 updates.
    Paper,
}

impl Preset {
    /// Name of the preset's default folder.
    pub(crate) fn folder(self) -> &'static str {
        match self {
            Self::Small => "runs/table1-small",
            Self::Paper => "runs/table1-paper",
        }
    }

    /// Episodes of one cell.
    pub(crate) fn episodes(self) -> u64 {
        match self {
            Self::Small => 50,
            Self::Paper => 1000,
        }
    }

    /// The paper's updates, divided by this, are ours.
    fn divisor(self) -> u64 {
        match self {
            Self::Small => 100,
            Self::Paper => 1,
        }
    }

    /// Updates between two checkpoints: what an interruption can cost.
    fn checkpoint_every(self) -> u64 {
        match self {
            Self::Small => 25,
            Self::Paper => 250,
        }
    }

    /// Our number of updates for a number of the paper's.
    pub(crate) fn updates(self, of_paper: u64) -> u64 {
        of_paper / self.divisor()
    }

    /// What a row says of its training, where it is not the paper's.
    pub(crate) fn note(self, row: &BehavioursRow) -> Option<String> {
        let ours = self.updates(row.updates.into());
        (self.divisor() > 1).then(|| format!("{ours} updates stand for the paper's {}", row.updates))
    }
}

/// One training run of the plan.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Run {
    /// Folder below the output folder.
    pub(crate) folder: String,
    pub(crate) config: Config,
}

/// The run that serves the table's rows with this many behaviours; the longest of them decides its length.
pub(crate) fn row_run(preset: Preset, n_behaviours: u32) -> Run {
    let rows = TABLE_1.iter().filter(|row| row.n_behaviours == n_behaviours);
    let updates = rows.map(|row| u64::from(row.updates)).max().unwrap_or(0);
    run(preset, format!("policies/m{n_behaviours}"), n_behaviours, ROW_SEED, updates)
}

/// The runs of all rows, each once, in the order of the table.
pub(crate) fn row_runs(preset: Preset) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for row in &TABLE_1 {
        let run = row_run(preset, row.n_behaviours);
        if !runs.contains(&run) {
            runs.push(run);
        }
    }
    runs
}

/// The runs of the pedestrians' policies.
pub(crate) fn pool_runs(preset: Preset) -> Vec<Run> {
    POOL_SEEDS.map(|seed| run(preset, format!("pool/seed{seed}"), 1, seed, POOL_UPDATES)).to_vec()
}

fn run(preset: Preset, folder: String, n_behaviours: u32, seed: u64, updates_of_paper: u64) -> Run {
    let mut config = Config {
        seed,
        updates: preset.updates(updates_of_paper),
        checkpoint_every: preset.checkpoint_every(),
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
    fn the_paper_preset_is_the_papers() {
        let lengths = |runs: Vec<Run>| -> Vec<(usize, u64)> {
            runs.iter().map(|run| (run.config.n_behaviours, run.config.updates)).collect()
        };
        assert_eq!(lengths(row_runs(Preset::Paper)), [(1, 5_000), (5, 5_000), (10, 10_000), (20, 20_000)]);
        assert_eq!(lengths(pool_runs(Preset::Paper)), [(1, 5_000); 4]);
        assert_eq!(lengths(row_runs(Preset::Small)), [(1, 50), (5, 50), (10, 100), (20, 200)]);
    }

    #[test]
    fn the_shipped_configurations_are_the_plans() {
        let none: &[&str] = &[];
        for (n_behaviours, name) in [(1, "baseline_m1.toml"), (5, "diversity_m5.toml")] {
            let shipped =
                Config::load(&crate::provenance::workspace().join("configs").join(name), none).unwrap();
            assert_eq!(shipped.hash(), row_run(Preset::Paper, n_behaviours).config.hash(), "{name}");
        }
    }

    #[test]
    fn no_two_runs_share_a_folder_or_a_curve() {
        for preset in [Preset::Small, Preset::Paper] {
            let runs = [row_runs(preset), pool_runs(preset)].concat();
            for (i, a) in runs.iter().enumerate() {
                for b in &runs[..i] {
                    assert_ne!(a.folder, b.folder);
                    assert_ne!(a.config.hash(), b.config.hash());
                }
            }
        }
    }
}
