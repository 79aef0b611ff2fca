//! One cell: a policy with one token in one crowd.

use jostle_peds::CrowdName;
use serde::{Deserialize, Serialize};

use crate::driving::{Driven, DrivingSummary};
use crate::metrics::Summary;
use crate::records::EpisodeRecord;
use crate::statistics::{Interval, Mcnemar, PairedCounts, paired_difference};
use jostle_arena::Outcome;
use jostle_arena::crowds::PoolNote;
use jostle_arena::metrics::MetricScale;

/// A paired comparison with a baseline on the same episodes; the baseline is the first of the pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Successes of the pair.
    pub counts: PairedCounts,
    /// p-values.
    pub mcnemar: Mcnemar,
    /// 95 % interval of (this rate − the baseline's).
    pub difference: Option<Interval>,
}

impl Comparison {
    /// Compares two lists of records; `None` unless both hold the same number of episodes.
    pub fn new(baseline: &[EpisodeRecord], records: &[EpisodeRecord]) -> Option<Self> {
        let successes = |records: &[EpisodeRecord]| -> Vec<bool> {
            records.iter().map(|record| record.outcome == Outcome::Success).collect()
        };
        let counts = PairedCounts::count(&successes(baseline), &successes(records))?;
        Some(Self { counts, mcnemar: counts.mcnemar(), difference: paired_difference(&counts) })
    }
}

/// The result of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellResult {
    /// Name of the crowd.
    pub crowd: CrowdName,
    /// Hash of the cell's key.
    pub cell: String,
    /// Counts, interval, metrics.
    pub summary: Summary,
    /// The robot's driving; `None` in reports from before there were these values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driving: Option<DrivingSummary>,
    /// The pedestrians' policies; `None` for crowds without.
    pub pool: Option<PoolNote>,
    /// Against the table's baseline, where there is one.
    pub versus_baseline: Option<Comparison>,
}

impl CellResult {
    /// Result of a cell's records.
    pub fn new(
        crowd: impl Into<CrowdName>,
        cell: String,
        scale: &MetricScale,
        records: &[EpisodeRecord],
        pool: Option<PoolNote>,
    ) -> Self {
        let episodes = records.iter().map(|record| (record.outcome, &record.metrics));
        let driven = records.iter().map(|record| Driven {
            outcome: record.outcome,
            metrics: &record.metrics,
            driving: record.driving.as_ref(),
        });
        let driving = Some(DrivingSummary::new(scale, driven));
        Self {
            crowd: crowd.into(),
            cell,
            summary: Summary::from_episodes(scale.v_max, episodes),
            driving,
            pool,
            versus_baseline: None,
        }
    }
}
