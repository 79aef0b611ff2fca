//! The metric D and the pairwise divergences against PyTorch's (`tests/data/README.md`).

use jostle_diversity::BehaviourActions;
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

#[track_caller]
fn assert_close(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-12 + 1e-10 * expected.abs(), "found {found}, expected {expected}");
}

#[test]
fn divergences_are_those_of_pytorch() {
    let file: Value = serde_json::from_str(include_str!("data/kl.json")).expect("valid JSON");
    let cases = file["cases"].as_array().expect("cases");
    assert_eq!(cases.len(), 5);
    for case in cases {
        let n_behaviours = case["tokens"].as_u64().expect("tokens") as usize;
        let (mean, log_std) = (numbers(&case["mean"]), numbers(&case["log_std"]));
        let actions = BehaviourActions::new(&mean, &log_std, n_behaviours, 2).expect("shapes fit");
        assert_close(actions.diversity(), case["D"].as_f64().expect("D"));
        let expected = numbers(&case["pairwise"]);
        actions
            .pairwise()
            .into_iter()
            .zip(expected)
            .for_each(|(found, expected)| assert_close(found, expected));
    }
}
