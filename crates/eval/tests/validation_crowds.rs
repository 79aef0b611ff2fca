//! The walkers for validation: they see nobody, walk at drawn speeds, stand at drawn times, and
//! repeat to the bit.

use crate::common::{brief, pools, seek};
use glam::Vec2;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{ArenaConfig, ArenaError, PerRow, PolicyIdentity, Pools};
use jostle_eval::{Protocol, Subject};
use jostle_peds::{Command, CrowdKind};
use jostle_sim::Laser;

const WALKERS: [CrowdKind; 2] = [CrowdKind::Straight, CrowdKind::StopAndGo];

/// Velocities of the pedestrians of an episode while the robot repeats an action, at each step.
fn velocities(config: &ArenaConfig, crowd: CrowdKind, episode: u64, action: [f32; 2]) -> Vec<Vec<Vec2>> {
    let protocol = Protocol::new(config.clone(), Pools::default()).unwrap();
    let plan = RoomPlan::new(config, crowd).unwrap();
    let mut walkers = protocol.crowd(&plan).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
    let mut motions = vec![Command::STILL; config.n_pedestrians()];
    let mut steps = Vec::new();
    loop {
        walkers.decide(&[room.view(&[])], &mut motions).unwrap();
        steps.push(
            motions
                .iter()
                .map(|motion| match motion {
                    Command::Walk { velocity } => *velocity,
                    Command::Drive { .. } => panic!("walkers do not drive"),
                })
                .collect(),
        );
        if room.step(&plan, action, &motions).unwrap().is_some() {
            return steps;
        }
    }
}

#[test]
fn a_straight_walker_keeps_the_speed_that_was_drawn_for_it() {
    let mut speeds = Vec::new();
    for episode in 0..5 {
        let steps = velocities(&brief(100), CrowdKind::Straight, episode, [0.0; 2]);
        for pedestrian in 0..4 {
            let first = steps[0][pedestrian].length();
            assert!(steps.iter().all(|step| (step[pedestrian].length() - first).abs() < 1e-5));
            speeds.push(first);
        }
    }
    speeds.sort_by(f32::total_cmp);
    assert!(speeds[0] >= 0.5 && speeds[0] < 0.7 && speeds[19] <= 1.5 && speeds[19] > 1.3, "{speeds:?}");
}

#[test]
fn a_stop_and_go_walker_has_two_speeds_one_of_them_zero() {
    let mut stops = 0;
    for episode in 0..5 {
        let steps = velocities(&brief(150), CrowdKind::StopAndGo, episode, [0.0; 2]);
        for pedestrian in 0..4 {
            let speeds: Vec<f32> = steps.iter().map(|step| step[pedestrian].length()).collect();
            let most = speeds.iter().copied().fold(0.0, f32::max);
            assert!(speeds.iter().all(|speed| *speed == 0.0 || (speed - most).abs() < 1e-5));
            stops += speeds.windows(2).filter(|pair| pair[0] > 0.0 && pair[1] == 0.0).count();
        }
    }
    // 20 walkers for 15 s with a stop every 6.5 s.
    assert!((20..=70).contains(&stops), "{stops} stops");
}

/// The walkers do the same whatever the robot does, for as long as both episodes last.
#[test]
fn walkers_do_not_see_the_robot() {
    for crowd in WALKERS {
        let mut compared = 0;
        for episode in 0..4 {
            let still = velocities(&brief(80), crowd, episode, [0.0; 2]);
            let moving = velocities(&brief(80), crowd, episode, [1.0, 0.3]);
            assert!(still.iter().zip(&moving).all(|(a, b)| a == b), "{crowd}, episode {episode}");
            compared += still.len().min(moving.len());
        }
        assert!(compared > 80, "{crowd}: only {compared} steps could be compared");
    }
}

#[test]
fn cells_repeat_at_any_lock_step_and_have_keys_of_their_own() {
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let run = |crowd, lock_step| {
        let config = ArenaConfig { lock_step, ..brief(120) };
        let protocol = Protocol::new(config, pools()).unwrap();
        protocol.evaluate(&mut PerRow::new(seek), subject, crowd, 24, None, |_| ()).unwrap()
    };
    let mut cells = Vec::new();
    for crowd in CrowdKind::VALIDATION {
        let wide = run(crowd, 24);
        assert_eq!(wide.records, run(crowd, 5).records, "{crowd}");
        assert_eq!(wide.result.pool.is_some(), crowd == CrowdKind::CrossPlay);
        cells.push(wide.result.cell);
    }
    cells.push(run(CrowdKind::Nh, 24).result.cell);
    cells.sort();
    cells.dedup();
    assert_eq!(cells.len(), 4);
}

#[test]
fn walkers_that_meet_are_put_elsewhere() {
    // A crowd of 30 in 20 m by 20 m meets often.
    let config = ArenaConfig { n_agents: 31, ..brief(200) };
    let protocol = Protocol::new(config.clone(), Pools::default()).unwrap();
    let plan = RoomPlan::new(&config, CrowdKind::Straight).unwrap();
    let mut walkers = protocol.crowd(&plan).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut room = ArenaRoom::new(&plan, &laser, 0).unwrap();
    let mut motions = vec![Command::STILL; 30];
    let (mut n_put, mut n_stuck) = (0, 0);
    for _ in 0..150 {
        let before: Vec<Vec2> = room.pedestrians().iter().map(|p| p.position).collect();
        walkers.decide(&[room.view(&[])], &mut motions).unwrap();
        if room.step(&plan, [0.0; 2], &motions).unwrap().is_some() {
            break;
        }
        for (pedestrian, before) in room.pedestrians().iter().zip(before) {
            n_put += u32::from(pedestrian.position.distance(before) > 0.5);
            n_stuck += u32::from(pedestrian.position == before);
        }
    }
    assert!(n_put > 5, "{n_put} were put elsewhere");
    // Only the robot, which is nobody's crash, may hold a walker up.
    assert!(n_stuck < 30, "{n_stuck} steps without a move");
}

#[test]
fn cross_play_needs_a_pool() {
    let protocol = Protocol::new(brief(10), Pools::default()).unwrap();
    let plan = RoomPlan::new(protocol.config(), CrowdKind::CrossPlay).unwrap();
    let error = protocol.crowd(&plan).err().unwrap();
    assert!(matches!(error, ArenaError::EmptyPool { crowd: CrowdKind::CrossPlay }), "{error}");
}
