//! One policy in detail: outcomes with intervals and metrics, a row per crowd.

use std::fmt::Write as _;

use jostle_peds::CrowdKind;
use serde::{Deserialize, Serialize};

use super::cell::CellResult;
use super::grid::{Grid, csv_line, number};
use super::table::{cell_notes, provenance, seen_in_training};
use crate::driving::DrivingSummary;
use crate::metrics::MeanStd;
use crate::statistics::{Interval, wilson};
use jostle_arena::identity::PolicyIdentity;

/// A policy with one token among some crowds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The robot's policy.
    pub policy: PolicyIdentity,
    /// Its behaviour token.
    pub token: u32,
    /// One robot and `n_agents` − 1 pedestrians.
    pub n_agents: usize,
    /// A result per crowd.
    pub cells: Vec<CellResult>,
    /// A remark on the robot, such as that it knows what a laser does not tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

impl Evaluation {
    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n\n{}\n", self.head(), self.grid().text());
        if let Some(grid) = self.driving_grid() {
            let _ = writeln!(text, "{}", grid.text());
        }
        for note in self.notes() {
            let _ = writeln!(text, "{note}");
        }
        text
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("{}\n\n{}\n", self.head(), self.grid().markdown());
        if let Some(grid) = self.driving_grid() {
            let _ = writeln!(text, "{}", grid.markdown());
        }
        for note in self.notes() {
            let _ = writeln!(text, "- {note}");
        }
        text
    }

    /// As JSON, with everything.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("an evaluation is always JSON") + "\n"
    }

    /// As CSV, a line per crowd.
    pub fn csv(&self) -> String {
        let driving_heads = DrivingSummary::EMPTY.columns().map(|(name, ..)| name);
        let heads = [
            "crowd",
            "token",
            "n_agents",
            "episodes",
            "success",
            "collision_wall",
            "collision_pedestrian",
            "timeout",
            "success_rate",
            "low_95",
            "high_95",
            "extra_time_mean",
            "extra_time_std",
            "extra_distance_mean",
            "extra_distance_std",
            "average_speed_mean",
            "average_speed_std",
            "policy",
            "cell",
        ];
        let mut text = csv_line(heads.into_iter().chain(driving_heads));
        let float = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for cell in &self.cells {
            let s = &cell.summary;
            let mut fields = vec![cell.crowd.to_string(), self.token.to_string(), self.n_agents.to_string()];
            let counts = [s.episodes, s.success, s.collision_wall, s.collision_pedestrian, s.timeout];
            fields.extend(counts.map(|count| count.to_string()));
            let ends = [s.wilson_95.map(|ends| ends.low), s.wilson_95.map(|ends| ends.high)];
            fields.extend([s.success_rate, ends[0], ends[1]].map(float));
            for value in [s.extra_time, s.extra_distance, s.average_speed] {
                fields.extend([value.mean, value.std].map(float));
            }
            fields.extend([self.policy.sha256.clone(), cell.cell.clone()]);
            let driving = cell.driving.unwrap_or(DrivingSummary::EMPTY);
            fields.extend(driving.columns().map(|(.., value)| float(value)));
            text += &csv_line(fields);
        }
        text
    }

    fn head(&self) -> String {
        format!("{}, z = {}, N = {}", provenance(&self.policy), self.token, self.n_agents)
    }

    fn grid(&self) -> Grid {
        let mut grid = Grid::new([
            "crowd",
            "episodes",
            "success",
            "hit wall",
            "hit pedestrian",
            "timeout",
            "extra time (s)",
            "extra distance (m)",
            "speed (m/s)",
        ]);
        for cell in &self.cells {
            let s = &cell.summary;
            let share = |count| with_interval(count, s.episodes);
            let seen = if seen_in_training(&self.policy, cell).is_some() { " (seen)" } else { "" };
            grid.push(
                false,
                vec![
                    format!("{}{seen}", cell.crowd),
                    s.episodes.to_string(),
                    share(s.success),
                    share(s.collision_wall),
                    share(s.collision_pedestrian),
                    share(s.timeout),
                    mean_std(s.extra_time, 2),
                    mean_std(s.extra_distance, 2),
                    mean_std(s.average_speed, 3),
                ],
            );
        }
        grid
    }

    /// The robot's driving, a row per crowd; `None` where no cell says.
    fn driving_grid(&self) -> Option<Grid> {
        self.cells.iter().find(|cell| cell.driving.is_some())?;
        let heads = DrivingSummary::EMPTY.columns().map(|(_, head, _)| head);
        let mut grid = Grid::new(std::iter::once("crowd").chain(heads));
        for cell in &self.cells {
            let driving = cell.driving.unwrap_or(DrivingSummary::EMPTY);
            let values = driving.columns().map(|(.., value)| number(value, 3));
            grid.push(false, std::iter::once(cell.crowd.to_string()).chain(values).collect());
        }
        Some(grid)
    }

    fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.remark.iter().cloned().collect();
        notes.push(
            "Shares of the episodes with 95 % Wilson intervals; times, distances and speeds are means ± sample \
             standard deviations over the successes."
                .to_owned(),
        );
        if self.cells.iter().any(|cell| cell.driving.is_some()) {
            notes.push(
                "TTC: share of the steps with a time to collision below; within: share of the steps so near to a pedestrian; jerk, \
                 stalled: means over all episodes; deadlocks: share of the episodes. docs/metrics.md has the formulas."
                    .to_owned(),
            );
        }
        for cell in &self.cells {
            let label = cell.crowd.to_string();
            let built_in = cell.crowd.built_in();
            if built_in.is_some_and(CrowdKind::is_for_validation) {
                notes.push(format!("{label}: a validation crowd, to choose settings by; not of the paper"));
            }
            if built_in == Some(CrowdKind::Recorded) {
                notes.push(format!(
                    "{label}: people as they walked, who do not react to the robot; not of the paper"
                ));
            }
            if built_in.is_none() {
                notes.push(format!("{label}: a crowd of the user's own; not of the paper"));
            }
            if let Some(pool) = &cell.pool {
                let policies: Vec<String> = pool.policies.iter().map(provenance).collect();
                notes.push(format!("{label}: pedestrians driven by {}", policies.join("; ")));
            }
            notes.extend(cell_notes(&label, Some(&self.policy), cell));
        }
        notes
    }
}

/// A share with its 95 % Wilson interval.
pub(super) fn with_interval(count: u64, episodes: u64) -> String {
    match wilson(count, episodes) {
        Some(Interval { low, high }) => {
            format!("{:.3} ({low:.3}–{high:.3})", count as f64 / episodes as f64)
        }
        None => "–".to_owned(),
    }
}

fn mean_std(value: MeanStd, decimals: usize) -> String {
    match (value.mean, value.std) {
        (None, _) => "–".to_owned(),
        (mean, std) => format!("{} ± {}", number(mean, decimals), number(std, decimals)),
    }
}
