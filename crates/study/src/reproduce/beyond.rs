//! Beyond the paper: every behaviour token in every crowd, how episodes end, and how robots drive.

use crate::claims::SeedRun;
use anyhow::Result;
use jostle_arena::Outcome;
use jostle_arena::Planner;
use jostle_arena::config::ArenaConfig;
use jostle_eval::compact::CompactEpisode;
use jostle_eval::driving::{Driven, DrivingSummary};
use jostle_eval::report::{PooledCell, PooledRow, PooledTable, SeedValue, Source};
use jostle_peds::CrowdKind;

use super::evaluator::RowEvaluator;
use super::plan::ROWS;

/// Rows of the table of how robots drive.
const DRIVERS: [&str; 3] = ["m1", "m5", "strong"];
/// The row whose tokens are told apart.
const ROW: &str = "m5";

/// Success of every token in every crowd.
pub(super) fn tokens(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let found = evaluator.row(ROW)?.found.clone();
    let n_behaviours = found.iter().map(|policy| policy.policy.file.network.n_behaviours).max().unwrap_or(0);
    let sources: Vec<Source> = found.iter().map(super::policies::Found::source).collect();
    let mut rows = Vec::new();
    for token in 0..n_behaviours as u32 {
        let mut cells = Vec::new();
        for crowd in CrowdKind::PAPER {
            let mut seeds = Vec::new();
            for policy in &found {
                let episodes = evaluator.crowd(policy, token, crowd, None)?;
                let successes = episodes.iter().filter(|episode| episode.outcome == Outcome::Success).count();
                seeds.push(SeedValue::rate(policy.seed, successes as u64, episodes.len() as u64));
            }
            cells.push(Some(PooledCell::from_seeds(seeds, true)));
        }
        cells.push(PooledCell::average(&cells.iter().map(Option::as_ref).collect::<Vec<_>>()));
        rows.push(row(vec![token.to_string()], cells, &sources));
    }
    Ok(PooledTable {
        id: "tokens".to_owned(),
        title: "Beyond the paper: success of every behaviour token z (M = 5)".to_owned(),
        label_heads: vec!["z".to_owned()],
        columns: CrowdKind::PAPER.iter().map(|crowd| crowd.name().to_owned()).chain(["Avg".to_owned()]).collect(),
        rows,
        notes: vec![
            "The paper tests z = 0 alone; nothing in training makes tokens of different seeds alike, so that pooling a token \
             over seeds shows whether the index matters (it should not). The CSV has every seed."
                .to_owned(),
            format!("{} episodes a cell and seed.", evaluator.episodes()),
        ],
    })
}

/// Shares of the four ends of an episode, for every row that has policies.
pub(super) fn outcomes(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    for spec in &ROWS {
        let evaluated = evaluator.row(spec.name)?;
        let sources: Vec<Source> = evaluated.found.iter().map(super::policies::Found::source).collect();
        if sources.is_empty() {
            continue;
        }
        for outcome in Outcome::ALL {
            let cells = CrowdKind::PAPER.map(|crowd| {
                let seeds = evaluated.row.seeds.iter().map(|run| {
                    let episodes = &run.sites[crowd.name()];
                    let count = episodes.iter().filter(|episode| episode.outcome == outcome).count();
                    SeedValue::rate(run.seed, count as u64, episodes.len() as u64)
                });
                Some(PooledCell::from_seeds(seeds.collect(), true))
            });
            let end = match outcome {
                Outcome::Success => "success",
                Outcome::CollisionWall => "hit a wall",
                Outcome::CollisionPedestrian => "hit a pedestrian",
                Outcome::Timeout => "timeout",
            };
            rows.push(row(vec![spec.name.to_owned(), end.to_owned()], cells.to_vec(), &sources));
        }
    }
    Ok(PooledTable {
        id: "outcomes".to_owned(),
        title: "Beyond the paper: how episodes end".to_owned(),
        label_heads: ["row", "end"].map(str::to_owned).to_vec(),
        columns: CrowdKind::PAPER.map(|crowd| crowd.name().to_owned()).to_vec(),
        rows,
        notes: vec![format!("Shares of {} episodes a cell and seed.", evaluator.episodes())],
    })
}

/// The robot's driving, over the six crowds together, for every row that has policies and every
/// planner.
pub(super) fn driving(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let scale = jostle_arena::room::metric_scale(&ArenaConfig {
        sim: evaluator.policies.sim(),
        ..ArenaConfig::default()
    });
    let measured = |episodes: &mut dyn Iterator<Item = &Vec<CompactEpisode>>| {
        let driven = episodes.flatten().map(|episode| Driven {
            outcome: episode.outcome,
            metrics: &episode.metrics,
            driving: episode.driving.as_ref(),
        });
        DrivingSummary::new(&scale, driven)
    };
    let cells = |seeds: Vec<(u64, DrivingSummary)>| -> Vec<Option<PooledCell>> {
        let value = |(seed, summary): &(u64, DrivingSummary), i: usize| {
            let (.., value) = summary.columns()[i];
            SeedValue { seed: *seed, value, std: None, interval: None, episodes: 0 }
        };
        let cell = |(i, largest): (usize, f64)| {
            let values = seeds.iter().map(|seed| value(seed, i)).collect();
            Some(PooledCell::from_seeds(values, false).within(0.0, largest))
        };
        DrivingSummary::LARGEST.into_iter().enumerate().map(cell).collect()
    };
    let mut rows = Vec::new();
    for name in DRIVERS {
        let evaluated = evaluator.row(name)?;
        let sources: Vec<Source> = evaluated.found.iter().map(super::policies::Found::source).collect();
        if sources.is_empty() {
            continue;
        }
        let of_crowds = |run: &SeedRun| {
            let mut sites = CrowdKind::PAPER.iter().filter_map(|crowd| run.sites.get(crowd.name()));
            (run.seed, measured(&mut sites))
        };
        let seeds = evaluated.row.seeds.iter().map(of_crowds).collect();
        rows.push(row(vec![name.to_owned()], cells(seeds), &sources));
    }
    for planner in Planner::IN_TABLES {
        let sites = evaluator.planner(planner, 5)?;
        let summary = measured(&mut sites.values());
        let source = Source { policy: planner.identity(), wall_seconds: None };
        let of_planner = row(vec![planner.label()], cells(vec![(0, summary)]), &[source]);
        rows.push(PooledRow { planner: true, ..of_planner });
    }
    Ok(PooledTable {
        id: "driving".to_owned(),
        title: "Beyond the paper: how it drives".to_owned(),
        label_heads: vec!["row".to_owned()],
        columns: DrivingSummary::EMPTY.columns().map(|(_, head, _)| head.to_owned()).to_vec(),
        rows,
        notes: vec![
            format!(
                "All six crowds together, {} episodes a crowd and seed, N = 5; mean over training seeds with Student's interval. \
                 docs/metrics.md has the formulas and their sources.",
                evaluator.episodes()
            ),
            "A dash: an episode of the row was stored before there was such a value; `cargo xtask reproduce beyond --fresh` drives \
             them again and keeps it."
                .to_owned(),
            super::planners::NOTE.to_owned(),
        ],
    })
}

fn row(labels: Vec<String>, cells: Vec<Option<PooledCell>>, sources: &[Source]) -> PooledRow {
    let paper = vec![None; cells.len()];
    PooledRow {
        labels,
        cells,
        paper,
        decimals: 3,
        sources: sources.to_vec(),
        command: None,
        note: None,
        planner: false,
    }
}
