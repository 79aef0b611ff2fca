//! The results of a plan: a table with a row for each policy of each run, what training measured
//! around it, and, where the plan asks for it, its success among each crowd; how the variants
//! compare; and a figure of success against transitions.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_eval::report::grid::{Grid, csv_line};
use jostle_eval::statistics::{Contrast, Permutation, wilson};
use jostle_ppo::UpdateReport;
use jostle_ppo::report::EpisodeCounts;

use super::plan::Plan;
use super::spec::Task;
use super::stored::{self, Stored};
use super::tally::Tests;
use super::task::Stage;
use jostle_runs::log::RunLog;
use jostle_runs::run_folder::write_atomically;
use jostle_view::curves::{Axis, Curve, Panel, Panels};
use jostle_view::draw;

/// Writes table and figure into a folder, by default that of the runs, and returns the table for a
/// terminal. Another folder keeps what it holds of runs that are not here.
pub(super) fn store(plan: &Plan, folder: Option<&Path>) -> Result<String> {
    let kept = folder.map_or_else(|| Ok(BTreeMap::new()), |folder| stored::read(folder, plan))?;
    let table = Table::new(plan, kept)?;
    let folder = folder.unwrap_or(&plan.out);
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let grid = table.grid();
    let note = format!(
        "Training measures are means over the {} updates up to the one named; success is that of training episodes, \
         among the run's own kind, with its 95 % interval.\n",
        plan.window
    );
    let at = table.compared_at();
    let comparison = table.comparison(at);
    let compared = |page: String, shown: fn(&Grid) -> String| match &comparison {
        Some(comparison) => [&page, "\n", &shown(comparison), "\n", &compared_note(at)].concat(),
        None => page,
    };
    let markdown = compared(format!("{}\n{note}", grid.markdown()), Grid::markdown);
    if let Some(summary) = table.summary() {
        let page = compared(format!("{}\n{AVERAGED}", summary.markdown()), Grid::markdown);
        write_atomically(&folder.join("summary.md"), &page)?;
    }
    if let Some(evaluation) = &plan.evaluation {
        write_atomically(&folder.join(stored::ASKED), &evaluation.asked())?;
    }
    write_atomically(&folder.join("results.csv"), &table.csv())?;
    write_atomically(&folder.join("results.md"), &markdown)?;
    if let Some(panels) = table.panels() {
        write_atomically(&folder.join("results.svg"), &draw::panels::curves(&panels)?)?;
    }
    Ok(compared(format!("{}\n{note}", grid.text()), Grid::text))
}

/// The note below the summary.
const AVERAGED: &str = "Means over the training seeds; in brackets the least and the greatest seed's average. Own: success of training \
                        episodes, among the run's own kind.\n";
/// The note below the comparison of variants, made after so many transitions.
fn compared_note(at: Option<u64>) -> String {
    let when = at.map_or_else(
        || "at the end of training".to_owned(),
        |at| {
            format!(
                "after {:.1} million transitions, the furthest that all variants have come",
                at as f64 / 1e6
            )
        },
    );
    format!(
        "Averages over the crowds {when}, a value for each training seed. Differences are from the first variant, with \
         Welch's 95 % interval; p is that of the exact permutation test, in brackets the least that so many seeds can give.\n"
    )
}

/// A policy of a run, or where it stands now.
struct Point<'p> {
    task: &'p Task,
    /// The run's stage in a word.
    state: &'static str,
    /// Updates and transitions that it has seen.
    updates: u64,
    transitions: u64,
    episodes: EpisodeCounts,
    /// As [`MEASURES`]; none before the first update.
    measures: Option<[f64; MEASURES.len()]>,
    /// Seconds of training so far.
    seconds: f64,
    /// `None` where it was not tested.
    tests: Option<Tests>,
}

pub(super) type Measure = (&'static str, usize, fn(&UpdateReport) -> f64);

/// Name, digits, measure of an update.
pub(super) const MEASURES: [Measure; 5] = [
    ("D", 3, |r| r.diversity),
    ("sigma_v", 2, |r| f64::from(r.log_std[0]).exp()),
    ("sigma_w", 2, |r| f64::from(r.log_std[1]).exp()),
    ("explained_variance", 2, |r| r.explained_variance),
    ("transitions_per_second", 0, |r| r.clock.total),
];

/// Of intervals.
const LEVEL: f64 = 0.95;

struct Table<'p> {
    points: Vec<Point<'p>>,
    /// Planners that were not learned, in the same episodes.
    planners: Vec<(String, Tests)>,
    /// All crowds that anything was tested among, in the order in which they were met.
    crowds: Vec<String>,
}

/// The variant of a planner in the table.
pub(super) const NOT_LEARNED: &str = "not learned";
/// The state of a run that only the folder of results knows.
const STORED: &str = "stored";

impl<'p> Table<'p> {
    /// What the runs' folders hold, and what is kept of them from elsewhere.
    fn new(plan: &'p Plan, mut kept: BTreeMap<String, Vec<Stored>>) -> Result<Self> {
        let mut points = Vec::new();
        for task in &plan.tasks {
            let found = points_of(plan, task)?;
            points.extend(with_kept(task, found, kept.remove(&task.name).unwrap_or_default()));
        }
        let tested = match &plan.evaluation {
            Some(evaluation) => evaluation.planners(&plan.out)?,
            None => Vec::new(),
        };
        let planners: Vec<(String, Tests)> =
            tested.iter().map(|(name, tested)| (name.clone(), Tests::from_evaluation(tested))).collect();
        let mut crowds: Vec<String> = Vec::new();
        let tests = points.iter().filter_map(|point| point.tests.as_ref());
        for (name, _) in tests.chain(planners.iter().map(|(_, tests)| tests)).flat_map(|tests| &tests.0) {
            if !crowds.contains(name) {
                crowds.push(name.clone());
            }
        }
        Ok(Self { points, planners, crowds })
    }

    /// For people.
    fn grid(&self) -> Grid {
        let heads = ["run", "state", "updates", "transitions", "success", "timeout"];
        let measures = ["D", "σ v", "σ ω", "expl. var.", "transitions/s", "hours"];
        let crowds = self.crowds.iter().map(String::as_str);
        let average = (self.crowds.len() > 1).then_some("average");
        let mut grid = Grid::new(heads.into_iter().chain(measures).chain(crowds).chain(average));
        let mut last = None;
        for point in &self.points {
            let rate =
                |count: u64| point.episodes_share(count).map_or_else(dash, |share| format!("{share:.2}"));
            let mut row = vec![
                point.task.name.clone(),
                point.state.to_owned(),
                point.updates.to_string(),
                format!("{:.2} M", point.transitions as f64 / 1e6),
                point.success(),
                rate(point.episodes.timeout),
            ];
            for (index, (_, digits, _)) in MEASURES.iter().enumerate() {
                row.push(point.measures.map_or_else(dash, |of| format!("{:.digits$}", of[index])));
            }
            row.push(format!("{:.2}", point.seconds / 3600.0));
            row.extend(self.rates(point.tests.as_ref()));
            grid.push(last.is_some_and(|name| name != &point.task.variant), row);
            last = Some(&point.task.variant);
        }
        for (index, (name, tested)) in self.planners.iter().enumerate() {
            let mut row = vec![name.clone(), NOT_LEARNED.to_owned()];
            row.resize_with(heads.len() + measures.len(), dash);
            row.extend(self.rates(Some(tested)));
            grid.push(index == 0, row);
        }
        grid
    }

    /// Success among each crowd and, with more than one, their average.
    fn rates(&self, tested: Option<&Tests>) -> Vec<String> {
        let rates: Vec<Option<f64>> = self.crowds.iter().map(|crowd| rate(tested, crowd)).collect();
        let average = (self.crowds.len() > 1).then(|| self.average(tested));
        let shown = |rate: Option<f64>| rate.map_or_else(dash, |rate| format!("{rate:.3}"));
        rates.into_iter().chain(average).map(shown).collect()
    }

    /// Mean success over all crowds; `None` where one was not tested.
    fn average(&self, tested: Option<&Tests>) -> Option<f64> {
        let rates: Option<Vec<f64>> = self.crowds.iter().map(|crowd| rate(tested, crowd)).collect();
        rates.filter(|rates| !rates.is_empty()).map(|rates| rates.iter().sum::<f64>() / rates.len() as f64)
    }

    /// The variants in the order of the plan.
    fn variants(&self) -> Vec<&'p str> {
        let mut names: Vec<&str> = self.points.iter().map(|point| point.task.variant.as_str()).collect();
        let mut seen = BTreeSet::new();
        names.retain(|name| seen.insert(*name));
        names
    }

    /// Number of transitions at which variants are compared: the furthest at which all that have
    /// been tested at all were tested; `None` where all have been tested at the end of their
    /// training.
    fn compared_at(&self) -> Option<u64> {
        let tested = |variant: &str| {
            let of_variant = |point: &&Point<'_>| point.task.variant == variant && point.tests.is_some();
            let points: Vec<&Point<'_>> = self.points.iter().filter(of_variant).collect();
            points
        };
        let all: Vec<Vec<&Point<'_>>> =
            self.variants().into_iter().map(tested).filter(|points| !points.is_empty()).collect();
        let has_ended = |point: &&Point<'_>| point.updates == point.task.config.updates;
        if all.iter().all(|points| points.iter().any(has_ended)) {
            return None;
        }
        let reached = |at: u64| all.iter().all(|points| points.iter().any(|point| point.transitions == at));
        let known: BTreeSet<u64> = all.iter().flatten().map(|point| point.transitions).collect();
        known.into_iter().rev().find(|&at| reached(at))
    }

    /// The average of each seed of a variant after so many transitions; by default those whose
    /// training is done.
    fn averages(&self, variant: &str, at: Option<u64>) -> Vec<f64> {
        let chosen = |point: &&Point<'_>| {
            let there = at.map_or(point.updates == point.task.config.updates, |at| point.transitions == at);
            point.task.variant == variant && there
        };
        self.points.iter().filter(chosen).filter_map(|point| self.average(point.tests.as_ref())).collect()
    }

    /// Each variant after as many transitions, over its seeds, and the planners; `None` where
    /// nothing was tested.
    fn summary(&self) -> Option<Grid> {
        if self.crowds.is_empty() {
            return None;
        }
        let heads = ["variant", "transitions", "seeds", "own", "D", "σ v"].into_iter();
        let crowds = self.crowds.iter().map(String::as_str);
        let mut grid = Grid::new(heads.chain(crowds).chain(["average"]));
        for variant in self.variants() {
            let tested = self.points.iter().filter(|p| p.task.variant == variant && p.tests.is_some());
            let mut at: BTreeMap<u64, Vec<&Point<'_>>> = BTreeMap::new();
            tested.for_each(|point| at.entry(point.transitions).or_default().push(point));
            for (index, (transitions, points)) in at.into_iter().enumerate() {
                let mean = |of: &dyn Fn(&Point<'_>) -> Option<f64>, digits: usize| {
                    let values: Option<Vec<f64>> = points.iter().map(|point| of(point)).collect();
                    let mean = values.map(|values| values.iter().sum::<f64>() / values.len() as f64);
                    mean.map_or_else(dash, |mean| format!("{mean:.digits$}"))
                };
                let millions = format!("{:.1} M", transitions as f64 / 1e6);
                let mut row = vec![variant.to_owned(), millions, points.len().to_string()];
                row.push(mean(&|point| point.episodes_share(point.episodes.success), 3));
                let several = |point: &Point<'_>| point.task.config.n_behaviours > 1;
                row.push(mean(&|point| point.measures.filter(|_| several(point)).map(|of| of[0]), 2));
                row.push(mean(&|point| point.measures.map(|of| of[1]), 2));
                for crowd in &self.crowds {
                    row.push(mean(&|point| rate(point.tests.as_ref(), crowd), 3));
                }
                let average = |point: &Point<'_>| self.average(point.tests.as_ref());
                let ends = ends(points.iter().filter_map(|point| average(point)));
                row.push(format!("**{}** ({:.3}–{:.3})", mean(&average, 3), ends.0, ends.1));
                grid.push(index == 0, row);
            }
        }
        for (index, (name, tested)) in self.planners.iter().enumerate() {
            let mut row = vec![format!("{name} ({NOT_LEARNED})")];
            row.resize_with(6, dash);
            row.extend(
                self.crowds
                    .iter()
                    .map(|crowd| rate(Some(tested), crowd).map_or_else(dash, |rate| format!("{rate:.3}"))),
            );
            row.push(self.average(Some(tested)).map_or_else(dash, |rate| format!("**{rate:.3}**")));
            grid.push(index == 0, row);
        }
        Some(grid)
    }

    /// The variants compared after so many transitions, by default at the end of training; `None`
    /// where fewer than two have been tested.
    fn comparison(&self, at: Option<u64>) -> Option<Grid> {
        let all: Vec<(&str, Vec<f64>)> =
            self.variants().into_iter().map(|name| (name, self.averages(name, at))).collect();
        if all.iter().filter(|(_, averages)| !averages.is_empty()).count() < 2 {
            return None;
        }
        let mut grid = Grid::new(["variant", "seeds", "average", "least–greatest", "difference", "p"]);
        let (_, first) = &all[0];
        for (index, (name, averages)) in all.iter().enumerate() {
            let mut row = vec![(*name).to_owned(), averages.len().to_string()];
            let mean = averages.iter().sum::<f64>() / averages.len().max(1) as f64;
            let ends = ends(averages.iter().copied());
            row.push(if averages.is_empty() { dash() } else { format!("{mean:.3}") });
            row.push(if averages.is_empty() { dash() } else { format!("{:.3}–{:.3}", ends.0, ends.1) });
            let negated: Vec<f64> = first.iter().map(|average| -average).collect();
            let contrast = (index > 0).then(|| Contrast::from_groups(&[averages.clone(), negated])).flatten();
            row.push(contrast.map_or_else(dash, |contrast| {
                let ends = contrast.interval(LEVEL);
                format!("{:+.3} ({:+.3} to {:+.3})", contrast.estimate, ends.low, ends.high)
            }));
            let permutation = contrast.and_then(|_| Permutation::new(averages, first));
            row.push(permutation.map_or_else(dash, |test| format!("{:.2} ({:.2})", test.p, test.least_p)));
            grid.push(false, row);
        }
        Some(grid)
    }

    /// Success among each crowd, success among its own kind and D against transitions; `None` where
    /// nothing was tested.
    fn panels(&self) -> Option<Panels> {
        let variants = self.variants();
        let trained = self.points.iter().filter(|point| point.updates > 0);
        let ends = ends(trained.map(|point| point.transitions as f64));
        if self.crowds.is_empty() || ends.0 >= ends.1 {
            return None;
        }
        let panel = |title: String, range, levels, of: &dyn Fn(&Point<'_>) -> Option<f64>| {
            let curves = variants.iter().enumerate().map(|(group, variant)| {
                let points = self.points.iter().filter(|point| point.task.variant == *variant);
                Curve { group, dashed: false, points: bands(points, of) }
            });
            Panel { title, range, levels, curves: curves.collect(), empty: "not tested" }
        };
        let mut panels = Vec::new();
        for crowd in &self.crowds {
            let levels = self.planners.iter().filter_map(|(_, tested)| rate(Some(tested), crowd)).collect();
            panels.push(panel(format!("Success among {crowd}"), None, levels, &|point| {
                rate(point.tests.as_ref(), crowd)
            }));
        }
        if self.crowds.len() > 1 {
            let levels = self.planners.iter().filter_map(|(_, tested)| self.average(Some(tested))).collect();
            let average = |point: &Point<'_>| self.average(point.tests.as_ref());
            panels.push(panel("Success, average over the crowds".to_owned(), None, levels, &average));
        }
        let own = |point: &Point<'_>| point.episodes_share(point.episodes.success);
        panels.push(panel("Success of training episodes".to_owned(), Some((0.0, 1.0)), vec![], &own));
        let several = |point: &Point<'_>| {
            point.measures.filter(|_| point.task.config.n_behaviours > 1).map(|measures| measures[0])
        };
        panels.push(panel("D: mean KL between behaviours (nats)".to_owned(), None, vec![], &several));
        let labels = variants.iter().map(|variant| {
            let seeds: BTreeSet<u64> = self
                .points
                .iter()
                .filter(|point| point.task.variant == *variant && point.updates > 0)
                .map(|point| point.task.config.seed)
                .collect();
            match seeds.len() {
                1 => format!("{variant} (1 seed)"),
                n => format!("{variant} ({n} seeds: mean, least to greatest)"),
            }
        });
        let mut labels: Vec<String> = labels.collect();
        if let Some((first, others)) = self.planners.split_first() {
            let names = others.iter().fold(first.0.clone(), |all, (name, _)| format!("{all}, {name}"));
            labels.push(format!("dotted: {names}"));
        }
        Some(Panels { labels, panels, axis: Axis::Transitions(ends.0, ends.1) })
    }

    /// For programs, with all digits.
    fn csv(&self) -> String {
        let heads = [
            "run",
            "variant",
            "seed",
            "config",
            "state",
            "updates",
            "transitions",
            "episodes",
            "success",
            "collision_wall",
            "collision_agent",
            "timeout",
        ];
        let of_crowds = self
            .crowds
            .iter()
            .flat_map(|crowd| ["episodes", "success"].map(|what| format!("{crowd}_{what}")));
        let heads = heads.into_iter().chain(MEASURES.map(|(name, ..)| name)).chain(["seconds"]);
        let mut text = csv_line(heads.map(str::to_owned).chain(of_crowds));
        for point in &self.points {
            let Point { task, episodes: e, .. } = point;
            let mut row = vec![task.name.clone(), task.variant.clone(), task.config.seed.to_string()];
            row.extend([task.config.hash(), point.state.to_owned()]);
            let counts = [point.updates, point.transitions, e.ended, e.success];
            row.extend(counts.map(|count| count.to_string()));
            row.extend([e.collision_wall, e.collision_agent, e.timeout].map(|count| count.to_string()));
            let measures = point.measures.map(|of| of.map(|value| value.to_string()));
            row.extend(measures.unwrap_or_default());
            row.push(point.seconds.to_string());
            for crowd in &self.crowds {
                row.extend(counts_in(point.tests.as_ref(), crowd));
            }
            text += &csv_line(row);
        }
        let n_measures = MEASURES.len() + 1;
        for (name, tested) in &self.planners {
            let mut row = vec![name.clone(), NOT_LEARNED.to_owned()];
            row.resize(12 + n_measures, String::new());
            for crowd in &self.crowds {
                row.extend(counts_in(Some(tested), crowd));
            }
            text += &csv_line(row);
        }
        text
    }
}

/// Episodes and successes among a crowd; empty where there is no such test.
fn counts_in(tested: Option<&Tests>, crowd: &str) -> [String; 2] {
    let tally = tested.and_then(|tests| tests.among(crowd));
    tally.map(|tally| [tally.episodes, tally.success].map(|count| count.to_string())).unwrap_or_default()
}

fn rate(tested: Option<&Tests>, crowd: &str) -> Option<f64> {
    tested?.rate(crowd)
}

/// The least and the greatest of some values: ∞ and −∞ where there is none.
fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), x| (least.min(x), greatest.max(x)))
}

/// Mean, least and greatest of a measure over the points with as many transitions each.
fn bands<'a>(
    points: impl Iterator<Item = &'a Point<'a>>,
    of: &dyn Fn(&Point<'_>) -> Option<f64>,
) -> Vec<[f64; 4]> {
    let mut at: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    for point in points {
        if let Some(value) = of(point) {
            at.entry(point.transitions).or_default().push(value);
        }
    }
    let band = |(transitions, values): (u64, Vec<f64>)| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let (least, greatest) = ends(values.iter().copied());
        [transitions as f64, mean, least, greatest]
    };
    at.into_iter().map(band).collect()
}

impl Point<'_> {
    fn episodes_share(&self, count: u64) -> Option<f64> {
        (self.episodes.ended > 0).then(|| count as f64 / self.episodes.ended as f64)
    }

    fn success(&self) -> String {
        let EpisodeCounts { success, ended, .. } = self.episodes;
        let share = self.episodes_share(success).zip(wilson(success, ended));
        share.map_or_else(dash, |(rate, ends)| format!("{rate:.3} ({:.3}–{:.3})", ends.low, ends.high))
    }
}

/// The points of a run by its folder: what was tested, each milestone that it has reached, and its
/// newest update.
fn points_of<'p>(plan: &Plan, task: &'p Task) -> Result<Vec<Point<'p>>> {
    let state = Stage::read(plan, task)?.word();
    if !task.folder.join("config.toml").is_file() {
        return Ok(vec![Point {
            task,
            state,
            updates: 0,
            transitions: 0,
            episodes: EpisodeCounts::default(),
            measures: None,
            seconds: 0.0,
            tests: None,
        }]);
    }
    let log = RunLog::read(&task.folder)?;
    let made = (log.reports.len() as u64).min(task.config.updates);
    let rollout = task.config.rollout_len() as u64;
    let mut updates: Vec<u64> = task.milestones.iter().map(|at| at.div_ceil(rollout)).collect();
    updates.retain(|&at| at < made);
    updates.push(made);
    updates.sort_unstable();
    updates.dedup();
    let tested = plan.evaluation.as_ref().map(|evaluation| (evaluation, evaluation.tested(task)));
    let mut points = Vec::new();
    for updates in updates {
        let of_update = tested.iter().flat_map(|(evaluation, tested)| {
            tested.iter().filter(|tested| tested.updates == updates).map(|tested| evaluation.result(tested))
        });
        let evaluation = of_update.collect::<Result<Vec<_>>>()?.into_iter().flatten().next();
        let end = updates as usize;
        let mean = |measure: fn(&UpdateReport) -> f64| log.mean(end, plan.window, |r| Some(measure(r)));
        let mut measures = [0.0; MEASURES.len()];
        for (to, (_, _, measure)) in measures.iter_mut().zip(MEASURES) {
            *to = mean(measure).unwrap_or(0.0);
        }
        // Seconds of an update become a rate.
        let seconds = &mut measures[MEASURES.len() - 1];
        *seconds = if *seconds > 0.0 { rollout as f64 / *seconds } else { 0.0 };
        points.push(Point {
            task,
            state,
            updates,
            transitions: updates * rollout,
            episodes: log.episodes(end, plan.window),
            measures: (end > 0).then_some(measures),
            seconds: log.reports[..end].iter().map(|report| report.clock.total).sum(),
            tests: evaluation.as_ref().map(Tests::from_evaluation),
        });
    }
    Ok(points)
}

/// A run's points with those that only the folder of results knows, by their updates. What is here
/// is preferred, but a test that is missing here is taken from there; and a point that was no more
/// than where the run then stood goes when the run has come further.
fn with_kept<'p>(task: &'p Task, mut points: Vec<Point<'p>>, kept: Vec<Stored>) -> Vec<Point<'p>> {
    let made = points.iter().map(|point| point.updates).max().unwrap_or(0);
    for row in kept {
        if let Some(point) = points.iter_mut().find(|point| point.updates == row.updates) {
            point.tests = point.tests.take().or(row.tests);
        } else if row.tests.is_some() || row.updates > made {
            points.push(Point {
                task,
                state: STORED,
                updates: row.updates,
                transitions: row.transitions,
                episodes: row.episodes,
                measures: Some(row.measures),
                seconds: row.seconds,
                tests: row.tests,
            });
        }
    }
    if points.len() > 1 {
        points.retain(|point| point.updates > 0);
    }
    points.sort_by_key(|point| point.updates);
    points
}

fn dash() -> String {
    "–".to_owned()
}
