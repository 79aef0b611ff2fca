//! Generalised advantage estimation, with and without a bootstrap value at truncation.

use jostle_ppo::gae::{StepFate, advantages};
use serde::Deserialize;

use super::verdict::Verdict;

/// Tolerance in double precision (absolute, relative).
const DOUBLE: (f64, f64) = (1e-9, 1e-9);

#[derive(Deserialize)]
pub(crate) struct GaeFile {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    gamma: f64,
    lambda: f64,
    agents: Vec<Agent>,
    expected: Expected,
}

#[derive(Deserialize)]
struct Agent {
    rewards: Vec<f64>,
    values: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    truncation_values: Vec<Option<f64>>,
    last_value: f64,
}

#[derive(Deserialize)]
struct Expected {
    no_bootstrap: Option<Outcome>,
    bootstrap: Option<Outcome>,
}

#[derive(Deserialize)]
struct Outcome {
    advantages: Vec<Vec<f64>>,
    returns: Vec<Vec<f64>>,
}

/// Checks every agent of every case in both variants.
pub(crate) fn check(file: &GaeFile, verdict: &mut Verdict) {
    for case in &file.cases {
        let variants = [(false, &case.expected.no_bootstrap), (true, &case.expected.bootstrap)];
        for (bootstrap, expected) in variants {
            let Some(expected) = expected else { continue };
            let word = if bootstrap { "bootstrap" } else { "no bootstrap" };
            let (n, found) = (case.agents.len(), expected.advantages.len().min(expected.returns.len()));
            verdict.same(&found, &n, || format!("{}: agents of the expected outcome", case.name));
            for (index, agent) in case.agents.iter().enumerate().take(found) {
                let name = format!("{} ({word}) agent {index}", case.name);
                let outcome = (&expected.advantages[index][..], &expected.returns[index][..]);
                check_agent(agent, (case.gamma, case.lambda), bootstrap, outcome, &name, verdict);
            }
        }
    }
}

fn check_agent(
    agent: &Agent,
    discounts: (f64, f64),
    bootstrap: bool,
    (expected, returns): (&[f64], &[f64]),
    name: &str,
    verdict: &mut Verdict,
) {
    let n = agent.rewards.len();
    let lengths =
        [agent.values.len(), agent.terminated.len(), agent.truncated.len(), agent.truncation_values.len()];
    if lengths.iter().any(|&length| length != n) {
        verdict.problem(format!("{name}: sequences of different lengths"));
        return;
    }
    let fates: Vec<StepFate> = (0..n).map(|t| fate(agent, t, bootstrap)).collect();
    let mut actual = vec![0.0; n];
    advantages(&agent.rewards, &agent.values, &fates, agent.last_value, discounts, &mut actual);
    let sums: Vec<f64> = actual.iter().zip(&agent.values).map(|(a, v)| a + v).collect();
    verdict.all_close(actual.into_iter(), expected.iter().copied(), DOUBLE, &format!("{name}: advantages"));
    verdict.all_close(sums.into_iter(), returns.iter().copied(), DOUBLE, &format!("{name}: returns"));
}

/// If both flags are set, terminated wins.
fn fate(agent: &Agent, t: usize, bootstrap: bool) -> StepFate {
    match (agent.terminated[t], agent.truncated[t]) {
        (true, _) => StepFate::Terminated,
        (false, true) if bootstrap => {
            // A truncation without a value is a damaged fixture; NaN makes it fail.
            StepFate::Truncated { bootstrap_value: agent.truncation_values[t].unwrap_or(f64::NAN) }
        }
        (false, true) => StepFate::Truncated { bootstrap_value: 0.0 },
        (false, false) => StepFate::Running,
    }
}
