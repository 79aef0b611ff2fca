//! The tables of success rates (paper, Tables I–III): ours, its interval and the paper's figure,
//! one above the other.

use std::fmt::Write as _;

use jostle_peds::CrowdKind;
use serde::{Deserialize, Serialize};

use super::cell::CellResult;
use super::grid::{Grid, csv_line, number};
use jostle_arena::identity::{PolicyIdentity, short};

/// A row: one policy in up to six crowds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuccessRow {
    /// Texts of the label columns.
    pub labels: Vec<String>,
    /// The robot's policy; `None` where it has not been trained yet.
    pub policy: Option<PolicyIdentity>,
    /// Its behaviour token.
    pub token: u32,
    /// One robot and `n_agents` − 1 pedestrians.
    pub n_agents: usize,
    /// Results in any order, at most one per crowd.
    pub cells: Vec<CellResult>,
    /// The paper's rates in the order of [`CrowdKind::PAPER`], and their printed average.
    pub paper: Option<([f64; 6], f64)>,
    /// Diversity metric D, ours and the paper's, where the table has it.
    pub diversity: Option<(Option<f64>, f64)>,
    /// Anything to be said of the row, such as the command that trains a missing policy.
    pub note: Option<String>,
}

impl SuccessRow {
    /// The result in a crowd.
    pub fn cell(&self, crowd: CrowdKind) -> Option<&CellResult> {
        self.cells.iter().find(|cell| cell.crowd == crowd)
    }

    /// Mean of the six rates; `None` unless all six are there.
    pub fn average(&self) -> Option<f64> {
        let rates: Option<Vec<f64>> =
            CrowdKind::PAPER.iter().map(|crowd| self.cell(*crowd)?.summary.success_rate).collect();
        rates.map(|rates| rates.iter().sum::<f64>() / 6.0)
    }
}

/// A table of success rates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuccessTable {
    /// Its title.
    pub title: String,
    /// Heads of the label columns.
    pub label_heads: Vec<String>,
    /// The rows.
    pub rows: Vec<SuccessRow>,
}

impl SuccessTable {
    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n\n{}\n", self.title, self.grid().text());
        for note in self.notes() {
            let _ = writeln!(text, "{note}");
        }
        text
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n{}\n", self.title, self.grid().markdown());
        for note in self.notes() {
            let _ = writeln!(text, "- {note}");
        }
        text
    }

    /// As JSON, with everything.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a table is always JSON") + "\n"
    }

    /// As CSV, a line per row and crowd.
    pub fn csv(&self) -> String {
        let heads = [
            "crowd",
            "success_rate",
            "low_95",
            "high_95",
            "paper",
            "episodes",
            "success",
            "collision_wall",
            "collision_pedestrian",
            "timeout",
            "p_exact",
            "token",
            "policy",
            "config_hash",
            "seed",
            "commit",
            "updates_done",
            "transitions",
            "cell",
            "pool",
        ];
        let mut text = csv_line(self.label_heads.iter().map(String::as_str).chain(heads));
        for row in &self.rows {
            for (idx, crowd) in CrowdKind::PAPER.into_iter().enumerate() {
                let fields = csv_fields(row, idx, crowd);
                text += &csv_line(row.labels.iter().chain(&fields));
            }
        }
        text
    }

    fn grid(&self) -> Grid {
        let has_diversity = self.rows.iter().any(|row| row.diversity.is_some());
        let mut heads = self.label_heads.clone();
        heads.push(String::new());
        heads.extend(CrowdKind::PAPER.iter().map(ToString::to_string));
        heads.push("Avg".to_owned());
        heads.extend(has_diversity.then(|| "D".to_owned()));
        let mut grid = Grid::new(heads);
        for row in &self.rows {
            self.push_row(&mut grid, row, has_diversity);
        }
        grid
    }

    fn push_row(&self, grid: &mut Grid, row: &SuccessRow, has_diversity: bool) {
        let blank = vec![String::new(); self.label_heads.len()];
        let line = |labels: &[String], what: &str, cells: Vec<String>, average, diversity| {
            let mut line = labels.to_vec();
            line.push(what.to_owned());
            line.extend(cells);
            line.push(average);
            line.extend(has_diversity.then_some(diversity));
            line
        };
        let each = |render: &dyn Fn(&CellResult) -> String| -> Vec<String> {
            CrowdKind::PAPER
                .iter()
                .map(|crowd| row.cell(*crowd).map_or_else(|| "–".to_owned(), render))
                .collect()
        };
        let rates = each(&|cell| number(cell.summary.success_rate, 3));
        let diversity = number(row.diversity.and_then(|(ours, _)| ours), 2);
        grid.push(true, line(&row.labels, "ours", rates, number(row.average(), 3), diversity));
        let intervals = each(&|cell| match cell.summary.wilson_95 {
            Some(ends) => format!("{:.3}–{:.3}", ends.low, ends.high),
            None => "–".to_owned(),
        });
        grid.push(false, line(&blank, "95 %", intervals, String::new(), String::new()));
        if let Some((rates, average)) = row.paper {
            let rates = rates.iter().map(|rate| format!("{rate:.2}")).collect();
            let diversity = row.diversity.map_or_else(String::new, |(_, paper)| format!("{paper:.2}"));
            grid.push(false, line(&blank, "paper", rates, format!("{average:.2}"), diversity));
        }
    }

    /// Provenance of every row, pools, comparisons and checks.
    fn notes(&self) -> Vec<String> {
        let mut notes = vec![
            "ours: success rate; 95 %: its Wilson interval; paper: the figure printed there; p: exact McNemar \
             test against the baseline on the same episodes."
                .to_owned(),
        ];
        for row in &self.rows {
            let labels = self.label_heads.iter().zip(&row.labels);
            let label: Vec<String> = labels.map(|(head, label)| format!("{head} {label}")).collect();
            notes.extend(row_notes(&label.join(", "), row));
        }
        notes
    }
}

fn row_notes(label: &str, row: &SuccessRow) -> Vec<String> {
    let mut notes = Vec::new();
    match &row.policy {
        Some(policy) => {
            let episodes: Vec<u64> = row.cells.iter().map(|cell| cell.summary.episodes).collect();
            notes.push(format!(
                "{label}: {}, z = {}, N = {}, {}",
                provenance(policy),
                row.token,
                row.n_agents,
                episode_counts(&episodes)
            ));
        }
        None => notes.push(format!("{label}: no policy has been trained for this row yet")),
    }
    notes.extend(row.note.iter().map(|note| format!("{label}: {note}")));
    let p_values: Vec<String> = row
        .cells
        .iter()
        .filter_map(|cell| {
            let test = cell.versus_baseline?.mcnemar;
            Some(format!("{} {}", cell.crowd, p_value(test.p_exact)))
        })
        .collect();
    if !p_values.is_empty() {
        notes.push(format!("{label}: p {}", p_values.join(", ")));
    }
    for cell in &row.cells {
        notes.extend(cell_notes(&format!("{label}, {}", cell.crowd), row.policy.as_ref(), cell));
    }
    notes
}

/// Notes on a cell: a pool that is cycled, a broken bound.
pub(super) fn cell_notes(label: &str, policy: Option<&PolicyIdentity>, cell: &CellResult) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(seen) = policy.and_then(|policy| seen_in_training(policy, cell)) {
        notes.push(format!("{label}: seen in training: {seen}"));
    }
    if let Some(pool) = cell.pool.as_ref().filter(|pool| pool.is_cycled()) {
        let (policies, pedestrians) = (pool.policies.len(), pool.n_pedestrians);
        notes.push(format!("{label}: {policies} policies are cycled among {pedestrians} pedestrians"));
    }
    let check = cell.summary.distance_check;
    if !check.holds() {
        let (n, worst) = (check.violations, number(check.worst, 6));
        notes.push(format!(
            "{label}: CHECK FAILED: {n} episodes travelled up to {worst} m beyond v_max · time"
        ));
    }
    notes
}

/// In what way a policy was trained among what it is tested with in a cell; `None` where its crowd
/// is new to it.
pub(super) fn seen_in_training(policy: &PolicyIdentity, cell: &CellResult) -> Option<String> {
    let rule = match cell.crowd.built_in() {
        Some(CrowdKind::Straight) => "straight",
        Some(CrowdKind::StopAndGo) => "stop_and_go",
        _ => "",
    };
    if policy.was_among(rule) {
        return Some(format!("training_crowd.{rule} walks by the same rule"));
    }
    let pool = cell.pool.as_ref()?;
    let n_seen = pool.policies.iter().filter(|pedestrian| policy.has_seen(pedestrian)).count();
    (n_seen > 0).then(|| {
        format!("{n_seen} of the {} runs that drive the pedestrians were opponents", pool.policies.len())
    })
}

/// A policy's provenance in one line.
pub(super) fn provenance(policy: &PolicyIdentity) -> String {
    let or_dash = |value: Option<String>| value.unwrap_or_else(|| "–".to_owned());
    let sha256 = short(&policy.sha256);
    if policy.config_hash.is_none() && policy.updates.is_none() {
        // Nothing that was trained.
        return format!("{} (sha256 {sha256})", policy.name);
    }
    let among = match policy.trained_among.join(", ") {
        none if none.is_empty() => none,
        members => format!(", trained among {members}"),
    };
    format!(
        "{} (sha256 {sha256}, config {}, seed {}, commit {}, {} updates, {} transitions{among})",
        policy.name,
        or_dash(policy.config_hash.as_deref().map(|hash| short(hash).to_owned())),
        or_dash(policy.seed.map(|seed| seed.to_string())),
        or_dash(policy.commit.as_deref().map(|commit| short(commit).to_owned())),
        or_dash(policy.updates.map(|updates| updates.to_string())),
        or_dash(policy.transitions.map(|transitions| transitions.to_string())),
    )
}

fn episode_counts(counts: &[u64]) -> String {
    match (counts.iter().min(), counts.iter().max()) {
        (Some(least), Some(most)) if least == most => format!("{least} episodes per crowd"),
        (Some(least), Some(most)) => format!("{least} to {most} episodes per crowd"),
        _ => "no episode".to_owned(),
    }
}

fn p_value(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

fn csv_fields(row: &SuccessRow, idx: usize, crowd: CrowdKind) -> Vec<String> {
    let text = |value: Option<String>| value.unwrap_or_default();
    let cell = row.cell(crowd);
    let count = |get: &dyn Fn(&CellResult) -> u64| text(cell.map(|cell| get(cell).to_string()));
    let float = |get: &dyn Fn(&CellResult) -> Option<f64>| text(cell.and_then(get).map(|x| x.to_string()));
    let policy = row.policy.as_ref();
    let pool = cell.and_then(|cell| cell.pool.as_ref());
    vec![
        crowd.to_string(),
        float(&|cell| cell.summary.success_rate),
        float(&|cell| cell.summary.wilson_95.map(|ends| ends.low)),
        float(&|cell| cell.summary.wilson_95.map(|ends| ends.high)),
        text(row.paper.map(|(rates, _)| rates[idx].to_string())),
        count(&|cell| cell.summary.episodes),
        count(&|cell| cell.summary.success),
        count(&|cell| cell.summary.collision_wall),
        count(&|cell| cell.summary.collision_pedestrian),
        count(&|cell| cell.summary.timeout),
        float(&|cell| cell.versus_baseline.map(|comparison| comparison.mcnemar.p_exact)),
        row.token.to_string(),
        text(policy.map(|policy| policy.sha256.clone())),
        text(policy.and_then(|policy| policy.config_hash.clone())),
        text(policy.and_then(|policy| policy.seed).map(|seed| seed.to_string())),
        text(policy.and_then(|policy| policy.commit.clone())),
        text(policy.and_then(|policy| policy.updates).map(|updates| updates.to_string())),
        text(policy.and_then(|policy| policy.transitions).map(|count| count.to_string())),
        text(cell.map(|cell| cell.cell.clone())),
        text(pool.map(|pool| {
            let hashes: Vec<&str> = pool.policies.iter().map(|policy| short(&policy.sha256)).collect();
            hashes.join(" ")
        })),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use jostle_arena::crowds::PoolNote;
    use jostle_arena::identity::Opponent;

    #[test]
    fn a_crowd_that_was_seen_in_training_says_so() {
        let trained = |name: &str, seed| PolicyIdentity {
            config_hash: Some("c".to_owned()),
            seed: Some(seed),
            ..PolicyIdentity::custom(name, "1")
        };
        let opponent = Opponent { sha256: "s".to_owned(), config_hash: "c".to_owned(), seed: 3, update: 7 };
        let policy = PolicyIdentity {
            trained_among: vec!["blind 0.25".to_owned(), "straight 0.5".to_owned()],
            opponents: vec![opponent],
            ..trained("ours", 1)
        };
        let cell = |crowd, seeds: &[u64]| {
            let policies = seeds.iter().map(|seed| trained("pedestrian", *seed)).collect();
            let pool = (!seeds.is_empty()).then_some(PoolNote { policies, n_pedestrians: 2 });
            let scale = jostle_arena::metrics::MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
            CellResult::new(crowd, "cell".to_owned(), &scale, &[], pool)
        };
        let seen = |crowd, seeds: &[u64]| seen_in_training(&policy, &cell(crowd, seeds));
        let runs = Some("1 of the 2 runs that drive the pedestrians were opponents".to_owned());
        assert_eq!(seen(CrowdKind::Nh, &[3, 4]), runs);
        assert_eq!(seen(CrowdKind::So, &[2, 4]), None);
        let rule = Some("training_crowd.straight walks by the same rule".to_owned());
        assert_eq!(seen(CrowdKind::Straight, &[]), rule);
        assert_eq!((seen(CrowdKind::StopAndGo, &[]), seen(CrowdKind::Vo, &[])), (None, None));
        assert_eq!(
            cell_notes("IN", Some(&policy), &cell(CrowdKind::In, &[3])),
            [
                "IN: seen in training: 1 of the 1 runs that drive the pedestrians were opponents",
                "IN: 1 policies are cycled among 2 pedestrians"
            ]
        );
        assert!(provenance(&policy).ends_with("– transitions, trained among blind 0.25, straight 0.5)"));
        assert!(provenance(&trained("ours", 1)).ends_with("– transitions)"));
    }
}
