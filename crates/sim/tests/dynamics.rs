//! Robots with mass: what rapier and the wheels make of a command, and what must hold whatever
//! happens.

use glam::Vec2;
use jostle_sim::{
    BaseConfig, DriveState, Dynamics, Motion, Pose, Rooms, Shape, SimConfig, Stop, Streams, World,
};
use proptest::prelude::*;

const DT: f32 = 0.1;
/// A Jackal's grip, m/s².
const GRIP: f32 = 0.5 * 9.81;

fn body() -> Shape {
    Shape::Box { length: 0.508, width: 0.43 }
}

/// A world with a base at each pose.
fn world(base: &BaseConfig, poses: &[Pose]) -> World {
    let mut world = World::new();
    for (body_idx, pose) in poses.iter().enumerate() {
        world.add_body(&body(), *pose).unwrap();
        world.set_base(body_idx, base).unwrap();
    }
    world
}

fn advance(world: &mut World, motions: &[Motion]) -> Vec<Option<Stop>> {
    let mut stops = vec![None; motions.len()];
    world.advance_to_stops(motions, DT, &mut stops);
    stops
}

fn drive(v: f32, w: f32) -> Motion {
    Motion::Drive { v, w }
}

fn set_velocity(world: &mut World, body_idx: usize, velocity: Vec2, turn: f32) {
    world.set_drive_state(body_idx, DriveState { velocity, turn, commands: Vec::new() });
}

fn energy(world: &World, base: &BaseConfig) -> f64 {
    let of_body = |state: &DriveState| {
        let squared = f64::from(state.velocity.length()).powi(2);
        0.5 * (f64::from(base.mass) * squared + f64::from(base.inertia) * f64::from(state.turn).powi(2))
    };
    (0..world.n_bodies()).filter_map(|body_idx| world.drive_state(body_idx)).map(of_body).sum()
}

#[track_caller]
fn near(found: f32, expected: f32, tolerance: f32) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected}");
}

#[test]
fn a_start_is_held_by_the_grip_and_then_goes_on_evenly() {
    let base = BaseConfig { latency: 0.0, ..BaseConfig::default() };
    let mut world = world(&base, &[Pose::new(Vec2::ZERO, 0.6)]);
    for period in 1..=20 {
        assert_eq!(advance(&mut world, &[drive(1.0, 0.0)]), [None]);
        let (time, until) = (period as f32 * DT, 1.0 / GRIP);
        // Steps of 5 ms with the velocity at their end: half a step's gain of speed ahead of the
        // closed form.
        let way = if time < until { GRIP * time * time / 2.0 } else { time - until / 2.0 };
        let along = world.pose(0).direction().dot(world.pose(0).position);
        near(along, way, 0.5 * 0.005 * 1.0 + 1e-3);
        near(world.pose(0).direction().perp_dot(world.pose(0).position), 0.0, 1e-4);
        near(world.measured(0).unwrap()[0], (GRIP * time).min(1.0), 1e-4);
    }
}

#[test]
fn free_wheels_roll_on_for_ever() {
    let base = BaseConfig { motor_torque: 0.0, ..BaseConfig::default() };
    let mut world = world(&base, &[Pose::new(Vec2::new(-3.0, 1.0), 0.3)]);
    let along = world.pose(0).direction();
    set_velocity(&mut world, 0, along * 1.25, 0.0);
    for period in 1..=100 {
        advance(&mut world, &[drive(0.0, 0.0)]);
        let expected = Vec2::new(-3.0, 1.0) + along * (1.25 * DT * period as f32);
        // 2,000 steps, each rounded to single precision.
        near(world.pose(0).position.distance(expected), 0.0, 1e-3);
    }
}

#[test]
fn a_command_is_heeded_when_it_has_arrived() {
    let base = BaseConfig { latency: 0.25, ..BaseConfig::default() };
    let mut world = world(&base, &[Pose::default()]);
    let mut speeds = Vec::new();
    // Told to go for one period only.
    for period in 0..6 {
        let v = if period == 0 { 0.2 } else { 0.0 };
        advance(&mut world, &[drive(v, 0.0)]);
        speeds.push(world.measured(0).unwrap()[0]);
    }
    assert_eq!(speeds[..2], [0.0, 0.0]);
    // 50 ms of the third period and 50 of the fourth.
    near(speeds[2], 0.2, 1e-4);
    near(world.pose(0).position.x, 0.2 * DT, 1.5e-3);
    near(speeds[3], 0.0, 1e-4);
    assert_eq!(world.drive_state(0).unwrap().commands.len(), 3);
}

#[test]
fn turning_is_what_the_formula_says() {
    let mut world = world(&BaseConfig::default(), &[Pose::default()]);
    for _ in 0..20 {
        advance(&mut world, &[drive(0.0, 1.0)]);
    }
    // 1.5 · (b/2)² / ((b/2)² + (l/2)²)
    let [wide, long] = [0.375_59_f32, 0.262].map(|side| (side / 2.0).powi(2));
    near(world.measured(0).unwrap()[1], 1.5 * wide / (wide + long), 0.01);
    near(world.pose(0).position.length(), 0.0, 1e-3);
}

#[test]
fn whoever_drives_at_a_wall_stops_there() {
    let mut world = world(&BaseConfig::default(), &[Pose::new(Vec2::new(3.0, 0.0), 0.2)]);
    world.set_walls(Vec2::splat(-5.0), Vec2::splat(5.0)).unwrap();
    let mut met = false;
    for _ in 0..60 {
        let [stop] = advance(&mut world, &[drive(1.0, 0.0)])[..] else { panic!("one body") };
        assert!(stop.is_none_or(|stop| stop == Stop::Wall), "{stop:?}");
        met |= stop.is_some();
        assert!(!world.is_blocked(0), "{:?}", world.pose(0));
    }
    assert!(met && world.body_clearance(0) < 0.05, "{} m from the wall", world.body_clearance(0));
}

#[test]
fn a_body_that_walks_pushes_nobody_and_one_that_stands_stops_a_base() {
    let mut world = world(&BaseConfig::default(), &[Pose::default()]);
    world.add_body(&Shape::square(0.5), Pose::new(Vec2::new(1.5, 0.1), 0.0)).unwrap();
    let mut stop = None;
    for _ in 0..40 {
        stop = advance(&mut world, &[drive(1.0, 0.0), Motion::Still])[0].or(stop);
        assert!(!world.is_blocked(0));
    }
    assert_eq!(stop, Some(Stop::Body(1)));
    assert_eq!(world.pose(1).position, Vec2::new(1.5, 0.1));
    // It walks at the base, which holds its brakes, and has to stop itself.
    let stood = world.pose(0).position;
    for _ in 0..10 {
        advance(&mut world, &[drive(0.0, 0.0), Motion::Walk { velocity: Vec2::new(-1.0, 0.0) }]);
    }
    assert!(world.pose(0).position.distance(stood) < 0.05 && !world.is_blocked(1));
}

#[test]
fn a_base_out_of_range_or_a_wrong_command_is_told() {
    let mut world = world(&BaseConfig::default(), &[Pose::default()]);
    let message = world.set_base(0, &BaseConfig { latency: -1.0, ..BaseConfig::default() }).unwrap_err();
    assert_eq!(message.to_string(), "robot.base.latency: found -1, expected a number in [0, 10]");
    assert_eq!(advance(&mut world, &[drive(f32::NAN, 0.0)]), [Some(Stop::Command)]);
    assert_eq!(world.pose(0), Pose::default());
}

fn rapier() -> SimConfig {
    let mut config = SimConfig::default();
    config.robot.dynamics = Dynamics::Rapier;
    config.room.width = 8.0;
    config.room.height = 8.0;
    config.spawn.goal_distance = 4.0;
    config
}

/// Some action of each agent in each step.
fn actions(n: usize, step: usize) -> Vec<[f32; 2]> {
    let part = |k: usize| ((k * 2_654_435_761) % 1000) as f32 / 1000.0;
    (0..n).map(|agent| [part(step / 7 + 31 * agent), 2.0 * part(step / 5 + 17 * agent) - 1.0]).collect()
}

fn run(rooms: &mut Rooms, steps: std::ops::Range<usize>) {
    for step in steps {
        let actions = actions(rooms.len(), step);
        rooms.step(&actions);
    }
}

#[test]
fn rooms_have_the_same_bits_at_any_number_of_threads_and_after_a_restart() {
    let fresh = || Rooms::new(&rapier(), 6, 4, 1, &Streams::new(3)).unwrap();
    let at = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut rooms = fresh();
            run(&mut rooms, 0..80);
            serde_json::to_string(&rooms.state()).unwrap()
        })
    };
    let one = at(1);
    assert!(one == at(2) && one == at(4), "threads changed the rooms");
    let mut rooms = fresh();
    run(&mut rooms, 0..33);
    let text = serde_json::to_string(&rooms.state()).unwrap();
    assert!(text.contains("\"drive\":{\"velocity\":["));
    let mut restored = fresh();
    restored.restore(serde_json::from_str(&text).unwrap()).unwrap();
    run(&mut restored, 33..80);
    assert!(serde_json::to_string(&restored.state()).unwrap() == one, "a restart changed the rooms");
    // A snapshot of robots without mass is none of these rooms.
    let mut kinematic = rapier();
    kinematic.robot.dynamics = Dynamics::Kinematic;
    let state = Rooms::new(&kinematic, 6, 4, 1, &Streams::new(3)).unwrap().state();
    assert!(fresh().restore(state).is_err());
}

#[test]
fn rooms_measure_what_the_wheels_do() {
    let mut config = rapier();
    config.robot.base = Some(BaseConfig { latency: 0.1, ..BaseConfig::default() });
    let mut rooms = Rooms::new(&config, 1, 1, 1, &Streams::new(1)).unwrap();
    let velocity = |rooms: &Rooms| {
        let row = rooms.observations();
        [row[row.len() - 2], row[row.len() - 1]]
    };
    rooms.step(&[[0.4, 0.0]]);
    assert_eq!(velocity(&rooms), [0.0, 0.0]);
    rooms.step(&[[0.4, 0.0]]);
    assert!((velocity(&rooms)[0] - 0.4).abs() < 1e-3, "{:?}", velocity(&rooms));
    assert_eq!(rooms.transitions()[0].executed, [0.4, 0.0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Bases that brake or roll free among one another, walls and obstacles only lose energy, stay
    /// where they were on the one side of a thin wall, and overlap nothing.
    #[test]
    fn energy_does_not_grow_and_nothing_is_passed_through(
        velocities in prop::collection::vec((-12.0_f32..12.0, -12.0_f32..12.0, -6.0_f32..6.0), 3),
        headings in prop::collection::vec(-3.0_f32..3.0, 3),
        torque in prop_oneof![Just(0.0_f32), Just(24.5)],
    ) {
        let base = BaseConfig { motor_torque: torque, ..BaseConfig::default() };
        let places = [Vec2::new(-2.5, 1.5), Vec2::new(-2.5, -1.5), Vec2::new(2.5, 0.0)];
        let poses: Vec<Pose> = places.iter().zip(&headings).map(|(p, h)| Pose::new(*p, *h)).collect();
        let mut world = world(&base, &poses);
        world.set_walls(Vec2::splat(-4.0), Vec2::splat(4.0)).unwrap();
        let wall = Shape::Segment { a: Vec2::new(0.0, -4.0), b: Vec2::new(0.0, 4.0) };
        world.add_obstacle(&wall, Pose::default()).unwrap();
        world.add_obstacle(&Shape::Circle { radius: 0.4 }, Pose::new(Vec2::new(-1.2, 0.0), 0.0)).unwrap();
        for (body_idx, (x, y, turn)) in velocities.iter().enumerate() {
            set_velocity(&mut world, body_idx, Vec2::new(*x, *y), *turn);
        }
        for _ in 0..25 {
            let before = energy(&world, &base);
            advance(&mut world, &[drive(0.0, 0.0); 3]);
            let after = energy(&world, &base);
            prop_assert!(after <= before * 1.001 + 1e-4, "{before} J, then {after} J");
            for (body_idx, start) in places.iter().enumerate() {
                let position = world.pose(body_idx).position;
                prop_assert!(position.x * start.x > 0.0, "base {body_idx} is at {position}");
                prop_assert!(position.abs().max_element() < 4.0, "base {body_idx} is at {position}");
                prop_assert!(!world.is_blocked(body_idx), "base {body_idx} at {position} overlaps something");
            }
        }
    }
}
