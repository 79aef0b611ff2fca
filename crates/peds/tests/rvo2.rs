//! The port against trajectories and half-planes that RVO2 itself recorded (provenance:
//! `tests/data/README.md`).

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::support::{Recording, read_lines};
use glam::Vec2;
use jostle_peds::orca::Obstacles;

/// One step from a recorded state, m/s and m.
const ONE_STEP: f32 = 1e-5;
/// The whole trajectory from its first state, m.
const CLOSED_LOOP: f32 = 1e-3;

fn recordings() -> Vec<(String, PathBuf)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rvo2");
    let mut found: Vec<(String, PathBuf)> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.file_stem().unwrap().to_str().unwrap().to_owned(), path))
        .filter(|(name, _)| !name.ends_with("_lines"))
        .collect();
    found.sort();
    assert!(found.len() >= 8, "{} recordings", found.len());
    found
}

#[test]
fn one_step_from_every_recorded_state() {
    for (name, path) in recordings() {
        let recording = Recording::read(&path);
        let obstacles = Arc::new(Obstacles::new(&recording.obstacles).unwrap());
        let mut worst = 0.0_f32;
        for step in 1..recording.rows.len() {
            let mut simulator = recording.simulator(&obstacles, step - 1);
            for (agent, row) in recording.rows[step].iter().enumerate() {
                simulator.set_preferred_velocity(agent, row.preferred).unwrap();
            }
            simulator.step();
            for (agent, row) in recording.rows[step].iter().enumerate() {
                worst = worst.max(simulator.velocity(agent).distance(row.velocity));
                worst = worst.max(simulator.position(agent).distance(row.position));
            }
        }
        println!("{name}: one step {worst:e}");
        assert!(worst <= ONE_STEP, "{name}: {worst:e}");
    }
}

#[test]
fn whole_trajectories() {
    for (name, path) in recordings() {
        let recording = Recording::read(&path);
        let obstacles = Arc::new(Obstacles::new(&recording.obstacles).unwrap());
        let mut simulator = recording.simulator(&obstacles, 0);
        let perturbed = name.starts_with('b');
        let mut worst = 0.0_f32;
        for rows in &recording.rows[1..] {
            for (agent, row) in rows.iter().enumerate() {
                let to_goal = recording.goals[agent] - simulator.position(agent);
                let length_sq = to_goal.length_squared();
                let rule = if length_sq > 1.0 { to_goal * (1.0 / length_sq.sqrt()) } else { to_goal };
                let preferred = if perturbed { row.preferred } else { rule };
                simulator.set_preferred_velocity(agent, preferred).unwrap();
            }
            simulator.step();
            for (agent, row) in rows.iter().enumerate() {
                worst = worst.max(simulator.position(agent).distance(row.position));
            }
        }
        println!("{name}: closed loop {worst:e}");
        assert!(worst <= CLOSED_LOOP, "{name}: {worst:e}");
    }
}

/// Same number, or both undetermined.
fn agree(a: Vec2, b: Vec2) -> bool {
    a.distance(b) <= ONE_STEP || (a.is_nan() && b.is_nan())
}

#[test]
fn half_planes_in_order() {
    let mut n_files = 0;
    for (name, path) in recordings() {
        let expected = read_lines(&path.with_file_name(format!("{name}_lines.csv")));
        n_files += usize::from(!expected.is_empty());
        let recording = Recording::read(&path);
        let obstacles = Arc::new(Obstacles::new(&recording.obstacles).unwrap());
        for step in 1..recording.rows.len() {
            let expected: Vec<_> = expected.iter().filter(|row| row.step == step).collect();
            if expected.is_empty() {
                continue;
            }
            let mut simulator = recording.simulator(&obstacles, step - 1);
            simulator.record_lines(true);
            simulator.plan();
            for agent in 0..simulator.len() {
                let expected: Vec<_> = expected.iter().filter(|row| row.agent == agent).collect();
                let got = simulator.lines(agent).unwrap();
                assert_eq!(got.lines.len(), expected.len(), "{name} step {step} agent {agent}");
                for (line, row) in got.lines.iter().zip(expected) {
                    assert_eq!(got.n_agent_lines, row.n_agent_lines, "{name} step {step} agent {agent}");
                    let same = agree(line.point, row.point) && agree(line.direction, row.direction);
                    assert!(
                        same,
                        "{name} step {step} agent {agent}: {line:?}, not {} {}",
                        row.point, row.direction
                    );
                }
            }
        }
    }
    assert!(n_files >= 5, "{n_files} files of half-planes");
}
