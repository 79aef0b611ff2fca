//! The paper's tables of success rates as [`SuccessTable`]s, none of their rows filled.

use jostle_eval::report::{SuccessRow, SuccessTable};

use crate::paper;

/// Table I with its six rows, none of them filled.
pub fn table_1() -> SuccessTable {
    let row = |row: &paper::BehavioursRow| {
        let labels = [row.n_behaviours, row.updates, row.updates / row.n_behaviours];
        row_of(labels.map(|label| label.to_string()).to_vec(), 5, row.rates, row.average)
    };
    SuccessTable {
        title: "Table 1. Success rate against the number of behaviours M".to_owned(),
        label_heads: ["M", "updates", "updates/M"].map(str::to_owned).to_vec(),
        rows: paper::TABLE_1.iter().map(row).collect(),
    }
}

/// Table II with its six rows, none of them filled.
pub fn table_2() -> SuccessTable {
    let row = |row: &paper::AgentsRow| {
        let diversity = if row.diversity { "yes" } else { "no" };
        let labels = vec![row.n_agents.to_string(), diversity.to_owned()];
        row_of(labels, row.n_agents as usize, row.rates, row.average)
    };
    SuccessTable {
        title: "Table 2. Success rate against the number of agents N".to_owned(),
        label_heads: ["N", "diversity"].map(str::to_owned).to_vec(),
        rows: paper::TABLE_2.iter().map(row).collect(),
    }
}

/// Table III with its four rows, none of them filled.
pub fn table_3() -> SuccessTable {
    let row = |row: &paper::IntrinsicRow| {
        let labels = vec![row.intrinsic_reward.to_owned(), format!("{:.2}", row.alpha)];
        let diversity = Some((None, row.diversity));
        SuccessRow { diversity, ..row_of(labels, 5, row.rates, row.average) }
    };
    SuccessTable {
        title: "Table 3. Success rate against the intrinsic reward".to_owned(),
        label_heads: ["intrinsic reward", "α"].map(str::to_owned).to_vec(),
        rows: paper::TABLE_3.iter().map(row).collect(),
    }
}

fn row_of(labels: Vec<String>, n_agents: usize, rates: [f64; 6], average: f64) -> SuccessRow {
    SuccessRow {
        labels,
        policy: None,
        token: 0,
        n_agents,
        cells: Vec::new(),
        paper: Some((rates, average)),
        diversity: None,
        note: None,
    }
}
