//! Crowd VO: pedestrians that avoid each other and the walls by ORCA, from ground-truth positions.

use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{AgentParameters, Obstacles, OrcaSimulator};
use crate::{
    Command, Crowd, CrowdKind, CrowdName, Pedestrian, PedsError, RoomView, Visibility,
    crowd::{check_commands, with_commands},
    error::{checked, require},
};

/// Parameters of crowd VO.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrcaConfig {
    /// Radius of a pedestrian's disc, m. Default 0.35: the robot's square of 0.5 m lies within it.
    pub radius: f32,
    /// Largest and preferred speed, m/s. Default 1, the robot's.
    pub max_speed: f32,
    /// Others at this distance or farther are not looked at, m. Default 10.
    pub neighbour_distance: f32,
    /// At most this many others are looked at. Default 10.
    pub max_neighbours: usize,
    /// Horizon for agents, s. Default 5.
    pub time_horizon: f32,
    /// Horizon for obstacles, s. Default 5.
    pub time_horizon_obstacles: f32,
    /// Radius of the disc by which the robot is seen, where it is seen, m. Default 0.35.
    pub robot_radius: f32,
}

impl Default for OrcaConfig {
    fn default() -> Self {
        Self {
            radius: 0.35,
            max_speed: 1.0,
            neighbour_distance: 10.0,
            max_neighbours: 10,
            time_horizon: 5.0,
            time_horizon_obstacles: 5.0,
            robot_radius: 0.35,
        }
    }
}

impl OrcaConfig {
    /// The agents' parameters.
    pub fn parameters(&self) -> AgentParameters {
        AgentParameters {
            neighbour_distance: self.neighbour_distance,
            max_neighbours: self.max_neighbours,
            time_horizon: self.time_horizon,
            time_horizon_obstacles: self.time_horizon_obstacles,
            radius: self.radius,
            max_speed: self.max_speed,
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// See [`AgentParameters::validate`].
    pub fn validate(&self) -> Result<(), PedsError> {
        self.parameters().validate()?;
        let robot = self.robot_radius;
        require((0.0..=100.0).contains(&robot), "robot_radius", robot.into(), "0 to 100 m")
    }
}

/// Crowd VO. Speed factors are ignored: every pedestrian prefers `max_speed`.
#[derive(Debug)]
pub struct OrcaCrowd {
    parameters: AgentParameters,
    robot: AgentParameters,
    visibility: Visibility,
    empty: OrcaSimulator,
    /// One per room: scratch memory.
    simulators: Vec<OrcaSimulator>,
}

impl OrcaCrowd {
    /// `time_step` is the control period; the obstacles are those of every room.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn new(
        config: &OrcaConfig,
        visibility: Visibility,
        time_step: f32,
        obstacles: Arc<Obstacles>,
    ) -> Result<Self, PedsError> {
        config.validate()?;
        let parameters = config.parameters();
        Ok(Self {
            parameters,
            robot: AgentParameters { radius: config.robot_radius, ..parameters },
            visibility,
            empty: OrcaSimulator::new(time_step, obstacles)?,
            simulators: Vec::new(),
        })
    }
}

impl Crowd for OrcaCrowd {
    fn name(&self) -> CrowdName {
        CrowdKind::Vo.into()
    }

    fn visibility(&self) -> Visibility {
        self.visibility
    }

    fn senses_by_laser(&self) -> bool {
        false
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError> {
        check_commands(rooms, commands)?;
        if self.simulators.len() < rooms.len() {
            self.simulators.resize(rooms.len(), self.empty.clone());
        }
        let (parameters, robot, visibility) = (self.parameters, self.robot, self.visibility);
        with_commands(rooms, commands).into_par_iter().zip(&mut self.simulators[..rooms.len()]).try_for_each(
            |((room, commands), simulator)| {
                let others = if visibility.robot { room.others } else { &[] };
                let mut planner = Planner { simulator, parameters: &parameters, robot: &robot, others };
                if visibility.pedestrians {
                    return planner.decide(room.pedestrians, commands);
                }
                let alone = room.pedestrians.chunks(1).zip(commands.chunks_mut(1));
                alone.into_iter().try_for_each(|(pedestrian, command)| planner.decide(pedestrian, command))
            },
        )
    }
}

struct Planner<'a> {
    simulator: &'a mut OrcaSimulator,
    parameters: &'a AgentParameters,
    robot: &'a AgentParameters,
    others: &'a [Pedestrian],
}

impl Planner<'_> {
    /// Plans for pedestrians that see each other and the others.
    fn decide(&mut self, pedestrians: &[Pedestrian], commands: &mut [Command]) -> Result<(), PedsError> {
        self.simulator.clear_agents();
        for pedestrian in pedestrians {
            let agent =
                self.simulator.add_agent(pedestrian.position, pedestrian.velocity, self.parameters)?;
            let preferred = preferred_velocity(pedestrian, self.parameters.max_speed)?;
            self.simulator.set_preferred_velocity(agent, preferred)?;
        }
        for other in self.others {
            self.simulator.add_agent(other.position, other.velocity, self.robot)?;
        }
        self.simulator.plan();
        for (agent, command) in commands.iter_mut().enumerate() {
            *command = Command::Walk { velocity: self.simulator.planned_velocity(agent) };
        }
        Ok(())
    }
}

/// Towards the goal at full speed, and slower within one second of it, as RVO2's examples do.
fn preferred_velocity(pedestrian: &Pedestrian, max_speed: f32) -> Result<Vec2, PedsError> {
    let to_goal = checked("goal", pedestrian.goal)? - pedestrian.position;
    Ok(to_goal.clamp_length_max(max_speed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_preferred_velocity_slows_within_a_second_of_the_goal() {
        let at = |goal: Vec2| {
            let pedestrian = Pedestrian {
                position: Vec2::ONE,
                velocity: Vec2::ZERO,
                heading: 0.0,
                goal: Vec2::ONE + goal,
            };
            preferred_velocity(&pedestrian, 2.0).unwrap()
        };
        assert!(at(Vec2::new(30.0, 40.0)).distance(Vec2::new(1.2, 1.6)) < 1e-6);
        assert_eq!(at(Vec2::new(0.5, -1.0)), Vec2::new(0.5, -1.0));
    }

    #[test]
    fn the_config_says_what_the_agents_are() {
        let config = OrcaConfig { radius: 0.2, max_speed: 1.5, max_neighbours: 4, ..OrcaConfig::default() };
        let parameters = config.parameters();
        assert_eq!((parameters.radius, parameters.max_speed, parameters.max_neighbours), (0.2, 1.5, 4));
        assert_eq!((parameters.neighbour_distance, parameters.time_horizon), (10.0, 5.0));
        assert!(OrcaConfig { radius: -1.0, ..config }.validate().is_err());
        assert!(OrcaConfig { robot_radius: 100.5, ..config }.validate().is_err());
        assert_eq!(OrcaConfig { robot_radius: 100.0, ..config }.validate(), Ok(()));
    }
}
