//! Scenes of a suite in episodes: paired, repeatable, and with their standing and stopping
//! pedestrians.

use crate::common::{brief, pools, seek};
use glam::Vec2;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{ArenaConfig, PerRow, PolicyIdentity};
use jostle_eval::suite::Suite;
use jostle_eval::{Protocol, Subject};
use jostle_peds::{Command, CrowdKind};
use jostle_sim::Laser;

fn config(scene: &str, base: &ArenaConfig) -> ArenaConfig {
    let suite = Suite::standard();
    suite.scenes.iter().find(|found| found.name == scene).unwrap().config(base).unwrap()
}

#[test]
fn episodes_are_paired_over_crowds_and_repeat_at_any_lock_step() {
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    for scene in ["corridor", "blind-corner", "standing-group", "stops-dead"] {
        let run = |crowd, lock_step| {
            let config = config(scene, &ArenaConfig { lock_step, ..brief(30) });
            let protocol = Protocol::new(config, pools()).unwrap();
            protocol.evaluate(&mut PerRow::new(seek), subject, crowd, 4, None, |_| ()).unwrap()
        };
        let reference = run(CrowdKind::Vo, 4);
        assert_eq!(reference.records, run(CrowdKind::Vo, 3).records, "{scene}");
        for crowd in [CrowdKind::Sf, CrowdKind::Straight, CrowdKind::StopAndGo] {
            for (a, b) in reference.records.iter().zip(&run(crowd, 4).records) {
                assert_eq!((a.start, a.goal), (b.start, b.goal), "{scene}, {crowd}");
            }
        }
    }
}

/// Positions of the pedestrians of an episode, step by step, while the robot stands.
fn paths(scene: &str, crowd: CrowdKind, episode: u64) -> Vec<Vec<Vec2>> {
    let config = config(scene, &brief(150));
    let protocol = Protocol::new(config.clone(), pools()).unwrap();
    let plan = RoomPlan::new(&config, crowd).unwrap();
    let mut pedestrians = protocol.crowd(&plan).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
    let mut motions = vec![Command::STILL; config.n_pedestrians()];
    let mut path = Vec::new();
    loop {
        path.push(room.pedestrians().iter().map(|p| p.position).collect());
        pedestrians.decide(&[room.view(&[])], &mut motions).unwrap();
        if room.step(&plan, [0.0; 2], &motions).unwrap().is_some() {
            return path;
        }
    }
}

#[test]
fn a_group_stands_whatever_drives_the_crowd() {
    for (crowd, n_episodes) in [(CrowdKind::Straight, 3), (CrowdKind::Sf, 3), (CrowdKind::Nh, 1)] {
        for episode in 0..n_episodes {
            let path = paths("standing-group", crowd, episode);
            assert!(path.len() > 20, "{crowd}: {} steps", path.len());
            for step in &path {
                assert_eq!(step[..4], path[0][..4], "{crowd}");
            }
        }
    }
    let walked = paths("standing-group", CrowdKind::Straight, 0);
    assert!(walked[20][4].distance(walked[0][4]) > 0.5);
}

#[test]
fn the_leader_walks_and_stops_dead_between_two_and_six_seconds() {
    for episode in 0..6 {
        let path = paths("stops-dead", CrowdKind::Straight, episode);
        let leader: Vec<Vec2> = path.iter().map(|step| step[0]).collect();
        let last_move = leader.windows(2).rposition(|pair| pair[0] != pair[1]).unwrap() + 1;
        assert!((20..=60).contains(&last_move), "stopped after {last_move} steps");
        assert!(leader[..last_move].windows(2).all(|pair| pair[0] != pair[1]), "it walked until then");
        assert!(leader[last_move].x > leader[0].x + 0.9);
    }
}

#[test]
fn pedestrians_turn_back_where_they_arrive() {
    // 15 s at up to 1.5 m/s: some of twelve walkers get to the far side and come back.
    let turns = (0..2)
        .flat_map(|episode| {
            let path = paths("crossing", CrowdKind::Straight, episode);
            (0..6).map(move |i| {
                let ys: Vec<f32> = path.iter().map(|step| step[i].y).collect();
                let up = |pair: &[f32]| pair[1] > pair[0];
                let steps: Vec<bool> =
                    ys.windows(2).filter(|pair| (pair[1] - pair[0]).abs() < 0.2).map(up).collect();
                steps.windows(2).filter(|pair| pair[0] != pair[1]).count()
            })
        })
        .sum::<usize>();
    assert!(turns > 0, "nobody turned back");
}
