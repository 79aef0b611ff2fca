//! Metrics and statistics against fixtures made with statsmodels, pandas and shapely (see
//! `data/README.md`).

use jostle_arena::Outcome;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};
use jostle_eval::metrics::Summary;
use jostle_eval::statistics::{Interval, PairedCounts, wilson};
use serde::Deserialize;

#[derive(Deserialize)]
struct EpisodesFile {
    dt: f64,
    goal_radius: f64,
    v_max: f64,
    cases: Vec<EpisodesCase>,
}

#[derive(Deserialize)]
struct EpisodesCase {
    name: String,
    episodes: Vec<Episode>,
    expected: EpisodesExpected,
}

#[derive(Deserialize)]
struct Episode {
    goal: [f64; 2],
    outcome: Outcome,
    positions: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
struct EpisodesExpected {
    per_episode: Vec<EpisodeMetrics>,
    summary: ExpectedSummary,
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
    extra_time: jostle_eval::metrics::MeanStd,
    extra_distance: jostle_eval::metrics::MeanStd,
    average_speed: jostle_eval::metrics::MeanStd,
}

#[derive(Deserialize)]
struct IntervalsFile {
    wilson: Vec<WilsonCase>,
    mcnemar: Vec<McnemarCase>,
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
    p_exact: f64,
    p_chi2: Option<f64>,
    p_chi2_corrected: Option<f64>,
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

fn close(what: &str, actual: Option<f64>, expected: Option<f64>) {
    match (actual, expected) {
        (Some(actual), Some(expected)) => {
            assert!((actual - expected).abs() <= 1e-9, "{what}: {actual} ≠ {expected}");
        }
        (actual, expected) => assert_eq!(actual, expected, "{what}"),
    }
}

fn close_p(what: &str, actual: Option<f64>, expected: Option<f64>) {
    match (actual, expected) {
        (Some(actual), Some(expected)) => {
            assert!((actual - expected).abs() <= 1e-6 * expected, "{what}: {actual:e} ≠ {expected:e}");
        }
        (actual, expected) => assert_eq!(actual, expected, "{what}"),
    }
}

fn ends(interval: Option<Interval>) -> [Option<f64>; 2] {
    [interval.map(|ends| ends.low), interval.map(|ends| ends.high)]
}

#[test]
fn episodes() {
    let file: EpisodesFile = serde_json::from_str(include_str!("data/episodes.json")).unwrap();
    let scale = MetricScale { dt: file.dt, goal_radius: file.goal_radius, v_max: file.v_max };
    for case in &file.cases {
        let metrics: Vec<EpisodeMetrics> = case
            .episodes
            .iter()
            .map(|e| EpisodeMetrics::from_positions(&scale, e.outcome, &e.positions, e.goal))
            .collect();
        for (actual, expected) in metrics.iter().zip(&case.expected.per_episode) {
            close(&case.name, Some(actual.time), Some(expected.time));
            close(&case.name, Some(actual.path_length), Some(expected.path_length));
            close(&case.name, Some(actual.straight_distance), Some(expected.straight_distance));
            close(&case.name, actual.extra_time, expected.extra_time);
            close(&case.name, actual.extra_distance, expected.extra_distance);
            close(&case.name, actual.average_speed, expected.average_speed);
        }
        let outcomes = case.episodes.iter().map(|e| e.outcome);
        let summary = Summary::from_episodes(file.v_max, outcomes.zip(&metrics));
        let expected = &case.expected.summary;
        assert_eq!(
            (summary.episodes, summary.success, summary.collision_wall, summary.collision_pedestrian),
            (expected.episodes, expected.success, expected.collision_wall, expected.collision_pedestrian),
        );
        assert_eq!(summary.timeout, expected.timeout);
        close(&case.name, summary.success_rate, expected.success_rate);
        let expected_ends = expected.wilson_95;
        for (actual, k) in ends(summary.wilson_95).into_iter().zip(0..) {
            close(&case.name, actual, expected_ends.map(|ends| ends[k]));
        }
        for (actual, wanted) in [
            (summary.extra_time, expected.extra_time),
            (summary.extra_distance, expected.extra_distance),
            (summary.average_speed, expected.average_speed),
        ] {
            close(&case.name, actual.mean, wanted.mean);
            close(&case.name, actual.std, wanted.std);
        }
        assert!(summary.distance_check.holds(), "{}", case.name);
    }
}

#[test]
fn intervals() {
    let file: IntervalsFile = serde_json::from_str(include_str!("data/intervals.json")).unwrap();
    for case in &file.wilson {
        for (actual, expected) in ends(wilson(case.successes, case.episodes)).into_iter().zip(case.low_high) {
            close("wilson", actual, Some(expected));
        }
    }
    for case in file.mcnemar.iter().chain(file.paired.iter().map(|case| &case.expected.test)) {
        let test = case.counts.mcnemar();
        close_p("exact", Some(test.p_exact), Some(case.p_exact));
        close_p("χ²", test.p_chi2, case.p_chi2);
        close_p("corrected χ²", test.p_chi2_corrected, case.p_chi2_corrected);
    }
    for case in &file.paired {
        let counts = PairedCounts::count(&case.first, &case.second).unwrap();
        assert_eq!(counts, case.expected.test.counts);
        close("first rate", counts.first_rate(), Some(case.expected.first_rate));
        close("second rate", counts.second_rate(), Some(case.expected.second_rate));
    }
}
