//! Agents among obstacles, stepped together.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;

use super::{
    AgentParameters, Line, Obstacles,
    agent::{Agent, Body},
    agent_lines::agent_line,
    agent_tree::{AgentTree, Search},
    linear_program::solve,
    obstacle_lines::push_obstacle_lines,
    obstacle_tree::ObstacleNeighbour,
};
use crate::{
    PedsError,
    error::{checked, require},
};

/// The share of avoiding that each of two agents takes on itself (RVO2).
const RECIPROCAL: f32 = 0.5;
/// Agents handled by one task of [`OrcaSimulator::par_plan`]; results do not depend on it.
const CHUNK: usize = 128;

/// The half-planes that an agent's velocity was chosen by.
#[derive(Debug, Clone, Copy)]
pub struct AgentLines<'a> {
    /// In order of construction: obstacle lines first, then one per agent neighbour, nearest first.
    pub lines: &'a [Line],
    /// Number of lines, from the end, that come from agents.
    pub n_agent_lines: usize,
}

/// RVO2's simulator: plan (choose velocities from the present state), then move.
#[derive(Debug, Clone)]
pub struct OrcaSimulator {
    time_step: f32,
    responsibility: f32,
    obstacles: Arc<Obstacles>,
    agents: Vec<Agent>,
    tree: AgentTree,
    planned: Vec<Vec2>,
    scratch: Scratch,
    recorded: Option<Vec<RecordedLines>>,
}

#[derive(Debug, Clone, Default)]
struct RecordedLines {
    lines: Vec<Line>,
    n_obstacle_lines: usize,
}

/// Memory that one agent's computation leaves for the next.
#[derive(Debug, Clone, Default)]
struct Scratch {
    obstacle_neighbours: Vec<ObstacleNeighbour>,
    search: Search,
    lines: Vec<Line>,
    projected: Vec<Line>,
}

impl OrcaSimulator {
    /// A simulator without agents.
    ///
    /// # Errors
    /// A time step outside 1e-4 … 10 s.
    pub fn new(time_step: f32, obstacles: Arc<Obstacles>) -> Result<Self, PedsError> {
        require((1e-4..=10.0).contains(&time_step), "time_step", time_step.into(), "0.0001 to 10 s")?;
        Ok(Self {
            time_step,
            responsibility: RECIPROCAL,
            obstacles,
            agents: Vec::new(),
            tree: AgentTree::default(),
            planned: Vec::new(),
            scratch: Scratch::default(),
            recorded: None,
        })
    }

    /// The share of avoiding that every agent takes on itself: ½ (as in RVO2, the default) where
    /// the others do the rest, 1 where they do nothing. An obstacle avoids nobody, so an agent
    /// always does all of that.
    ///
    /// # Errors
    /// A share outside 0 … 1.
    pub fn set_responsibility(&mut self, share: f32) -> Result<(), PedsError> {
        require((0.0..=1.0).contains(&share), "responsibility", share.into(), "0 to 1")?;
        self.responsibility = share;
        Ok(())
    }

    /// Adds an agent whose preferred velocity is 0; returns its index.
    ///
    /// # Errors
    /// Non-finite state, parameters out of range.
    pub fn add_agent(
        &mut self,
        position: Vec2,
        velocity: Vec2,
        parameters: &AgentParameters,
    ) -> Result<usize, PedsError> {
        parameters.validate()?;
        self.agents.push(Agent {
            position: checked("agent position", position)?,
            velocity: checked("agent velocity", velocity)?,
            preferred_velocity: Vec2::ZERO,
            planned_velocity: Vec2::ZERO,
            parameters: *parameters,
        });
        Ok(self.agents.len() - 1)
    }

    /// Removes all agents, and the order in the k-d tree that decides ties. Memory is kept.
    pub fn clear_agents(&mut self) {
        self.agents.clear();
        self.tree.clear();
    }

    /// Puts an agent somewhere.
    ///
    /// # Errors
    /// No such agent, non-finite state.
    pub fn set_state(&mut self, agent: usize, position: Vec2, velocity: Vec2) -> Result<(), PedsError> {
        let position = checked("agent position", position)?;
        let velocity = checked("agent velocity", velocity)?;
        let agent = self.agent_mut(agent)?;
        agent.position = position;
        agent.velocity = velocity;
        Ok(())
    }

    /// Sets the velocity that an agent would take without neighbours. Not limited here; the planned
    /// velocity is.
    ///
    /// # Errors
    /// No such agent, non-finite velocity.
    pub fn set_preferred_velocity(&mut self, agent: usize, velocity: Vec2) -> Result<(), PedsError> {
        self.agent_mut(agent)?.preferred_velocity = checked("preferred velocity", velocity)?;
        Ok(())
    }

    fn agent_mut(&mut self, agent: usize) -> Result<&mut Agent, PedsError> {
        let count = self.agents.len();
        self.agents.get_mut(agent).ok_or(PedsError::NoSuchAgent { agent, count })
    }

    /// Number of agents.
    pub fn len(&self) -> usize {
        self.agents.len()
    }

    /// True if there is no agent.
    pub fn is_empty(&self) -> bool {
        self.agents.is_empty()
    }

    /// Present position of an agent. Panics when there is no such agent, as the other getters do.
    pub fn position(&self, agent: usize) -> Vec2 {
        self.agents[agent].position
    }

    /// Present velocity of an agent.
    pub fn velocity(&self, agent: usize) -> Vec2 {
        self.agents[agent].velocity
    }

    /// The velocity that the last plan chose.
    pub fn planned_velocity(&self, agent: usize) -> Vec2 {
        self.agents[agent].planned_velocity
    }

    /// Switches whether plans keep their half-planes for [`Self::lines`]. Off at first: it costs
    /// time and memory.
    pub fn record_lines(&mut self, on: bool) {
        self.recorded = on.then(Vec::new);
    }

    /// The half-planes of the last plan; none unless they were recorded.
    pub fn lines(&self, agent: usize) -> Option<AgentLines<'_>> {
        let recorded = self.recorded.as_ref()?.get(agent)?;
        let n_agent_lines = recorded.lines.len() - recorded.n_obstacle_lines;
        Some(AgentLines { lines: &recorded.lines, n_agent_lines })
    }

    /// Plans, then moves every agent with its planned velocity for one time step.
    pub fn step(&mut self) {
        self.plan();
        self.advance();
    }

    /// As [`Self::step`], over rayon's threads, with the same bits.
    pub fn par_step(&mut self) {
        self.par_plan();
        self.advance();
    }

    fn advance(&mut self) {
        for agent in &mut self.agents {
            agent.velocity = agent.planned_velocity;
            agent.position += agent.velocity * self.time_step;
        }
    }

    /// Chooses every agent's next velocity; nobody moves.
    pub fn plan(&mut self) {
        self.tree.build(&self.agents);
        let mut scratch = std::mem::take(&mut self.scratch);
        self.planned.clear();
        if let Some(recorded) = &mut self.recorded {
            recorded.resize_with(self.agents.len(), RecordedLines::default);
        }
        for slot in 0..self.tree.bodies.len() {
            let (velocity, n_obstacle_lines) = self.plan_slot(slot, &mut scratch);
            self.planned.push(velocity);
            if let Some(recorded) = &mut self.recorded {
                let entry = &mut recorded[self.tree.bodies[slot].agent as usize];
                entry.lines.clone_from(&scratch.lines);
                entry.n_obstacle_lines = n_obstacle_lines;
            }
        }
        self.scratch = scratch;
        self.publish();
    }

    /// As [`Self::plan`], over rayon's threads, with the same bits. (On one thread when half-planes
    /// are recorded.)
    pub fn par_plan(&mut self) {
        if self.recorded.is_some() {
            return self.plan();
        }
        self.tree.build(&self.agents);
        let mut planned = std::mem::take(&mut self.planned);
        planned.clear();
        planned.resize(self.agents.len(), Vec2::ZERO);
        planned.par_chunks_mut(CHUNK).enumerate().for_each_init(
            Scratch::default,
            |scratch, (chunk, velocities)| {
                for (i, velocity) in velocities.iter_mut().enumerate() {
                    *velocity = self.plan_slot(chunk * CHUNK + i, scratch).0;
                }
            },
        );
        self.planned = planned;
        self.publish();
    }

    /// Hands the velocities, planned in tree order, to the agents.
    fn publish(&mut self) {
        for (body, &velocity) in self.tree.bodies.iter().zip(&self.planned) {
            self.agents[body.agent as usize].planned_velocity = velocity;
        }
    }

    /// Velocity of the agent at `slot` of the tree, and the number of obstacle lines; its lines are
    /// left in `scratch`.
    fn plan_slot(&self, slot: usize, scratch: &mut Scratch) -> (Vec2, usize) {
        let Scratch { obstacle_neighbours, search, lines, projected } = scratch;
        let agent = &self.agents[self.tree.bodies[slot].agent as usize];
        let parameters = &agent.parameters;
        lines.clear();

        let Obstacles { vertices, tree } = &*self.obstacles;
        tree.neighbours(vertices, agent.position, parameters.obstacle_range_sq(), obstacle_neighbours);
        push_obstacle_lines(agent, vertices, obstacle_neighbours, lines);
        let n_obstacle_lines = lines.len();

        let range_sq = parameters.neighbour_distance * parameters.neighbour_distance;
        self.tree.neighbours(slot, parameters.max_neighbours, range_sq, search);
        let inv_time_horizon = 1.0 / parameters.time_horizon;
        let inv_time_step = 1.0 / self.time_step;
        lines.extend(search.found.iter().map(|neighbour| {
            let other: &Body = &self.tree.bodies[neighbour.slot as usize];
            agent_line(agent, other, inv_time_horizon, inv_time_step, self.responsibility)
        }));

        let velocity = if lines.iter().all(Line::is_determined) {
            solve(lines, n_obstacle_lines, parameters.max_speed, agent.preferred_velocity, projected)
        } else {
            let kept: Vec<Line> = lines.iter().copied().filter(Line::is_determined).collect();
            let n_kept = lines[..n_obstacle_lines].iter().filter(|line| line.is_determined()).count();
            solve(&kept, n_kept, parameters.max_speed, agent.preferred_velocity, projected)
        };
        (velocity, n_obstacle_lines)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: AgentParameters = AgentParameters {
        neighbour_distance: 10.0,
        max_neighbours: 10,
        time_horizon: 5.0,
        time_horizon_obstacles: 5.0,
        radius: 0.35,
        max_speed: 1.0,
    };

    fn simulator(time_step: f32) -> OrcaSimulator {
        OrcaSimulator::new(time_step, Arc::new(Obstacles::default())).unwrap()
    }

    #[test]
    fn an_agent_alone_moves_as_it_prefers() {
        let mut simulator = simulator(0.5);
        assert!(simulator.is_empty());
        assert_eq!(simulator.add_agent(Vec2::ONE, Vec2::Y, &PARAMETERS), Ok(0));
        assert_eq!((simulator.is_empty(), simulator.len()), (false, 1));
        simulator.set_preferred_velocity(0, Vec2::new(0.5, -0.25)).unwrap();
        simulator.plan();
        assert_eq!((simulator.position(0), simulator.velocity(0)), (Vec2::ONE, Vec2::Y), "nobody moves yet");
        assert_eq!(simulator.planned_velocity(0), Vec2::new(0.5, -0.25));
        simulator.step();
        assert_eq!(
            (simulator.position(0), simulator.velocity(0)),
            (Vec2::new(1.25, 0.875), Vec2::new(0.5, -0.25))
        );
        simulator.set_state(0, Vec2::ZERO, Vec2::X).unwrap();
        assert_eq!((simulator.position(0), simulator.velocity(0)), (Vec2::ZERO, Vec2::X));
        simulator.par_step();
        assert_eq!(simulator.position(0), Vec2::new(0.25, -0.125));
        assert_eq!(
            simulator.set_state(1, Vec2::ZERO, Vec2::X),
            Err(PedsError::NoSuchAgent { agent: 1, count: 1 })
        );
        simulator.clear_agents();
        assert!(simulator.is_empty());
    }

    #[test]
    fn half_planes_are_kept_only_when_asked_for() {
        let mut simulator = simulator(0.1);
        for x in [0.0, 1.5] {
            simulator.add_agent(Vec2::new(x, 0.0), Vec2::ZERO, &PARAMETERS).unwrap();
        }
        simulator.plan();
        assert!(simulator.lines(0).is_none());
        simulator.record_lines(true);
        for parallel in [false, true] {
            if parallel {
                simulator.par_plan();
            } else {
                simulator.plan();
            }
            let lines = simulator.lines(1).unwrap();
            assert_eq!((lines.lines.len(), lines.n_agent_lines), (1, 1));
        }
        assert!(simulator.lines(2).is_none());
        simulator.record_lines(false);
        assert!(simulator.lines(0).is_none());
    }

    /// Someone comes straight on at p = (6, 0.1) m with the relative velocity v = (2, 0) m/s; the
    /// radii are R = 0.7 m together. The near leg of the cone of relative velocities that end in a
    /// crash has the direction d = (p.x·l + p.y·R, p.y·l − p.x·R) / |p|² with l² = |p|² − R², which
    /// is (0.994979, −0.100084), and v lies u = (v·d)·d − v = (−0.020033, −0.199162) inside of it.
    /// So who takes the share s changes its velocity from (1, 0) by s·u. If nobody changed it
    /// again, the two would pass at |p × (v + s·u)| / |v + s·u|: 0.3997 m with half of it, and R
    /// with all.
    #[test]
    fn who_expects_nothing_of_the_other_avoids_all_by_itself() {
        let comes_on = |simulator: &mut OrcaSimulator, x: f32| {
            simulator.set_state(1, Vec2::new(x, 0.1), -Vec2::X).unwrap();
        };
        let meeting = |share: f32| {
            let mut simulator = simulator(0.1);
            simulator.set_responsibility(share).unwrap();
            simulator.add_agent(Vec2::ZERO, Vec2::X, &PARAMETERS).unwrap();
            simulator.add_agent(Vec2::ZERO, Vec2::ZERO, &PARAMETERS).unwrap();
            simulator.set_preferred_velocity(0, Vec2::X).unwrap();
            comes_on(&mut simulator, 6.0);
            simulator
        };
        for (share, change, passes_at) in
            [(0.5, Vec2::new(-0.010_017, -0.099_581), 0.3997), (1.0, Vec2::new(-0.020_033, -0.199_162), 0.7)]
        {
            let mut simulator = meeting(share);
            simulator.plan();
            let found = simulator.planned_velocity(0) - Vec2::X;
            assert!(found.distance(change) < 2e-5, "{share}: {found}");
            let relative = 2.0 * Vec2::X + found;
            let distance = Vec2::new(6.0, 0.1).perp_dot(relative).abs() / relative.length();
            assert!((distance - passes_at).abs() < 2e-4, "{share}: {distance} m");
        }
        // Who takes all of it is never nearer than R to someone who never gives way.
        let mut simulator = meeting(1.0);
        for step in 0..60_u8 {
            let x = 6.0 - 0.1 * f32::from(step);
            comes_on(&mut simulator, x);
            let distance = simulator.position(0).distance(Vec2::new(x, 0.1));
            assert!(distance > 0.7 - 1e-4, "step {step}: {distance} m");
            simulator.step();
        }
    }

    #[test]
    fn an_agent_looks_no_farther_than_its_distance() {
        // The other stands in the way, 2 m ahead and within its horizon.
        let velocity = |neighbour_distance| {
            let mut simulator = simulator(0.1);
            let parameters = AgentParameters { neighbour_distance, ..PARAMETERS };
            simulator.add_agent(Vec2::ZERO, Vec2::X, &parameters).unwrap();
            simulator.add_agent(Vec2::new(2.0, 0.1), Vec2::ZERO, &parameters).unwrap();
            simulator.set_preferred_velocity(0, Vec2::X).unwrap();
            simulator.plan();
            simulator.planned_velocity(0)
        };
        assert_eq!(velocity(1.9), Vec2::X);
        assert_ne!(velocity(2.1), Vec2::X);
    }

    #[test]
    fn time_steps_are_accepted_from_a_tenth_of_a_millisecond_to_ten_seconds() {
        let ok = |time_step| OrcaSimulator::new(time_step, Arc::new(Obstacles::default())).is_ok();
        assert!(ok(1e-4) && ok(10.0) && !ok(0.9e-4) && !ok(10.1) && !ok(f32::NAN));
    }
}
