//! The tokens of a policy in the crowds, as `evaluate` stored them.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use jostle_eval::report::Evaluation;
use jostle_peds::CrowdKind;

use jostle_view::draw::heat::{HeatMap, Rate};

/// One grid for each policy, in the order of their first evaluation; a row for each token.
///
/// # Errors
/// Two evaluations of the same token of one policy.
pub(crate) fn heat_maps(evaluations: &[Evaluation]) -> Result<Vec<(String, HeatMap)>> {
    let mut policies: Vec<(&str, &str)> = Vec::new();
    for evaluation in evaluations {
        let id = (evaluation.policy.sha256.as_str(), evaluation.policy.name.as_str());
        if !policies.iter().any(|(sha256, _)| *sha256 == id.0) {
            policies.push(id);
        }
    }
    let grid = |(sha256, name): (&str, &str)| {
        let of_policy = evaluations.iter().filter(|evaluation| evaluation.policy.sha256 == sha256);
        Ok((name.to_owned(), heat_map(name, of_policy)?))
    };
    policies.into_iter().map(grid).collect()
}

fn heat_map<'a>(name: &str, evaluations: impl Iterator<Item = &'a Evaluation>) -> Result<HeatMap> {
    let mut rows = BTreeMap::new();
    let mut episodes: Vec<u64> = Vec::new();
    for evaluation in evaluations {
        let cells = CrowdKind::PAPER.map(|crowd| {
            let cell = evaluation.cells.iter().find(|cell| cell.crowd == crowd)?;
            episodes.push(cell.summary.episodes);
            Some(Rate { value: cell.summary.success_rate?, interval: cell.summary.wilson_95 })
        });
        let before = rows.insert(evaluation.token, cells.to_vec());
        ensure!(before.is_none(), "token {} of {name} is given twice", evaluation.token);
    }
    episodes.sort_unstable();
    let count = match (episodes.first(), episodes.last()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
        (Some(least), _) => least.to_string(),
        (None, _) => "no".to_owned(),
    };
    Ok(HeatMap {
        title: format!("{name}: success rate of each behaviour token in each crowd"),
        rows: rows.keys().map(|token| format!("z = {token}")).collect(),
        columns: CrowdKind::PAPER.map(|crowd| crowd.name().to_owned()).to_vec(),
        cells: rows.into_values().collect(),
        note: format!("{count} episodes a cell; below each rate its 95 % Wilson interval"),
    })
}
