//! Tables as they are printed.

use crate::common::{brief, pools, seek, untrained};
use jostle_arena::{PerRow, Pools};
use jostle_eval::report::{CellResult, Comparison, Evaluation, SuccessTable};
use jostle_eval::{Protocol, Subject};
use jostle_peds::CrowdKind;
use jostle_study::success_tables;

/// The first two rows of Table 1 filled by a goal seeker that goes by two identities.
fn filled() -> SuccessTable {
    let mut table = success_tables::table_1();
    let few = Pools { full: pools().full[..2].to_vec(), ..pools() };
    let protocol = Protocol::new(brief(30), few).unwrap();
    for row in 0..2 {
        let identity = untrained(row as u64).identity;
        let subject = Subject { identity: &identity, token: 0 };
        let cells = [CrowdKind::Vo, CrowdKind::Nh].map(|crowd| {
            let run = protocol.evaluate(&mut PerRow::new(seek), subject, crowd, 4, None, |_| ()).unwrap();
            let versus_baseline = (row == 1).then(|| Comparison::new(&run.records, &run.records).unwrap());
            CellResult { versus_baseline, ..run.result }
        });
        table.rows[row].cells = cells.to_vec();
        table.rows[row].policy = Some(identity);
    }
    table.rows[2].note = Some("train it by the command above".to_owned());
    table
}

#[test]
fn table_1_stands_beside_the_papers() {
    let table = filled();
    let text = table.text();
    for line in [
        "M   updates  updates/M",
        "paper  0.87         0.85  0.86  0.72  0.78         0.77  0.81",
        "M 1, updates 5000, updates/M 5000: untrained-0 (sha256 0000000000000000, config config-0, seed 0, commit 0000000, 0 updates, \
         0 transitions), z = 0, N = 5, 4 episodes per crowd",
        "M 5, updates 5000, updates/M 1000: p VO 1.000, NH 1.000",
        "M 1, updates 5000, updates/M 5000, NH: 2 policies are cycled among 4 pedestrians",
        "M 10, updates 5000, updates/M 500: no policy has been trained for this row yet",
        "M 10, updates 5000, updates/M 500: train it by the command above",
    ] {
        assert!(text.contains(line), "`{line}` is not in\n{text}");
    }
    assert_eq!(text, filled().text());
    let markdown = table.markdown();
    assert!(markdown.starts_with("## Table 1.") && markdown.contains("| 1 | 5000 | 5000 | ours |"));
    let csv = table.csv();
    assert_eq!(csv.lines().count(), 1 + 6 * 6);
    let n_fields = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().all(|line| line.split(',').count() == n_fields));
    assert_eq!(serde_json::from_str::<SuccessTable>(&table.json()).unwrap(), table);
}

#[test]
fn tables_2_and_3_have_their_rows() {
    let (second, third) = (success_tables::table_2(), success_tables::table_3());
    assert_eq!((second.rows.len(), second.rows[5].n_agents), (6, 20));
    assert!(third.text().contains("1.10") && third.text().contains("state_action"));
}

#[test]
fn an_average_needs_all_six_crowds() {
    let mut row = filled().rows.swap_remove(0);
    assert_eq!(row.average(), None);
    let cell = row.cells[0].clone();
    row.cells = CrowdKind::PAPER.map(|crowd| CellResult { crowd: crowd.into(), ..cell.clone() }).to_vec();
    assert_eq!(row.average(), cell.summary.success_rate);
}

#[test]
fn an_evaluation_has_a_row_for_each_crowd() {
    let row = filled().rows.swap_remove(0);
    let evaluation =
        Evaluation { policy: row.policy.unwrap(), token: 0, n_agents: 5, cells: row.cells, remark: None };
    assert!(evaluation.text().contains("NH: pedestrians driven by untrained-1 (sha256"));
    assert_eq!(evaluation.csv().lines().count(), 3);
    assert!(evaluation.markdown().contains("| VO | 4 |"));
    assert_eq!(serde_json::from_str::<Evaluation>(&evaluation.json()).unwrap(), evaluation);
}
