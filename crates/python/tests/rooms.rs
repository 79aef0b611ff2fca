//! The rooms that Python steps are those of the test and of training, with the same rewards.

use jostle_arena::lock_step::run_episodes;
use jostle_arena::room::RoomPlan;
use jostle_arena::{Outcome, PerRow, Pools};
use jostle_eval::Protocol;
use jostle_peds::CrowdKind;
use jostle_python::crowd_rooms::training_seed;
use jostle_python::{CrowdRooms, RobotRoom, Settings, settings};
use jostle_sim::{Rooms, StepEnd, Streams};

const WIDTH: usize = 1540;

fn rooms(crowd: CrowdKind, n_rooms: usize) -> CrowdRooms {
    let base = settings::base(None, &[]).unwrap();
    CrowdRooms::new(Settings::new(&base, crowd, None, None, Pools::default()).unwrap(), n_rooms).unwrap()
}

/// Turns to the goal and drives on.
fn seek(row: &[f32]) -> [f32; 2] {
    let (x, y) = (row[1536], row[1537]);
    [if x > 0.0 { 1.0 } else { 0.0 }, (y / x.abs().max(0.1)).clamp(-1.0, 1.0)]
}

#[test]
fn an_episode_of_the_test_ends_here_as_there() {
    for crowd in [CrowdKind::Vo, CrowdKind::Sf] {
        let base = settings::base(None, &[]).unwrap();
        let settings = Settings::new(&base, crowd, None, None, Pools::default()).unwrap();
        let protocol = Protocol::new(settings.config.clone(), settings.pools.clone()).unwrap();
        let plan = RoomPlan::new(protocol.config(), crowd).unwrap();
        let mut expected = Vec::new();
        let mut pedestrians = protocol.crowd(&plan).unwrap();
        run_episodes::<jostle_arena::ArenaError>(
            &plan,
            &mut PerRow::new(seek),
            &mut *pedestrians,
            0..6,
            |end| {
                expected.push(end);
                Ok(())
            },
        )
        .unwrap();

        let mut rooms = CrowdRooms::new(settings, 1).unwrap();
        for expected in expected {
            rooms.begin(0, 0, expected.episode).unwrap();
            let mut row = rooms.rooms()[0].robot_observation().to_vec();
            let end = loop {
                let action = seek(&row);
                if let Some(end) = rooms.step(&[action]).unwrap()[0].end {
                    break end.finished;
                }
                row.copy_from_slice(rooms.rooms()[0].robot_observation());
            };
            assert_eq!(end, expected);
        }
    }
}

#[test]
fn rewards_are_the_equations() {
    let mut rooms = rooms(CrowdKind::Sf, 1);
    let (mut ends, mut row) = (Vec::new(), vec![0.0; WIDTH]);
    for episode in 0..40 {
        rooms.begin(0, 3, episode).unwrap();
        row.copy_from_slice(rooms.rooms()[0].robot_observation());
        loop {
            let (before, [v, w]) = (row[1536].hypot(row[1537]), seek(&row));
            let step = rooms.step(&[[v, w]]).unwrap()[0];
            row.copy_from_slice(rooms.rooms()[0].robot_observation());
            let after = row[1536].hypot(row[1537]);
            let main = match step.end.map(|end| end.finished.outcome) {
                Some(Outcome::Success) => 15.0,
                Some(Outcome::CollisionWall | Outcome::CollisionPedestrian) => -15.0,
                Some(Outcome::Timeout) | None => 2.5 * (before - after),
            };
            let turning = if w.abs() > 0.7 { 0.1 * w.abs() } else { 0.0 };
            assert!((step.reward - (main - turning)).abs() < 1e-4, "{step:?}");
            if let Some(end) = step.end {
                // The last observation is of the state that ended the episode.
                assert_eq!(end.finished.outcome == Outcome::Success, after < 0.5);
                ends.push(end.finished.outcome);
                break;
            }
        }
    }
    assert!(ends.contains(&Outcome::Success) && ends.contains(&Outcome::CollisionPedestrian));
}

#[test]
fn rooms_side_by_side_are_the_rooms_alone() {
    let mut together = rooms(CrowdKind::Vo, 3);
    let mut alone: Vec<_> = (0..3).map(|_| rooms(CrowdKind::Vo, 1)).collect();
    for (seed, room) in alone.iter_mut().enumerate() {
        room.begin(0, training_seed(seed as u64), 0).unwrap();
    }
    let mut n_ended = 0;
    for _ in 0..200 {
        let steps = together.step(&[[1.0, 0.1]; 3]).unwrap();
        for (i, room) in alone.iter_mut().enumerate() {
            assert_eq!(room.step(&[[1.0, 0.1]]).unwrap()[0], steps[i]);
            assert_eq!(room.rooms()[0].robot_observation(), together.rooms()[i].robot_observation());
            if steps[i].end.is_some() {
                together.begin_next(i).unwrap();
                room.begin_next(0).unwrap();
                n_ended += 1;
            }
        }
    }
    assert!(n_ended > 2);
}

#[test]
fn what_cannot_be_done_moves_nothing() {
    let mut rooms = rooms(CrowdKind::Sf, 2);
    let before = rooms.rooms()[0].robot();
    let mut refused = |actions: &[[f32; 2]], message: &str| {
        assert_eq!(rooms.step(actions).unwrap_err().to_string(), message);
        assert_eq!(rooms.rooms()[0].robot(), before);
    };
    refused(&[[0.0; 2]], "actions: found 1 rows, expected 2, one for each room");
    refused(&[[0.0; 2], [f32::NAN, 1.0]], "actions: found (NaN, 1) for room 1, expected finite numbers");
    while rooms.step(&[[1.0, 0.0]; 2]).unwrap().iter().all(|step| step.end.is_none()) {}
    let error = rooms.step(&[[1.0, 0.0]; 2]).unwrap_err().to_string();
    assert!(error.starts_with("step: found an ended episode in room"), "{error}");
}

#[test]
fn robots_live_in_the_room_of_training_until_one_leaves() {
    let base = settings::base(None, &[]).unwrap();
    let mut training = Rooms::new(&base.sim, 1, 5, 3, &Streams::new(4)).unwrap();
    let mut room = RobotRoom::new(&base.sim, 5, 3, 4).unwrap();
    assert_eq!(room.tokens(), training.tokens());
    let mut one_has_left = false;
    while room.present().contains(&true) {
        let there = room.present().to_vec();
        let transitions = room.step(&[[1.0, 0.05]; 5]).unwrap().to_vec();
        let first_part = !one_has_left;
        if first_part {
            training.step(&[[1.0, 0.05]; 5]);
            assert_eq!(transitions, training.transitions());
        }
        for agent in 0..5 {
            let ended = transitions[agent].end != StepEnd::Running;
            assert_eq!(room.present()[agent], there[agent] && !ended);
            one_has_left |= ended;
            if first_part {
                let row = &training.observations()[agent * WIDTH..][..WIDTH];
                let row = if ended { training.final_observation(agent) } else { row };
                assert_eq!(room.observation(agent), row);
            }
        }
    }
    assert!(one_has_left);
}

#[test]
fn clones_and_snapshots_go_on_bit_for_bit() {
    for crowd in [CrowdKind::Vo, CrowdKind::Sf, CrowdKind::StopAndGo] {
        let mut original = rooms(crowd, 2);
        let mut others: Vec<CrowdRooms> = Vec::new();
        // A goal is at least 95 steps away and the time limit is 400: within 800 steps each of two
        // rooms ends an episode or more.
        let mut ends = Vec::new();
        for step in 0..800 {
            if step % 50 == 10 {
                let mut restored = rooms(crowd, 2);
                restored.step(&[[0.5, -0.5]; 2]).unwrap();
                let text = serde_json::to_string(&original.snapshot()).unwrap();
                restored.restore(&serde_json::from_str(&text).unwrap()).unwrap();
                others = vec![original.try_clone().unwrap(), restored];
            }
            let actions: Vec<[f32; 2]> =
                original.rooms().iter().map(|room| seek(room.robot_observation())).collect();
            let steps = original.step(&actions).unwrap();
            for other in &mut others {
                assert_eq!(other.step(&actions).unwrap(), steps);
                for (room, expected) in other.rooms().iter().zip(original.rooms()) {
                    assert_eq!(room.robot_observation(), expected.robot_observation());
                    assert_eq!(room.pedestrians(), expected.pedestrians());
                    assert_eq!(room.episode(), expected.episode());
                }
            }
            for (i, end) in steps.iter().enumerate().filter_map(|(i, step)| Some((i, step.end.as_ref()?))) {
                ends.push(end.finished.outcome);
                original.begin_next(i).unwrap();
                for other in &mut others {
                    other.begin_next(i).unwrap();
                }
            }
        }
        // At a goal or a crash, with copies that were made before and that went through it: not
        // only at the time limit.
        let n_early = ends.iter().filter(|outcome| **outcome != Outcome::Timeout).count();
        assert!(ends.len() >= 4 && n_early > 0, "{crowd}: {ends:?}");
    }
}

#[test]
fn a_snapshot_of_other_rooms_is_refused_and_changes_nothing() {
    let mut other = rooms(CrowdKind::Sf, 1);
    other.step(&[[1.0, 0.0]]).unwrap();
    for (mut room, part) in
        [(rooms(CrowdKind::Vo, 1), "found other settings"), (rooms(CrowdKind::Sf, 2), "found 1 rooms")]
    {
        let before = room.snapshot();
        let message = room.restore(&other.snapshot()).unwrap_err().to_string();
        assert!(message.starts_with("snapshot: ") && message.contains(part), "{message}");
        assert_eq!(room.snapshot(), before);
    }
}

#[test]
fn robots_go_on_from_clones_and_snapshots_bit_for_bit() {
    let sim = settings::base(None, &[]).unwrap().sim;
    let mut original = RobotRoom::new(&sim, 4, 3, 9).unwrap();
    let mut others: Vec<RobotRoom> = Vec::new();
    let mut step = 0;
    while original.present().contains(&true) {
        if step % 40 == 15 {
            let snapshot = original.snapshot("these".to_owned());
            let restored = RobotRoom::from_snapshot(&sim, (4, 3), "these", &snapshot).unwrap();
            others = vec![original.clone(), restored];
        }
        let actions: Vec<[f32; 2]> = (0..4).map(|agent| seek(original.observation(agent))).collect();
        let there = original.present().to_vec();
        let transitions = original.step(&actions).unwrap().to_vec();
        for other in &mut others {
            assert_eq!(other.step(&actions).unwrap(), transitions);
            for agent in (0..4).filter(|agent| there[*agent]) {
                assert_eq!(other.observation(agent), original.observation(agent));
                assert_eq!(other.whereabouts(agent), original.whereabouts(agent));
                assert_eq!(other.min_clearance(agent), original.min_clearance(agent));
            }
        }
        step += 1;
    }
    assert!(step > 55, "{step}");
    let snapshot = original.snapshot("these".to_owned());
    for (numbers, settings) in [((4, 2), "these"), ((5, 3), "these"), ((4, 3), "those")] {
        let refused = RobotRoom::from_snapshot(&sim, numbers, settings, &snapshot).err().unwrap().to_string();
        assert!(refused.starts_with("snapshot: found other settings"), "{refused}");
    }
}
