//! The results of a plan in one table: a row for each policy of each run, what training measured around it, and, where the
//! plan asks for it, its success among each crowd.

use anyhow::{Context as _, Result};
use jostle_eval::report::Evaluation;
use jostle_eval::report::grid::{Grid, csv_line};
use jostle_eval::statistics::wilson;
use jostle_ppo::UpdateReport;
use jostle_ppo::report::EpisodeCounts;

use super::plan::{Plan, Task};
use super::task::Stage;
use crate::run_folder::write_atomically;
use crate::runs::log::RunLog;

/// Writes the table beside the runs and returns it for a terminal.
pub(super) fn store(plan: &Plan) -> Result<String> {
    let table = Table::of(plan)?;
    std::fs::create_dir_all(&plan.out).with_context(|| format!("cannot create {}", plan.out.display()))?;
    let grid = table.grid();
    let note = format!(
        "Training measures are means over the {} updates up to the one named; success is that of training episodes, \
         among the run's own kind, with its 95 % interval.\n",
        plan.window
    );
    write_atomically(&plan.out.join("results.csv"), &table.csv())?;
    write_atomically(&plan.out.join("results.md"), &format!("{}\n{note}", grid.markdown()))?;
    Ok(format!("{}\n{note}", grid.text()))
}

/// A policy of a run, or where it stands now.
struct Point<'p> {
    task: &'p Task,
    stage: Stage,
    /// Updates and transitions that it has seen.
    updates: u64,
    transitions: u64,
    episodes: EpisodeCounts,
    /// As [`MEASURES`]; none before the first update.
    measures: Option<[f64; MEASURES.len()]>,
    /// Seconds of training so far.
    seconds: f64,
    evaluation: Option<Evaluation>,
}

type Measure = (&'static str, usize, fn(&UpdateReport) -> f64);

/// Name, digits, measure of an update.
const MEASURES: [Measure; 5] = [
    ("D", 3, |r| r.diversity),
    ("sigma_v", 2, |r| f64::from(r.log_std[0]).exp()),
    ("sigma_w", 2, |r| f64::from(r.log_std[1]).exp()),
    ("explained_variance", 2, |r| r.explained_variance),
    ("transitions_per_second", 0, |r| r.clock.total),
];

struct Table<'p> {
    points: Vec<Point<'p>>,
    /// All crowds that anything was tested among, in the order in which they were met.
    crowds: Vec<String>,
}

impl<'p> Table<'p> {
    fn of(plan: &'p Plan) -> Result<Self> {
        let mut points = Vec::new();
        for task in &plan.tasks {
            points_of(plan, task, &mut points)?;
        }
        let mut crowds: Vec<String> = Vec::new();
        for cell in points.iter().filter_map(|point| point.evaluation.as_ref()).flat_map(|e| &e.cells) {
            let name = cell.crowd.to_string();
            if !crowds.contains(&name) {
                crowds.push(name);
            }
        }
        Ok(Self { points, crowds })
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
                point.stage.word().to_owned(),
                point.updates.to_string(),
                format!("{:.2} M", point.transitions as f64 / 1e6),
                point.success(),
                rate(point.episodes.timeout),
            ];
            for (index, (_, digits, _)) in MEASURES.iter().enumerate() {
                row.push(point.measures.map_or_else(dash, |of| format!("{:.digits$}", of[index])));
            }
            row.push(format!("{:.2}", point.seconds / 3600.0));
            let rates: Vec<Option<f64>> = self.crowds.iter().map(|crowd| point.rate(crowd)).collect();
            row.extend(rates.iter().map(|rate| rate.map_or_else(dash, |rate| format!("{rate:.3}"))));
            if average.is_some() {
                let all: Option<Vec<f64>> = rates.into_iter().collect();
                let mean = all.map(|rates| rates.iter().sum::<f64>() / rates.len() as f64);
                row.push(mean.map_or_else(dash, |mean| format!("{mean:.3}")));
            }
            grid.push(last.is_some_and(|name| name != &point.task.variant), row);
            last = Some(&point.task.variant);
        }
        grid
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
            row.extend([task.config.hash(), point.stage.word().to_owned()]);
            let counts = [point.updates, point.transitions, e.ended, e.success];
            row.extend(counts.map(|count| count.to_string()));
            row.extend([e.collision_wall, e.collision_agent, e.timeout].map(|count| count.to_string()));
            let measures = point.measures.map(|of| of.map(|value| value.to_string()));
            row.extend(measures.unwrap_or_default());
            row.push(point.seconds.to_string());
            for crowd in &self.crowds {
                let summary = point.cell(crowd).map(|cell| &cell.summary);
                let counts = summary.map(|s| [s.episodes, s.success].map(|count| count.to_string()));
                row.extend(counts.unwrap_or_default());
            }
            text += &csv_line(row);
        }
        text
    }
}

impl Point<'_> {
    fn cell(&self, crowd: &str) -> Option<&jostle_eval::report::CellResult> {
        self.evaluation.as_ref()?.cells.iter().find(|cell| cell.crowd.to_string() == crowd)
    }

    fn rate(&self, crowd: &str) -> Option<f64> {
        self.cell(crowd)?.summary.success_rate
    }

    fn episodes_share(&self, count: u64) -> Option<f64> {
        (self.episodes.ended > 0).then(|| count as f64 / self.episodes.ended as f64)
    }

    fn success(&self) -> String {
        let EpisodeCounts { success, ended, .. } = self.episodes;
        let share = self.episodes_share(success).zip(wilson(success, ended));
        share.map_or_else(dash, |(rate, ends)| format!("{rate:.3} ({:.3}–{:.3})", ends.low, ends.high))
    }
}

/// The points of a run: what was tested, each milestone that it has reached, and its newest update.
fn points_of<'p>(plan: &Plan, task: &'p Task, points: &mut Vec<Point<'p>>) -> Result<()> {
    let stage = Stage::of(plan, task)?;
    if !task.folder.join("config.toml").is_file() {
        points.push(Point {
            task,
            stage,
            updates: 0,
            transitions: 0,
            episodes: EpisodeCounts::default(),
            measures: None,
            seconds: 0.0,
            evaluation: None,
        });
        return Ok(());
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
            stage,
            updates,
            transitions: updates * rollout,
            episodes: log.episodes(end, plan.window),
            measures: (end > 0).then_some(measures),
            seconds: log.reports[..end].iter().map(|report| report.clock.total).sum(),
            evaluation,
        });
    }
    Ok(())
}

fn dash() -> String {
    "–".to_owned()
}
