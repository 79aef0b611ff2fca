//! Social forces term by term in all variants, and trajectories.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use glam::DVec2;
use jostle_peds::social_force::{Border, Forces, SocialForce, SocialForceConfig, Variant, ViewTest, Walker};
use serde::Deserialize;

use super::verdict::Verdict;

/// Tolerance of forces in double precision (absolute, relative).
const FORCE: (f64, f64) = (1e-9, 1e-9);
const TRAJECTORY: f64 = 1e-7;

type Vectors = Vec<[f64; 2]>;

#[derive(Deserialize)]
pub(crate) struct ForcesFile {
    parameters: Parameters,
    states: Vec<StateCase>,
}

#[derive(Deserialize)]
pub(crate) struct TrajectoriesFile {
    parameters: Parameters,
    cases: Vec<TrajectoryCase>,
}

#[derive(Deserialize)]
struct Parameters {
    tau: f64,
    #[serde(rename = "V0")]
    v0: f64,
    sigma: f64,
    #[serde(rename = "U0")]
    u0: f64,
    #[serde(rename = "R")]
    r: f64,
    field_of_view_degrees: f64,
    c: f64,
    max_speed_factor: f64,
    variants: BTreeMap<String, VariantChoice>,
}

#[derive(Deserialize)]
struct VariantChoice {
    delta_t_in_b: f64,
    view_test: String,
}

#[derive(Deserialize)]
struct State {
    position: Vectors,
    velocity: Vectors,
    goal: Vectors,
    desired_speed: Vec<f64>,
    borders: Vec<Vec<[[f64; 2]; 2]>>,
}

#[derive(Deserialize)]
struct StateCase {
    name: String,
    #[serde(flatten)]
    state: State,
    expected: BTreeMap<String, ExpectedForces>,
}

#[derive(Deserialize)]
struct ExpectedForces {
    goal: Vectors,
    pedestrian: Vectors,
    wall: Vectors,
    total: Vectors,
    pair: Vec<Vectors>,
    weight: Vec<Vec<f64>>,
    wall_each: Vec<Vectors>,
}

#[derive(Deserialize)]
struct TrajectoryCase {
    name: String,
    #[serde(flatten)]
    state: State,
    dt: f64,
    trajectories: BTreeMap<String, Trajectory>,
}

#[derive(Deserialize)]
struct Trajectory {
    position: Vec<Vectors>,
    velocity: Vec<Vectors>,
}

impl Parameters {
    /// Our model with the file's parameters, in the variant that makes the file's choices under
    /// this name.
    fn model(&self, name: &str) -> Result<SocialForce> {
        let choice =
            self.variants.get(name).with_context(|| format!("variant {name} is not among the parameters"))?;
        let is_chosen = |variant: &&Variant| {
            let view = match variant.view_test() {
                ViewTest::Force => "force",
                ViewTest::Position => "position",
            };
            variant.foresight() == choice.delta_t_in_b && view == choice.view_test
        };
        let variant = Variant::ALL
            .iter()
            .find(is_chosen)
            .with_context(|| format!("variant {name} makes unknown choices"))?;
        Ok(SocialForce::new(&SocialForceConfig {
            variant: *variant,
            max_speed_factor: self.max_speed_factor,
            tau: self.tau,
            v0: self.v0,
            sigma: self.sigma,
            u0: self.u0,
            r: self.r,
            field_of_view_degrees: self.field_of_view_degrees,
            out_of_view_weight: self.c,
            ..SocialForceConfig::default()
        })?)
    }
}

impl State {
    fn walkers(&self) -> Result<Vec<Walker>> {
        let n = self.position.len();
        let lengths = [self.velocity.len(), self.goal.len(), self.desired_speed.len()];
        anyhow::ensure!(
            lengths == [n; 3],
            "{n} positions with {lengths:?} velocities, goals, desired speeds"
        );
        let walker = |i: usize| Walker {
            position: self.position[i].into(),
            velocity: self.velocity[i].into(),
            goal: self.goal[i].into(),
            desired_speed: self.desired_speed[i],
        };
        Ok((0..n).map(walker).collect())
    }

    fn borders(&self) -> Result<Vec<Border>> {
        let border = |segments: &Vec<[[f64; 2]; 2]>| {
            let segments: Vec<[DVec2; 2]> = segments.iter().map(|ends| ends.map(DVec2::from)).collect();
            Ok(Border::new(&segments)?)
        };
        self.borders.iter().map(border).collect()
    }
}

/// Checks every term of every state in every variant.
pub(crate) fn check_forces(file: &ForcesFile, verdict: &mut Verdict) -> Result<()> {
    for case in &file.states {
        let (walkers, borders) = (case.state.walkers()?, case.state.borders()?);
        for (variant, expected) in &case.expected {
            let forces = file.parameters.model(variant)?.forces(&walkers, &borders);
            compare_forces(&forces, expected, &format!("{} ({variant})", case.name), verdict);
        }
    }
    Ok(())
}

fn compare_forces(forces: &Forces, expected: &ExpectedForces, name: &str, verdict: &mut Verdict) {
    let rows = [
        ("goal", &forces.goal, &expected.goal),
        ("pedestrian", &forces.pedestrian, &expected.pedestrian),
        ("wall", &forces.wall, &expected.wall),
        ("total", &forces.total, &expected.total),
    ];
    for (term, actual, expected) in rows {
        compare(actual, expected, FORCE, &format!("{name}: {term}"), verdict);
    }
    for (term, actual, expected) in
        [("pair", &forces.pair, &expected.pair), ("wall_each", &forces.wall_each, &expected.wall_each)]
    {
        verdict.same(&actual.len(), &expected.len(), || format!("{name}: rows of {term}"));
        for (row, (actual, expected)) in actual.iter().zip(expected).enumerate() {
            compare(actual, expected, FORCE, &format!("{name}: {term}[{row}]"), verdict);
        }
    }
    let flat = |rows: &[Vec<f64>]| rows.concat().into_iter();
    verdict.all_close(flat(&forces.weight), flat(&expected.weight), FORCE, &format!("{name}: weight"));
}

/// Checks every trajectory of every case at every step.
pub(crate) fn check_trajectories(file: &TrajectoriesFile, verdict: &mut Verdict) -> Result<()> {
    for case in &file.cases {
        let borders = case.state.borders()?;
        for (variant, expected) in &case.trajectories {
            let model = file.parameters.model(variant)?;
            let mut walkers = case.state.walkers()?;
            let (n, m) = (expected.position.len(), expected.velocity.len());
            verdict.same(&n, &m, || format!("{} ({variant}): steps of positions and velocities", case.name));
            for (step, (position, velocity)) in expected.position.iter().zip(&expected.velocity).enumerate() {
                if step > 0 {
                    model.step(&mut walkers, &borders, case.dt);
                }
                let name = |what: &str| format!("{} ({variant}): {what}, step {step}", case.name);
                let positions: Vec<DVec2> = walkers.iter().map(|walker| walker.position).collect();
                let velocities: Vec<DVec2> = walkers.iter().map(|walker| walker.velocity).collect();
                compare(&positions, position, (TRAJECTORY, 0.0), &name("position"), verdict);
                compare(&velocities, velocity, (TRAJECTORY, 0.0), &name("velocity"), verdict);
            }
        }
    }
    Ok(())
}

fn compare(
    actual: &[DVec2],
    expected: &[[f64; 2]],
    tolerance: (f64, f64),
    name: &str,
    verdict: &mut Verdict,
) {
    let actual: Vec<f64> = actual.iter().flat_map(DVec2::to_array).collect();
    verdict.all_close(actual.into_iter(), expected.concat().into_iter(), tolerance, name);
}
