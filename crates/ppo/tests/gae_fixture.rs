//! Generalised advantage estimation against stable-baselines3 (`tests/data/README.md`).

use jostle_ppo::gae::{StepFate, advantages};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// The fate of step `t` of an agent, with or without a bootstrap at truncation.
fn fate(agent: &Value, t: usize, bootstrap: bool) -> StepFate {
    let flag = |name: &str| agent[name][t].as_bool().expect("a flag");
    if flag("terminated") {
        StepFate::Terminated
    } else if flag("truncated") {
        let value = agent["truncation_values"][t].as_f64().expect("V at a truncation");
        StepFate::Truncated { bootstrap_value: if bootstrap { value } else { 0.0 } }
    } else {
        StepFate::Running
    }
}

#[track_caller]
fn assert_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= 1e-9 + 1e-9 * e.abs(), "found {f}, expected {e}");
    }
}

#[test]
fn advantages_are_those_of_stable_baselines() {
    let file: Value = serde_json::from_str(include_str!("data/gae.json")).expect("valid JSON");
    let cases = file["cases"].as_array().expect("cases");
    assert_eq!(cases.len(), 5);
    for case in cases {
        let number = |name: &str| case[name].as_f64().expect("a number");
        for (bootstrap, key) in [(false, "no_bootstrap"), (true, "bootstrap")] {
            for (i, agent) in case["agents"].as_array().expect("agents").iter().enumerate() {
                let (rewards, values) = (numbers(&agent["rewards"]), numbers(&agent["values"]));
                let fates: Vec<_> = (0..rewards.len()).map(|t| fate(agent, t, bootstrap)).collect();
                let last = agent["last_value"].as_f64().expect("a number");
                let mut found = vec![0.0; rewards.len()];
                advantages(&rewards, &values, &fates, last, (number("gamma"), number("lambda")), &mut found);
                let expected = &case["expected"][key];
                assert_close(&found, &numbers(&expected["advantages"][i]));
                let returns: Vec<f64> = found.iter().zip(&values).map(|(a, v)| a + v).collect();
                assert_close(&returns, &numbers(&expected["returns"][i]));
            }
        }
    }
}
