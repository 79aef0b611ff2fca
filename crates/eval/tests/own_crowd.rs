//! A crowd of one's own: its name, visibility and version reach keys, records and rooms; nobody
//! takes it for a built-in one.

use crate::common::{brief, seek};
use jostle_arena::room::RoomPlan;
use jostle_arena::{PerRow, PolicyIdentity, Pools};
use jostle_eval::records::read_records;
use jostle_eval::report::evaluation::Evaluation;
use jostle_eval::{CellRun, EvalError, Protocol, Subject};
use jostle_peds::{Command, Crowd, CrowdKind, CrowdName, PedsError, RoomView, Visibility};

/// Walks away from the robot where it sees it, else stands.
struct Shy {
    name: CrowdName,
    sees_robot: bool,
    version: &'static str,
    seen: u64,
}

impl Shy {
    fn new(sees_robot: bool) -> Self {
        Self { name: CrowdName::new("shy").unwrap(), sees_robot, version: "1", seen: 0 }
    }
}

impl Crowd for Shy {
    fn name(&self) -> CrowdName {
        self.name
    }

    fn senses_by_laser(&self) -> bool {
        false
    }

    fn visibility(&self) -> Visibility {
        Visibility { pedestrians: false, robot: self.sees_robot }
    }

    fn version(&self) -> &str {
        self.version
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], motions: &mut [Command]) -> Result<(), PedsError> {
        self.seen += rooms.iter().map(|room| room.others.len() as u64).sum::<u64>();
        motions.fill(Command::STILL);
        Ok(())
    }
}

fn run(crowd: &mut Shy, file: Option<&std::path::Path>) -> Result<CellRun, EvalError> {
    let identity = PolicyIdentity::custom("seek", "1");
    let protocol = Protocol::new(brief(60), Pools::default()).unwrap();
    let subject = Subject { identity: &identity, token: 0 };
    protocol.evaluate_among(&mut PerRow::new(seek), subject, crowd, 6, file, |_| ())
}

#[test]
fn its_visibility_reaches_the_room() {
    let (mut seeing, mut blind) = (Shy::new(true), Shy::new(false));
    let plan = RoomPlan::among(&brief(60), &seeing).unwrap();
    assert_eq!(plan.visibility, Visibility { pedestrians: false, robot: true });
    assert_eq!((plan.crowd.as_str(), plan.senses_by_laser), ("shy", false));
    run(&mut seeing, None).unwrap();
    run(&mut blind, None).unwrap();
    assert!(seeing.seen > 60 && blind.seen == 0, "{} and {}", seeing.seen, blind.seen);
}

#[test]
fn its_name_is_in_records_and_reports_and_its_version_in_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cell.ndjson");
    let first = run(&mut Shy::new(true), Some(&file)).unwrap();
    assert_eq!(first.result.crowd, CrowdName::new("shy").unwrap());
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.lines().all(|line| line.contains(r#""crowd":"shy""#)), "{text}");
    assert_eq!(read_records(&file).unwrap().records, first.records);
    assert_eq!(run(&mut Shy::new(true), Some(&file)).unwrap().reused, 6);
    let policy = PolicyIdentity::custom("seek", "1");
    let report = Evaluation { policy, token: 0, n_agents: 5, cells: vec![first.result], remark: None };
    for text in [report.text(), report.markdown(), report.csv(), report.json()] {
        assert!(text.contains("shy"), "{text}");
    }
    assert!(report.text().contains("shy: a crowd of the user's own; not of the paper"), "{}", report.text());
    for mut other in [Shy { version: "2", ..Shy::new(true) }, Shy::new(false)] {
        let error = run(&mut other, Some(&file)).unwrap_err();
        assert!(matches!(error, EvalError::OtherCell { .. }), "{error}");
    }
}

#[test]
fn a_name_alone_makes_no_crowd_and_a_built_in_name_is_refused() {
    let plan = RoomPlan::among(&brief(60), &Shy::new(true)).unwrap();
    let protocol = Protocol::new(brief(60), Pools::default()).unwrap();
    let error = protocol.crowd(&plan).err().unwrap().to_string();
    assert!(error.starts_with("crowd shy is no built-in one"), "{error}");
    let mut posing = Shy { name: CrowdKind::Sf.into(), ..Shy::new(true) };
    let error = run(&mut posing, None).unwrap_err().to_string();
    assert_eq!(error, "crowd: found SF, expected a name of its own (see `CrowdName::new`)");
}
