//! Learning curves: measures over a window of updates, and bands over the seeds of one recipe.

use std::collections::BTreeMap;

use jostle_runs::log::RunLog;

/// Points of a curve at most; more cannot be seen.
const POINTS: usize = 400;

/// Runs that differ in their seed alone.
pub struct Group<'a> {
    /// Their name in the legend.
    pub label: String,
    runs: Vec<&'a RunLog>,
}

/// Groups runs by everything but the seed, in the order of their first member. Runs that are to
/// make more updates than others stand alone: a band ends where its shortest run does.
pub fn groups(runs: &[RunLog]) -> Vec<Group<'_>> {
    let mut order: Vec<Group<'_>> = Vec::new();
    let mut place: BTreeMap<(String, u64), usize> = BTreeMap::new();
    for run in runs {
        let at = *place.entry((run.recipe(), run.config.updates)).or_insert(order.len());
        if at == order.len() {
            order.push(Group { label: run.name.clone(), runs: Vec::new() });
        }
        order[at].runs.push(run);
    }
    for group in &mut order {
        if group.runs.len() > 1 {
            group.label = format!("{} and {} more seeds", group.label, group.runs.len() - 1);
        }
    }
    order
}

/// A curve: the mean over seeds and, with more than one, the least and the greatest.
pub struct Curve {
    /// Its group.
    pub group: usize,
    /// True for a dashed line.
    pub dashed: bool,
    /// Place on the axis, mean, least, greatest.
    pub points: Vec<[f64; 4]>,
}

/// One picture of the page.
pub struct Panel {
    /// The name of the measure.
    pub title: String,
    /// The whole range, where it is known; else it follows from the data.
    pub range: Option<(f64, f64)>,
    /// A level to compare with, such as that of guessing, for each number of behaviours that
    /// occurs.
    pub levels: Vec<f64>,
    /// One for each group that has the measure.
    pub curves: Vec<Curve>,
    /// The text where there is no curve.
    pub empty: &'static str,
}

/// The quantity along the x axis.
#[derive(Clone, Copy)]
pub enum Axis {
    /// Updates, from 0 to so many.
    Updates(usize),
    /// Transitions from the first number to the second, on a logarithmic scale.
    Transitions(f64, f64),
    /// Processes of a run from the first number to the second, on a logarithmic scale.
    Ranks(f64, f64),
}

/// All that is drawn on one page.
pub struct Panels {
    /// Names of the groups, in the order of their colours.
    pub labels: Vec<String>,
    /// The panels, from left to right and from top to bottom.
    pub panels: Vec<Panel>,
    /// The horizontal axis, the same for all.
    pub axis: Axis,
}

/// The six panels of some groups.
pub fn panels(groups: &[Group<'_>], window: usize) -> Panels {
    let updates = groups.iter().flat_map(|group| &group.runs).map(|run| run.reports.len()).max().unwrap_or(1);
    let mut levels: Vec<usize> =
        groups.iter().map(|group| behaviours(group)).filter(|behaviours| *behaviours > 1).collect();
    levels.sort_unstable();
    levels.dedup();
    let any = |_: &Group<'_>| true;
    // A discriminator of one behaviour has nothing to tell apart.
    let several = |group: &Group<'_>| behaviours(group) > 1;
    let of = |measure: &Measure<'_>, dashed, shown: &dyn Fn(&Group<'_>) -> bool| -> Vec<Curve> {
        let chosen = groups.iter().enumerate().filter(|(_, group)| shown(group));
        chosen.map(|(index, group)| Curve { group: index, dashed, points: points(group, measure) }).collect()
    };
    let empty = "nothing to show: one behaviour";
    let panel =
        |title: &str, range, levels, curves| Panel { title: title.to_owned(), range, levels, curves, empty };
    let both = |first, second| {
        [of(first, false, &several), of(second, true, &several)].into_iter().flatten().collect()
    };
    // The curves that are shipped do not hold the return.
    let returns = of(&|run, end| run.mean(end, window, |r| r.episode_return), false, &any);
    let (reward, rewards) = if returns.iter().all(|curve| curve.points.is_empty()) {
        ("Task reward of a step", of(&|run, end| run.mean(end, window, |r| Some(r.task_reward)), false, &any))
    } else {
        ("Return of an episode (task reward)", returns)
    };
    let panels = vec![
        panel(
            "Success of training episodes",
            Some((0.0, 1.0)),
            vec![],
            of(&|run, end| run.success(end, window), false, &any),
        ),
        panel(reward, None, vec![], rewards),
        panel(
            "D: mean KL between behaviours (nats)",
            None,
            vec![],
            of(&|run, end| run.mean(end, window, |r| Some(r.diversity)), false, &several),
        ),
        panel(
            "Discriminator loss (nats): q(z|s,a) solid, q(z|s) dashed",
            None,
            levels.iter().map(|m| (*m as f64).ln()).collect(),
            both(
                &|run, end| run.mean(end, window, |r| Some(r.discriminator_state_action.loss)),
                &|run, end| run.mean(end, window, |r| Some(r.discriminator_state.loss)),
            ),
        ),
        panel(
            "Discriminator accuracy: q(z|s,a) solid, q(z|s) dashed",
            Some((0.0, 1.0)),
            levels.iter().map(|m| 1.0 / *m as f64).collect(),
            both(
                &|run, end| run.mean(end, window, |r| Some(r.discriminator_state_action.accuracy)),
                &|run, end| run.mean(end, window, |r| Some(r.discriminator_state.accuracy)),
            ),
        ),
        panel(
            "Intrinsic reward of a step, before α",
            None,
            vec![0.0],
            of(&|run, end| run.mean(end, window, |r| Some(r.intrinsic_reward)), false, &several),
        ),
    ];
    Panels {
        labels: groups.iter().map(|group| group.label.clone()).collect(),
        panels,
        axis: Axis::Updates(updates),
    }
}

type Measure<'a> = dyn Fn(&RunLog, usize) -> Option<f64> + 'a;

fn behaviours(group: &Group<'_>) -> usize {
    group.runs[0].config.n_behaviours
}

/// As far as every seed of the group has come.
fn points(group: &Group<'_>, measure: &Measure<'_>) -> Vec<[f64; 4]> {
    let common = group.runs.iter().map(|run| run.reports.len()).min().unwrap_or(0);
    let step = common.div_ceil(POINTS).max(1);
    // The last update is always among them.
    let mut ends: Vec<usize> = (0..common).step_by(step).map(|back| common - back).collect();
    ends.reverse();
    let point = |end: usize| {
        let values: Option<Vec<f64>> = group.runs.iter().map(|run| measure(run, end)).collect();
        let values = values?;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some([end as f64, mean, least, greatest])
    };
    ends.into_iter().filter_map(point).collect()
}
