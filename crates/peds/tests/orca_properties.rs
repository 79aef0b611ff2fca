//! Properties of ORCA in any scene: symmetries, separation, finite answers, the same bits on any
//! number of threads.

use std::sync::Arc;

use glam::Vec2;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};
use proptest::{prelude::*, test_runner::RngSeed};

const PARAMETERS: AgentParameters = AgentParameters {
    neighbour_distance: 10.0,
    max_neighbours: 10,
    time_horizon: 5.0,
    time_horizon_obstacles: 5.0,
    radius: 0.35,
    max_speed: 1.0,
};

/// Position, velocity, preferred velocity.
type State = (Vec2, Vec2, Vec2);

fn vector(limit: f32) -> impl Strategy<Value = Vec2> {
    (-limit..limit, -limit..limit).prop_map(|(x, y)| Vec2::new(x, y))
}

/// Up to `n` agents of a 12 m square, at least a diameter apart.
fn crowd(n: usize) -> impl Strategy<Value = Vec<State>> {
    prop::collection::vec((vector(6.0), vector(0.7), vector(0.7)), 1..n).prop_map(|candidates| {
        let mut kept: Vec<State> = Vec::new();
        for candidate in candidates {
            if kept.iter().all(|other| other.0.distance(candidate.0) > 0.75) {
                kept.push(candidate);
            }
        }
        kept
    })
}

/// A wall and a block, clear of nobody in particular.
fn obstacles(map: impl Fn(Vec2) -> Vec2, reverse: bool) -> Arc<Obstacles> {
    let wall = vec![Vec2::new(-7.0, 7.0), Vec2::new(7.0, 7.5), Vec2::new(7.0, 8.0), Vec2::new(-7.0, 8.0)];
    let block = vec![Vec2::new(7.0, -2.0), Vec2::new(9.0, -2.0), Vec2::new(9.0, 1.0)];
    let mapped = |polygon: Vec<Vec2>| {
        let mut polygon: Vec<Vec2> = polygon.into_iter().map(&map).collect();
        if reverse {
            polygon.reverse();
        }
        polygon
    };
    Arc::new(Obstacles::new(&[mapped(wall), mapped(block)]).unwrap())
}

fn simulator(states: &[State], obstacles: &Arc<Obstacles>) -> OrcaSimulator {
    let mut simulator = OrcaSimulator::new(0.1, Arc::clone(obstacles)).unwrap();
    for (position, velocity, preferred) in states {
        let agent = simulator.add_agent(*position, *velocity, &PARAMETERS).unwrap();
        simulator.set_preferred_velocity(agent, *preferred).unwrap();
    }
    simulator
}

fn plan(states: &[State], obstacles: &Arc<Obstacles>) -> Vec<Vec2> {
    let mut simulator = simulator(states, obstacles);
    simulator.plan();
    (0..simulator.len()).map(|agent| simulator.planned_velocity(agent)).collect()
}

fn seeded(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// Asserts that planning commutes with a rigid map of the plane.
fn check_equivariance(
    states: &[State],
    point: impl Fn(Vec2) -> Vec2,
    vector: impl Fn(Vec2) -> Vec2,
    mirrors: bool,
) {
    let plain = plan(states, &obstacles(|p| p, false));
    let mapped: Vec<State> = states.iter().map(|(p, v, w)| (point(*p), vector(*v), vector(*w))).collect();
    let got = plan(&mapped, &obstacles(&point, mirrors));
    for (got, plain) in got.iter().zip(plain) {
        let expected = vector(plain);
        // Positions of about 10 m are rounded to 1e-6 m, and a dense scene's linear program
        // enlarges that.
        assert!(got.distance(expected) < 2e-3, "{got}, not {expected}");
    }
}

proptest! {
    #![proptest_config(seeded(200))]

    #[test]
    fn rotation_and_translation(states in crowd(12), angle in 0.0..std::f32::consts::TAU, shift in vector(20.0)) {
        let turn = Vec2::from_angle(angle);
        check_equivariance(&states, |p| turn.rotate(p) + shift, |v| turn.rotate(v), false);
    }

    #[test]
    fn mirror(states in crowd(12)) {
        let flip = |p: Vec2| Vec2::new(p.x, -p.y);
        check_equivariance(&states, flip, flip, true);
    }

    #[test]
    fn order_of_agents(states in crowd(40), shift in 1_usize..40) {
        let obstacles = obstacles(|p| p, false);
        let plain = plan(&states, &obstacles);
        let mut turned = states.clone();
        let shift = shift % states.len();
        turned.rotate_left(shift);
        let mut got = plan(&turned, &obstacles);
        got.rotate_right(shift);
        prop_assert_eq!(got, plain);
    }

    #[test]
    fn speed_is_limited_and_a_free_agent_gets_what_it_prefers(states in crowd(30), preferred in vector(3.0)) {
        let empty = Arc::new(Obstacles::default());
        for velocity in plan(&states, &empty) {
            prop_assert!(velocity.length() <= 1.0 + 1e-5);
        }
        let alone = plan(&[(Vec2::ZERO, Vec2::ZERO, preferred)], &empty)[0];
        prop_assert!(alone.distance(preferred.clamp_length_max(1.0)) < 1e-6);
    }

    #[test]
    fn coincident_agents_are_finite(states in crowd(6), copies in 2_usize..30) {
        let crowded: Vec<State> = states.iter().flat_map(|state| vec![*state; copies]).collect();
        for velocity in plan(&crowded, &obstacles(|p| p, false)) {
            prop_assert!(velocity.is_finite() && velocity.length() <= 1.0 + 1e-5);
        }
    }
}

proptest! {
    #![proptest_config(seeded(20))]

    #[test]
    fn agents_keep_apart_on_their_way(states in crowd(14), goals in prop::collection::vec(vector(6.0), 14)) {
        let mut simulator = simulator(&states, &Arc::new(Obstacles::default()));
        let nearest = walk(&mut simulator, &goals, 250);
        prop_assert!(nearest >= 2.0 * PARAMETERS.radius - 0.01, "{}", nearest);
    }

    #[test]
    fn threads_do_not_change_a_bit(states in crowd(60), dense in 1_usize..8) {
        let offset = |i: usize| Vec2::new(i as f32 * 0.1, i as f32 * 0.07);
        let many: Vec<State> =
            (0..dense).flat_map(|i| states.iter().map(move |(p, v, w)| (*p + offset(i), *v, *w))).collect();
        let obstacles = obstacles(|p| p, false);
        let (mut alone, mut parallel) = (simulator(&many, &obstacles), simulator(&many, &obstacles));
        for _ in 0..5 {
            alone.step();
            parallel.par_step();
        }
        for agent in 0..many.len() {
            let bits = |s: &OrcaSimulator| s.position(agent).to_array().map(f32::to_bits);
            prop_assert_eq!(bits(&alone), bits(&parallel));
        }
    }
}

/// Steps agents to their goals; returns the least distance between two of them at any time.
fn walk(simulator: &mut OrcaSimulator, goals: &[Vec2], steps: usize) -> f32 {
    let mut nearest = f32::INFINITY;
    for _ in 0..steps {
        for (agent, goal) in goals.iter().enumerate().take(simulator.len()) {
            let to_goal = goal - simulator.position(agent);
            simulator.set_preferred_velocity(agent, to_goal.clamp_length_max(1.0)).unwrap();
        }
        simulator.step();
        for a in 0..simulator.len() {
            for b in 0..a {
                nearest = nearest.min(simulator.position(a).distance(simulator.position(b)));
            }
        }
    }
    nearest
}

#[test]
fn a_circle_swaps_without_overlap() {
    // With a horizon of 5 s, ten and more settle in a ring around the centre (RVO2 does the same):
    // only separation is asked.
    for (n, arrive) in [(2, true), (5, true), (8, true), (12, false), (25, false)] {
        // A small twist: exactly opposite agents would stop in front of each other, as RVO2's do.
        let start = |i: usize| 6.0 * Vec2::from_angle(i as f32 * std::f32::consts::TAU / n as f32);
        let states: Vec<State> = (0..n).map(|i| (start(i), Vec2::ZERO, Vec2::ZERO)).collect();
        let goals: Vec<Vec2> = (0..n).map(|i| -Vec2::from_angle(0.02).rotate(start(i))).collect();
        let mut simulator = simulator(&states, &Arc::new(Obstacles::default()));
        let nearest = walk(&mut simulator, &goals, 600);
        assert!(nearest >= 2.0 * PARAMETERS.radius - 1e-3, "{n}: {nearest}");
        for (agent, goal) in goals.iter().enumerate() {
            let to_go = simulator.position(agent).distance(*goal);
            assert!(!arrive || to_go < 0.1, "{n}: agent {agent} has {to_go} m to go");
        }
    }
}

#[test]
fn two_at_one_point_take_what_they_prefer() {
    let state = (Vec2::ONE, Vec2::ZERO, Vec2::new(0.3, -0.2));
    let other = (Vec2::ONE, Vec2::ZERO, Vec2::new(-0.6, 0.0));
    let got = plan(&[state, other], &Arc::new(Obstacles::default()));
    assert_eq!(got, [state.2, other.2]);
}

#[test]
fn two_thousand_at_one_point_do_not_exhaust_the_stack() {
    let states = vec![(Vec2::ONE, Vec2::ZERO, Vec2::X); 2_000];
    assert!(plan(&states, &Arc::new(Obstacles::default())).iter().all(|v| *v == Vec2::X));
}

#[test]
fn non_finite_input_is_refused() {
    let mut simulator = simulator(&[], &Arc::new(Obstacles::default()));
    for bad in [Vec2::new(f32::NAN, 0.0), Vec2::new(0.0, f32::INFINITY), Vec2::splat(1e30)] {
        assert!(simulator.add_agent(bad, Vec2::ZERO, &PARAMETERS).is_err());
        assert!(simulator.add_agent(Vec2::ZERO, bad, &PARAMETERS).is_err());
    }
    let agent = simulator.add_agent(Vec2::ZERO, Vec2::ZERO, &PARAMETERS).unwrap();
    assert!(simulator.set_preferred_velocity(agent, Vec2::NAN).is_err());
    assert!(simulator.set_state(agent, Vec2::NAN, Vec2::ZERO).is_err());
    assert!(simulator.set_state(agent + 1, Vec2::ZERO, Vec2::ZERO).is_err());
    for parameters in [
        AgentParameters { radius: f32::NAN, ..PARAMETERS },
        AgentParameters { max_speed: -1.0, ..PARAMETERS },
        AgentParameters { time_horizon: 0.0, ..PARAMETERS },
        AgentParameters { time_horizon_obstacles: f32::INFINITY, ..PARAMETERS },
        AgentParameters { neighbour_distance: f32::NEG_INFINITY, ..PARAMETERS },
    ] {
        assert!(simulator.add_agent(Vec2::ZERO, Vec2::ZERO, &parameters).is_err());
    }
    assert!(OrcaSimulator::new(0.0, Arc::new(Obstacles::default())).is_err());
}

/// A wall 0.4 m thick across x = 0 with a gap around y = 0.
fn bottleneck(gap: f32) -> Arc<Obstacles> {
    let half = 0.5 * gap;
    let block = |y0: f32, y1: f32| {
        vec![Vec2::new(-0.2, y0), Vec2::new(0.2, y0), Vec2::new(0.2, y1), Vec2::new(-0.2, y1)]
    };
    Arc::new(Obstacles::new(&[block(-8.0, -half), block(half, 8.0)]).unwrap())
}

/// With the crowd's own parameters. (Shorter horizons are faster, but let discs overlap by
/// centimetres in the jam.)
#[test]
fn a_bottleneck_passes_twenty_without_overlap() {
    let mut simulator = OrcaSimulator::new(0.1, bottleneck(1.2)).unwrap();
    for i in 0..20_usize {
        let at = Vec2::new(-2.0 - (i / 5) as f32, (i % 5) as f32 - 2.0 + 0.01 * i as f32);
        simulator.add_agent(at, Vec2::ZERO, &PARAMETERS).unwrap();
    }
    let mut nearest = f32::INFINITY;
    let mut steps = 0;
    while (0..20).any(|agent| simulator.position(agent).x < 1.0) {
        for agent in 0..20 {
            let at = simulator.position(agent);
            // Through the middle of the gap, then onwards.
            let aim = if at.x < -0.2 { Vec2::new(0.3, 0.0) } else { at + Vec2::new(2.0, 0.3 * at.y) };
            simulator.set_preferred_velocity(agent, (aim - at).clamp_length(0.0, 1.0)).unwrap();
        }
        simulator.step();
        for a in 0..20 {
            let at = simulator.position(a);
            let to_wall = Vec2::new((at.x.abs() - 0.2).max(0.0), (0.6 - at.y.abs()).max(0.0)).length();
            assert!(to_wall >= 0.35 - 1e-3, "agent {a} touches the wall at {at}");
            nearest = (0..a).map(|b| at.distance(simulator.position(b))).fold(nearest, f32::min);
        }
        steps += 1;
        assert!(steps < 4000, "not all pass");
    }
    println!("20 through 1.2 m in {steps} steps, least distance {nearest}");
    assert!(nearest >= 0.7 - 0.01, "{nearest}");
}
