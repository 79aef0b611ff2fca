//! Pedestrians without lasers: ORCA and the social force model on open ground.
//!
//! The ORCA scene is built from a generator of a few lines, so that the drivers in `peers/` build
//! the same.

use std::sync::Arc;

use glam::{DVec2, Vec2};
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};
use jostle_peds::social_force::{SocialForce, SocialForceConfig, Walker};

use crate::clock::{Round, Stopwatch};
use crate::error::BenchError;

/// As in RVO2's examples, but for the radius and the speed, which are the robot's.
const PARAMETERS: AgentParameters = AgentParameters {
    neighbour_distance: 15.0,
    max_neighbours: 10,
    time_horizon: 5.0,
    time_horizon_obstacles: 5.0,
    radius: 0.35,
    max_speed: 1.0,
};
/// Steps before the clock starts. Both sides should agree on where the agents are then; much later
/// they need not, since a dense crowd makes large differences of small ones.
const WARM_UP: usize = 20;

/// A 64-bit linear congruential generator.
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

/// Agents at random starts with random goals, one on 4 m².
#[derive(Clone)]
pub struct OrcaScene {
    simulator: OrcaSimulator,
    goals: Vec<Vec2>,
}

impl OrcaScene {
    /// A scene of `n_agents`.
    ///
    /// # Errors
    ///
    /// When ORCA refuses an agent.
    pub fn new(n_agents: usize) -> Result<Self, BenchError> {
        let (mut lcg, side) = (Lcg(1), (n_agents as f32 * 4.0).sqrt());
        let mut simulator = OrcaSimulator::new(0.1, Arc::new(Obstacles::default()))?;
        let mut goals = Vec::with_capacity(n_agents);
        for _ in 0..n_agents {
            simulator.add_agent(lcg.point(side), Vec2::ZERO, &PARAMETERS)?;
            goals.push(lcg.point(side));
        }
        Ok(Self { simulator, goals })
    }

    /// One step of all agents towards their goals; in parallel on request, with the same bits.
    ///
    /// # Panics
    ///
    /// Never: positions stay finite.
    pub fn step(&mut self, parallel: bool) {
        for (agent, goal) in self.goals.iter().enumerate() {
            let preferred = (goal - self.simulator.position(agent)).clamp_length_max(1.0);
            self.simulator.set_preferred_velocity(agent, preferred).expect("a finite velocity");
        }
        if parallel {
            self.simulator.par_step();
        } else {
            self.simulator.step();
        }
    }

    /// A round from the start of the scene: the same steps every time. The check is a sum over the
    /// positions at which the clock starts.
    pub fn round(&self, threads: usize) -> Round {
        let mut scene = self.clone();
        (0..WARM_UP).for_each(|_| scene.step(threads > 1));
        let check = Some(scene.weighted_sum());
        let watch = Stopwatch::start(threads);
        let n_steps = n_steps(self.goals.len());
        (0..n_steps).for_each(|_| scene.step(threads > 1));
        let seconds = watch.seconds();
        Round { seconds, units: (n_steps * self.goals.len()) as f64, check }
    }

    fn weighted_sum(&self) -> f64 {
        let weighted = |position: Vec2| f64::from(position.x) + 2.0 * f64::from(position.y);
        (0..self.goals.len()).map(|agent| weighted(self.simulator.position(agent))).sum()
    }
}

/// Timed steps of a round: about 600,000 agent-steps, but not fewer than 30 steps nor more than
/// 20,000.
fn n_steps(n_agents: usize) -> usize {
    (600_000 / n_agents).clamp(30, 20_000)
}

/// Walkers of the social force model, one on 4 m².
pub struct SocialForceScene {
    model: SocialForce,
    walkers: Vec<Walker>,
}

impl SocialForceScene {
    /// A scene of `n_walkers`.
    ///
    /// # Errors
    ///
    /// When the model refuses its parameters.
    pub fn new(n_walkers: usize) -> Result<Self, BenchError> {
        let (mut lcg, side) = (Lcg(1), (n_walkers as f32 * 4.0).sqrt());
        let walker = |_| Walker {
            position: lcg.point(side).as_dvec2(),
            velocity: DVec2::ZERO,
            goal: lcg.point(side).as_dvec2(),
            desired_speed: 1.0,
        };
        let walkers = (0..n_walkers).map(walker).collect();
        Ok(Self { model: SocialForce::new(&SocialForceConfig::default())?, walkers })
    }

    /// One step of all walkers.
    pub fn step(&mut self) {
        self.model.step(&mut self.walkers, &[], 0.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_repeat_and_threads_change_nothing() {
        let scene = OrcaScene::new(20_000).expect("a scene");
        let (one, again, two) = (scene.round(1).check, scene.round(1).check, scene.round(2).check);
        assert_eq!(one, again);
        assert_eq!(one, two);
    }
}
