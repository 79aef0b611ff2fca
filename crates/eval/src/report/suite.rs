//! One policy on a suite: success in each scene among each crowd, and one score.

use std::fmt::Write as _;

use jostle_peds::CrowdName;
use serde::{Deserialize, Serialize};

use super::cell::CellResult;
use super::evaluation::with_interval;
use super::grid::{Grid, csv_line, number};
use super::table::provenance;
use crate::statistics::cvar;
use jostle_arena::identity::PolicyIdentity;

/// Share of the worst cells whose mean is the score's conditional value at risk (`cvar`).
pub const CVAR_SHARE: f64 = 0.25;

/// A scene's cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// The scene.
    pub scene: String,
    /// A description, in a line.
    pub about: String,
    /// One robot and `n_agents` − 1 pedestrians.
    pub n_agents: usize,
    /// A result for each crowd, in the order of the columns.
    pub cells: Vec<CellResult>,
}

/// The cell with the lowest success rate; the first of several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorstCell {
    /// Its scene.
    pub scene: String,
    /// Its crowd.
    pub crowd: CrowdName,
    /// Its success rate.
    pub success_rate: f64,
}

/// Success rates of all cells in one number, and in two that look at the worst.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuiteScore {
    /// Mean over the cells.
    pub mean: f64,
    /// The worst cell.
    pub worst: WorstCell,
    /// Mean over the worst quarter of the cells ([`CVAR_SHARE`]); see [`cvar`].
    pub cvar: f64,
}

impl SuiteScore {
    /// The score of cells, each with its scene, its crowd and its success rate; `None` where there
    /// is none.
    pub fn new<'a>(cells: impl IntoIterator<Item = (&'a str, CrowdName, f64)>) -> Option<Self> {
        let mut all = Vec::new();
        let mut worst: Option<WorstCell> = None;
        for (scene, crowd, rate) in cells {
            all.push(rate);
            if worst.as_ref().is_none_or(|worst| rate < worst.success_rate) {
                worst = Some(WorstCell { scene: scene.to_owned(), crowd, success_rate: rate });
            }
        }
        Some(Self { mean: mean(&all)?, worst: worst?, cvar: cvar(&all, CVAR_SHARE)? })
    }
}

/// A policy on a suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuiteReport {
    /// The suite.
    pub suite: String,
    /// The robot's policy.
    pub policy: PolicyIdentity,
    /// Its behaviour token.
    pub token: u32,
    /// Root seed of the episodes.
    pub seed: u64,
    /// Episodes a cell.
    pub episodes: u64,
    /// A result for each scene.
    pub scenes: Vec<SceneResult>,
    /// The score; `None` without a cell.
    pub score: Option<SuiteScore>,
}

impl SuiteReport {
    /// A report of scenes' results, with its score.
    pub fn new(
        suite: String,
        policy: PolicyIdentity,
        token: u32,
        seed: u64,
        episodes: u64,
        scenes: Vec<SceneResult>,
    ) -> Self {
        let score = score(&scenes);
        Self { suite, policy, token, seed, episodes, scenes, score }
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n\n{}\n", self.head(), self.grid().text());
        for note in self.notes() {
            let _ = writeln!(text, "{note}");
        }
        text
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("{}\n\n{}\n", self.head(), self.grid().markdown());
        for note in self.notes() {
            let _ = writeln!(text, "- {note}");
        }
        text
    }

    /// As JSON, with everything.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report is always JSON") + "\n"
    }

    /// As CSV, a line for each cell.
    pub fn csv(&self) -> String {
        let mut text = csv_line([
            "suite",
            "scene",
            "crowd",
            "token",
            "n_agents",
            "episodes",
            "success",
            "collision_wall",
            "collision_pedestrian",
            "timeout",
            "success_rate",
            "policy",
            "cell",
        ]);
        for scene in &self.scenes {
            for cell in &scene.cells {
                let s = &cell.summary;
                let mut fields = vec![self.suite.clone(), scene.scene.clone(), cell.crowd.to_string()];
                fields.extend([self.token.to_string(), scene.n_agents.to_string()]);
                let counts = [s.episodes, s.success, s.collision_wall, s.collision_pedestrian, s.timeout];
                fields.extend(counts.map(|count| count.to_string()));
                fields.push(s.success_rate.map_or_else(String::new, |rate| rate.to_string()));
                fields.extend([self.policy.sha256.clone(), cell.cell.clone()]);
                text += &csv_line(fields);
            }
        }
        text
    }

    fn head(&self) -> String {
        let Self { suite, token, seed, .. } = self;
        format!("{}, z = {token}; suite {suite}, seed {seed}", provenance(&self.policy))
    }

    /// A row for each scene, a column for each crowd, and their mean.
    fn grid(&self) -> Grid {
        let crowds = self.scenes.first().map_or(&[][..], |scene| &scene.cells);
        let heads = ["scene", "N"].into_iter().map(str::to_owned);
        let crowds = crowds.iter().map(|cell| cell.crowd.to_string());
        let mut grid = Grid::new(heads.chain(crowds).chain(["mean".to_owned()]));
        for scene in &self.scenes {
            let mut row = vec![scene.scene.clone(), scene.n_agents.to_string()];
            row.extend(
                scene.cells.iter().map(|cell| with_interval(cell.summary.success, cell.summary.episodes)),
            );
            row.push(number(mean(&rates(&scene.cells)), 3));
            grid.push(false, row);
        }
        grid
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = vec![format!(
            "Success rates of {} episodes a cell with 95 % Wilson intervals; not of the paper.",
            self.episodes
        )];
        if let Some(SuiteScore { mean, worst, cvar }) = &self.score {
            notes.push(format!(
                "score: mean {mean:.3}, worst cell {:.3} ({}, {}), mean of the worst quarter (CVaR) {cvar:.3}",
                worst.success_rate, worst.scene, worst.crowd
            ));
        }
        notes.extend(self.scenes.iter().map(|scene| format!("{}: {}", scene.scene, scene.about)));
        let pool = self.scenes.iter().flat_map(|scene| &scene.cells).find_map(|cell| cell.pool.as_ref());
        if let Some(pool) = pool {
            let policies: Vec<String> = pool.policies.iter().map(provenance).collect();
            notes.push(format!("learned pedestrians driven by {}, cycled", policies.join("; ")));
        }
        notes
    }
}

fn rates(cells: &[CellResult]) -> Vec<f64> {
    cells.iter().filter_map(|cell| cell.summary.success_rate).collect()
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn score(scenes: &[SceneResult]) -> Option<SuiteScore> {
    let rated = |scene: &'_ SceneResult| {
        let rate = |cell: &CellResult| Some((cell.crowd, cell.summary.success_rate?));
        scene.cells.iter().filter_map(rate).collect::<Vec<_>>()
    };
    SuiteScore::new(scenes.iter().flat_map(|scene| {
        rated(scene).into_iter().map(move |(crowd, rate)| (scene.scene.as_str(), crowd, rate))
    }))
}

#[cfg(test)]
mod tests {
    use jostle_peds::CrowdKind;

    use super::*;
    use crate::metrics::Summary;
    use jostle_arena::Outcome;
    use jostle_arena::metrics::{EpisodeMetrics, MetricScale};

    /// A cell of ten episodes.
    fn cell(crowd: CrowdKind, success: usize) -> CellResult {
        let scale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
        let episodes: Vec<_> = (0..10)
            .map(|k| if k < success { Outcome::Success } else { Outcome::Timeout })
            .map(|outcome| (outcome, EpisodeMetrics::from_totals(&scale, outcome, 120, 11.0, 10.0)))
            .collect();
        let summary =
            Summary::from_episodes(1.0, episodes.iter().map(|(outcome, metrics)| (*outcome, metrics)));
        CellResult {
            crowd: crowd.into(),
            cell: "c".into(),
            summary,
            driving: None,
            pool: None,
            versus_baseline: None,
        }
    }

    fn report() -> SuiteReport {
        let scene = |name: &str, counts: [usize; 2]| SceneResult {
            scene: name.into(),
            about: "about it".into(),
            n_agents: 4,
            cells: vec![cell(CrowdKind::Vo, counts[0]), cell(CrowdKind::Sf, counts[1])],
        };
        let scenes = vec![scene("corridor", [9, 3]), scene("doorway", [1, 7])];
        SuiteReport::new("standard".into(), PolicyIdentity::custom("p", "1"), 0, 7, 10, scenes)
    }

    #[test]
    fn the_score_is_mean_worst_and_tail() {
        let score = report().score.unwrap();
        assert!((score.mean - 0.5).abs() < 1e-12);
        assert_eq!((score.worst.scene.as_str(), score.worst.crowd.as_str()), ("doorway", "VO"));
        // A quarter of four cells is the worst one.
        assert!((score.cvar - 0.1).abs() < 1e-12 && score.worst.success_rate == score.cvar);
        assert_eq!(cvar(&[0.5, 0.1, 0.3], 1.0).map(|value| (value * 1e9).round()), Some(3e8));
        let empty = SuiteReport { scenes: vec![], ..report() };
        assert_eq!(super::score(&empty.scenes), None);
    }

    #[test]
    fn renderings_hold_every_cell_and_the_score() {
        let report = report();
        let text = report.text();
        for part in
            ["corridor", "0.900 (", "0.600", "worst cell 0.100 (doorway, VO)", "(CVaR) 0.100", "seed 7"]
        {
            assert!(text.contains(part), "{part} in\n{text}");
        }
        assert!(report.markdown().contains("| doorway | 4 | 0.100 ("));
        assert_eq!(report.csv().lines().count(), 5);
        let read: SuiteReport = serde_json::from_str(&report.json()).unwrap();
        assert_eq!(read, report);
    }
}
