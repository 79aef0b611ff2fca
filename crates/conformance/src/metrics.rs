//! Episode metrics, their summaries, Wilson intervals and paired tests.

use anyhow::{Context as _, Result};
use jostle_arena::Outcome;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};
use jostle_eval::metrics::{MeanStd, Summary};
use jostle_eval::statistics::{Interval, Mcnemar, PairedCounts, wilson};
use serde::Deserialize;

use super::verdict::Verdict;

const TOLERANCE: f64 = 1e-9;
/// Relative tolerance of p-values, which may be very small.
const P_VALUE: f64 = 1e-6;

#[derive(Deserialize)]
pub(crate) struct EpisodesFile {
    #[serde(flatten)]
    scale: MetricScale,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    episodes: Vec<Episode>,
    expected: Expected,
}

#[derive(Deserialize)]
struct Episode {
    goal: [f64; 2],
    outcome: Outcome,
    positions: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
struct Expected {
    summary: ExpectedSummary,
    per_episode: Vec<EpisodeMetrics>,
}

#[derive(Deserialize)]
struct ExpectedSummary {
    episodes: u64,
    success: u64,
    collision_wall: u64,
    collision_pedestrian: u64,
    timeout: u64,
    success_rate: Option<f64>,
    wilson_95: Option<[f64; 2]>,
    extra_time: MeanStd,
    extra_distance: MeanStd,
    average_speed: MeanStd,
}

/// Checks each episode's metrics and the summaries.
pub(crate) fn check_episodes(file: &EpisodesFile, verdict: &mut Verdict) -> Result<()> {
    for case in &file.cases {
        let mut found = Vec::with_capacity(case.episodes.len());
        for episode in &case.episodes {
            anyhow::ensure!(!episode.positions.is_empty(), "{}: an episode without positions", case.name);
            let metrics = EpisodeMetrics::from_positions(
                &file.scale,
                episode.outcome,
                &episode.positions,
                episode.goal,
            );
            found.push((episode.outcome, metrics));
        }
        let (actual, expected) = (found.len(), case.expected.per_episode.len());
        verdict.same(&actual, &expected, || format!("{}: number of episodes", case.name));
        for (index, ((_, actual), expected)) in found.iter().zip(&case.expected.per_episode).enumerate() {
            check_episode(actual, expected, &format!("{}[{index}]", case.name), verdict);
        }
        let summary = Summary::from_episodes(
            file.scale.v_max,
            found.iter().map(|(outcome, metrics)| (*outcome, metrics)),
        );
        check_summary(&summary, &case.expected.summary, &case.name, verdict);
    }
    Ok(())
}

/// A field's name, and how it is read.
type Field = (&'static str, fn(&EpisodeMetrics) -> Option<f64>);

fn check_episode(actual: &EpisodeMetrics, expected: &EpisodeMetrics, name: &str, verdict: &mut Verdict) {
    let fields: [Field; 6] = [
        ("time", |m| Some(m.time)),
        ("path_length", |m| Some(m.path_length)),
        ("straight_distance", |m| Some(m.straight_distance)),
        ("extra_time", |m| m.extra_time),
        ("extra_distance", |m| m.extra_distance),
        ("average_speed", |m| m.average_speed),
    ];
    for (field, value) in fields {
        verdict.close_or_none(value(actual), value(expected), TOLERANCE, &format!("{name}: {field}"));
    }
}

fn check_summary(actual: &Summary, expected: &ExpectedSummary, name: &str, verdict: &mut Verdict) {
    let counts = [
        ("episodes", actual.episodes, expected.episodes),
        ("success", actual.success, expected.success),
        ("collision_wall", actual.collision_wall, expected.collision_wall),
        ("collision_pedestrian", actual.collision_pedestrian, expected.collision_pedestrian),
        ("timeout", actual.timeout, expected.timeout),
    ];
    for (field, actual, expected) in counts {
        verdict.same(&actual, &expected, || format!("{name}: {field}"));
    }
    let interval = actual.wilson_95;
    let numbers = [
        ("success_rate", actual.success_rate, expected.success_rate),
        ("wilson_95 low", interval.map(|i| i.low), expected.wilson_95.map(|i| i[0])),
        ("wilson_95 high", interval.map(|i| i.high), expected.wilson_95.map(|i| i[1])),
        ("extra_time mean", actual.extra_time.mean, expected.extra_time.mean),
        ("extra_time std", actual.extra_time.std, expected.extra_time.std),
        ("extra_distance mean", actual.extra_distance.mean, expected.extra_distance.mean),
        ("extra_distance std", actual.extra_distance.std, expected.extra_distance.std),
        ("average_speed mean", actual.average_speed.mean, expected.average_speed.mean),
        ("average_speed std", actual.average_speed.std, expected.average_speed.std),
    ];
    for (field, actual, expected) in numbers {
        verdict.close_or_none(actual, expected, TOLERANCE, &format!("{name}: {field}"));
    }
}

/// A group that a file does not hold is not checked.
#[derive(Deserialize)]
pub(crate) struct IntervalsFile {
    #[serde(default)]
    wilson: Vec<WilsonCase>,
    #[serde(default)]
    mcnemar: Vec<McnemarCase>,
    #[serde(default)]
    paired: Vec<PairedCase>,
}

#[derive(Deserialize)]
struct WilsonCase {
    successes: u64,
    episodes: u64,
    low_high: [f64; 2],
}

#[derive(Deserialize)]
struct McnemarCase {
    #[serde(flatten)]
    counts: PairedCounts,
    #[serde(flatten)]
    expected: Mcnemar,
}

#[derive(Deserialize)]
struct PairedCase {
    first: Vec<bool>,
    second: Vec<bool>,
    expected: PairedExpected,
}

#[derive(Deserialize)]
struct PairedExpected {
    #[serde(flatten)]
    test: McnemarCase,
    first_rate: f64,
    second_rate: f64,
}

/// Checks intervals, tests on counts, and tests on paired outcomes.
pub(crate) fn check_intervals(file: &IntervalsFile, verdict: &mut Verdict) -> Result<()> {
    for case in &file.wilson {
        let name = format!("wilson {}/{}", case.successes, case.episodes);
        anyhow::ensure!(case.successes <= case.episodes, "{name}: more successes than episodes");
        let Interval { low, high } =
            wilson(case.successes, case.episodes).context("an interval of no episode")?;
        verdict.close(low, case.low_high[0], TOLERANCE, 0.0, || format!("{name} low"));
        verdict.close(high, case.low_high[1], TOLERANCE, 0.0, || format!("{name} high"));
    }
    for (index, case) in file.mcnemar.iter().enumerate() {
        check_mcnemar(&case.counts, &case.expected, &format!("mcnemar[{index}]"), verdict);
    }
    for (index, case) in file.paired.iter().enumerate() {
        let name = format!("paired[{index}]");
        let counts = PairedCounts::count(&case.first, &case.second).context("lists of different lengths")?;
        let expected = &case.expected;
        verdict.same(&counts, &expected.test.counts, || format!("{name}: counts"));
        check_mcnemar(&counts, &expected.test.expected, &name, verdict);
        verdict.close_or_none(
            counts.first_rate(),
            Some(expected.first_rate),
            TOLERANCE,
            &format!("{name}: first_rate"),
        );
        verdict.close_or_none(
            counts.second_rate(),
            Some(expected.second_rate),
            TOLERANCE,
            &format!("{name}: second_rate"),
        );
    }
    Ok(())
}

fn check_mcnemar(counts: &PairedCounts, expected: &Mcnemar, name: &str, verdict: &mut Verdict) {
    let actual = counts.mcnemar();
    let p_values = [
        ("p_exact", Some(actual.p_exact), Some(expected.p_exact)),
        ("p_chi2", actual.p_chi2, expected.p_chi2),
        ("p_chi2_corrected", actual.p_chi2_corrected, expected.p_chi2_corrected),
    ];
    for (field, actual, expected) in p_values {
        match (actual, expected) {
            // Relative alone: p-values down to 1e-18 would all pass an absolute tolerance.
            (Some(a), Some(e)) => verdict.close(a, e, 0.0, P_VALUE, || format!("{name}: {field}")),
            _ => verdict.close_or_none(actual, expected, TOLERANCE, &format!("{name}: {field}")),
        }
    }
}
