//! Places of robots, pedestrians and their goals in the test's rooms, and the ends of episodes by
//! contact.

use std::io::Write as _;

use glam::Vec2;
use jostle_arena::ArenaConfig;
use jostle_arena::Outcome;
use jostle_arena::RoomStepper;
use jostle_arena::crowds::{Pools, make_crowd};
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::site::polygons;
use jostle_peds::{Command, CrowdKind};
use jostle_sim::{Laser, SimConfig};

/// Few beams: what is tested here are places.
fn quick(n_agents: usize) -> ArenaConfig {
    let mut sim = SimConfig::default();
    sim.laser.beams = 64;
    ArenaConfig { sim, n_agents, ..ArenaConfig::default() }
}

fn square(side: f32, n_agents: usize) -> ArenaConfig {
    let mut config = quick(n_agents);
    (config.sim.room.width, config.sim.room.height) = (side, side);
    config
}

/// Runs episodes with a robot that stands still, to their ends or `steps`; `watch` sees each room
/// after each step.
fn run(
    config: &ArenaConfig,
    crowd: CrowdKind,
    episodes: std::ops::Range<u64>,
    steps: u32,
    mut watch: impl FnMut(&ArenaRoom),
) {
    let plan = RoomPlan::new(config, crowd).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut pedestrians = make_crowd(config, crowd, &Pools::default(), &polygons(&plan.scenario)).unwrap();
    let mut stepper = RoomStepper::default();
    let mut rooms: Vec<ArenaRoom> = episodes.map(|k| ArenaRoom::new(&plan, &laser, k).unwrap()).collect();
    for _ in 0..steps {
        let actions = vec![[0.0; 2]; rooms.len()];
        let ends = stepper.step_with(&plan, &mut *pedestrians, &mut rooms, &actions).unwrap();
        rooms.iter().for_each(&mut watch);
        let mut ends = ends.into_iter();
        rooms.retain(|_| ends.next().unwrap().is_none());
    }
}

/// FNV-1a over positions and goals of everyone. The robot's end is not looked at: pedestrians walk
/// on beside it.
fn hash_of_walks(config: &ArenaConfig, crowd: CrowdKind) -> u64 {
    let plan = RoomPlan::new(config, crowd).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut pedestrians = make_crowd(config, crowd, &Pools::default(), &polygons(&plan.scenario)).unwrap();
    let mut stepper = RoomStepper::default();
    let mut rooms: Vec<ArenaRoom> = (0..4).map(|k| ArenaRoom::new(&plan, &laser, k).unwrap()).collect();
    let mut hash: u64 = 0xCBF2_9CE4_8422_2325;
    for _ in 0..395 {
        stepper.step_with(&plan, &mut *pedestrians, &mut rooms, &[[0.0; 2]; 4]).unwrap();
        for room in &rooms {
            let robot = room.robot();
            for body in room.pedestrians().iter().chain([&robot]) {
                for x in body.position.to_array().into_iter().chain(body.goal.to_array()) {
                    hash = (hash ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01B3);
                }
            }
        }
    }
    hash
}

/// Written down before the free space was enumerated.
#[test]
fn the_draws_of_the_usual_room_are_pinned() {
    let config = |n_agents| ArenaConfig { n_agents, ..ArenaConfig::default() };
    assert_eq!(hash_of_walks(&config(5), CrowdKind::Sf), 0x051B_07C2_13BE_F9D7);
    assert_eq!(hash_of_walks(&config(5), CrowdKind::Vo), 0x5DE8_268D_8E5A_7253);
    assert_eq!(hash_of_walks(&config(20), CrowdKind::Sf), 0x612C_5693_A0BF_ADCC);
    for (map, hash) in [("warehouse", 0x1F81_6227_539A_D791), ("hospital", 0x53B8_F81D_B8F9_6D07)] {
        let mut config = ArenaConfig { respawn_clearance: 1.5, ..config(9) };
        config.sim.room.map = Some(format!("{}/../../maps/{map}.toml", env!("CARGO_MANIFEST_DIR")).into());
        config.sim.spawn.goal_distance = 5.0;
        (config.sim.robot.length, config.sim.robot.width) = (0.508, 0.430);
        assert_eq!(hash_of_walks(&config, CrowdKind::Sf), hash, "{map}");
    }
}

/// In such rooms many places have no goal 10 m away, and few are 3 m from everyone.
#[test]
fn episodes_in_small_rooms_go_on_to_their_ends() {
    for side in [11.0, 12.0, 14.0, 15.0] {
        for crowd in [CrowdKind::Sf, CrowdKind::Vo] {
            let config = square(side, 5);
            let mut n_new_goals = 0;
            let mut goals = std::collections::BTreeMap::new();
            run(&config, crowd, 0..60, 400, |room| {
                for (i, pedestrian) in room.pedestrians().iter().enumerate() {
                    let last = goals.insert((room.episode(), i), pedestrian.goal);
                    if last.is_some_and(|last| last != pedestrian.goal) {
                        n_new_goals += 1;
                        // A new goal is as far as the room allows, and never far below what is
                        // asked for: the old goal's start was a goal distance away from it, and one
                        // arrives a goal radius before it.
                        let far = pedestrian.position.distance(pedestrian.goal);
                        assert!(far > 9.0, "{side} m, {crowd}: a goal {far} m away");
                    }
                    assert!(pedestrian.goal.abs().max_element() <= side / 2.0 - 1.0);
                }
            });
            assert!(n_new_goals > 5, "{side} m, {crowd}: {n_new_goals} new goals");
        }
    }
}

/// 39 pedestrians that re-spawn 3 m from everyone do not fit into the usual room: they get the
/// freest places.
#[test]
fn a_dense_crowd_goes_on_to_its_end() {
    let config = quick(40);
    let mut n_jumps = 0;
    let mut last = std::collections::BTreeMap::new();
    run(&config, CrowdKind::Sf, 0..20, 400, |room| {
        for (i, pedestrian) in room.pedestrians().iter().enumerate() {
            let before = last.insert((room.episode(), i), pedestrian.position);
            if before.is_some_and(|before: Vec2| before.distance(pedestrian.position) > 0.3) {
                n_jumps += 1;
                // Placed where the robot's scan shows no crash.
                let from_robot = room.robot().position.distance(pedestrian.position);
                assert!(from_robot >= 1.0, "{from_robot} m from the robot");
            }
        }
    });
    assert!(n_jumps > 20, "{n_jumps} re-spawned");
}

#[test]
fn rooms_that_cannot_hold_a_crowd_are_refused_at_the_start() {
    let refusal = |config: &ArenaConfig| RoomPlan::new(config, CrowdKind::Sf).unwrap_err().to_string();
    assert!(refusal(&square(12.0, 40)).starts_with("n_agents: found 40, expected so few that their spawn"));
    assert!(refusal(&square(9.0, 2)).starts_with("spawn.goal_distance: found 10, expected at most 9.8"));
    let near = ArenaConfig { respawn_clearance: 0.6, ..quick(5) };
    assert_eq!(
        refusal(&near),
        "respawn_clearance: found 0.6, expected at least 0.8535534 m, a body's radius and the crash range, so that no \
         re-spawn is a crash"
    );
    assert!(RoomPlan::new(&ArenaConfig { respawn_clearance: 0.0, ..quick(1) }, CrowdKind::Sf).is_ok());
}

/// Pedestrians of a divided room stay on their side, through all their goals and re-spawns.
#[test]
fn pedestrians_get_goals_that_they_can_get_to() {
    let mut map = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    let text = "walls = { min = [-10.0, -10.0], max = [10.0, 10.0] }\n\
                [[obstacle]]\nsegment = [[-10.0, 1.0], [10.0, 1.0]]\n";
    map.write_all(text.as_bytes()).unwrap();
    let mut config = quick(7);
    config.sim.room.map = Some(map.path().to_owned());
    let mut goals = std::collections::BTreeSet::new();
    run(&config, CrowdKind::Sf, 0..10, 400, |room| {
        let robot = room.robot();
        for body in room.pedestrians().iter().chain([&robot]) {
            assert_eq!(body.position.y > 1.0, body.goal.y > 1.0, "{} to {}", body.position, body.goal);
            goals.insert(body.goal.to_array().map(f32::to_bits));
        }
    });
    assert!(goals.len() > 100, "{} goals", goals.len());
}

/// A long robot and a pedestrian that meet end the robot's episode, whoever of the two moves; so
/// does a wall.
#[test]
fn a_long_robot_that_touches_something_has_crashed() {
    let mut config = quick(2);
    config.sim.robot.length = 2.0;
    (config.sim.spawn.wall_clearance, config.sim.spawn.body_clearance) = (1.1, 2.2);
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut outcomes = [0; 3];
    for crowd in [CrowdKind::Sf, CrowdKind::Nh] {
        let plan = RoomPlan::new(&config, crowd).unwrap();
        for episode in 0..40 {
            let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
            let stands = episode % 2 == 0;
            let end = loop {
                // Straight at the robot; every other robot drives straight on.
                let (robot, pedestrian) = (room.robot(), room.pedestrians()[0]);
                let velocity = (robot.position - pedestrian.position).normalize_or_zero();
                let action = [if stands { 0.0 } else { 1.0 }, 0.0];
                if let Some(end) = room.step(&plan, action, &[Command::Walk { velocity }]).unwrap() {
                    break end;
                }
            };
            match end.outcome {
                Outcome::CollisionWall => outcomes[0] += 1,
                Outcome::CollisionPedestrian => outcomes[1] += 1,
                Outcome::Timeout => outcomes[2] += 1,
                Outcome::Success => {}
            }
        }
    }
    let [walls, pedestrians, timeouts] = outcomes;
    assert!(
        walls > 5 && pedestrians > 40 && timeouts == 0,
        "{walls} walls, {pedestrians} pedestrians, {timeouts} timeouts"
    );
}

/// Long pedestrians that go by their scan are re-spawned where they are stopped by a wall, and not
/// by the robot.
#[test]
fn a_long_pedestrian_that_touches_a_wall_is_put_elsewhere() {
    let mut config = quick(2);
    config.sim.robot.length = 2.0;
    (config.sim.spawn.wall_clearance, config.sim.spawn.body_clearance) = (1.1, 2.2);
    let plan = RoomPlan::new(&config, CrowdKind::Nh).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut n_respawned = 0;
    for episode in 0..20 {
        let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
        let mut n_still = 0;
        loop {
            let before = room.pedestrians()[0].position;
            if room.step(&plan, [0.0, 0.0], &[Command::Drive { v: 1.0, w: 0.0 }]).unwrap().is_some() {
                break;
            }
            let moved = before.distance(room.pedestrians()[0].position);
            n_respawned += usize::from(moved > 0.3);
            n_still = if moved < 1e-6 { n_still + 1 } else { 0 };
            assert!(n_still < 2, "a pedestrian stands at a wall");
        }
    }
    assert!(n_respawned > 20, "{n_respawned} re-spawned");
}
