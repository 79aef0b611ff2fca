//! Tables 1 to 5 of the paper from the rows of a study.

use crate::claims::{Measure, SeedRun};
use crate::paper::{self, Metric};
use anyhow::Result;
use jostle_arena::Outcome;
use jostle_arena::metrics::EpisodeMetrics;
use jostle_arena::{Driver, Planner};
use jostle_eval::compact::CompactEpisode;
use jostle_eval::metrics::Summary;
use jostle_eval::report::{PooledCell, PooledRow, PooledTable, SeedValue};
use jostle_eval::statistics::{Interval, wilson};
use jostle_peds::CrowdKind;
use jostle_sim::Dynamics;

use super::deployment;
use super::evaluator::{Evaluated, RowEvaluator};
use super::mujoco::Pilot;
use super::plan::{STRONG, row_spec};
use super::planners::{self, Reference, own_label};

/// Rows of Table I in the paper's order, and so on.
const ROWS_1: [&str; 6] = ["m1", "m5", "m10", "m20", "m10-long", "m20-long"];
const ROWS_2: [&str; 6] = ["m1", "m5", "n10-m1", "n10-m5", "n20-m1", "n20-m5"];
const ROWS_3: [&str; 4] = ["m5", "state-action", "state", "m1"];
const ROWS_4: [(&str, &str); 3] = [("Basic", "m1"), ("Safe", "safety-zone"), ("Ours", "m5")];
const ROWS_5: [&str; 2] = ["m1", "m5"];
/// Rows that are tested with mass, under the names of that table.
const ROWS_WITH_MASS: [(&str, &str); 3] = [("M = 1", "m1"), ("M = 5", "m5"), (STRONG, STRONG)];
/// The name of the other simulator's rows.
const MUJOCO: &str = "mujoco";
/// The strong policy by the number of agents.
pub(super) const ROWS_STRONG: [&str; 3] = ["strong", "strong-n10", "strong-n20"];

/// The note on values and intervals.
const READING: &str = "ours: mean over training seeds (robot's token z = 0). 95 %: with one seed, over its episodes (Wilson for a \
    rate, Student for a mean); with several, Student's interval over the seeds. paper: the figure printed there.";

/// The note on comparisons of planners with learned rows.
const PAIRED: &str = "against M = 1 (M = 5): difference to the mean of its training seeds, and the largest p of McNemar's exact \
    test over them, each on the same episodes.";

/// The note on the comparison of the strong policy with a planner.
const POOLED: &str = "against dwa: difference of success; in brackets the episodes that only the policy or only dwa brought to the \
    goal, all training seeds together, and p of McNemar's exact test of them; as the seeds meet dwa on the same episodes, the \
    largest p of a single seed stands beside it.";

/// The planner that the strong policy is held against.
const BAR: Planner = Planner::Dwa;

/// Success against the number of behaviours.
pub(super) fn table_1(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    for (of_paper, name) in paper::TABLE_1.iter().zip(ROWS_1) {
        let labels = [of_paper.n_behaviours, of_paper.updates, of_paper.updates / of_paper.n_behaviours];
        let labels = labels.map(|label| label.to_string()).to_vec();
        rows.push(success_row(
            evaluator.row(name)?,
            name,
            labels,
            of_paper.rates,
            of_paper.average,
            "table1",
        ));
    }
    let references = Reference::pair(evaluator, ["m1", "m5"])?;
    rows.extend(planners::success_rows(evaluator, 5, |planner| own_label(planner, 3), &references)?);
    let title = "Table 1. Success rate against the number of behaviours M";
    let mut table = success_table(evaluator, "table1", title, &["M", "updates", "updates/M"], rows);
    table.notes.push(planners::NOTE.to_owned());
    table.notes.push(PAIRED.to_owned());
    Ok(table)
}

/// Success of the policy that is meant to be used, trained beyond the paper's setting. Not of the
/// paper.
pub(super) fn table_strong(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let crowds = CrowdKind::PAPER.each_ref().map(CrowdKind::name);
    let mut rows = Vec::new();
    for name in ROWS_STRONG {
        let n_agents = row_spec(name).n_agents.expect("the strong rows name their number of agents");
        let labels = |robot: String| vec![n_agents.to_string(), robot];
        let bar = evaluator.planner(BAR, n_agents)?.clone();
        let evaluated = evaluator.row(name)?;
        let mut row = success_row(evaluated, name, labels(STRONG.to_owned()), [0.0; 6], 0.0, "strong");
        row.paper = vec![None; row.paper.len()];
        let paired = planners::pooled_note(&evaluated.row, BAR, &bar, &crowds);
        row.note = [row.note, paired].into_iter().flatten().reduce(|note, more| format!("{note}; {more}"));
        rows.push(row);
        rows.extend(planners::success_rows(evaluator, n_agents, |planner| labels(planner.label()), &[])?);
    }
    let title = "Beyond the paper: the strong policy (configs/strong.toml) among N − 1 pedestrians";
    let mut table = success_table(evaluator, "strong", title, &["N", "robot"], rows);
    table.notes.push(planners::NOTE.to_owned());
    table.notes.push(POOLED.to_owned());
    Ok(table)
}

/// Success against the number of agents.
pub(super) fn table_2(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    for (of_paper, name) in paper::TABLE_2.iter().zip(ROWS_2) {
        let labels =
            vec![of_paper.n_agents.to_string(), if of_paper.diversity { "yes" } else { "no" }.to_owned()];
        rows.push(success_row(
            evaluator.row(name)?,
            name,
            labels,
            of_paper.rates,
            of_paper.average,
            "table2",
        ));
    }
    for (n_agents, learned) in [(5, ["m1", "m5"]), (10, ["n10-m1", "n10-m5"]), (20, ["n20-m1", "n20-m5"])] {
        let references = Reference::pair(evaluator, learned)?;
        let labels = |planner: Planner| vec![n_agents.to_string(), planner.label()];
        rows.extend(planners::success_rows(evaluator, n_agents, labels, &references)?);
    }
    let title = "Table 2. Success rate against the number of agents N";
    let mut table = success_table(evaluator, "table2", title, &["N", "diversity"], rows);
    table.notes.push(planners::NOTE.to_owned());
    table.notes.push(PAIRED.to_owned());
    table.notes.push(
        "Tested among N − 1 pedestrians; where they are more than the policies that drive them, the policies are cycled."
            .to_owned(),
    );
    Ok(table)
}

/// Success and D against the intrinsic reward.
pub(super) fn table_3(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    for (of_paper, name) in paper::TABLE_3.iter().zip(ROWS_3) {
        let evaluated = evaluator.row_with_diversity(name)?;
        let labels = vec![of_paper.intrinsic_reward.to_owned(), format!("{:.2}", of_paper.alpha)];
        let mut row = success_row(evaluated, name, labels, of_paper.rates, of_paper.average, "table3");
        let values =
            evaluated.row.seeds.iter().filter_map(|seed| Some(SeedValue::number(seed.seed, seed.diversity?)));
        let values: Vec<SeedValue> = values.collect();
        row.cells.push((!values.is_empty()).then(|| PooledCell::from_seeds(values, false)));
        row.paper.push(Some((of_paper.diversity, None)));
        let sigmas: Vec<String> = evaluated
            .diversity
            .iter()
            .zip(&evaluated.found)
            .map(|(measured, found)| {
                let [v, w] = measured.sigma;
                format!("seed {}: σ = ({v:.3}, {w:.3})", found.seed)
            })
            .collect();
        if !sigmas.is_empty() {
            let noted = row.note.take().map_or_else(String::new, |note| note + "; ");
            row.note = Some(format!("{noted}{}", sigmas.join(", ")));
        }
        rows.push(row);
    }
    let of_planners = planners::success_rows(evaluator, 5, |planner| own_label(planner, 2), &[])?;
    rows.extend(of_planners.into_iter().map(|mut row| {
        // A planner knows no behaviours.
        row.cells.push(None);
        row.paper.push(None);
        row
    }));
    let title = "Table 3. Success rate and D against the intrinsic reward";
    let mut table = success_table(evaluator, "table3", title, &["intrinsic reward", "α"], rows);
    table.columns.push("D".to_owned());
    table.notes.push(format!("{} Paired with M = 1 and M = 5 in Table 1.", planners::NOTE));
    table.notes.push(
        "D: mean KL divergence (nats) between behaviours over a trajectory of 1000 steps of the baseline of the least seed. It \
         grows with 1/σ², so the learned σ of v and ω stands beside it."
            .to_owned(),
    );
    Ok(table)
}

/// Success, time, distance and speed of three policies.
pub(super) fn table_4(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    let mut checks = Vec::new();
    for metric in [Metric::SuccessRate, Metric::ExtraTime, Metric::ExtraDistance, Metric::AverageSpeed] {
        for (policy, name) in ROWS_4 {
            let of_paper = paper::TABLE_4.iter().find(|row| row.metric == metric && row.policy == policy);
            let figures = of_paper.expect("the paper's table has every policy for every metric").figures;
            let evaluated = evaluator.row(name)?;
            let (label, measure, decimals) = described(metric);
            let sites = CrowdKind::PAPER.each_ref().map(CrowdKind::name);
            if metric == Metric::SuccessRate {
                checks.push(distance_check(evaluated, policy));
            }
            rows.push(PooledRow {
                labels: vec![label.to_owned(), policy.to_owned()],
                cells: cells(evaluated, &sites, measure),
                paper: figures.iter().map(|figure| Some((figure.mean, figure.std))).collect(),
                decimals,
                sources: sources(evaluated),
                command: Some(command("table4", name)),
                note: note(evaluated),
                planner: false,
            });
        }
        let (label, measure, _) = described(metric);
        rows.extend(planners::measure_rows(evaluator, label, measure)?);
    }
    let mut notes = vec![
        READING.to_owned(),
        format!("{} episodes a cell and seed; means ± standard deviations over the successes.", evaluator.episodes()),
        format!("{} Paired with M = 1 and M = 5 in Table 1.", planners::NOTE),
        "Safe is a safety-zone baseline (Jin-style), not the original, whose constants are not public.".to_owned(),
        "The paper's extra distances exceed what its extra times allow at 1 m/s in all 18 cells: its orderings are targets, \
         its absolute times and distances are not."
            .to_owned(),
    ];
    notes.extend(checks.into_iter().flatten());
    Ok(PooledTable {
        id: "table4".to_owned(),
        title: "Table 4. Baseline, safety zone and ours".to_owned(),
        label_heads: ["metric", "policy"].map(str::to_owned).to_vec(),
        columns: CrowdKind::PAPER.map(|crowd| crowd.name().to_owned()).to_vec(),
        rows,
        notes,
    })
}

/// A metric's label, measure and decimals.
fn described(metric: Metric) -> (&'static str, Measure, usize) {
    match metric {
        Metric::SuccessRate => ("success rate", Measure::Success, 3),
        Metric::ExtraTime => ("extra time (s)", Measure::ExtraTime, 3),
        Metric::ExtraDistance => ("extra distance (m)", Measure::ExtraDistance, 3),
        Metric::AverageSpeed => ("average speed (m/s)", Measure::AverageSpeed, 3),
    }
}

/// Success on two realistic maps.
pub(super) fn table_5(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let (mut rows, mut references) = (Vec::new(), Vec::new());
    for (of_paper, name) in paper::TABLE_5.iter().zip(ROWS_5) {
        let evaluated = evaluator.row_at(name, deployment::run)?;
        references.extend(Reference::new(if of_paper.diversity { "M = 5" } else { "M = 1" }, &evaluated.row));
        rows.push(PooledRow {
            labels: vec![if of_paper.diversity { "yes" } else { "no" }.to_owned()],
            cells: cells(evaluated, &deployment::MAPS, Measure::Success),
            paper: vec![Some((of_paper.warehouse, None)), Some((of_paper.hospital, None))],
            decimals: 3,
            sources: sources(evaluated),
            command: Some(command("table5", name)),
            note: note(evaluated),
            planner: false,
        });
    }
    for planner in Planner::IN_TABLES {
        let sim = evaluator.policies.sim();
        let driver = Driver::Planner(planner);
        let sites = deployment::on_maps(&mut evaluator.cells, &driver, &sim, Dynamics::Kinematic)?;
        rows.push(planners::site_row(planner, &sites.into_iter().collect(), &deployment::MAPS, &references));
    }
    Ok(PooledTable {
        id: "table5".to_owned(),
        title: "Table 5. Success rate on realistic maps".to_owned(),
        label_heads: vec!["diversity".to_owned()],
        columns: deployment::MAPS.map(str::to_owned).to_vec(),
        rows,
        notes: vec![
            READING.to_owned(),
            deployment::NOTE.to_owned(),
            planners::NOTE.to_owned(),
            PAIRED.to_owned(),
        ],
    })
}

/// Success on the same maps where the robot has mass. Not of the paper.
pub(super) fn table_dynamics(evaluator: &mut RowEvaluator) -> Result<PooledTable> {
    let mut rows = Vec::new();
    let here = [(Dynamics::Kinematic, "kinematic"), (Dynamics::Rapier, "rapier")];
    for (label, name) in ROWS_WITH_MASS {
        let row = |evaluated: &Evaluated, shown: &str, sites: &[&str]| PooledRow {
            labels: [label, shown].map(str::to_owned).to_vec(),
            cells: cells(evaluated, sites, Measure::Success),
            paper: vec![None; deployment::MAPS.len()],
            decimals: 3,
            sources: sources(evaluated),
            command: Some(command("table5", name)),
            note: note(evaluated),
            planner: false,
        };
        for (dynamics, shown) in here {
            let evaluated =
                evaluator.row_at(name, |cells, found| deployment::run_with(cells, found, dynamics))?;
            rows.push(row(evaluated, shown, &deployment::sites(dynamics)));
        }
        let evaluated = evaluator.row_at(name, deployment::run_in_mujoco)?;
        rows.push(row(evaluated, MUJOCO, &deployment::MAPS_IN_MUJOCO));
    }
    let (sim, driver) = (evaluator.policies.sim(), Driver::Planner(BAR));
    let mut planner = |sites: Vec<(String, Vec<CompactEpisode>)>, shown: &str, names: &[&str]| {
        let mut row = planners::site_row(BAR, &sites.into_iter().collect(), names, &[]);
        row.labels.push(shown.to_owned());
        rows.push(row);
    };
    for (dynamics, shown) in here {
        let sites = deployment::on_maps(&mut evaluator.cells, &driver, &sim, dynamics)?;
        planner(sites, shown, &deployment::sites(dynamics));
    }
    let sites = deployment::in_mujoco(&mut evaluator.cells, &driver, Pilot::Planner(BAR), &sim)?;
    planner(sites, MUJOCO, &deployment::MAPS_IN_MUJOCO);
    let mut notes =
        vec![READING.to_owned(), deployment::NOTE_WITH_MASS.to_owned(), planners::NOTE.to_owned()];
    notes.extend(pooled_rates(&rows));
    Ok(PooledTable {
        id: "dynamics".to_owned(),
        title: "Beyond the paper: success on Table 5's maps of robots with mass".to_owned(),
        label_heads: ["robot", "dynamics"].map(str::to_owned).to_vec(),
        columns: deployment::MAPS.map(str::to_owned).to_vec(),
        rows,
        notes,
    })
}

/// What MuJoCo makes of each robot, all its training seeds together, with Wilson's interval; where
/// it has not run, the command that runs it.
fn pooled_rates(rows: &[PooledRow]) -> Option<String> {
    let of_row = |row: &PooledRow| {
        let rate = |(cell, map): (&Option<PooledCell>, &str)| {
            let seeds = &cell.as_ref()?.seeds;
            let episodes: u64 = seeds.iter().map(|seed| seed.episodes).sum();
            let won: f64 = seeds.iter().filter_map(|seed| Some(seed.value? * seed.episodes as f64)).sum();
            let won = won.round() as u64;
            let Interval { low, high } = wilson(won, episodes)?;
            Some(format!("{map} {won} of {episodes} ({low:.3} to {high:.3})"))
        };
        let rates: Option<Vec<String>> = row.cells.iter().zip(deployment::MAPS).map(rate).collect();
        Some(format!("{} {}", row.labels[0], rates?.join(", ")))
    };
    let mujoco: Vec<&PooledRow> = rows.iter().filter(|row| row.labels[1] == MUJOCO).collect();
    let rates: Vec<String> = mujoco.iter().filter_map(|row| of_row(row)).collect();
    let missing = (rates.len() < mujoco.len())
        .then(|| "cargo xtask reproduce table5 --mujoco runs what is missing".to_owned());
    let all: Vec<String> = rates.into_iter().chain(missing).collect();
    (!all.is_empty())
        .then(|| format!("mujoco, all training seeds together, with Wilson's interval: {}.", all.join("; ")))
}

fn success_table(
    evaluator: &RowEvaluator,
    id: &str,
    title: &str,
    heads: &[&str],
    rows: Vec<PooledRow>,
) -> PooledTable {
    let crowds = CrowdKind::PAPER.iter().map(|crowd| crowd.name().to_owned());
    PooledTable {
        id: id.to_owned(),
        title: title.to_owned(),
        label_heads: heads.iter().map(|head| (*head).to_owned()).collect(),
        columns: crowds.chain(["Avg".to_owned()]).collect(),
        rows,
        notes: vec![READING.to_owned(), format!("{} episodes a cell and seed.", evaluator.episodes())],
    }
}

fn success_row(
    evaluated: &Evaluated,
    name: &'static str,
    labels: Vec<String>,
    rates: [f64; 6],
    average: f64,
    table: &str,
) -> PooledRow {
    let mut cells = cells(evaluated, &CrowdKind::PAPER.each_ref().map(CrowdKind::name), Measure::Success);
    let mean = PooledCell::average(&cells.iter().map(Option::as_ref).collect::<Vec<_>>());
    cells.push(mean);
    PooledRow {
        labels,
        cells,
        paper: rates.into_iter().chain([average]).map(|figure| Some((figure, None))).collect(),
        decimals: 3,
        sources: sources(evaluated),
        command: Some(command(table, name)),
        note: note(evaluated),
        planner: false,
    }
}

/// A cell for each site; `None` where the row has no policy.
fn cells(evaluated: &Evaluated, sites: &[&str], measure: Measure) -> Vec<Option<PooledCell>> {
    sites
        .iter()
        .map(|site| {
            let seeds: Option<Vec<SeedValue>> =
                evaluated.row.seeds.iter().map(|run| seed_value(run, site, measure)).collect();
            let seeds = seeds.filter(|seeds| !seeds.is_empty())?;
            Some(PooledCell::from_seeds(seeds, measure == Measure::Success))
        })
        .collect()
}

fn seed_value(run: &SeedRun, site: &str, measure: Measure) -> Option<SeedValue> {
    let episodes = run.sites.get(site)?;
    if measure == Measure::Success {
        let successes = episodes.iter().filter(|episode| episode.outcome == Outcome::Success).count();
        return Some(SeedValue::rate(run.seed, successes as u64, episodes.len() as u64));
    }
    let values: Vec<f64> = episodes.iter().filter_map(|episode| measure.value(episode)).collect();
    Some(SeedValue::mean(run.seed, &values))
}

fn sources(evaluated: &Evaluated) -> Vec<jostle_eval::report::Source> {
    evaluated.found.iter().map(super::policies::Found::source).collect()
}

/// The command that trains a row.
fn command(table: &str, name: &'static str) -> String {
    format!("cargo xtask reproduce {table} --train --rows {}", row_spec(name).variant)
}

fn note(evaluated: &Evaluated) -> Option<String> {
    let (done, wanted) = evaluated.row.shorter?;
    Some(format!("trained for {done} updates, not for the paper's {wanted}"))
}

/// The check that no episode went farther than its time allows, in words.
fn distance_check(evaluated: &Evaluated, policy: &str) -> Option<String> {
    let scale = evaluated.found.first()?.policy.sim_config().ok()?.robot.v_max;
    let episodes: Vec<&CompactEpisode> =
        evaluated.row.seeds.iter().flat_map(|run| run.sites.values().flatten()).collect();
    let pairs = episodes.iter().map(|episode| (episode.outcome, &episode.metrics as &EpisodeMetrics));
    let check = Summary::from_episodes(f64::from(scale), pairs).distance_check;
    let worst =
        check.worst.map_or_else(|| "no success".to_owned(), |worst| format!("largest excess {worst:.1e} m"));
    Some(if check.holds() {
        format!("{policy}: extra distance ≤ v_max · extra time holds in every success ({worst}).")
    } else {
        format!(
            "{policy}: CHECK FAILED: extra distance > v_max · extra time in {} successes ({worst}).",
            check.violations
        )
    })
}
