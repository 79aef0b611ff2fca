//! Starts and goals: the draws of the usual room are pinned; elsewhere a draw always succeeds,
//! keeps what it promises, or the room is refused before anything runs.

use glam::Vec2;
use jostle_sim::{Outcome, Pose, Rooms, Shape, SimConfig, Spawner, StepEnd, Streams, World, maps};
use rand::RngExt;
use std::path::Path;
use tempfile::TempDir;

/// Few beams: what is tested here are places.
fn quick() -> SimConfig {
    let mut config = SimConfig::default();
    config.laser.beams = 64;
    config.laser.noise_std = 0.0;
    config
}

fn square(side: f32) -> SimConfig {
    let mut config = quick();
    (config.room.width, config.room.height) = (side, side);
    config
}

/// A map in a folder of its own.
fn with_map(name: &str, files: &[(&str, &[u8])]) -> (TempDir, SimConfig) {
    let folder = tempfile::tempdir().expect("folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("file");
    }
    let mut config = quick();
    config.room.map = Some(folder.path().join(name));
    (folder, config)
}

/// The usual room with obstacles, written as a polygon map.
fn with_obstacles(obstacles: &str) -> (TempDir, SimConfig) {
    let map = format!("walls = {{ min = [-10.0, -10.0], max = [10.0, 10.0] }}\n{obstacles}");
    with_map("m.toml", &[("m.toml", map.as_bytes())])
}

/// An image as a mapper writes it: unknown everywhere, a free square room with a solid rim in the
/// middle of the image.
fn mapped_room(pixels: usize, room: f32) -> (TempDir, SimConfig) {
    let (resolution, half) = (0.1, room / 0.1 / 2.0);
    let centre = pixels as f32 / 2.0;
    let grey = |i: usize| {
        let [x, y] = [i % pixels, i / pixels].map(|k| (k as f32 + 0.5 - centre).abs());
        match x.max(y) {
            d if d < half => 254,
            d if d < half + 2.0 => 0,
            _ => 205,
        }
    };
    let image: Vec<u8> = format!("P5\n{pixels} {pixels}\n255\n")
        .into_bytes()
        .into_iter()
        .chain((0..pixels * pixels).map(grey))
        .collect();
    let origin = -(pixels as f32) * resolution / 2.0;
    let yaml = format!(
        "image: m.pgm\nresolution: {resolution}\norigin: [{origin}, {origin}, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    );
    with_map("m.yaml", &[("m.yaml", yaml.as_bytes()), ("m.pgm", &image)])
}

fn world_of(config: &SimConfig) -> World {
    let half = Vec2::new(config.room.width, config.room.height) / 2.0;
    let load = |path: &Path| maps::load(path).expect("map").build().expect("world");
    config.room.map.as_deref().map_or_else(
        || {
            let mut world = World::new();
            world.set_walls(-half, half).expect("walls");
            world
        },
        load,
    )
}

/// The refusal of a room for that many robots.
fn refusal(config: &SimConfig, n_agents: usize) -> String {
    let message = Rooms::new(config, 1, n_agents, 1, &Streams::new(0))
        .err()
        .expect("refused before it begins")
        .to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    message
}

/// Starts and goals of a single body.
fn draws(config: &SimConfig, n: usize) -> Vec<(Vec2, Vec2)> {
    let world = world_of(config);
    let spawner = Spawner::new(config, &world).expect("spawner");
    let mut rng = Streams::new(3).stream("spawn", &[]);
    let draw = |_| {
        let (start, goal) = spawner.start_and_goal(&world, |_| true, &mut rng);
        (start.position, goal)
    };
    (0..n).map(draw).collect()
}

/// FNV-1a over the observations of many short episodes, in which starts, goals and tokens show.
fn hash_of_draws(config: &SimConfig, n_agents: usize) -> u64 {
    let mut rooms = Rooms::new(config, 2, n_agents, 5, &Streams::new(7)).expect("rooms");
    let mut rng = Streams::new(99).stream("action", &[]);
    let mut hash: u64 = 0xCBF2_9CE4_8422_2325;
    for _ in 0..400 {
        let actions: Vec<[f32; 2]> = (0..rooms.len()).map(|_| [1.0, rng.random_range(-1.0..1.0)]).collect();
        rooms.step(&actions);
        for x in rooms.observations() {
            hash = (hash ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01B3);
        }
    }
    hash
}

/// Written down before the free space was enumerated.
#[test]
fn the_draws_of_the_usual_room_are_pinned() {
    let mut config = SimConfig::default();
    config.episode.step_limit = 10;
    assert_eq!(hash_of_draws(&config, 5), 0x1600_D9CD_A497_1CA4);
    assert_eq!(hash_of_draws(&config, 20), 0x9157_D42F_4D62_1C1A);
}

#[test]
fn a_small_room_in_a_large_image_never_runs_out_of_tries() {
    let (_folder, mut config) = mapped_room(1000, 12.4);
    config.episode.step_limit = 1;
    let mut rooms = Rooms::new(&config, 4, 1, 1, &Streams::new(0)).expect("rooms");
    for _ in 0..2000 {
        rooms.step(&[[0.0, 0.0]; 4]);
    }
    for (start, goal) in draws(&config, 500) {
        assert!(start.distance(goal) >= 10.0);
        assert!([start, goal].iter().all(|p| p.abs().max_element() <= 5.2 + 1e-3), "{start} {goal}");
    }
}

#[test]
fn a_large_image_with_a_small_free_part_is_accepted() {
    let (_folder, config) = mapped_room(2000, 20.0);
    let mut rooms = Rooms::new(&config, 1, 5, 1, &Streams::new(0)).expect("rooms");
    rooms.step(&[[0.0, 0.0]; 5]);
    // Uniform over the free part, as in the room that has no image around it: each quarter has its
    // share.
    let starts: Vec<Vec2> = draws(&config, 2000).into_iter().map(|(start, _)| start).collect();
    assert!(starts.iter().all(|p| p.abs().max_element() <= 9.0 + 1e-3));
    for quarter in 0..4 {
        let inside = |p: &&Vec2| usize::from(p.x > 0.0) + 2 * usize::from(p.y > 0.0) == quarter;
        let n = starts.iter().filter(inside).count();
        assert!((430..570).contains(&n), "{n} of 2000 starts in quarter {quarter}");
    }
}

/// Sides of starts and goals of a wall across the room at y = 1, as (both below, both above,
/// apart).
fn sides(config: &SimConfig) -> [usize; 3] {
    let mut counts = [0; 3];
    for (start, goal) in draws(config, 1000) {
        counts[if (start.y > 1.0) == (goal.y > 1.0) { usize::from(goal.y > 1.0) } else { 2 }] += 1;
    }
    counts
}

#[test]
fn goals_are_where_the_robot_can_get_to() {
    let (_folder, divided) = with_obstacles("[[obstacle]]\nsegment = [[-10.0, 1.0], [10.0, 1.0]]\n");
    let [below, above, apart] = sides(&divided);
    assert!(below > 300 && above > 200 && apart == 0, "{below} below, {above} above, {apart} apart");
    // A robot whose ranges must not fall below 0.5 m gets through a door of 1.2 m and not through
    // one of 0.9 m.
    let door = |width: f32| {
        let half = width / 2.0;
        with_obstacles(&format!(
            "[[obstacle]]\nsegment = [[-10.0, 1.0], [-{half}, 1.0]]\n\
             [[obstacle]]\nsegment = [[{half}, 1.0], [10.0, 1.0]]\n"
        ))
    };
    let (_folder, wide) = door(1.2);
    assert!(sides(&wide)[2] > 300, "{:?}", sides(&wide));
    let (_folder, mut narrow) = door(0.9);
    assert_eq!(sides(&narrow)[2], 0);
    // A smaller robot with a smaller crash range does.
    narrow.episode.crash_range = 0.4;
    assert!(sides(&narrow)[2] > 300, "{:?}", sides(&narrow));
}

#[test]
fn starts_are_only_where_a_goal_can_be_reached() {
    // A closet of 3 m by 3 m in a corner: too small for a goal distance of 10 m.
    let closet = "[[obstacle]]\nsegment = [[-10.0, -7.0], [-7.0, -7.0]]\n\
                  [[obstacle]]\nsegment = [[-7.0, -10.0], [-7.0, -7.0]]\n";
    let (_folder, config) = with_obstacles(closet);
    assert!(
        draws(&config, 3000)
            .iter()
            .all(|(start, goal)| { [start, goal].iter().all(|p| p.x > -7.0 || p.y > -7.0) })
    );
    // Four rooms of 10 m by 10 m: no room is wide enough.
    let cross = "[[obstacle]]\nsegment = [[-10.0, 0.0], [10.0, 0.0]]\n\
                 [[obstacle]]\nsegment = [[0.0, -10.0], [0.0, 10.0]]\n";
    let (_folder, mut config) = with_obstacles(cross);
    config.spawn.goal_distance = 12.0;
    let message = refusal(&config, 1);
    let expected = "the largest distance between two places that can be reached from one another";
    assert!(message.starts_with("spawn.goal_distance: found 12, expected at most 11.1"), "{message}");
    assert!(message.ends_with(expected), "{message}");
    // Solid everywhere.
    let solid = "[[obstacle]]\nbox = { centre = [0.0, 0.0], length = 20.0, width = 20.0 }\n";
    let (_folder, config) = with_obstacles(solid);
    assert!(refusal(&config, 1).starts_with("spawn.wall_clearance: found 1, expected a distance from walls"));
}

/// Every pair of a size and a number is either refused at once or keeps all its distances for as
/// long as it runs.
#[test]
fn rooms_of_any_size_are_refused_or_keep_their_distances() {
    let (mut n_accepted, mut n_refused) = (0, 0);
    for side in [8.5_f32, 9.5, 10.0, 11.0, 12.0, 14.0, 15.0, 16.0] {
        for n_agents in [1, 2, 3, 5, 8, 13, 21, 34] {
            let config = square(side);
            let mut world = world_of(&config);
            let spawner = Spawner::new(&config, &world);
            let Some(spawner) = spawner.ok().filter(|spawner| spawner.check_room(n_agents).is_ok()) else {
                n_refused += 1;
                continue;
            };
            n_accepted += 1;
            let mut rng = Streams::new(5).stream("spawn", &[]);
            for _ in 0..n_agents {
                world.add_body(&Shape::square(0.5), Pose::new(Vec2::splat(1e3), 0.0)).expect("body");
            }
            for i in 0..10 * n_agents {
                let body = i % n_agents;
                let (start, goal) = spawner.start_and_goal(&world, |other| other != body, &mut rng);
                let apart =
                    |other: &usize| world.pose(*other).position.distance(start.position) >= 1.0 - 1e-4;
                assert!((0..n_agents).filter(|other| *other != body).all(|other| apart(&other)));
                assert!(start.position.distance(goal) >= 10.0 - 1e-4);
                assert!([start.position, goal].iter().all(|p| p.abs().max_element() <= side / 2.0 - 1.0));
                world.set_pose(body, start);
            }
        }
    }
    assert!(n_accepted > 20 && n_refused > 10, "{n_accepted} accepted, {n_refused} refused");
}

#[test]
fn a_respawn_gets_the_freest_place_where_its_clearance_is_not_to_be_had() {
    let config = square(20.0);
    let mut world = world_of(&config);
    let spawner = Spawner::new(&config, &world).expect("spawner");
    // A lattice of bodies every 3 m leaves places that are 2.1 m from all, but none that is 3 m
    // from all.
    for i in 0..49_u8 {
        let place = Vec2::new(f32::from(i % 7) - 3.0, f32::from(i / 7) - 3.0) * 3.0;
        world.add_body(&Shape::square(0.5), Pose::new(place, 0.0)).expect("body");
    }
    let mut rng = Streams::new(1).stream("spawn", &[]);
    let nearest = |point: Vec2| {
        (0..49).map(|body| world.pose(body).position.distance(point)).fold(f32::INFINITY, f32::min)
    };
    for _ in 0..20 {
        let (start, goal) = spawner.respawn(&world, |_| true, 3.0, &mut rng);
        assert!(nearest(start.position) > 2.05, "{} m from the nearest body", nearest(start.position));
        assert!(start.position.distance(goal) >= 10.0 - 1e-4);
        // A clearance that can be kept is kept, however seldom a draw at random would keep it.
        let (start, _) = spawner.respawn(&world, |_| true, 2.11, &mut rng);
        assert!(nearest(start.position) >= 2.11, "{} m from the nearest body", nearest(start.position));
    }
}

#[test]
fn a_goal_from_where_none_is_far_enough_is_the_farthest_place() {
    let config = square(12.0);
    let world = world_of(&config);
    let spawner = Spawner::new(&config, &world).expect("spawner");
    let mut rng = Streams::new(1).stream("spawn", &[]);
    let goal = spawner.goal(&world, Vec2::new(0.1, 0.2), &mut rng);
    assert!(goal.distance(Vec2::splat(-5.0)) < 0.1, "{goal}");
    let goal = spawner.goal(&world, Vec2::new(4.9, 4.9), &mut rng);
    assert!(goal.distance(Vec2::splat(4.9)) >= 10.0);
}

#[test]
fn clearances_that_let_a_start_be_a_crash_are_refused() {
    let refused = |change: &dyn Fn(&mut SimConfig), expected: &str| {
        let mut config = quick();
        change(&mut config);
        assert_eq!(refusal(&config, 2), expected);
    };
    refused(
        &|c| c.spawn.wall_clearance = 0.3,
        "spawn.wall_clearance: found 0.3, expected at least 0.5 m, the crash range, so that no start is a crash",
    );
    refused(
        &|c| c.episode.crash_range = 1.2,
        "spawn.wall_clearance: found 1, expected at least 1.2 m, the crash range, so that no start is a crash",
    );
    refused(
        &|c| c.robot.length = 3.0,
        "spawn.wall_clearance: found 1, expected at least 1.5206907 m, the body's circumradius, so that no start touches \
         a wall",
    );
    refused(
        &|c| c.spawn.body_clearance = 0.8,
        "spawn.body_clearance: found 0.8, expected at least 0.8535534 m, a body's radius and the crash range, so that no \
         start is a crash",
    );
    // One body has no other to keep away from.
    let mut alone = quick();
    alone.spawn.body_clearance = 0.0;
    assert!(Rooms::new(&alone, 1, 1, 1, &Streams::new(0)).is_ok());
}

/// The least clearances that are accepted: no robot that stands still crashes.
#[test]
fn the_least_clearances_start_no_crash() {
    let mut config = quick();
    config.episode.step_limit = 1;
    config.spawn.wall_clearance = config.passing_radius();
    config.spawn.body_clearance = config.body_clearance_min();
    let mut rooms = Rooms::new(&config, 4, 20, 1, &Streams::new(0)).expect("rooms");
    for _ in 0..200 {
        rooms.step(&[[0.0, 0.0]; 80]);
        assert!(rooms.transitions().iter().all(|t| t.end == StepEnd::Ended(Outcome::Timeout)));
    }
}

/// Ends of episodes of robots that drive straight on: (walls, agents, time limits).
fn straight_on(config: &SimConfig, n_agents: usize) -> [usize; 3] {
    let mut rooms = Rooms::new(config, 2, n_agents, 1, &Streams::new(2)).expect("rooms");
    let mut ends = [0; 3];
    for _ in 0..1500 {
        rooms.step(&vec![[config.robot.v_max, 0.0]; 2 * n_agents]);
        for t in rooms.transitions() {
            match t.end {
                StepEnd::Ended(Outcome::CollisionWall) => ends[0] += 1,
                StepEnd::Ended(Outcome::CollisionPedestrian) => ends[1] += 1,
                StepEnd::Ended(Outcome::Timeout) => ends[2] += 1,
                StepEnd::Ended(Outcome::Success) | StepEnd::Running => {}
            }
        }
    }
    ends
}

#[test]
fn a_body_that_is_stopped_before_its_scan_shows_it_has_crashed() {
    let check = |change: &dyn Fn(&mut SimConfig)| {
        let mut config = quick();
        change(&mut config);
        config.spawn.wall_clearance = config.passing_radius().max(1.0);
        config.spawn.body_clearance = config.body_clearance_min().max(1.0);
        let [walls, agents, limits] = straight_on(&config, 5);
        assert!(
            walls > 20 && agents > 2 && limits == 0,
            "{walls} walls, {agents} agents, {limits} time limits"
        );
    };
    check(&|_| ());
    check(&|c| c.robot.length = 2.0);
    check(&|c| c.robot.width = 2.0);
    check(&|c| c.robot.v_max = 3.0);
    check(&|c| c.episode.dt = 0.4);
    check(&|c| c.episode.crash_range = 0.1);
    check(&|c| c.laser.beams = 3);
}

/// A pole that is thinner than the gap between two beams stops a body of the usual size, too.
#[test]
fn a_pole_between_two_beams_is_a_crash() {
    let pole = |i: i32| {
        let (x, y) = (f64::from(i % 20) - 9.5, f64::from(i / 20) * 2.0 - 9.0);
        format!("[[obstacle]]\ncircle = {{ centre = [{x}, {y}], radius = 0.001 }}\n")
    };
    let poles = (0..200).map(pole).collect::<Vec<_>>().concat();
    let (_folder, mut config) = with_obstacles(&poles);
    // So sparse that most poles are missed, so near that the crash range shows none of the rest.
    config.laser.beams = 16;
    config.spawn.goal_distance = 0.6;
    config.episode.goal_radius = 0.01;
    config.spawn.wall_clearance = 0.5;
    let [walls, _, limits] = straight_on(&config, 1);
    assert!(walls > 20 && limits == 0, "{walls} walls, {limits} time limits");
}
