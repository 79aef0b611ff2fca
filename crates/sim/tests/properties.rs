//! Properties of scan, observation, reward and motion that hold for any scene.

use glam::{DVec2, Vec2};
use jostle_sim::{
    Hit, Laser, LaserConfig, LaserKernel, Motion, Observer, Pose, Sensor, Shape, SimConfig, Streams, World,
    outcome, reward,
};
use proptest::prelude::*;
use proptest::strategy::ValueTree;

const BEAMS: usize = 512;

/// A shape with its pose, away from the origin so that the sensor there is never inside.
fn placed() -> impl Strategy<Value = (Shape, Pose)> {
    let shape = prop_oneof![
        (0.1_f32..0.8).prop_map(|radius| Shape::Circle { radius }),
        (0.2_f32..1.2, 0.2_f32..1.2).prop_map(|(length, width)| Shape::Box { length, width }),
        (3_u8..8, 0.2_f32..0.9).prop_map(|(n, radius)| Shape::Polygon {
            vertices: (0..n)
                .map(|i| radius * Vec2::from_angle(f32::from(i) * std::f32::consts::TAU / f32::from(n)))
                .collect(),
        }),
        (0.1_f32..0.9).prop_map(|x| Shape::Segment { a: Vec2::new(-x, 0.0), b: Vec2::new(x, 0.1) }),
    ];
    (shape, 1.2_f32..9.0, -3.1_f32..3.1, -3.1_f32..3.1).prop_map(|(shape, distance, bearing, heading)| {
        (shape, Pose::new(distance * Vec2::from_angle(bearing), heading))
    })
}

fn scene() -> impl Strategy<Value = Vec<(Shape, Pose)>> {
    prop::collection::vec(placed(), 0..9)
}

fn world(shapes: &[(Shape, Pose)], walls: bool) -> World {
    let mut world = World::new();
    if walls {
        world.set_walls(Vec2::splat(-10.0), Vec2::new(10.0, 9.0)).expect("walls");
    }
    for (shape, pose) in shapes {
        world.add_obstacle(shape, *pose).expect("obstacle");
    }
    world
}

fn scan(world: &World, sensor: Pose, kernel: LaserKernel) -> Vec<f32> {
    let mut laser = Laser::new(&LaserConfig { kernel, ..LaserConfig::default() }).expect("laser");
    let mut ranges = vec![0.0; BEAMS];
    laser.scan(world, Sensor::Free(sensor), |_| true, &mut ranges);
    ranges
}

/// Brute force in f64: every beam against every side, no culling, nothing shared with the kernels.
fn reference(shapes: &[(Shape, Pose)], walls: bool, sensor: Pose, angle: f64) -> f64 {
    let origin = sensor.position.as_dvec2();
    let d = DVec2::from_angle(f64::from(sensor.heading) + angle);
    let mut best = 10.0_f64;
    let mut side = |a: DVec2, b: DVec2| {
        let (along, to_a) = (b - a, a - origin);
        let det = d.perp_dot(along);
        let (t, u) = (to_a.perp_dot(along) / det, to_a.perp_dot(d) / det);
        if det != 0.0 && t >= 0.0 && (0.0..=1.0).contains(&u) {
            best = best.min(t);
        }
    };
    if walls {
        let corners = [(-10.0, -10.0), (10.0, -10.0), (10.0, 9.0), (-10.0, 9.0)].map(DVec2::from);
        (0..4).for_each(|i| side(corners[i], corners[(i + 1) % 4]));
    }
    let mut discs = Vec::new();
    for (shape, pose) in shapes {
        let turn = DVec2::from_angle(f64::from(pose.heading));
        let place = |v: Vec2| pose.position.as_dvec2() + turn.rotate(v.as_dvec2());
        let vertices = match shape {
            Shape::Circle { radius } => {
                discs.push((pose.position.as_dvec2() - origin, f64::from(*radius)));
                continue;
            }
            Shape::Box { length, width } => {
                let h = Vec2::new(length / 2.0, width / 2.0);
                vec![-h, Vec2::new(h.x, -h.y), h, Vec2::new(-h.x, h.y)]
            }
            Shape::Segment { a, b } => vec![*a, *b],
            Shape::Polygon { vertices } => vertices.clone(),
        };
        (0..vertices.len()).for_each(|i| side(place(vertices[i]), place(vertices[(i + 1) % vertices.len()])));
    }
    for (centre, radius) in discs {
        let (b, q) = (d.dot(centre), d.perp_dot(centre));
        if b > 0.0 && q.abs() <= radius {
            best = best.min(b - (radius * radius - q * q).sqrt());
        }
    }
    best
}

/// True if a beam grazes: the reference moves by more than `tolerance` when its angle moves by
/// `delta`.
fn grazes(shapes: &[(Shape, Pose)], walls: bool, sensor: Pose, k: usize, delta: f64, tolerance: f64) -> bool {
    let at =
        |shift| reference(shapes, walls, sensor, std::f64::consts::TAU * k as f64 / BEAMS as f64 + shift);
    let middle = at(0.0);
    [-delta, delta].into_iter().any(|shift| (at(shift) - middle).abs() > tolerance)
}

/// Most grazing beams among those compared, as the kernels' contract has it.
const SILHOUETTES: f64 = 1e-5;

/// Both kernels against the reference and against each other over many fixed random scenes, without
/// proptest's shrinking because the bound is on the whole sample.
#[test]
fn both_kernels_agree_with_each_other_and_with_f64() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let (mut n, mut apart) = (0_u32, 0_u32);
    for _ in 0..400 {
        let shapes = scene().new_tree(&mut runner).expect("scene").current();
        let heading = (-3.1_f32..3.1).new_tree(&mut runner).expect("heading").current();
        let sensor = Pose::new(Vec2::ZERO, heading);
        let scene = world(&shapes, true);
        let analytic = scan(&scene, sensor, LaserKernel::Analytic);
        let parry = scan(&scene, sensor, LaserKernel::Parry);
        for k in 0..BEAMS {
            n += 1;
            apart += u32::from((analytic[k] - parry[k]).abs() > 1e-4);
            let exact = reference(&shapes, true, sensor, std::f64::consts::TAU * k as f64 / BEAMS as f64);
            let grazing =
                |x: f32| (f64::from(x) - exact).abs() <= 1e-4 || grazes(&shapes, true, sensor, k, 2e-6, 5e-5);
            assert!(grazing(analytic[k]), "analytic beam {k}: {} for {exact}: {shapes:?}", analytic[k]);
            assert!(grazing(parry[k]), "parry beam {k}: {} for {exact}: {shapes:?}", parry[k]);
        }
    }
    assert!(f64::from(apart) <= (f64::from(n) * SILHOUETTES).max(2.0), "{apart} of {n} beams differ");
}

/// The two scans agree but for a few grazing beams.
fn close(a: &[f32], b: impl Fn(usize) -> f32) -> bool {
    (0..BEAMS).filter(|k| (a[*k] - b(*k)).abs() > 1e-3).count() <= 3
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn scan_is_equivariant_under_rotation_and_translation(
        shapes in scene(), heading in -3.0_f32..3.0, turn in -3.0_f32..3.0, x in -50.0_f32..50.0, y in -50.0_f32..50.0,
    ) {
        let (shift, about) = (Vec2::new(x, y), Vec2::from_angle(turn));
        let moved: Vec<(Shape, Pose)> = shapes
            .iter()
            .map(|(s, p)| (s.clone(), Pose::new(shift + about.rotate(p.position), p.heading + turn)))
            .collect();
        let before = scan(&world(&shapes, false), Pose::new(Vec2::ZERO, heading), LaserKernel::Analytic);
        let after = scan(&world(&moved, false), Pose::new(shift, heading + turn), LaserKernel::Analytic);
        prop_assert!(close(&before, |k| after[k]));
    }

    #[test]
    fn scan_is_equivariant_under_mirroring(shapes in scene(), heading in -3.0_f32..3.0) {
        let flip = |v: Vec2| Vec2::new(v.x, -v.y);
        let mirrored: Vec<(Shape, Pose)> = shapes
            .iter()
            .map(|(s, p)| {
                let s = match s {
                    Shape::Polygon { vertices } => {
                        Shape::Polygon { vertices: vertices.iter().rev().map(|v| flip(*v)).collect() }
                    }
                    Shape::Segment { a, b } => Shape::Segment { a: flip(*a), b: flip(*b) },
                    other => other.clone(),
                };
                (s, Pose::new(flip(p.position), -p.heading))
            })
            .collect();
        let before = scan(&world(&shapes, false), Pose::new(Vec2::ZERO, heading), LaserKernel::Analytic);
        let after = scan(&world(&mirrored, false), Pose::new(Vec2::ZERO, -heading), LaserKernel::Analytic);
        prop_assert!(close(&before, |k| after[(BEAMS - k) % BEAMS]));
    }

    #[test]
    fn ranges_shrink_as_an_obstacle_nears(distance in 1.5_f32..8.0, step in 0.05_f32..0.8, heading in -3.0_f32..3.0) {
        // Along one beam: the obstacle's near side moves towards the sensor and never away from it.
        let at = |d: f32| world(&[(Shape::Circle { radius: 0.5 }, Pose::new(Vec2::new(d, 0.0), heading))], true);
        let far = scan(&at(distance), Pose::default(), LaserKernel::Analytic);
        let near = scan(&at(distance - step), Pose::default(), LaserKernel::Analytic);
        prop_assert!((far[0] - near[0] - step).abs() < 1e-5);
        prop_assert!((0..BEAMS).all(|k| near[k] <= far[k] + 1e-5));
    }

    #[test]
    fn the_order_of_bodies_does_not_matter_to_a_scan(shapes in scene(), heading in -3.0_f32..3.0) {
        let sensor = Pose::new(Vec2::ZERO, heading);
        let reversed: Vec<(Shape, Pose)> = shapes.iter().rev().cloned().collect();
        prop_assert_eq!(
            scan(&world(&shapes, true), sensor, LaserKernel::Analytic),
            scan(&world(&reversed, true), sensor, LaserKernel::Analytic)
        );
    }

    #[test]
    fn a_body_is_seen_only_by_those_who_may(heading in -3.0_f32..3.0, x in 1.0_f32..5.0) {
        let mut world = World::new();
        world.add_body(&Shape::square(0.5), Pose::default()).expect("body");
        world.add_body(&Shape::square(0.5), Pose::new(Vec2::new(x, 0.0), heading)).expect("body");
        let mut laser = Laser::new(&LaserConfig::default()).expect("laser");
        let (mut ranges, mut hits) = (vec![0.0; BEAMS], vec![Hit::None; BEAMS]);
        let seen = laser.scan_hits(&world, Sensor::Body(0), |_| true, &mut ranges, &mut hits);
        prop_assert_eq!((seen.nearest, hits[0]), (Hit::Body(1), Hit::Body(1)));
        prop_assert!(seen.min_range < x);
        let blind = laser.scan_hits(&world, Sensor::Body(0), |i| i != 1, &mut ranges, &mut hits);
        prop_assert_eq!((blind.nearest, blind.min_range), (Hit::None, 10.0));
        prop_assert!(ranges.iter().all(|r| *r == 10.0));
    }

    #[test]
    fn goal_and_reward_do_not_depend_on_the_frame(
        x in -9.0_f32..9.0, y in -9.0_f32..9.0, heading in -3.0_f32..3.0, turn in -3.0_f32..3.0, w in -1.0_f32..1.0,
    ) {
        let mut config = SimConfig::default();
        config.laser.beams = 1;
        let observer = Observer::new(&config, Streams::new(0).stream("noise", &[]));
        let row = |pose: Pose, goal: Vec2, w: f32| {
            let mut row = [0.0; 7];
            observer.write_motion(pose, goal, [0.5, w], &mut row);
            row
        };
        let (goal, about, shift) = (Vec2::new(x, y), Vec2::from_angle(turn), Vec2::new(3.0, -2.0));
        let plain = row(Pose::new(Vec2::X, heading), goal, w);
        let moved = row(Pose::new(shift + about.rotate(Vec2::X), heading + turn), shift + about.rotate(goal), w);
        prop_assert!((plain[3] - moved[3]).abs() < 1e-4 && (plain[4] - moved[4]).abs() < 1e-4);
        let mirrored = row(Pose::new(Vec2::X, -heading), Vec2::new(x, -y), -w);
        prop_assert!((plain[3] - mirrored[3]).abs() < 1e-5 && (plain[4] + mirrored[4]).abs() < 1e-5);
        let ended = outcome(goal.distance(Vec2::X), 0.5, None);
        prop_assert_eq!(reward(&config.reward, ended, 0.1, w), reward(&config.reward, ended, 0.1, -w));
    }

    #[test]
    fn nothing_overlaps_after_any_step(
        seed in 0_u64..1000, dt in 0.05_f32..3.0, speed in 0.5_f32..20.0,
    ) {
        let streams = Streams::new(seed);
        let mut rng = streams.stream("test", &[]);
        let mut world = World::new();
        world.set_walls(Vec2::splat(-4.0), Vec2::splat(4.0)).expect("walls");
        let block = Shape::Polygon { vertices: vec![Vec2::ZERO, Vec2::new(1.0, 0.0), Vec2::new(0.5, 0.7)] };
        world.add_obstacle(&block, Pose::default()).expect("obstacle");
        for i in 0..8_u8 {
            let place = Vec2::new(f32::from(i % 4) * 1.5 - 2.5, if i < 4 { -2.0 } else { 2.0 });
            let shape = if i % 3 == 0 { Shape::Circle { radius: 0.3 } } else { Shape::square(0.5) };
            world.add_body(&shape, Pose::new(place, f32::from(i))).expect("body");
        }
        let mut stalled = [false; 8];
        for _ in 0..40 {
            let mut draw = || speed * (2.0 * rng.random::<f32>() - 1.0);
            let motions: [Motion; 8] = std::array::from_fn(|i| match i % 2 {
                0 => Motion::Drive { v: draw(), w: draw() },
                _ => Motion::Walk { velocity: Vec2::new(draw(), draw()) },
            });
            let before: Vec<Pose> = (0..8).map(|i| world.pose(i)).collect();
            world.advance(&motions, dt, &mut stalled);
            for i in 0..8 {
                prop_assert!(!world.is_blocked(i));
                prop_assert!(world.pose(i).position.abs().max_element() < 4.0);
                prop_assert!(!stalled[i] || world.pose(i) == before[i]);
            }
        }
    }
}
