//! The protocol's promises: outcomes, pairing, and the same bytes whatever the threads and the lock
//! step.

use crate::common::{brief, pools, seek, untrained};
use jostle_arena::{
    ArenaConfig, ArenaError, Outcome, PerRow, PolicyIdentity, Pools, Robot, RobotPolicy as _, TrainedRobot,
};
use jostle_eval::records::{Completeness, completeness};
use jostle_eval::{CellRun, Protocol, Subject};
use jostle_peds::CrowdKind;

fn run(config: &ArenaConfig, robot: &mut dyn Robot, crowd: CrowdKind, episodes: u64) -> CellRun {
    let protocol = Protocol::new(config.clone(), pools()).unwrap();
    let identity = PolicyIdentity::custom("test", "1");
    let subject = Subject { identity: &identity, token: 0 };
    protocol.evaluate(robot, subject, crowd, episodes, None, |_| ()).unwrap()
}

#[test]
fn in_an_empty_room_a_goal_seeker_arrives_and_an_untrained_policy_does_not() {
    let config = ArenaConfig { n_agents: 1, ..ArenaConfig::default() };
    let seeker = run(&config, &mut PerRow::new(seek), CrowdKind::Sf, 60);
    let summary = seeker.result.summary;
    assert_eq!((summary.success, summary.episodes), (60, 60));
    assert!(summary.distance_check.holds(), "{:?}", summary.distance_check);
    assert!(summary.extra_time.mean.unwrap() > 0.0);
    assert!(seeker.records.iter().all(|record| record.metrics.straight_distance >= 10.0 - 1e-5));

    let mut fresh = TrainedRobot::new(&untrained(9), 1, config.backend).unwrap();
    assert!(run(&config, &mut fresh, CrowdKind::Sf, 30).result.summary.success <= 3);

    let standing = run(&brief(20), &mut PerRow::new(|_: &[f32]| [0.0, 0.0]), CrowdKind::Vo, 5);
    assert!(standing.records.iter().all(|record| record.metrics.path_length == 0.0));
    let ahead = run(&config, &mut PerRow::new(|_: &[f32]| [1.0, 0.0]), CrowdKind::Sf, 40).result.summary;
    assert_eq!((ahead.collision_pedestrian, ahead.timeout), (0, 0));
    assert!(ahead.collision_wall > 30);
}

#[test]
fn episodes_start_alike_in_every_crowd_for_every_policy_and_any_n() {
    let starts = |n_agents: usize, crowd: CrowdKind, action: [f32; 2]| -> Vec<([f32; 2], [f32; 2])> {
        let config = ArenaConfig { n_agents, ..brief(2) };
        let records = run(&config, &mut PerRow::new(move |_: &[f32]| action), crowd, 8).records;
        records.iter().map(|record| (record.start, record.goal)).collect()
    };
    let expected = starts(5, CrowdKind::Nh, [0.0, 0.0]);
    for crowd in CrowdKind::PAPER {
        assert_eq!(starts(5, crowd, [1.0, 0.3]), expected, "{crowd}");
    }
    assert_eq!(starts(10, CrowdKind::Vo, [0.0, 0.0]), expected);
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn threads_and_lock_step_do_not_change_a_bit() {
    for (crowd, episodes) in
        [(CrowdKind::Sf, 40), (CrowdKind::Vo, 40), (CrowdKind::Va, 6), (CrowdKind::So, 6)]
    {
        let bytes = |threads: usize, lock_step: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let config = ArenaConfig { lock_step, ..brief(60) };
                let mut robot = TrainedRobot::new(&untrained(9), 0, config.backend).unwrap();
                serde_json::to_string(&run(&config, &mut robot, crowd, episodes).records).unwrap()
            })
        };
        let expected = bytes(1, 64);
        for (threads, lock_step) in [(2, 64), (8, 64), (2, 1), (1, 5)] {
            assert_eq!(bytes(threads, lock_step), expected, "{crowd}: {threads} threads, {lock_step} rooms");
        }
    }
}

#[test]
fn a_row_is_answered_alike_in_any_batch() {
    let mut rng = jostle_sim::Streams::new(3).stream("rows", &[]);
    let n_rows = 333;
    let rows: Vec<f32> =
        (0..n_rows * 1540).map(|_| rand::RngExt::random_range(&mut rng, -0.5..0.5)).collect();
    let mut robot = TrainedRobot::new(&untrained(9), 1, ArenaConfig::default().backend).unwrap();
    let mut together = vec![[0.0; 2]; n_rows];
    robot.act(&rows, &mut together);
    for n_together in [1, 7, 64] {
        let mut apart = vec![[0.0; 2]; n_rows];
        for (rows, actions) in rows.chunks(n_together * 1540).zip(apart.chunks_mut(n_together)) {
            robot.act(rows, actions);
        }
        assert_eq!(apart, together, "{n_together} rows a call");
    }
}

#[test]
fn a_file_is_reused_and_continued_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let protocol = Protocol::new(brief(30), Pools::default()).unwrap();
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let key = protocol.key(subject, CrowdKind::Sf);
    let evaluate = |name: &str, episodes: u64| {
        let path = folder.path().join(name);
        let mut robot = PerRow::new(seek);
        protocol.evaluate(&mut robot, subject, CrowdKind::Sf, episodes, Some(&path), |_| ()).unwrap()
    };
    evaluate("whole", 12);
    assert_eq!(evaluate("parts", 5).reused, 0);
    let text = std::fs::read(folder.path().join("parts")).unwrap();
    std::fs::write(folder.path().join("parts"), &text[..text.len() - 3]).unwrap();
    assert_eq!(
        completeness(&folder.path().join("parts"), &key, 5).unwrap(),
        Completeness::Partial { episodes: 4 }
    );
    let continued = evaluate("parts", 12);
    assert_eq!((continued.reused, continued.repaired.is_some()), (4, true));
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("whole") == read("parts"), "a continued file differs from one written at once");
    let shorter = evaluate("whole", 7);
    assert_eq!((shorter.reused, shorter.records.len()), (7, 7));
    assert_eq!(completeness(&folder.path().join("whole"), &key, 12).unwrap(), Completeness::Complete);
}

#[test]
fn what_cannot_be_tested_is_refused() {
    let identity = PolicyIdentity::custom("test", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let protocol = Protocol::new(brief(5), Pools::default()).unwrap();
    let message = |crowd, episodes, action: [f32; 2]| {
        let mut robot = PerRow::new(move |_: &[f32]| action);
        protocol.evaluate(&mut robot, subject, crowd, episodes, None, |_| ()).unwrap_err().to_string()
    };
    assert_eq!(message(CrowdKind::Sf, 0, [0.0; 2]), "episodes: found 0, expected at least 1");
    assert!(message(CrowdKind::So, 1, [0.0; 2]).starts_with("crowd SO needs a pool"));
    assert!(message(CrowdKind::Sf, 1, [f32::NAN, 0.0]).contains("episode 0, step 0"));
    let token = TrainedRobot::new(&untrained(1), 2, ArenaConfig::default().backend).err().unwrap();
    assert!(matches!(token, ArenaError::Setting { field: "token", .. }));
    let mut narrow = brief(5);
    narrow.sim.laser.beams = 64;
    let protocol = Protocol::new(narrow, pools()).unwrap();
    let mut robot = PerRow::new(seek);
    assert!(protocol.evaluate(&mut robot, subject, CrowdKind::Nh, 1, None, |_| ()).is_err());
}

#[test]
fn outcomes_are_consistent_with_their_metrics() {
    let records = run(&ArenaConfig::default(), &mut PerRow::new(seek), CrowdKind::Vo, 100).records;
    for record in &records {
        let success = record.outcome == Outcome::Success;
        assert_eq!(record.metrics.extra_time.is_some(), success);
        assert_eq!(record.outcome == Outcome::Timeout, record.steps == 400 && !success);
        assert!(record.metrics.path_length <= record.metrics.time + 1e-9);
    }
    let kinds: Vec<_> = records.iter().map(|record| record.outcome).collect();
    assert!(kinds.contains(&Outcome::Success) && kinds.contains(&Outcome::CollisionPedestrian));
}
