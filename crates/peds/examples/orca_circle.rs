//! Twelve pedestrians on a circle change sides by ORCA; prints who is where, and how near two of
//! them came.
//!
//! `cargo run --release -p jostle-peds --example orca_circle`

use std::sync::Arc;

use glam::Vec2;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaConfig, OrcaSimulator};

fn main() -> Result<(), jostle_peds::PedsError> {
    const N: usize = 12;
    let start = |i: usize| 6.0 * Vec2::from_angle(std::f32::consts::TAU * i as f32 / N as f32);
    // A slight twist breaks the symmetry in which opposite agents would wait for each other for
    // ever.
    let goal = |i: usize| -Vec2::from_angle(0.02).rotate(start(i));

    // With the default horizon of 5 s, so many would settle in a ring around the centre.
    let parameters = AgentParameters { time_horizon: 2.0, ..OrcaConfig::default().parameters() };
    let mut simulator = OrcaSimulator::new(0.1, Arc::new(Obstacles::default()))?;
    for i in 0..N {
        simulator.add_agent(start(i), Vec2::ZERO, &parameters)?;
    }
    let mut nearest = f32::INFINITY;
    for step in 1..=300 {
        for i in 0..N {
            let to_goal = goal(i) - simulator.position(i);
            simulator.set_preferred_velocity(i, to_goal.clamp_length_max(1.0))?;
        }
        simulator.step();
        let pairs = (0..N).flat_map(|a| (0..a).map(move |b| (a, b)));
        let distances = pairs.map(|(a, b)| simulator.position(a).distance(simulator.position(b)));
        nearest = distances.fold(nearest, f32::min);
        if step % 50 == 0 {
            let to_go = (0..N).map(|i| simulator.position(i).distance(goal(i))).sum::<f32>() / N as f32;
            println!("{:4.1} s: {to_go:5.2} m to go on average", 0.1 * step as f32);
        }
    }
    println!("two centres were never nearer than {nearest:.3} m; a diameter is 0.7 m");
    Ok(())
}
