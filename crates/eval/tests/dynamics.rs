//! Tests of robots that have mass: the same episodes, other ways through them.

use std::sync::Mutex;

use crate::common::{pools, seek};
use jostle_arena::{ArenaConfig, PerRow, PolicyIdentity};
use jostle_eval::{CellRun, Protocol, Subject};
use jostle_peds::CrowdKind;
use jostle_sim::{BaseConfig, Dynamics};

fn run(config: &ArenaConfig, crowd: CrowdKind, episodes: u64) -> CellRun {
    let protocol = Protocol::new(config.clone(), pools()).unwrap();
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    protocol.evaluate(&mut PerRow::new(seek), subject, crowd, episodes, None, |_| ()).unwrap()
}

fn with_mass() -> ArenaConfig {
    let mut config = ArenaConfig::default();
    config.sim.robot.dynamics = Dynamics::Rapier;
    config
}

#[test]
fn a_goal_seeker_with_mass_arrives_a_little_later() {
    let alone = |config: ArenaConfig| run(&ArenaConfig { n_agents: 1, ..config }, CrowdKind::Sf, 30);
    let (kinematic, mass) = (alone(ArenaConfig::default()), alone(with_mass()));
    let mut slow = with_mass();
    slow.sim.robot.base = Some(BaseConfig { latency: 0.3, friction: 0.1, ..BaseConfig::default() });
    let slow = alone(slow);
    for (light, heavy) in [(&kinematic, &mass), (&mass, &slow)] {
        let time = |cell: &CellRun| cell.result.summary.extra_time.mean.unwrap();
        assert_eq!((light.result.summary.success, heavy.result.summary.success), (30, 30));
        assert!(time(light) < time(heavy), "{} s, then {} s", time(light), time(heavy));
        assert!(heavy.result.summary.distance_check.holds(), "{:?}", heavy.result.summary.distance_check);
        for (one, other) in light.records.iter().zip(&heavy.records) {
            assert_eq!((one.start, one.goal), (other.start, other.goal));
        }
    }
    let hash = |config: &ArenaConfig| config.settings_hash(None);
    assert_ne!(hash(&with_mass()), hash(&ArenaConfig::default()));
}

#[test]
fn a_robot_with_mass_observes_the_velocity_that_it_has() {
    // Full speed ahead from rest, in an empty room. Wheels with μ = 0.5 give at most 4.9 m/s², so
    // that a control period of 0.1 s, the first 0.02 s of it before the command is heeded, ends
    // with at most 0.4 m/s.
    let observed = |config: ArenaConfig| {
        let speeds = Mutex::new(Vec::new());
        let protocol = Protocol::new(ArenaConfig { n_agents: 1, ..config }, pools()).unwrap();
        let identity = PolicyIdentity::custom("ahead", "1");
        let subject = Subject { identity: &identity, token: 0 };
        let mut ahead = PerRow::new(|row: &[f32]| {
            speeds.lock().unwrap().push(row[row.len() - 2]);
            [1.0, 0.0]
        });
        protocol.evaluate(&mut ahead, subject, CrowdKind::Sf, 1, None, |_| ()).unwrap();
        speeds.into_inner().unwrap()
    };
    let (kinematic, mass) = (observed(ArenaConfig::default()), observed(with_mass()));
    assert_eq!(kinematic[..3], [0.0, 1.0, 1.0]);
    assert_eq!(mass[0], 0.0);
    assert!((0.2..=0.4).contains(&mass[1]), "{:?}", &mass[..4]);
    assert!(mass[1] < mass[2] && mass[2] < mass[3] && mass[10] > 0.9, "{:?}", &mass[..12]);
}

#[test]
fn threads_and_lock_step_do_not_change_a_robot_with_mass() {
    for (crowd, episodes) in [(CrowdKind::Sf, 24), (CrowdKind::Va, 4)] {
        let records = |threads: usize, lock_step: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let cell = pool.install(|| run(&ArenaConfig { lock_step, ..with_mass() }, crowd, episodes));
            format!("{:?}", cell.records)
        };
        let expected = records(1, 1);
        assert!(expected == records(4, 7) && expected == records(2, 256), "{crowd}");
    }
}
