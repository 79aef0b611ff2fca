//! Hand-made rooms with a training crowd: who sees whom, who crashes, who is stopped.

use crate::config::{FRAMES, SimConfig};
use crate::episode::{Outcome, StepEnd};
use crate::geometry::{Pose, Shape};
use crate::rng::Streams;
use crate::rooms::Rooms;
use crate::traits::{Role, TrainingCrowd, Traits};
use glam::Vec2;
use std::f32::consts::PI;

/// All but the first are blind.
fn all_blind() -> TrainingCrowd {
    TrainingCrowd { blind: 1.0, stall_limit: 3, ..TrainingCrowd::default() }
}

/// One room without noise, whose agents stand at the given places (x, y, heading) with goals out of
/// the way.
fn room(crowd: &TrainingCrowd, places: &[(f32, f32, f32)]) -> Rooms {
    let mut config = SimConfig::default();
    config.laser.noise_std = 0.0;
    let mut rooms = Rooms::with_crowd(&config, crowd, 1, places.len(), 1, &Streams::new(5)).expect("rooms");
    let room = &mut rooms.rooms[0];
    for (agent, &(x, y, heading)) in places.iter().enumerate() {
        let (position, goal) = (Vec2::new(x, y), Vec2::new(9.0, -9.0));
        room.world.set_pose(agent, Pose::new(position, heading));
        room.episodes[agent].goal = goal;
        room.episodes[agent].goal_distance = goal.distance(position);
    }
    rooms
}

/// The newest scan of an agent, m.
fn newest_scan(rooms: &Rooms, agent: usize) -> Vec<f32> {
    let (beams, width) = (rooms.config().laser.beams, rooms.config().observation_len());
    let row = &rooms.observations()[agent * width..][..FRAMES * beams];
    row[(FRAMES - 1) * beams..].iter().map(|x| (x + 0.5) * 10.0).collect()
}

fn end(rooms: &Rooms, agent: usize) -> StepEnd {
    rooms.transitions()[agent].end
}

#[test]
fn a_blind_agents_scan_shows_nobody() {
    let mut rooms = room(&all_blind(), &[(0.0, 0.0, 0.0), (2.0, 0.0, PI), (4.0, 1.0, 0.0)]);
    assert_eq!([0, 1, 2].map(|agent| rooms.role(agent)), [Role::Learner, Role::Blind, Role::Blind]);
    rooms.step(&[[0.0; 2]; 3]);
    let seeing = newest_scan(&rooms, 0);
    assert!((seeing[0] - 1.75).abs() < 1e-4, "the front of the body at 2 m: {}", seeing[0]);
    // Alone in the same place it reads the same.
    let mut alone = room(&all_blind(), &[(-8.0, -8.0, 0.0), (2.0, 0.0, PI)]);
    alone.remove(0);
    alone.step(&[[0.0; 2]; 2]);
    assert_eq!(newest_scan(&rooms, 1), newest_scan(&alone, 1));
    assert_eq!(newest_scan(&rooms, 1)[0], 10.0);
}

#[test]
fn the_first_scan_of_a_blind_episode_shows_nobody() {
    let mut rooms = room(&all_blind(), &[(0.0, 0.0, 0.0), (2.0, 0.0, PI)]);
    rooms.rooms[0].episodes[1].steps = rooms.config().episode.step_limit - 1;
    rooms.step(&[[0.0; 2]; 2]);
    assert_eq!(end(&rooms, 1), StepEnd::Ended(Outcome::Timeout));
    let [scan, unseen] = [true, false].map(|visible| {
        let room = &rooms.rooms[0];
        let mut ranges = vec![0.0; rooms.config().laser.beams];
        let mut laser = crate::laser::Laser::new(&rooms.config().laser).expect("laser");
        laser.scan(&room.world, crate::laser::Sensor::Body(1), |_| visible, &mut ranges);
        ranges
    });
    assert_ne!(scan, unseen, "the learner is within range of wherever the other is placed");
    for (found, expected) in newest_scan(&rooms, 1).iter().zip(&unseen) {
        assert!((found - expected).abs() < 1e-5);
    }
}

#[test]
fn a_learner_that_a_blind_agent_runs_into_crashes_and_the_blind_one_goes_on() {
    let mut rooms = room(&all_blind(), &[(0.0, 0.0, 0.0), (1.0, 0.0, PI)]);
    // The front of the blind body is at 0.75 m, and 0.1 m nearer after each step.
    for step in 1..=3 {
        rooms.step(&[[0.0; 2], [1.0, 0.0]]);
        let expected = if step < 3 { StepEnd::Running } else { StepEnd::Ended(Outcome::CollisionPedestrian) };
        assert_eq!((end(&rooms, 0), end(&rooms, 1)), (expected, StepEnd::Running), "step {step}");
    }
    assert_eq!(rooms.transitions()[0].role, Role::Learner);
    assert_eq!(rooms.transitions()[1].role, Role::Blind);
    assert_eq!(rooms.role(0), Role::Learner, "the first agent of a room always learns");
}

#[test]
fn blind_agents_that_block_one_another_are_taken_away_after_the_limit() {
    let mut rooms = room(&all_blind(), &[(-8.0, 8.0, 0.0), (-0.275, 0.0, 0.0), (0.275, 0.0, PI)]);
    let forward = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]];
    rooms.step(&forward);
    rooms.step(&forward);
    assert_eq!((end(&rooms, 1), end(&rooms, 2)), (StepEnd::Running, StepEnd::Running));
    // A step in which it could go, here by standing, starts the count anew.
    rooms.step(&[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]);
    let collision = StepEnd::Ended(Outcome::CollisionPedestrian);
    assert_eq!((end(&rooms, 1), end(&rooms, 2)), (StepEnd::Running, collision));
}

#[test]
fn a_blind_agent_crashes_into_a_wall_by_its_own_scan() {
    let mut rooms = room(&all_blind(), &[(-8.0, 8.0, 0.0), (9.55, 0.0, 0.0)]);
    rooms.step(&[[0.0, 0.0], [0.0, 0.0]]);
    assert_eq!(end(&rooms, 1), StepEnd::Ended(Outcome::CollisionWall));
}

#[test]
fn a_speed_factor_is_on_what_is_executed() {
    let crowd = TrainingCrowd { speed_min: 1.5, speed_max: 1.5, ..all_blind() };
    let mut rooms = room(&crowd, &[(-8.0, 8.0, 0.0), (0.0, 0.0, 0.0)]);
    rooms.step(&[[1.0, 0.0], [3.0, 0.5]]);
    let at = |rooms: &Rooms, agent| rooms.rooms[0].world.pose(agent);
    assert!((at(&rooms, 1).position.x - 0.15).abs() < 1e-6 && (at(&rooms, 1).heading - 0.05).abs() < 1e-6);
    assert!((at(&rooms, 0).position.x + 7.9).abs() < 1e-6);
    let width = rooms.config().observation_len();
    assert_eq!(rooms.observations()[2 * width - 2..], [1.5, 0.5], "it knows its velocity");
}

/// Agent 1 as a walker: the others are learners.
fn walker(role: Role, places: &[(f32, f32, f32)]) -> Rooms {
    let mut rooms = room(&all_blind(), places);
    for agent in 1..places.len() {
        rooms.rooms[0].traits[agent] = Traits::default();
    }
    rooms.rooms[0].traits[1] = Traits { role, speed: 1.5, ..Traits::default() };
    rooms
}

#[test]
fn a_straight_walker_goes_to_its_goal_whatever_the_actions() {
    let mut rooms = walker(Role::Straight, &[(-8.0, 8.0, 0.0), (6.0, -9.0, 0.0)]);
    let row = rooms.observations()[rooms.config().observation_len()..].to_vec();
    // 3 m to the goal less its radius at 1.5 m/s.
    for step in 1..=17 {
        rooms.step(&[[0.0; 2], [0.0, 1.0]]);
        let expected = if step < 17 { StepEnd::Running } else { StepEnd::Ended(Outcome::Success) };
        assert_eq!(end(&rooms, 1), expected, "step {step}");
        if step < 17 {
            assert_eq!(rooms.observations()[row.len()..], row, "it senses nothing");
        }
    }
    let episode = rooms.transitions()[1].episode.expect("it has ended");
    assert!((episode.path_length - 2.55).abs() < 1e-5, "{}", episode.path_length);
}

#[test]
fn a_walker_is_seen_and_sees_nobody() {
    let mut rooms = walker(Role::Straight, &[(7.9, -9.0, 0.0), (6.0, -9.0, 0.0)]);
    for step in 1..=8 {
        rooms.step(&[[0.0; 2]; 2]);
        // Its front is at 1.65 m, and 0.15 m nearer after each step.
        let expected = if step < 8 { StepEnd::Running } else { StepEnd::Ended(Outcome::CollisionPedestrian) };
        assert_eq!((end(&rooms, 0), end(&rooms, 1)), (expected, StepEnd::Running), "step {step}");
    }
}

#[test]
fn a_walker_that_is_stopped_ends_its_episode_by_what_stopped_it() {
    let facing_the_goal = -std::f32::consts::FRAC_PI_4;
    for (standing, x, outcome) in
        [(true, 0.0, Outcome::CollisionPedestrian), (false, 9.6, Outcome::CollisionWall)]
    {
        let mut rooms =
            walker(Role::Straight, &[(-8.0, 8.0, 0.0), (x, -x, facing_the_goal), (0.4, -0.4, 0.0)]);
        rooms.rooms[0].traits[2] = Traits { role: Role::Standing, ..Traits::default() };
        rooms.rooms[0].episodes[1].goal = Vec2::new(12.0, -12.0);
        if !standing {
            rooms.remove(2);
        }
        for step in 1..=3 {
            rooms.step(&[[0.0; 2]; 3]);
            let expected = if step < 3 { StepEnd::Running } else { StepEnd::Ended(outcome) };
            assert_eq!(end(&rooms, 1), expected, "x = {x}, step {step}");
        }
    }
}

#[test]
fn a_standing_member_stands_until_the_time_limit() {
    let mut rooms = walker(Role::Standing, &[(-8.0, 8.0, 0.0), (0.0, 0.0, 0.5)]);
    let limit = rooms.config().episode.step_limit;
    for step in 1..=limit {
        rooms.step(&[[0.0; 2], [1.0, 1.0]]);
        let expected = if step < limit { StepEnd::Running } else { StepEnd::Ended(Outcome::Timeout) };
        assert_eq!(end(&rooms, 1), expected, "step {step}");
        if step < limit {
            let pose = rooms.rooms[0].world.pose(1);
            assert_eq!((pose.position, pose.heading), (Vec2::ZERO, 0.5));
        }
    }
}

#[test]
fn a_member_that_arrives_walks_on_and_may_face_its_new_goal_at_once() {
    for turn_at_once in [false, true] {
        let crowd = TrainingCrowd { straight: 1.0, walk_on: true, turn_at_once, ..TrainingCrowd::default() };
        let mut rooms = room(&crowd, &[(0.0, 5.0, 0.0), (7.95, -9.0, 0.0)]);
        // The goal at (9, −9) is 1.05 m ahead: reached once it is nearer than 0.5 m.
        for _ in 0..5 {
            rooms.step(&[[0.0; 2]; 2]);
        }
        assert_eq!(rooms.rooms[0].episodes[1].goal, Vec2::new(9.0, -9.0));
        rooms.step(&[[0.0; 2]; 2]);
        assert_eq!(end(&rooms, 1), StepEnd::Running, "its episode goes on");
        let (pose, goal) = (rooms.rooms[0].world.pose(1), rooms.rooms[0].episodes[1].goal);
        assert!(goal.distance(pose.position) >= 10.0, "{goal} from {}", pose.position);
        let ahead = pose.point_in_frame(goal);
        assert_eq!(ahead.y.abs() < 1e-3 && ahead.x > 0.0, turn_at_once, "{ahead}");
    }
}

#[test]
fn a_learner_that_arrives_has_arrived() {
    let crowd = TrainingCrowd { walk_on: true, new_goal_every: 0.1, ..all_blind() };
    let mut rooms = room(&crowd, &[(8.45, -9.0, 0.0), (0.0, 5.0, 0.0)]);
    let goal = rooms.rooms[0].episodes[0].goal;
    rooms.step(&[[1.0, 0.0], [0.0, 0.0]]);
    assert_eq!(end(&rooms, 0), StepEnd::Ended(Outcome::Success));
    assert_ne!(rooms.rooms[0].episodes[0].goal, goal);
    assert_ne!(rooms.rooms[0].episodes[1].goal, goal, "the other one has changed its mind");
}

#[test]
fn a_larger_member_has_a_larger_body_and_room_around_it() {
    let crowd = TrainingCrowd { size_min: 2.0, size_max: 2.0, ..all_blind() };
    let mut rooms = room(&crowd, &[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]);
    rooms.step(&[[0.0; 2]; 2]);
    assert!((newest_scan(&rooms, 0)[0] - 1.5).abs() < 1e-4, "{}", newest_scan(&rooms, 0)[0]);
    let shapes = [0, 1].map(|agent| rooms.rooms[0].world.shape(agent).clone());
    assert_eq!(shapes, [Shape::square(0.5), Shape::square(1.0)]);
    // Nobody touches anybody at a start, and everyone has the way to a wall that a robot's body
    // leaves.
    let crowd = TrainingCrowd { size_min: 0.5, size_max: 4.0, ..all_blind() };
    for seed in 0..20 {
        let rooms =
            Rooms::with_crowd(&SimConfig::default(), &crowd, 1, 6, 1, &Streams::new(seed)).expect("rooms");
        let world = &rooms.rooms[0].world;
        for agent in 0..6 {
            assert!(!world.is_blocked(agent), "seed {seed}, agent {agent}");
            let free = world.clearance(world.pose(agent).position) - world.shape(agent).circumradius();
            assert!(free >= 1.0 - Shape::square(0.5).circumradius() - 1e-5, "{free}");
        }
    }
}

#[test]
fn a_body_is_a_robots_again_when_its_agent_learns() {
    let crowd = TrainingCrowd { blind: 0.5, size_min: 2.0, size_max: 2.0, ..TrainingCrowd::default() };
    let mut config = SimConfig::default();
    config.episode.step_limit = 1;
    let mut rooms = Rooms::with_crowd(&config, &crowd, 1, 4, 1, &Streams::new(5)).expect("rooms");
    let mut seen = [0; 2];
    for _ in 0..50 {
        rooms.step(&[[0.0; 2]; 4]);
        for agent in 0..4 {
            let learns = rooms.role(agent).learns();
            seen[usize::from(learns)] += 1;
            let side = if learns { 0.5 } else { 1.0 };
            assert_eq!(rooms.rooms[0].world.shape(agent), &Shape::square(side));
        }
    }
    assert!(seen.iter().all(|n| *n > 40), "{seen:?}");
}

/// A room that changes every ten steps.
fn changing(crowd: &TrainingCrowd, n_agents: usize, seed: u64) -> Rooms {
    let crowd = TrainingCrowd { renew_steps: 10, ..crowd.clone() };
    let mut config = SimConfig::default();
    config.episode.step_limit = 12;
    Rooms::with_crowd(&config, &crowd, 1, n_agents, 1, &Streams::new(seed)).expect("rooms")
}

#[test]
fn obstacles_come_and_go_clear_of_bodies_and_goals() {
    let crowd = TrainingCrowd { obstacles_min: 2, obstacles_max: 8, ..TrainingCrowd::default() };
    let (mut numbers, mut changes) = (Vec::new(), 0);
    for seed in 0..4 {
        let mut rooms = changing(&crowd, 5, seed);
        let mut before = Vec::new();
        for step in 0..200 {
            rooms.step(&[[0.5, 0.1]; 5]);
            let room = &rooms.rooms[0];
            let obstacles = &room.renewal.as_ref().expect("it changes").obstacles;
            assert_eq!(room.world.n_obstacles(), obstacles.len());
            if *obstacles == before {
                continue;
            }
            (changes, before) = (changes + 1, obstacles.clone());
            numbers.push(obstacles.len());
            for agent in 0..5 {
                let position = room.world.pose(agent).position;
                assert!(room.world.clearance(room.episodes[agent].goal) > 0.99);
                if step == 0 || !rooms.transitions()[agent].end.is_running() {
                    // Placed after the obstacles.
                    assert!(room.world.clearance(position) > 0.9);
                    continue;
                }
                for (shape, pose) in obstacles {
                    let away = position.distance(pose.position) - shape.circumradius();
                    assert!(away > 1.99, "step {step}, agent {agent}: {away}");
                }
            }
        }
    }
    assert!(changes >= 4 * 19, "{changes}");
    assert!(numbers.iter().all(|n| *n <= 8) && numbers.contains(&2) && numbers.contains(&8), "{numbers:?}");
}

#[test]
fn obstacles_are_seen_and_are_crashed_into() {
    let crowd = TrainingCrowd { obstacles_min: 1, obstacles_max: 1, ..TrainingCrowd::default() };
    let mut rooms = room(&crowd, &[(0.0, 0.0, 0.0)]);
    let obstacle = (Shape::Circle { radius: 0.5 }, Pose::new(Vec2::new(2.05, 0.0), 0.0));
    let room = &mut rooms.rooms[0];
    let furnished = room.plan.furnish(&[obstacle]).expect("an obstacle");
    room.move_into(furnished);
    for step in 1..=11 {
        rooms.step(&[[1.0, 0.0]]);
        assert!(step == 11 || (newest_scan(&rooms, 0)[0] - (1.55 - 0.1 * step as f32)).abs() < 1e-4);
        let expected = if step < 11 { StepEnd::Running } else { StepEnd::Ended(Outcome::CollisionWall) };
        assert_eq!(end(&rooms, 0), expected, "step {step}");
    }
}

#[test]
fn agents_leave_as_their_episodes_end_and_return() {
    let crowd = TrainingCrowd { agents_min: 2, ..TrainingCrowd::default() };
    let mut rooms = changing(&crowd, 6, 1);
    let (mut seen, mut away) = ([0; 7], 0);
    for _ in 0..600 {
        let absent: Vec<bool> = (0..6).map(|agent| rooms.role(agent) == Role::Absent).collect();
        rooms.step(&[[0.6, 0.0]; 6]);
        let n_present = rooms.rooms[0].renewal.as_ref().expect("it changes").n_present;
        for (agent, was_absent) in absent.into_iter().enumerate() {
            let (transition, is_absent) = (rooms.transitions()[agent], rooms.role(agent) == Role::Absent);
            assert_eq!(transition.role == Role::Absent, was_absent);
            assert!(!was_absent || (transition.end, transition.reward) == (StepEnd::Running, 0.0));
            // Nobody leaves but at an episode's end, nor stays away while there is room.
            assert!(!is_absent || was_absent || !transition.end.is_running());
            assert!(!is_absent || agent >= n_present);
            let (min, max) = rooms.rooms[0].world.walls().expect("walls");
            let position = rooms.rooms[0].world.pose(agent).position;
            assert_eq!(position.cmpge(min).all() && position.cmple(max).all(), !is_absent);
            away += usize::from(is_absent);
        }
        seen[(0..6).filter(|agent| rooms.role(*agent) != Role::Absent).count()] += 1;
        assert_eq!(rooms.role(0), Role::Learner);
    }
    assert!(seen[..2].iter().all(|n| *n == 0) && seen[2..].iter().all(|n| *n > 0), "{seen:?}");
    assert!(away > 600, "{away}");
}
