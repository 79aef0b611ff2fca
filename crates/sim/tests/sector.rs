//! A laser that sees a sector: its beams are those of a full circle, and its crashes are judged all
//! round.

use glam::Vec2;
use jostle_sim::{
    FRAMES, Hit, Laser, LaserConfig, LaserKernel, Outcome, Pose, Rooms, ScanSummary, Sensor, Shape,
    SimConfig, StepEnd, Streams, World,
};
use proptest::prelude::*;
use rand::RngExt;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Shapes of all kinds around the origin, some of them near it; the last two are bodies.
fn scene(seed: u64) -> Vec<(Shape, Pose)> {
    let mut rng = Streams::new(seed).stream("scene", &[]);
    let triangle = vec![Vec2::new(-0.4, -0.3), Vec2::new(0.5, -0.2), Vec2::new(0.0, 0.6)];
    let shapes = [
        Shape::Circle { radius: 0.4 },
        Shape::Segment { a: Vec2::new(-0.6, 0.0), b: Vec2::new(0.6, 0.1) },
        Shape::Polygon { vertices: triangle },
        Shape::Box { length: 1.1, width: 0.3 },
        Shape::square(0.5),
        Shape::Circle { radius: 0.3 },
    ];
    let mut place = |shape: Shape| {
        let bearing = Vec2::from_angle(rng.random_range(-PI..PI));
        (shape, Pose::new(rng.random_range(0.8_f32..6.0) * bearing, rng.random_range(-PI..PI)))
    };
    shapes.into_iter().map(&mut place).collect()
}

fn world(seed: u64) -> World {
    let mut world = World::new();
    world.set_walls(Vec2::splat(-7.0), Vec2::new(9.0, 8.0)).expect("walls");
    for (i, (shape, pose)) in scene(seed).iter().enumerate() {
        if i < 4 {
            world.add_obstacle(shape, *pose).expect("obstacle");
        } else {
            world.add_body(shape, *pose).expect("body");
        }
    }
    world
}

/// Points of an outline in the room, at most a few millimetres apart.
fn outline(shape: &Shape, pose: Pose) -> Vec<Vec2> {
    const POINTS: u16 = 1000;
    let corners = match shape {
        Shape::Circle { radius } => {
            (0..POINTS).map(|i| *radius * Vec2::from_angle(TAU * f32::from(i) / f32::from(POINTS))).collect()
        }
        Shape::Box { length, width } => {
            let (x, y) = (length / 2.0, width / 2.0);
            vec![Vec2::new(-x, -y), Vec2::new(x, -y), Vec2::new(x, y), Vec2::new(-x, y)]
        }
        Shape::Segment { a, b } => vec![*a, *b],
        Shape::Polygon { vertices } => vertices.clone(),
    };
    let part = |i: u16| f32::from(i) / f32::from(POINTS);
    let side = |(a, b): (Vec2, Vec2)| (0..=POINTS).map(move |i| a.lerp(b, part(i)));
    let next = corners.iter().copied().cycle().skip(1);
    let points = corners.iter().copied().zip(next).flat_map(side);
    points.map(|point| pose.position + Vec2::from_angle(pose.heading).rotate(point)).collect()
}

/// Ranges and hits of a scan from the origin, and its summary.
fn scan(world: &World, heading: f32, config: &LaserConfig) -> (Vec<f32>, Vec<Hit>, ScanSummary) {
    let mut laser = Laser::new(config).expect("laser");
    let (mut ranges, mut hits) = (vec![0.0; config.beams], vec![Hit::None; config.beams]);
    let sensor = Sensor::Free(Pose::new(Vec2::ZERO, heading));
    let summary = laser.scan_hits(world, sensor, |_| true, &mut ranges, &mut hits);
    let mut alone = vec![0.0; config.beams];
    assert_eq!(laser.scan(world, sensor, |_| true, &mut alone), summary);
    assert_eq!(alone, ranges);
    (ranges, hits, summary)
}

fn circle(kernel: LaserKernel) -> LaserConfig {
    LaserConfig { kernel, ..LaserConfig::default() }
}

/// The sector of `beams` beams of a full circle of 512 that begins at its beam `first`.
fn sector_of_circle(first: i32, beams: usize, kernel: LaserKernel) -> LaserConfig {
    let step = TAU / 512.0;
    LaserConfig { beams, fov: step * (beams - 1) as f32, angle_min: step * first as f32, ..circle(kernel) }
}

/// Beams of a scan that may differ: an angle that is rounded to another bit meets a silhouette or
/// misses it.
const GRAZING: usize = 3;

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    /// As many beams as culling is by, and fewer.
    #[test]
    fn a_sector_is_the_same_beams_of_a_full_circle(
        seed in 0_u64..10_000, heading in -3.0_f32..3.0, first in -511_i32..512, beams in 2_usize..511,
    ) {
        let world = world(seed);
        for kernel in [LaserKernel::Analytic, LaserKernel::Parry] {
            let (whole, whole_hits, _) = scan(&world, heading, &circle(kernel));
            let (ranges, hits, _) = scan(&world, heading, &sector_of_circle(first, beams, kernel));
            let apart = |k: &usize| {
                let beam = (first + *k as i32).rem_euclid(512) as usize;
                (ranges[*k] - whole[beam]).abs() > 1e-4 || hits[*k] != whole_hits[beam]
            };
            let apart: Vec<usize> = (0..beams).filter(apart).collect();
            prop_assert!(apart.len() <= GRAZING, "{:?}: beams {:?} differ", kernel, apart);
        }
    }

    #[test]
    fn both_kernels_see_the_same_sector(
        seed in 0_u64..10_000, heading in -3.0_f32..3.0, beams in 2_usize..1200, fov in 0.001_f32..6.27,
        angle_min in -TAU..TAU,
    ) {
        let world = world(seed);
        let of = |kernel| scan(&world, heading, &LaserConfig { beams, fov, angle_min, ..circle(kernel) });
        let (analytic, parry) = (of(LaserKernel::Analytic), of(LaserKernel::Parry));
        let apart = (0..beams).filter(|k| (analytic.0[*k] - parry.0[*k]).abs() > 1e-4).count();
        prop_assert!(apart <= GRAZING, "{} of {} beams differ", apart, beams);
        prop_assert_eq!(analytic.2, parry.2);
    }

    /// A turned circle of beams sees what a turned sensor sees.
    #[test]
    fn beam_zero_of_a_full_circle_points_where_it_is_told_to(
        seed in 0_u64..10_000, heading in -3.0_f32..3.0, angle_min in -TAU..TAU,
    ) {
        let world = world(seed);
        let (turned, _, _) = scan(&world, heading, &LaserConfig { angle_min, ..LaserConfig::default() });
        let (ahead, _, _) = scan(&world, heading + angle_min, &LaserConfig::default());
        let apart = (0..512).filter(|k| (turned[*k] - ahead[*k]).abs() > 1e-3).count();
        prop_assert!(apart <= GRAZING, "{} beams differ", apart);
    }

    /// Whatever a sector sees, what is nearest is the nearest point of all outlines.
    #[test]
    fn what_is_near_is_judged_all_round(
        seed in 0_u64..10_000, heading in -3.0_f32..3.0, fov in 0.1_f32..6.0, angle_min in -3.0_f32..3.0,
    ) {
        let mut all: Vec<(f32, Hit)> = vec![(7.0, Hit::Wall(0))];
        for (i, (shape, pose)) in scene(seed).iter().enumerate() {
            let nearest = outline(shape, *pose).into_iter().map(Vec2::length).fold(f32::INFINITY, f32::min);
            all.push((nearest, if i < 4 { Hit::Obstacle(i) } else { Hit::Body(i - 4) }));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let sector = LaserConfig { beams: 64, fov, angle_min, ..LaserConfig::default() };
        let (ranges, _, near) = scan(&world(seed), heading, &sector);
        prop_assert!((near.min_range - all[0].0).abs() < 2e-3, "{near:?} for {:?}", all[0]);
        prop_assert!(near.nearest == all[0].1 || all[1].0 - all[0].0 < 2e-3, "{near:?} for {all:?}");
        prop_assert!(ranges.iter().all(|range| *range >= near.min_range - 1e-5));
    }
}

#[test]
fn the_first_and_the_last_beam_lie_on_the_edges() {
    let laser = LaserConfig { beams: 3, fov: PI, angle_min: -FRAC_PI_2, ..LaserConfig::default() };
    let mut world = World::new();
    world.set_walls(Vec2::new(-1.0, -2.0), Vec2::new(3.0, 4.0)).expect("walls");
    let (ranges, _, near) = scan(&world, 0.0, &laser);
    let close = |a: f32, b: f32| (a - b).abs() < 1e-5;
    assert!(close(ranges[0], 2.0) && close(ranges[1], 3.0) && close(ranges[2], 4.0), "{ranges:?}");
    assert_eq!((near.min_range, near.nearest), (1.0, Hit::Wall(0)), "the wall behind is the nearest");
}

/// Robots whose lasers look ahead.
fn config(fov: f32) -> SimConfig {
    let mut config = SimConfig::default();
    config.laser.noise_std = 0.0;
    (config.laser.beams, config.laser.fov, config.laser.angle_min) = (128, fov, -0.5 * fov);
    config
}

#[test]
fn a_robot_that_looks_ahead_crashes_into_what_comes_from_behind() {
    let config = config(1.0);
    let mut rooms = Rooms::new(&config, 1, 2, 1, &Streams::new(3)).expect("rooms");
    let mut state = serde_json::to_value(rooms.state()).expect("JSON");
    // Robot 1 stands 0.8 m ahead of robot 0, looks the same way and has its back to it.
    for (agent, x) in [(0, -0.4), (1, 0.4)] {
        state["agents"][agent]["pose"] = serde_json::json!({ "position": [x, 0.0], "heading": 0.0 });
    }
    rooms.restore(serde_json::from_value(state).expect("state")).expect("restore");
    // 0.8 m − 0.25 m − 0.5 m: the first step leaves a range of 0.45 m.
    rooms.step(&[[1.0, 0.0], [0.0, 0.0]]);
    let crashed = StepEnd::Ended(Outcome::CollisionPedestrian);
    assert_eq!(rooms.transitions()[0].end, crashed, "the one who looks at the other");
    assert_eq!(rooms.transitions()[1].end, crashed, "the one who has the other behind");
    let newest = &rooms.final_observation(1)[(FRAMES - 1) * 128..FRAMES * 128];
    assert!(newest.iter().all(|range| *range > 0.0), "it sees nothing within 5 m");
    assert!(rooms.final_observation(0)[(FRAMES - 1) * 128 + 64] < -0.45, "it sees the other ahead");
}

#[test]
fn an_observation_holds_the_beams_of_the_sector_and_no_others() {
    let mut half = config(PI);
    half.laser.beams = 129;
    let mut whole = config(TAU);
    (whole.laser.beams, whole.laser.angle_min) = (256, 0.0);
    let rooms = |config: &SimConfig| Rooms::new(config, 2, 3, 1, &Streams::new(5)).expect("rooms");
    let (half, whole) = (rooms(&half), rooms(&whole));
    let (len, len_whole) = (3 * 129 + 4, 3 * 256 + 4);
    assert_eq!((half.observations().len(), whole.observations().len()), (6 * len, 6 * len_whole));
    for (agent, row) in half.observations().chunks_exact(len).enumerate() {
        let of_whole = &whole.observations()[agent * len_whole..][..len_whole];
        assert_eq!(row[3 * 129..], of_whole[3 * 256..], "goal and velocity of robot {agent}");
        // The half circle begins at the beam that points to the right.
        let apart = |k: &usize| (row[*k] - of_whole[(k + 192) % 256]).abs() > 1e-5;
        let apart: Vec<usize> = (0..129).filter(apart).collect();
        assert!(apart.len() <= GRAZING, "beams {apart:?} of robot {agent} differ");
    }
}

#[test]
fn rooms_of_sectors_give_the_same_bits_at_any_number_of_threads_and_from_a_snapshot() {
    let config = config(1.5 * PI);
    let step = |rooms: &mut Rooms, from: u64, to: u64| {
        for k in from..to {
            let mut rng = Streams::new(9).stream("action", &[k]);
            let actions: Vec<[f32; 2]> = (0..rooms.len())
                .map(|_| [rng.random_range(-0.5..1.8), rng.random_range(-1.5..1.5)])
                .collect();
            rooms.step(&actions);
        }
        rooms.observations().iter().map(|x| x.to_bits()).collect::<Vec<u32>>()
    };
    let rooms = || Rooms::new(&config, 3, 4, 2, &Streams::new(1)).expect("rooms");
    let of_threads = [1, 5].map(|n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("pool");
        pool.install(|| step(&mut rooms(), 0, 300))
    });
    assert_eq!(of_threads[0], of_threads[1]);
    let mut first = rooms();
    step(&mut first, 0, 120);
    let mut second = rooms();
    second.restore(first.state()).expect("restore");
    assert_eq!(step(&mut second, 120, 300), of_threads[0]);
}
