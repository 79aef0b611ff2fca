//! Prints the time of an ORCA step in ns per agent: random starts and goals, one agent per 4 m², and a circle.
//!
//! `cargo run --release -p jostle-peds --example orca_timing`

use std::{sync::Arc, time::Instant};

use glam::Vec2;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};

const PARAMETERS: AgentParameters = AgentParameters {
    neighbour_distance: 15.0,
    max_neighbours: 10,
    time_horizon: 5.0,
    time_horizon_obstacles: 5.0,
    radius: 0.35,
    max_speed: 1.0,
};

/// A 64-bit linear congruential generator: the scene is easily built again in another language.
struct Lcg(u64);

impl Lcg {
    fn uniform(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 / (1_u64 << 53) as f64) as f32
    }

    fn point(&mut self, side: f32) -> Vec2 {
        let x = self.uniform() * side;
        Vec2::new(x, self.uniform() * side)
    }
}

/// Starts and goals.
fn scene(name: &str, n: usize) -> Vec<(Vec2, Vec2)> {
    let mut lcg = Lcg(1);
    let side = (n as f32 * 4.0).sqrt();
    let radius = (n as f32 / std::f32::consts::TAU).max(2.0);
    let on_circle = |i: usize| {
        let start = radius * Vec2::from_angle(i as f32 * std::f32::consts::TAU / n as f32);
        (start, -start)
    };
    match name {
        "random" => (0..n).map(|_| (lcg.point(side), lcg.point(side))).collect(),
        _ => (0..n).map(on_circle).collect(),
    }
}

fn run(simulator: &mut OrcaSimulator, goals: &[Vec2], steps: usize, step: fn(&mut OrcaSimulator)) {
    for _ in 0..steps {
        for (agent, goal) in goals.iter().enumerate() {
            let preferred = (goal - simulator.position(agent)).clamp_length_max(1.0);
            simulator.set_preferred_velocity(agent, preferred).expect("a finite velocity");
        }
        step(simulator);
    }
}

fn main() {
    for n in [5, 100, 1_000, 10_000] {
        for name in ["random", "circle"] {
            let scene = scene(name, n);
            let goals: Vec<Vec2> = scene.iter().map(|(_, goal)| *goal).collect();
            let mut empty =
                OrcaSimulator::new(0.1, Arc::new(Obstacles::default())).expect("a valid time step");
            for (start, _) in &scene {
                empty.add_agent(*start, Vec2::ZERO, &PARAMETERS).expect("a finite start");
            }
            let steps = (300_000 / n).clamp(30, 2000);
            for (how, step) in [
                ("1 thread", OrcaSimulator::step as fn(&mut OrcaSimulator)),
                ("parallel", OrcaSimulator::par_step),
            ] {
                let mut simulator = empty.clone();
                run(&mut simulator, &goals, 5, step);
                let start = Instant::now();
                run(&mut simulator, &goals, steps, step);
                let ns = start.elapsed().as_nanos() as f64 / (n * steps) as f64;
                let sum: f64 = (0..n)
                    .map(|i| simulator.position(i))
                    .map(|p| f64::from(p.x) + 2.0 * f64::from(p.y))
                    .sum();
                println!("{name} n={n} {how}: {ns:.0} ns per agent-step (sum {sum:.6})");
            }
        }
    }
}
