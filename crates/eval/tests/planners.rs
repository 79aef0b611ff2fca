//! Planners in the protocol: the same episodes whatever the threads and the lock step, and what
//! each is worth.

use crate::common;
use jostle_arena::room::RoomPlan;
use jostle_arena::{ArenaConfig, Driver, LoadedPolicy, Planner, Pools};
use jostle_eval::records::EpisodeRecord;
use jostle_eval::{Protocol, Subject};
use jostle_peds::CrowdKind;

/// The records of a planner among a validation crowd.
fn records(planner: Planner, config: &ArenaConfig, episodes: u64) -> Vec<EpisodeRecord> {
    let crowd = CrowdKind::Straight;
    let protocol = Protocol::new(config.clone(), Pools::default()).unwrap();
    let driver = Driver::Planner(planner);
    let identity = driver.identity();
    let mut robot = driver.robot(0, &RoomPlan::new(config, crowd).unwrap()).unwrap();
    let subject = Subject { identity: &identity, token: 0 };
    protocol.evaluate(&mut *robot, subject, crowd, episodes, None, |_| ()).unwrap().records
}

#[test]
fn the_same_episodes_at_any_lock_step_and_any_number_of_threads() {
    let config = common::brief(60);
    for planner in Planner::ALL {
        let expected = records(planner, &config, 12);
        let narrow = ArenaConfig { lock_step: 3, ..config.clone() };
        assert!(records(planner, &narrow, 12) == expected, "{planner}: three rooms side by side");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert!(pool.install(|| records(planner, &config, 12)) == expected, "{planner}: three threads");
    }
}

#[test]
fn planners_are_worth_what_they_look_at() {
    // A seed that no setting was chosen by.
    let config = ArenaConfig { seed: 4, ..ArenaConfig::default() };
    let successes = |planner: Planner| {
        let records = records(planner, &config, 60);
        records.iter().filter(|record| record.metrics.extra_time.is_some()).count()
    };
    let [straight, brake, dwa] = [Planner::Straight, Planner::Brake, Planner::Dwa].map(successes);
    assert!(straight < brake && brake + 5 < dwa && dwa >= 52, "{straight}, {brake} and {dwa} of 60");
}

#[test]
fn a_driver_is_a_policy_or_a_planner() {
    let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Sf).unwrap();
    let refused = |driver: &Driver, token: u32| driver.robot(token, &plan).err().unwrap().to_string();
    let planner = Driver::Planner(Planner::Dwa);
    assert_eq!(refused(&planner, 2), "token: found 2, expected 0: the planner dwa knows no behaviours");
    assert_eq!(planner.config().unwrap(), ArenaConfig::default());
    assert!(planner.trained().is_none() && planner.check_observation(&ArenaConfig::default()).is_ok());
    let policy: LoadedPolicy = common::untrained(1);
    let trained = Driver::Trained(Box::new(policy.clone()));
    assert_eq!(trained.identity(), policy.identity);
    assert!(trained.robot(1, &plan).is_ok() && refused(&trained, 2).starts_with("token: found 2"));
    let mut few_beams = ArenaConfig::default();
    few_beams.sim.laser.beams = 128;
    assert!(trained.check_observation(&few_beams).is_err() && planner.check_observation(&few_beams).is_ok());
}
