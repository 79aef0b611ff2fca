//! Properties of social forces in any scene: symmetries, limits, order.

use glam::{DVec2, Vec2};
use jostle_peds::social_force::{Border, SocialForce, SocialForceConfig, Variant, Walker};
use proptest::{prelude::*, test_runner::RngSeed};

fn vector(limit: f64) -> impl Strategy<Value = DVec2> {
    (-limit..limit, -limit..limit).prop_map(|(x, y)| DVec2::new(x, y))
}

fn walkers() -> impl Strategy<Value = Vec<Walker>> {
    let walker = (vector(5.0), vector(1.0), vector(9.0), 0.5..1.5).prop_map(
        |(position, velocity, goal, desired_speed)| Walker { position, velocity, goal, desired_speed },
    );
    prop::collection::vec(walker, 1..8)
}

fn borders(map: impl Fn(DVec2) -> DVec2) -> Vec<Border> {
    let at = |x: f64, y: f64| map(DVec2::new(x, y));
    let wall = [[at(-6.0, -6.0), at(6.0, -6.0)]];
    let block = [[at(1.0, 1.0), at(2.0, 1.0)], [at(2.0, 1.0), at(2.0, 3.0)], [at(2.0, 3.0), at(1.0, 1.0)]];
    vec![Border::new(&wall).unwrap(), Border::new(&block).unwrap()]
}

fn model(variant: Variant) -> SocialForce {
    SocialForce::new(&SocialForceConfig { variant, ..SocialForceConfig::default() }).unwrap()
}

/// True if no pair is at the edge of a view or near b = 0, where rounding decides or is enlarged.
fn is_regular(model: &SocialForce, walkers: &[Walker]) -> bool {
    let cos_half_view = 100_f64.to_radians().cos();
    walkers.iter().enumerate().all(|(a, walker)| {
        let direction = (walker.goal - walker.position).normalize_or_zero();
        walkers.iter().enumerate().filter(|(b, _)| *b != a).all(|(_, other)| {
            let (force, _) = model.pair_force(walker, other);
            let margin = |u: DVec2| (direction.dot(u.normalize_or_zero()) - cos_half_view).abs();
            margin(-force) > 1e-6 && margin(other.position - walker.position) > 1e-6 && force.length() < 100.0
        })
    })
}

fn check_equivariance(walkers: &[Walker], point: impl Fn(DVec2) -> DVec2, vector: impl Fn(DVec2) -> DVec2) {
    for variant in Variant::ALL {
        let model = model(variant);
        if !is_regular(&model, walkers) {
            continue;
        }
        let mapped: Vec<Walker> = walkers
            .iter()
            .map(|w| Walker {
                position: point(w.position),
                velocity: vector(w.velocity),
                goal: point(w.goal),
                ..*w
            })
            .collect();
        let plain = model.forces(walkers, &borders(|p| p)).total;
        let got = model.forces(&mapped, &borders(&point)).total;
        for (got, plain) in got.iter().zip(plain) {
            let expected = vector(plain);
            assert!(got.distance(expected) < 1e-7 * (1.0 + expected.length()), "{got}, not {expected}");
        }
    }
}

fn seeded(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(seeded(200))]

    #[test]
    fn rotation_and_translation(walkers in walkers(), angle in 0.0..std::f64::consts::TAU, shift in vector(20.0)) {
        let turn = DVec2::from_angle(angle);
        check_equivariance(&walkers, |p| turn.rotate(p) + shift, |v| turn.rotate(v));
    }

    #[test]
    fn mirror(walkers in walkers()) {
        let flip = |p: DVec2| DVec2::new(p.x, -p.y);
        check_equivariance(&walkers, flip, flip);
    }

    #[test]
    fn order_of_walkers(walkers in walkers(), shift in 0_usize..8) {
        let model = model(Variant::Paper);
        let plain = model.forces(&walkers, &borders(|p| p)).total;
        let mut turned = walkers.clone();
        let shift = shift % walkers.len();
        turned.rotate_left(shift);
        let mut got = model.forces(&turned, &borders(|p| p)).total;
        got.rotate_right(shift);
        for (got, plain) in got.iter().zip(plain) {
            prop_assert!(got.distance(plain) <= 1e-12 * (1.0 + plain.length()));
        }
    }

    #[test]
    fn speeds_are_limited_and_finite(walkers in walkers(), copies in 1_usize..3) {
        let crowded: Vec<Walker> = walkers.iter().flat_map(|w| vec![*w; copies]).collect();
        for variant in Variant::ALL {
            let mut walkers = crowded.clone();
            for _ in 0..20 {
                model(variant).step(&mut walkers, &borders(|p| p), 0.1);
            }
            for walker in walkers {
                prop_assert!(walker.velocity.length() <= 1.3 * walker.desired_speed + 1e-12);
                prop_assert!(walker.position.is_finite());
            }
        }
    }

    #[test]
    fn a_wall_repels_more_the_nearer_it_is(x in -5.0..5.0_f64, near in 0.01..1.0_f64, farther in 0.01..1.0_f64) {
        let wall = &borders(|p| p)[0];
        let model = model(Variant::Paper);
        let force = |distance: f64| model.wall_force(DVec2::new(x, -6.0 + distance), wall);
        prop_assert!(force(near).y > force(near + farther).y && force(near + farther).y > 0.0);
        prop_assert!(force(near).x.abs() < 1e-9);
    }
}

#[test]
fn a_free_pedestrian_reaches_its_desired_speed() {
    let mut walkers = [Walker {
        position: DVec2::ZERO,
        velocity: DVec2::ZERO,
        goal: DVec2::new(60.0, 80.0),
        desired_speed: 1.34,
    }];
    for _ in 0..100 {
        model(Variant::Paper).step(&mut walkers, &[], 0.1);
    }
    assert!((walkers[0].velocity - 1.34 * DVec2::new(0.6, 0.8)).length() < 1e-6);
}

#[test]
fn a_corridor_is_traversed() {
    let room = [Vec2::new(0.0, -1.0), Vec2::new(0.0, 1.0), Vec2::new(20.0, 1.0), Vec2::new(20.0, -1.0)];
    let borders = Border::from_polygons(&[room]).unwrap();
    // One behind the other: two abreast slow each other down, for each recoils from the step that
    // it foresees the other take.
    let walker = |x: f64, y: f64| Walker {
        position: DVec2::new(x, y),
        velocity: DVec2::ZERO,
        goal: DVec2::new(19.0, y),
        desired_speed: 1.0,
    };
    let mut walkers = [walker(1.0, -0.4), walker(4.0, 0.4)];
    let mut steps = 0;
    while walkers.iter().any(|w| w.position.x < 17.0) {
        model(Variant::Paper).step(&mut walkers, &borders, 0.1);
        assert!(walkers.iter().all(|w| w.position.y.abs() < 1.0), "through the wall");
        steps += 1;
        assert!(steps < 260, "too slow: {walkers:?}");
    }
}

/// The wall of the ORCA test (0.4 m thick, a gap of 1.2 m). Pedestrians of this model are points:
/// what keeps them apart is their repulsion, so "without overlap" means here that no two come
/// nearer than a shoulder's width and none goes through the wall. Walks twenty through the gap:
/// steps (if they pass within 4,000) and the least distance.
fn through_the_gap(variant: Variant) -> (Option<usize>, f64) {
    let block =
        |y0: f32, y1: f32| [Vec2::new(-0.2, y0), Vec2::new(0.2, y0), Vec2::new(0.2, y1), Vec2::new(-0.2, y1)];
    let borders = Border::from_polygons(&[block(-8.0, -0.6), block(0.6, 8.0)]).unwrap();
    let start = |i: u8| DVec2::new(-2.0 - f64::from(i / 5), f64::from(i % 5) - 2.0 + 0.01 * f64::from(i));
    let walker = |i| Walker {
        position: start(i),
        velocity: DVec2::ZERO,
        goal: DVec2::new(0.3, 0.0),
        desired_speed: 1.0,
    };
    let mut walkers: Vec<Walker> = (0..20).map(walker).collect();
    let mut nearest = f64::INFINITY;
    for step in 0..4000 {
        if walkers.iter().all(|w| w.position.x >= 1.0) {
            return (Some(step), nearest);
        }
        for walker in &mut walkers {
            // Through the middle of the gap, then straight on.
            let at = walker.position;
            walker.goal = if at.x < -0.2 { DVec2::new(0.3, 0.0) } else { at + DVec2::new(2.0, 0.3 * at.y) };
        }
        model(variant).step(&mut walkers, &borders, 0.1);
        for (a, walker) in walkers.iter().enumerate() {
            let at = walker.position;
            assert!(at.x.abs() >= 0.2 || at.y.abs() < 0.6, "pedestrian {a} is inside the wall at {at}");
            nearest = walkers[..a].iter().map(|other| at.distance(other.position)).fold(nearest, f64::min);
        }
    }
    (None, nearest)
}

/// Pedestrians of this model are points, kept apart only by their repulsion; what keeps bodies
/// apart in a room is the room. With others' steps foreseen for 2 s the gap clogs: everyone aims at
/// one point, and each recoils from where all others would be in two seconds. The default variant
/// lets a few through and then jams, which is the model's and not the code's (the forces are the
/// fixtures'); with 0.4 s all twenty pass.
#[test]
fn a_bottleneck_passes_twenty_where_steps_are_foreseen_for_a_moment() {
    for variant in Variant::ALL {
        let (steps, nearest) = through_the_gap(variant);
        println!("{}: 20 through 1.2 m in {steps:?} steps, least distance {nearest}", variant.name());
        if variant.foresight() < 1.0 {
            assert!(steps.is_some_and(|steps| steps < 500), "{}: {steps:?}", variant.name());
            assert!(nearest > 0.12, "{}: {nearest}", variant.name());
        }
        assert!(variant != Variant::Paper || steps.is_none(), "the default no longer jams: say so in docs/");
    }
}
