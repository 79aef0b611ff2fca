//! Tables whose rows may rest on several training seeds: our value, its 95 % interval, the paper's
//! value.
//!
//! A value is the mean over training seeds of each seed's value. Its interval: with one seed that
//! of the episodes (Wilson's for a rate, Student's for a mean); with several Student's over the
//! seeds' values, since what differs between trainings is what a reader of a single table cannot
//! see.

use serde::{Deserialize, Serialize};

use super::grid::{Grid, csv_line, number};
use crate::statistics::{Contrast, Interval, half_width_of_mean, student, wilson};
use jostle_arena::identity::PolicyIdentity;

/// A cell of one training seed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedValue {
    /// Training seed.
    pub seed: u64,
    /// Rate or mean; `None` where there was nothing to average over.
    pub value: Option<f64>,
    /// Sample standard deviation over episodes, for means.
    pub std: Option<f64>,
    /// Interval over the episodes.
    pub interval: Option<Interval>,
    /// Episodes that the value rests on (of a mean: the successes).
    pub episodes: u64,
}

impl SeedValue {
    /// A rate of successes.
    pub fn rate(seed: u64, successes: u64, episodes: u64) -> Self {
        let value = (episodes > 0).then(|| successes as f64 / episodes as f64);
        Self { seed, value, std: None, interval: wilson(successes, episodes), episodes }
    }

    /// A mean over episodes, with Student's interval.
    pub fn mean(seed: u64, values: &[f64]) -> Self {
        let summary = crate::metrics::MeanStd::from_values(values);
        let n = values.len() as f64;
        let interval = summary.mean.zip(summary.std).map(|(mean, std)| {
            let half = student::critical(0.95, n - 1.0) * std / n.sqrt();
            Interval { low: mean - half, high: mean + half }
        });
        let episodes = values.len() as u64;
        Self { seed, value: summary.mean, std: summary.std, interval, episodes }
    }

    /// A number without episodes, such as D.
    pub fn number(seed: u64, value: f64) -> Self {
        Self { seed, value: Some(value), std: None, interval: None, episodes: 0 }
    }
}

/// A cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PooledCell {
    /// Mean over training seeds.
    pub value: Option<f64>,
    /// Its 95 % interval.
    pub interval: Option<Interval>,
    /// Mean of the seeds' standard deviations over episodes, for means.
    pub std: Option<f64>,
    /// A value for each seed.
    pub seeds: Vec<SeedValue>,
}

impl PooledCell {
    /// Pools seeds; a rate's interval is cut at 0 and 1.
    pub fn from_seeds(seeds: Vec<SeedValue>, is_rate: bool) -> Self {
        let values: Vec<f64> = seeds.iter().filter_map(|seed| seed.value).collect();
        let mean =
            |values: &[f64]| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let interval = match &seeds[..] {
            [one] => one.interval,
            _ => Contrast::from_groups(std::slice::from_ref(&values)).map(|contrast| contrast.interval(0.95)),
        };
        let stds: Vec<f64> = seeds.iter().filter_map(|seed| seed.std).collect();
        let cell = Self { value: mean(&values), interval, std: mean(&stds), seeds };
        if is_rate { cell.within(0.0, 1.0) } else { cell }
    }

    /// The same with its intervals cut to the values that there can be.
    #[must_use]
    pub fn within(mut self, least: f64, largest: f64) -> Self {
        let cut = |ends: Interval| Interval { low: ends.low.max(least), high: ends.high.min(largest) };
        self.interval = self.interval.map(cut);
        for seed in &mut self.seeds {
            seed.interval = seed.interval.map(cut);
        }
        self
    }

    /// Means of several cells, seed by seed: the average over crowds. Its interval with one seed is
    /// that of the mean of independent rates, by the normal distribution. `None` where a cell is
    /// missing or seeds differ.
    pub fn average(cells: &[Option<&Self>]) -> Option<Self> {
        let cells: Vec<&Self> = cells.iter().copied().collect::<Option<_>>()?;
        let (first, n) = (cells.first()?, cells.len() as f64);
        let seeds = (0..first.seeds.len()).map(|i| {
            let of_seed: Vec<&SeedValue> =
                cells.iter().map(|cell| cell.seeds.get(i)).collect::<Option<_>>()?;
            let values: Option<Vec<f64>> = of_seed.iter().map(|seed| seed.value).collect();
            let value = values?.iter().sum::<f64>() / n;
            let intervals: Option<Vec<Interval>> = of_seed.iter().map(|seed| seed.interval).collect();
            let interval = intervals.map(|intervals| {
                let half = half_width_of_mean(&intervals);
                Interval { low: value - half, high: value + half }
            });
            let episodes = of_seed.iter().map(|seed| seed.episodes).sum();
            Some(SeedValue { seed: of_seed[0].seed, value: Some(value), std: None, interval, episodes })
        });
        Some(Self::from_seeds(seeds.collect::<Option<_>>()?, true))
    }
}

/// Entry of a planner's row for a label that it has none for.
pub const NO_LABEL: &str = "–";

/// A policy behind a row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// The policy's identity.
    pub policy: PolicyIdentity,
    /// Seconds that its training took.
    pub wall_seconds: Option<f64>,
}

/// A row: labels, cells and the paper's figures beside them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PooledRow {
    /// Texts of the label columns.
    pub labels: Vec<String>,
    /// One for each column; `None` where there is no result.
    pub cells: Vec<Option<PooledCell>>,
    /// The paper's figures, mean and spread, one for each column.
    pub paper: Vec<Option<(f64, Option<f64>)>>,
    /// Decimals of our values.
    pub decimals: usize,
    /// The policies; none where the row has not been trained.
    pub sources: Vec<Source>,
    /// Command that trains a missing row.
    pub command: Option<String>,
    /// A note on the row.
    pub note: Option<String>,
    /// True for a planner's row: not learned, not of the paper, without training seeds.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub planner: bool,
}

/// A table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PooledTable {
    /// Short name, also of its files.
    pub id: String,
    /// Title.
    pub title: String,
    /// Heads of the label columns.
    pub label_heads: Vec<String>,
    /// Heads of the value columns.
    pub columns: Vec<String>,
    /// Rows.
    pub rows: Vec<PooledRow>,
    /// Notes on the table.
    pub notes: Vec<String>,
}

impl PooledTable {
    /// For a terminal.
    pub fn text(&self) -> String {
        let notes = self.all_notes().join("\n");
        format!("{}\n\n{}\n{notes}\n", self.title, self.grid().text())
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let notes = self.all_notes().join("\n- ");
        format!("## {}\n\n{}\n- {notes}\n", self.title, self.grid().markdown())
    }

    /// As JSON, with everything.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a table is always JSON") + "\n"
    }

    /// As CSV: a line for each row, column and training seed, and one (seed empty) for all seeds
    /// together.
    pub fn csv(&self) -> String {
        let heads = [
            "column",
            "seed",
            "value",
            "low_95",
            "high_95",
            "std",
            "episodes",
            "paper",
            "paper_std",
            "policy",
            "config_hash",
            "commit",
            "updates",
            "transitions",
            "wall_seconds",
        ];
        let mut text = csv_line(self.label_heads.iter().map(String::as_str).chain(heads));
        let float = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for row in &self.rows {
            for (i, column) in self.columns.iter().enumerate() {
                let paper = row.paper.get(i).copied().flatten();
                let paper = [float(paper.map(|(mean, _)| mean)), float(paper.and_then(|(_, std)| std))];
                let mut push = |seed: String,
                                value,
                                interval: Option<Interval>,
                                std,
                                episodes: String,
                                source: Option<&Source>| {
                    let ends = [float(interval.map(|e| e.low)), float(interval.map(|e| e.high))];
                    let policy = source.map(|source| &source.policy);
                    let text_of = |get: &dyn Fn(&PolicyIdentity) -> Option<String>| {
                        policy.and_then(get).unwrap_or_default()
                    };
                    let fields = [
                        column.clone(),
                        seed,
                        float(value),
                        ends[0].clone(),
                        ends[1].clone(),
                        float(std),
                        episodes,
                        paper[0].clone(),
                        paper[1].clone(),
                        text_of(&|policy| Some(policy.sha256.clone())),
                        text_of(&|policy| policy.config_hash.clone()),
                        text_of(&|policy| policy.commit.clone()),
                        text_of(&|policy| policy.updates.map(|n| n.to_string())),
                        text_of(&|policy| policy.transitions.map(|n| n.to_string())),
                        float(source.and_then(|source| source.wall_seconds)),
                    ];
                    text += &csv_line(row.labels.iter().chain(&fields));
                };
                match row.cells.get(i).and_then(Option::as_ref) {
                    None => push(String::new(), None, None, None, String::new(), None),
                    Some(cell) => {
                        let episodes: u64 = cell.seeds.iter().map(|seed| seed.episodes).sum();
                        let planner = row.sources.first().filter(|_| row.planner);
                        let episodes = episodes.to_string();
                        push(String::new(), cell.value, cell.interval, cell.std, episodes, planner);
                        for seed in cell.seeds.iter().filter(|_| !row.planner) {
                            let source =
                                row.sources.iter().find(|source| source.policy.seed == Some(seed.seed));
                            let episodes = seed.episodes.to_string();
                            push(
                                seed.seed.to_string(),
                                seed.value,
                                seed.interval,
                                seed.std,
                                episodes,
                                source,
                            );
                        }
                    }
                }
            }
        }
        text
    }

    /// As a LaTeX table (packages booktabs and, for wide tables, graphicx).
    pub fn latex(&self) -> String {
        let columns = format!("{}l{}", "l".repeat(self.label_heads.len()), "c".repeat(self.columns.len()));
        let heads: Vec<String> = self
            .label_heads
            .iter()
            .chain([&String::new()])
            .chain(&self.columns)
            .map(|head| latex(head))
            .collect();
        let line = |fields: Vec<String>| fields.join(" & ") + " \\\\\n";
        let mut text = format!(
            "% Made by `cargo xtask reproduce {}`.\n\\begin{{tabular}}{{{columns}}}\n\\toprule\n{}\\midrule\n",
            self.id,
            line(heads)
        );
        for (i, row) in self.rows.iter().enumerate() {
            if i > 0 {
                text += "\\addlinespace\n";
            }
            for fields in self.lines(row) {
                text += &line(fields.iter().map(|field| latex(field)).collect());
            }
        }
        text + "\\bottomrule\n\\end{tabular}\n"
    }

    fn grid(&self) -> Grid {
        let heads =
            self.label_heads.iter().cloned().chain([String::new()]).chain(self.columns.iter().cloned());
        let mut grid = Grid::new(heads);
        for row in &self.rows {
            for (i, line) in self.lines(row).into_iter().enumerate() {
                grid.push(i == 0, line);
            }
        }
        grid
    }

    /// The lines of a row: ours, its interval, the paper's.
    fn lines(&self, row: &PooledRow) -> Vec<Vec<String>> {
        let blank = vec![String::new(); self.label_heads.len()];
        let line = |labels: &[String], what: &str, cells: Vec<String>| {
            let mut line = labels.to_vec();
            line.push(what.to_owned());
            line.extend(cells);
            line
        };
        let decimals = row.decimals;
        let each = |render: &dyn Fn(&PooledCell) -> String| -> Vec<String> {
            (0..self.columns.len())
                .map(|i| row.cells.get(i).and_then(Option::as_ref).map_or_else(|| "–".to_owned(), render))
                .collect()
        };
        let value = |cell: &PooledCell| {
            let value = number(cell.value, decimals);
            cell.std.map_or_else(|| value.clone(), |std| format!("{value} ± {std:.decimals$}"))
        };
        let interval = |cell: &PooledCell| match cell.interval {
            Some(ends) => format!("{:.decimals$} to {:.decimals$}", ends.low, ends.high),
            None => "–".to_owned(),
        };
        let paper = (0..self.columns.len()).map(|i| match row.paper.get(i).copied().flatten() {
            Some((mean, Some(std))) => format!("{mean} ± {std}"),
            Some((mean, None)) => format!("{mean:.2}"),
            None => "–".to_owned(),
        });
        let who = if row.planner { "planner" } else { "ours" };
        let mut lines = vec![line(&row.labels, who, each(&value))];
        if !row.sources.is_empty() {
            lines.push(line(&blank, "95 %", each(&interval)));
        }
        if row.paper.iter().any(Option::is_some) {
            lines.push(line(&blank, "paper", paper.collect()));
        }
        lines
    }

    /// The table's notes, those of its rows, and the provenance of every policy once, at the first
    /// row that it serves.
    fn all_notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        let mut named: Vec<&str> = Vec::new();
        for row in &self.rows {
            let labels = self.label_heads.iter().zip(&row.labels);
            let label: Vec<String> = if row.planner {
                row.labels.iter().filter(|label| *label != NO_LABEL).cloned().collect()
            } else {
                labels.map(|(head, label)| format!("{head} {label}")).collect()
            };
            let label = label.join(", ");
            notes.extend(row.note.iter().map(|note| format!("{label}: {note}")));
            if let Some(command) = row.command.as_ref().filter(|_| row.sources.is_empty()) {
                notes.push(format!("{label}: not trained yet; `{command}` trains it"));
            }
            for source in &row.sources {
                if !named.contains(&source.policy.sha256.as_str()) {
                    named.push(&source.policy.sha256);
                    notes.push(format!("{label}: {}", provenance(source)));
                }
            }
        }
        notes
    }
}

/// A policy's provenance in one line.
fn provenance(source: &Source) -> String {
    let policy = &source.policy;
    let hours = source.wall_seconds.map_or_else(String::new, |s| format!(", trained in {:.1} h", s / 3600.0));
    format!("{}{hours}", super::table::provenance(policy))
}

/// Text with LaTeX's special characters escaped.
pub fn latex(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '&' | '%' | '#' | '_' | '$' | '{' | '}' => format!("\\{c}"),
            '\\' => "\\textbackslash{}".to_owned(),
            '~' => "\\textasciitilde{}".to_owned(),
            '^' => "\\textasciicircum{}".to_owned(),
            '±' => "$\\pm$".to_owned(),
            '−' => "$-$".to_owned(),
            'α' => "$\\alpha$".to_owned(),
            '–' => "--".to_owned(),
            c => c.to_string(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use jostle_arena::metrics::EpisodeMetrics;

    fn table() -> PooledTable {
        let identity =
            |seed| PolicyIdentity { seed: Some(seed), ..PolicyIdentity::custom("m", &format!("{seed}")) };
        let seeds = vec![SeedValue::rate(1, 50, 100), SeedValue::rate(2, 70, 100)];
        let cell = PooledCell::from_seeds(seeds, true);
        let row = |labels: &str, cells, sources| PooledRow {
            labels: vec![labels.to_owned()],
            cells,
            paper: vec![Some((0.63, None)), Some((0.55, None))],
            decimals: 3,
            sources,
            command: Some("cargo xtask reproduce t --train".to_owned()),
            note: None,
            planner: false,
        };
        let sources = [1, 2].map(|seed| Source { policy: identity(seed), wall_seconds: Some(5400.0) });
        PooledTable {
            id: "t".to_owned(),
            title: "T".to_owned(),
            label_heads: vec!["M_1".to_owned()],
            columns: vec!["NH".to_owned(), "Avg".to_owned()],
            rows: vec![
                row(
                    "5",
                    vec![Some(cell.clone()), PooledCell::average(&[Some(&cell), Some(&cell)])],
                    sources.to_vec(),
                ),
                row("10", vec![None, None], Vec::new()),
            ],
            notes: vec!["a note".to_owned()],
        }
    }

    #[test]
    fn seeds_are_pooled_by_their_means() {
        let cell =
            PooledCell::from_seeds(vec![SeedValue::rate(1, 50, 100), SeedValue::rate(2, 70, 100)], true);
        assert!((cell.value.unwrap() - 0.6).abs() < 1e-12);
        // t(0.975; 1) · 0.1 = 1.27: cut at both ends.
        assert_eq!(cell.interval, Some(Interval { low: 0.0, high: 1.0 }));
        let one = PooledCell::from_seeds(vec![SeedValue::rate(1, 50, 100)], true);
        assert_eq!(one.interval, wilson(50, 100));
        let mean = SeedValue::mean(1, &[1.0, 2.0, 3.0]);
        assert_eq!((mean.value, mean.std), (Some(2.0), Some(1.0)));
        let half = 4.302_652_73 / 3.0_f64.sqrt();
        assert!((mean.interval.unwrap().high - 2.0 - half).abs() < 1e-8);
        assert_eq!(SeedValue::mean(1, &[]).value, None);
    }

    /// Student's interval of 0.7, 0.8 and 0.99 ends at 1.19; of a number that is no share it stays.
    #[test]
    fn intervals_end_where_values_end() {
        let seeds = || [0.7, 0.8, 0.99].map(|value| SeedValue::number(1, value)).to_vec();
        let free = PooledCell::from_seeds(seeds(), false);
        let ends = free.interval.unwrap();
        assert!((ends.high - 1.195).abs() < 1e-3 && (ends.low - 0.465).abs() < 1e-3, "{ends:?}");
        let cut = free.clone().within(0.5, 1.0);
        assert_eq!((cut.interval, cut.value), (Some(Interval { low: 0.5, high: 1.0 }), free.value));
        assert_eq!(PooledCell::from_seeds(seeds(), true).interval.unwrap().high, 1.0);
        // The normal interval of one seed's average, in its own line of the CSV as well.
        let all = PooledCell::from_seeds(vec![SeedValue::rate(1, 20, 20)], true);
        let average = PooledCell::average(&[Some(&all), Some(&all)]).unwrap();
        assert_eq!(average.seeds[0].interval.unwrap().high, 1.0);
    }

    #[test]
    fn an_average_of_one_seed_has_the_interval_of_its_episodes() {
        let cell = PooledCell::from_seeds(vec![SeedValue::rate(1, 50, 100)], true);
        let average = PooledCell::average(&[Some(&cell), Some(&cell), Some(&cell), Some(&cell)]).unwrap();
        let (one, four) = (cell.interval.unwrap(), average.interval.unwrap());
        assert!(((one.high - one.low) / (four.high - four.low) - 2.0).abs() < 1e-9);
        assert_eq!(PooledCell::average(&[Some(&cell), None]), None);
    }

    #[test]
    fn every_form_has_every_row() {
        let table = table();
        let text = table.text();
        for part in [
            "5    ours   0.600",
            "paper  0.63",
            "10   ours   –",
            "trained in 1.5 h",
            "--train` trains it",
            "a note",
        ] {
            assert!(text.contains(part), "no {part:?} in\n{text}");
        }
        assert!(table.markdown().contains("| 5 | ours | 0.600 | 0.600 |"));
        let csv = table.csv();
        let n = csv.lines().next().unwrap().split(',').count();
        assert!(csv.lines().all(|line| line.split(',').count() == n), "{csv}");
        // Two columns: three lines each for the trained row, one for the other.
        assert_eq!(csv.lines().count(), 1 + 6 + 2);
        let latex = table.latex();
        assert!(latex.contains("M\\_1 &  & NH & Avg \\\\") && latex.contains("\\bottomrule"), "{latex}");
        assert_eq!(serde_json::from_str::<PooledTable>(&table.json()).unwrap(), table);
    }

    #[test]
    fn a_planners_row_is_marked_and_has_no_seeds() {
        let mut table = table();
        let identity = PolicyIdentity::custom("dwa", "1");
        let cell = PooledCell::from_seeds(vec![SeedValue::rate(0, 90, 100)], true);
        table.rows.push(PooledRow {
            labels: vec!["dwa".to_owned()],
            cells: vec![Some(cell.clone()), PooledCell::average(&[Some(&cell)])],
            paper: vec![None, None],
            decimals: 3,
            sources: vec![Source { policy: identity.clone(), wall_seconds: None }],
            command: None,
            note: Some("better".to_owned()),
            planner: true,
        });
        let text = table.text();
        assert!(text.contains("dwa  planner  0.900") && text.contains("dwa: better"), "{text}");
        assert!(
            text.contains(&format!("dwa: dwa (sha256 {})", jostle_arena::identity::short(&identity.sha256))),
            "{text}"
        );
        let of_planner: Vec<String> =
            table.csv().lines().filter(|l| l.starts_with("dwa")).map(str::to_owned).collect();
        assert_eq!(of_planner.len(), 2, "one line a column: {of_planner:?}");
        assert!(of_planner[0].contains(&identity.sha256), "{of_planner:?}");
        assert_eq!(serde_json::from_str::<PooledTable>(&table.json()).unwrap(), table);
        assert_eq!(table.json().matches("\"planner\"").count(), 1, "learned rows are written as before");
    }

    #[test]
    fn the_bound_of_time_on_distance_holds_for_rounded_distances() {
        let scale = jostle_arena::metrics::MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
        let outcome = jostle_arena::Outcome::Success;
        let metrics = EpisodeMetrics::from_totals(&scale, outcome, 100, 10.0, 9.123_456_7);
        let excess = metrics.extra_distance.unwrap() - metrics.extra_time.unwrap();
        assert!(excess.abs() < crate::metrics::DistanceCheck::TOLERANCE);
    }
}
