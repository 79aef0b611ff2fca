//! Traces tell of the episodes that records tell of.

use crate::common::{brief, pools, seek};
use glam::Vec2;
use jostle_arena::identity::PolicyIdentity;
use jostle_arena::replay::{EpisodeTrace, trace_episodes};
use jostle_arena::room::RoomPlan;
use jostle_arena::{Outcome, PerRow};
use jostle_eval::{Protocol, Subject};
use jostle_peds::CrowdKind;

const STEP_LIMIT: u32 = 60;

fn traces(protocol: &Protocol, crowd: CrowdKind, episodes: &[u64]) -> Vec<EpisodeTrace> {
    let plan = RoomPlan::new(protocol.config(), crowd).unwrap();
    let mut pedestrians = protocol.crowd(&plan).unwrap();
    trace_episodes(&plan, &mut PerRow::new(seek), &mut *pedestrians, episodes, 128).unwrap()
}

#[test]
fn a_trace_ends_as_its_record_says() {
    let protocol = Protocol::new(brief(STEP_LIMIT), pools()).unwrap();
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    for crowd in [CrowdKind::Sf, CrowdKind::Va] {
        let mut robot = PerRow::new(seek);
        let records = protocol.evaluate(&mut robot, subject, crowd, 5, None, |_| {}).unwrap().records;
        // Any selection, in any order.
        let traces = traces(&protocol, crowd, &[4, 1, 2, 1]);
        assert_eq!(traces.iter().map(|trace| trace.finished.episode).collect::<Vec<_>>(), [1, 2, 4]);
        for trace in traces {
            let record = &records[trace.finished.episode as usize];
            assert_eq!((trace.finished.outcome, trace.finished.steps), (record.outcome, record.steps));
            assert_eq!((trace.finished.metrics, trace.finished.goal), (record.metrics, record.goal));
            check(&trace);
        }
    }
}

/// Checks that hold in every trace.
fn check(trace: &EpisodeTrace) {
    let finished = &trace.finished;
    assert_eq!(trace.frames.len() as u64, finished.steps + 1);
    assert_eq!(trace.frames[0].robot.position.to_array(), finished.start);
    assert_eq!(trace.pedestrian_token, trace.crowd.built_in().unwrap().is_learned().then_some(0));
    for frame in &trace.frames {
        assert_eq!((frame.ranges.len(), frame.pedestrians.len(), trace.speed_factors.len()), (128, 4, 4));
        assert_eq!(frame.robot.goal.to_array(), finished.goal);
    }
    // Each step follows from the velocity that the trace gives.
    for pair in trace.frames.windows(2) {
        let moved = pair[1].robot.position - pair[0].robot.position;
        assert!(
            (moved - Vec2::from_angle(pair[0].robot.heading) * pair[1].velocity[0] * 0.1).length() < 1e-4
        );
    }
    let last = trace.frames.last().unwrap();
    let reached = last.robot.position.distance(last.robot.goal) < 0.5;
    match finished.outcome {
        Outcome::Success => assert!(reached),
        Outcome::CollisionWall | Outcome::CollisionPedestrian => assert!(last.min_range < 0.5),
        Outcome::Timeout => assert!(!reached && finished.steps == u64::from(STEP_LIMIT)),
    }
}
