//! Social forces and trajectories against recorded ones (provenance: `tests/data/README.md`).

use std::{fs, path::Path};

use glam::DVec2;
use jostle_peds::social_force::{Border, SocialForce, SocialForceConfig, Variant, Walker};
use serde_json::Value;

/// Forces, absolute and relative.
const FORCE: f64 = 1e-9;
/// Positions and velocities.
const TRAJECTORY: f64 = 1e-7;

fn read(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/social_force").join(name);
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap()
}

fn point(value: &Value) -> DVec2 {
    DVec2::new(value[0].as_f64().unwrap(), value[1].as_f64().unwrap())
}

fn walkers(state: &Value) -> Vec<Walker> {
    (0..list(&state["position"]).len())
        .map(|i| Walker {
            position: point(&state["position"][i]),
            velocity: point(&state["velocity"][i]),
            goal: point(&state["goal"][i]),
            desired_speed: state["desired_speed"][i].as_f64().unwrap(),
        })
        .collect()
}

fn borders(state: &Value) -> Vec<Border> {
    let segments = |border: &Value| -> Vec<[DVec2; 2]> {
        list(border).iter().map(|segment| [point(&segment[0]), point(&segment[1])]).collect()
    };
    list(&state["borders"]).iter().map(|border| Border::new(&segments(border)).unwrap()).collect()
}

fn model(variant: Variant) -> SocialForce {
    SocialForce::new(&SocialForceConfig { variant, ..SocialForceConfig::default() }).unwrap()
}

fn check(got: &[DVec2], expected: &Value, tolerance: f64, what: &str) {
    assert_eq!(got.len(), list(expected).len(), "{what}");
    for (i, (got, expected)) in got.iter().zip(list(expected)).enumerate() {
        let expected = point(expected);
        let bound = tolerance * (DVec2::ONE + expected.abs());
        let error = (*got - expected).abs();
        assert!(error.x <= bound.x && error.y <= bound.y, "{what}[{i}]: {got}, not {expected}");
    }
}

#[test]
fn forces_term_by_term() {
    let file = read("forces.json");
    for state in list(&file["states"]) {
        let (walkers, borders) = (walkers(state), borders(state));
        for variant in Variant::ALL {
            let expected = &state["expected"][variant.name()];
            let got = model(variant).forces(&walkers, &borders);
            let what = |term: &str| format!("{} {} {term}", state["name"], variant.name());
            check(&got.goal, &expected["goal"], FORCE, &what("goal"));
            check(&got.pedestrian, &expected["pedestrian"], FORCE, &what("pedestrian"));
            check(&got.wall, &expected["wall"], FORCE, &what("wall"));
            check(&got.total, &expected["total"], FORCE, &what("total"));
            for a in 0..walkers.len() {
                check(&got.pair[a], &expected["pair"][a], FORCE, &what("pair"));
                check(&got.wall_each[a], &expected["wall_each"][a], FORCE, &what("wall_each"));
                let weights = list(&expected["weight"][a]).iter().map(|w| w.as_f64().unwrap());
                assert!(got.weight[a].iter().copied().eq(weights), "{}", what("weight"));
            }
        }
    }
}

#[test]
fn trajectories() {
    let file = read("trajectories.json");
    for case in list(&file["cases"]) {
        for variant in [Variant::Paper, Variant::Package] {
            let expected = &case["trajectories"][variant.name()];
            let (mut walkers, borders) = (walkers(case), borders(case));
            let dt = case["dt"].as_f64().unwrap();
            for step in 0..=case["steps"].as_u64().unwrap() as usize {
                let positions: Vec<DVec2> = walkers.iter().map(|w| w.position).collect();
                let velocities: Vec<DVec2> = walkers.iter().map(|w| w.velocity).collect();
                let what = format!("{} {} step {step}", case["name"], variant.name());
                check(&positions, &expected["position"][step], TRAJECTORY, &what);
                check(&velocities, &expected["velocity"][step], TRAJECTORY, &what);
                model(variant).step(&mut walkers, &borders, dt);
            }
        }
    }
}
