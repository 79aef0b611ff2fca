//! ORCA against recorded runs of RVO2: each step from the recorded state, whole runs, and the
//! half-planes.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use glam::Vec2;
use jostle_peds::orca::{AgentLines, AgentParameters, Obstacles, OrcaSimulator};

use super::rvo2_file::{Line, Lines, Recording, State, read_lines};
use super::verdict::Verdict;

/// One step from a recorded state.
const ONE_STEP: f64 = 1e-5;
/// A whole run from the recorded start.
const CLOSED_LOOP: f64 = 1e-3;
/// Steps after which a crowd with random perturbations is chaotic: rounding alone moves it by more
/// than 1 mm from step 224.
const CHAOTIC_AFTER: usize = 100;
/// Positions are stored in f32; far from the origin their spacing exceeds the tolerance of one
/// step.
const F32_SPACING: f64 = 1.2e-7;

/// Checks `NAME.csv`.
pub(crate) fn check_states(path: &Path, verdict: &mut Verdict) -> Result<()> {
    let recording = Recording::read(path)?;
    check_one_step(&recording, verdict)?;
    check_closed_loop(&recording, verdict)
}

/// Checks `NAME_lines.csv` against the run `NAME.csv` beside it.
pub(crate) fn check_lines(path: &Path, verdict: &mut Verdict) -> Result<()> {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).context("a name that is no text")?;
    let run = stem.strip_suffix("_lines").context("half-planes whose name does not end in _lines.csv")?;
    let run = path.with_file_name(format!("{run}.csv"));
    let recording = Recording::read(&run).with_context(|| format!("its run {}", run.display()))?;
    let n_agents = recording.goals.len();
    let expected = read_lines(path, recording.states.len() - 1, n_agents)?;
    let mut simulator = simulator(&recording)?;
    simulator.record_lines(true);
    for (step, (pair, expected)) in recording.states.windows(2).zip(expected).enumerate() {
        load(&mut simulator, &pair[0], &pair[1])?;
        simulator.plan();
        for (agent, expected) in expected.iter().enumerate() {
            let found = simulator.lines(agent).context("no recorded half-planes")?;
            compare_lines(found, expected, &format!("step {} agent {agent}", step + 1), verdict);
        }
    }
    Ok(())
}

fn simulator(recording: &Recording) -> Result<OrcaSimulator> {
    let polygons: Vec<Vec<Vec2>> =
        recording.obstacles.iter().map(|polygon| polygon.iter().copied().map(Vec2::from).collect()).collect();
    let p = &recording.parameters;
    let parameters = AgentParameters {
        neighbour_distance: p.neighbor_dist,
        max_neighbours: p.max_neighbors,
        time_horizon: p.time_horizon,
        time_horizon_obstacles: p.time_horizon_obst,
        radius: p.radius,
        max_speed: p.max_speed,
    };
    let mut simulator = OrcaSimulator::new(p.time_step, Arc::new(Obstacles::new(&polygons)?))?;
    for state in &recording.states[0] {
        simulator.add_agent(state.position.into(), state.velocity.into(), &parameters)?;
    }
    Ok(simulator)
}

/// Positions and velocities of `from`, preferred velocities of the step that leads to `to`.
///
/// One simulator serves all steps: the order of its k-d tree, which decides ties, then lives on as
/// in RVO2.
fn load(simulator: &mut OrcaSimulator, from: &[State], to: &[State]) -> Result<()> {
    for (agent, (before, after)) in from.iter().zip(to).enumerate() {
        simulator.set_state(agent, before.position.into(), before.velocity.into())?;
        simulator.set_preferred_velocity(agent, after.preferred.into())?;
    }
    Ok(())
}

fn check_one_step(recording: &Recording, verdict: &mut Verdict) -> Result<()> {
    let mut simulator = simulator(recording)?;
    for (step, pair) in recording.states.windows(2).enumerate() {
        load(&mut simulator, &pair[0], &pair[1])?;
        simulator.step();
        for (agent, expected) in pair[1].iter().enumerate() {
            let place = |what: &str| format!("one step, {what}, step {} agent {agent}", step + 1);
            let velocity = simulator.velocity(agent).to_array();
            compare(velocity, expected.velocity, (ONE_STEP, 0.0), || place("velocity"), verdict);
            let position = simulator.position(agent).to_array();
            compare(position, expected.position, (ONE_STEP, F32_SPACING), || place("position"), verdict);
        }
    }
    Ok(())
}

fn check_closed_loop(recording: &Recording, verdict: &mut Verdict) -> Result<()> {
    let mut simulator = simulator(recording)?;
    let steps = if recording.perturbed { CHAOTIC_AFTER } else { usize::MAX };
    for (step, states) in recording.states.iter().enumerate().skip(1).take(steps) {
        for (agent, state) in states.iter().enumerate() {
            let preferred = if recording.perturbed {
                state.preferred.into()
            } else {
                towards(recording.goals[agent].into(), simulator.position(agent))
            };
            simulator.set_preferred_velocity(agent, preferred)?;
        }
        simulator.step();
        for (agent, state) in states.iter().enumerate() {
            let position = simulator.position(agent).to_array();
            let place = || format!("closed loop, position, step {step} agent {agent}");
            compare(position, state.position, (CLOSED_LOOP, 0.0), place, verdict);
        }
    }
    Ok(())
}

/// RVO2's examples: straight to the goal, at most at speed 1. RVO2 divides a vector by multiplying
/// with the reciprocal.
fn towards(goal: Vec2, position: Vec2) -> Vec2 {
    let way = goal - position;
    if way.length_squared() > 1.0 { way * (1.0 / way.length()) } else { way }
}

fn compare(
    actual: [f32; 2],
    expected: [f32; 2],
    (atol, rtol): (f64, f64),
    what: impl Fn() -> String,
    verdict: &mut Verdict,
) {
    for (a, e) in actual.into_iter().zip(expected) {
        verdict.close(f64::from(a), f64::from(e), atol, rtol, &what);
    }
}

/// Undetermined half-planes (NaN in RVO2, which then ignores them) may be left out.
fn compare_lines(found: AgentLines<'_>, expected: &Lines, place: &str, verdict: &mut Verdict) {
    let determined = |line: &&Line| !line.point.iter().chain(&line.direction).any(|x| x.is_nan());
    let wanted: Vec<&Line> = expected.lines.iter().filter(determined).collect();
    let kept: Vec<_> = found.lines.iter().filter(|line| line.is_determined()).collect();
    verdict.same(&kept.len(), &wanted.len(), || format!("{place}: number of half-planes"));
    if wanted.len() == expected.lines.len() {
        verdict.same(&found.n_agent_lines, &expected.n_agent_lines, || {
            format!("{place}: number of agent lines")
        });
    }
    for (index, (line, wanted)) in kept.iter().zip(wanted).enumerate() {
        let what = |part: &str| format!("{place} line {index} {part}");
        compare(line.point.to_array(), wanted.point, (ONE_STEP, ONE_STEP), || what("point"), verdict);
        compare(line.direction.to_array(), wanted.direction, (ONE_STEP, 0.0), || what("direction"), verdict);
    }
}
