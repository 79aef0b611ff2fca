//! Visibility: the robot's actions must not matter to a crowd that cannot see it, and must to one
//! that can.

use crate::common::{brief, pools};
use glam::Vec2;
use jostle_arena::ArenaConfig;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_eval::Protocol;
use jostle_peds::{Command, CrowdKind};
use jostle_sim::Laser;

/// Ways of the pedestrians of an episode while the robot repeats an action; they stop with the
/// robot's episode, or where a pedestrian was re-spawned (its new place keeps clear of the robot,
/// seen or not).
fn walk(config: &ArenaConfig, crowd: CrowdKind, episode: u64, action: [f32; 2]) -> Vec<Vec<Vec2>> {
    let protocol = Protocol::new(config.clone(), pools()).unwrap();
    let plan = RoomPlan::new(config, crowd).unwrap();
    let mut pedestrians = protocol.crowd(&plan).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
    let mut path = Vec::new();
    let mut motions = vec![Command::STILL; config.n_pedestrians()];
    loop {
        let positions: Vec<Vec2> = room.pedestrians().iter().map(|p| p.position).collect();
        let jumped = |last: &Vec<Vec2>| last.iter().zip(&positions).any(|(a, b)| a.distance(*b) > 0.5);
        if path.last().is_some_and(jumped) {
            return path;
        }
        path.push(positions);
        let robot = room.robot();
        let others = if plan.visibility.robot { std::slice::from_ref(&robot) } else { &[] };
        pedestrians.decide(&[room.view(others)], &mut motions).unwrap();
        if room.step(&plan, action, &motions).unwrap().is_some() {
            return path;
        }
    }
}

/// True if the crowd's paths are the same as long as both last, over a few episodes.
fn ignores_the_robot(config: &ArenaConfig, crowd: CrowdKind) -> bool {
    let mut compared = 0;
    let same = (0..4).all(|episode| {
        let (still, moving) =
            (walk(config, crowd, episode, [0.0; 2]), walk(config, crowd, episode, [1.0, 0.4]));
        compared += still.len().min(moving.len());
        still.iter().zip(&moving).all(|(a, b)| a == b)
    });
    assert!(!same || compared > 60, "{crowd}: only {compared} steps could be compared");
    same
}

#[test]
fn only_nh_and_so_react_to_the_robot() {
    for crowd in CrowdKind::PAPER {
        let reacts = matches!(crowd, CrowdKind::Nh | CrowdKind::So);
        assert_eq!(ignores_the_robot(&brief(60), crowd), !reacts, "{crowd}");
    }
}

#[test]
fn the_matrix_can_be_changed() {
    let mut config = brief(60);
    config.crowds.visibility.nh.robot = false;
    config.crowds.visibility.sf.robot = true;
    assert!(ignores_the_robot(&config, CrowdKind::Nh));
    assert!(!ignores_the_robot(&config, CrowdKind::Sf));
}

#[test]
fn speed_factors_are_drawn_per_pedestrian_and_episode_in_va_alone() {
    let config = brief(60);
    let laser = Laser::new(&config.sim.laser).unwrap();
    let factors = |crowd| -> Vec<f32> {
        let plan = RoomPlan::new(&config, crowd).unwrap();
        let rooms = (0..50).map(|episode| ArenaRoom::new(&plan, &laser, episode).unwrap());
        rooms.flat_map(|room| room.speed_factors().to_vec()).collect()
    };
    let mut va = factors(CrowdKind::Va);
    assert_eq!(va.len(), 200);
    assert!(va.iter().all(|factor| (0.5..=1.5).contains(factor)));
    va.sort_by(f32::total_cmp);
    va.dedup();
    assert!(va.len() > 190 && va[0] < 0.6 && va[va.len() - 1] > 1.4);
    for crowd in [CrowdKind::Nh, CrowdKind::In, CrowdKind::So, CrowdKind::Vo, CrowdKind::Sf] {
        assert!(factors(crowd).iter().all(|factor| *factor == 1.0), "{crowd}");
    }
}

/// Pedestrians that run into the walls come back at least the clearance away from everyone.
#[test]
fn who_crashes_is_put_far_from_everyone() {
    let config = brief(400);
    let plan = RoomPlan::new(&config, CrowdKind::Nh).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let straight_on = [Command::Drive { v: 1.0, w: 0.0 }; 4];
    let mut n_respawned = 0;
    for episode in 0..3 {
        let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
        let mut last: Vec<Vec2> = room.pedestrians().iter().map(|p| p.position).collect();
        while room.step(&plan, [0.0; 2], &straight_on).unwrap().is_none() {
            let now: Vec<Vec2> = room.pedestrians().iter().map(|p| p.position).collect();
            let jumped: Vec<usize> = (0..4).filter(|i| last[*i].distance(now[*i]) > 0.2).collect();
            for i in &jumped {
                n_respawned += 1;
                assert!(now[*i].distance(room.robot().position) >= 3.0);
                // Those re-spawned after it in the same step had still stood elsewhere.
                let placed = |j: &usize| *j != *i && (!jumped.contains(j) || j < i);
                assert!((0..4).filter(placed).all(|j| now[*i].distance(now[j]) >= 3.0));
                assert!(now[*i].abs().max_element() <= 9.0);
                assert!(room.pedestrians()[*i].goal.distance(now[*i]) >= 10.0 - 1e-4);
            }
            last = now;
        }
    }
    assert!(n_respawned > 10, "{n_respawned} were re-spawned");
}
