//! KL divergences between behaviours and the metric D.

use anyhow::Result;
use jostle_diversity::BehaviourActions;
use serde::Deserialize;

use super::verdict::Verdict;

/// Tolerance in double precision (absolute, relative).
const DOUBLE: (f64, f64) = (1e-12, 1e-10);

#[derive(Deserialize)]
pub(crate) struct KlFile {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    tokens: usize,
    mean: Vec<Vec<[f64; 2]>>,
    log_std: Vec<Vec<[f64; 2]>>,
    pairwise: Vec<Vec<f64>>,
    #[serde(rename = "D")]
    d: f64,
}

/// Checks every pair and D of every case.
pub(crate) fn check(file: &KlFile, verdict: &mut Verdict) -> Result<()> {
    for case in &file.cases {
        let flat =
            |states: &[Vec<[f64; 2]>]| states.iter().flatten().flatten().copied().collect::<Vec<f64>>();
        let (mean, log_std) = (flat(&case.mean), flat(&case.log_std));
        let actions = BehaviourActions::new(&mean, &log_std, case.tokens, 2)?;
        let expected: Vec<f64> = case.pairwise.iter().flatten().copied().collect();
        verdict.all_close(
            actions.pairwise().into_iter(),
            expected.into_iter(),
            DOUBLE,
            &format!("{}: pairwise", case.name),
        );
        verdict.close(actions.diversity(), case.d, DOUBLE.0, DOUBLE.1, || format!("{}: D", case.name));
    }
    Ok(())
}
