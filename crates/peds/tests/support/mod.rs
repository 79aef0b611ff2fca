//! Reads recorded RVO2 trajectories (format: `tests/data/README.md`).

use std::{fs, path::Path, sync::Arc};

use glam::Vec2;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};

/// State after a step, and the preferred velocity that was given to it.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    pub(crate) position: Vec2,
    pub(crate) velocity: Vec2,
    pub(crate) preferred: Vec2,
}

/// A half-plane as recorded.
pub(crate) struct LineRow {
    pub(crate) step: usize,
    pub(crate) agent: usize,
    pub(crate) n_agent_lines: usize,
    pub(crate) point: Vec2,
    pub(crate) direction: Vec2,
}

/// A recorded trajectory: `rows[step][agent]`.
pub(crate) struct Recording {
    pub(crate) time_step: f32,
    pub(crate) parameters: AgentParameters,
    pub(crate) obstacles: Vec<Vec<Vec2>>,
    pub(crate) goals: Vec<Vec2>,
    pub(crate) rows: Vec<Vec<Row>>,
}

impl Recording {
    pub(crate) fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let parameter = |name: &str| -> f32 {
            let start = text.find(&format!("{name}=")).unwrap() + name.len() + 1;
            text[start..].split_whitespace().next().unwrap().parse().unwrap()
        };
        let n_agents = parameter("agents") as usize;
        let mut rows = Vec::new();
        for line in text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit())) {
            let [_, _, px, py, vx, vy, pvx, pvy] = numbers(line)[..] else { panic!("{line}") };
            rows.push(Row {
                position: Vec2::new(px, py),
                velocity: Vec2::new(vx, vy),
                preferred: Vec2::new(pvx, pvy),
            });
        }
        Self {
            time_step: parameter("timeStep"),
            parameters: AgentParameters {
                neighbour_distance: parameter("neighborDist"),
                max_neighbours: parameter("maxNeighbors") as usize,
                time_horizon: parameter("timeHorizon"),
                time_horizon_obstacles: parameter("timeHorizonObst"),
                radius: parameter("radius"),
                max_speed: parameter("maxSpeed"),
            },
            obstacles: comments(&text, "# obstacle ")
                .map(|line| points(line.split(": ").nth(1).unwrap()))
                .collect(),
            goals: comments(&text, "# agent ")
                .filter(|line| line.contains(": pos="))
                .map(|line| *points(line.split("goal=").nth(1).unwrap()).last().unwrap())
                .collect(),
            rows: rows.chunks(n_agents).map(<[Row]>::to_vec).collect(),
        }
    }

    /// A simulator in the recorded state of `step`.
    pub(crate) fn simulator(&self, obstacles: &Arc<Obstacles>, step: usize) -> OrcaSimulator {
        let mut simulator = OrcaSimulator::new(self.time_step, Arc::clone(obstacles)).unwrap();
        for row in &self.rows[step] {
            simulator.add_agent(row.position, row.velocity, &self.parameters).unwrap();
        }
        simulator
    }
}

/// The half-planes recorded beside a trajectory, if any.
pub(crate) fn read_lines(path: &Path) -> Vec<LineRow> {
    let Ok(text) = fs::read_to_string(path) else { return Vec::new() };
    let rows = text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
    rows.map(|line| {
        let [step, agent, _, n_agent_lines, px, py, dx, dy] = numbers(line)[..] else { panic!("{line}") };
        LineRow {
            step: step as usize,
            agent: agent as usize,
            n_agent_lines: n_agent_lines as usize,
            point: Vec2::new(px, py),
            direction: Vec2::new(dx, dy),
        }
    })
    .collect()
}

fn comments<'a>(text: &'a str, prefix: &'static str) -> impl Iterator<Item = &'a str> {
    text.lines().filter(move |line| line.starts_with(prefix))
}

fn numbers(line: &str) -> Vec<f32> {
    line.split(',').map(|field| field.parse().unwrap()).collect()
}

fn points(text: &str) -> Vec<Vec2> {
    let pair = |pair: &str| {
        let (x, y) = pair.split_once(',').unwrap();
        Vec2::new(x.parse().unwrap(), y.parse().unwrap())
    };
    text.split_whitespace().filter(|word| word.contains(',')).map(pair).collect()
}
