//! `orca`: optimal reciprocal collision avoidance from everyone's true position and velocity.
//!
//! It knows positions, which a robot with a laser does not: a yardstick, no competitor. Most people
//! of the test crowds do not see the robot, so that it does not count on their half of the avoiding
//! ([`OrcaRobotConfig::responsibility`]).

use std::sync::Arc;

use glam::Vec2;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};
use jostle_sim::RobotConfig;
use serde::Serialize;

use super::each_room::RoomPlanner;
use super::steering::steer;
use crate::error::ArenaError;
use crate::robot::RobotView;
use crate::room::RoomPlan;

/// Parameters of the robot and of the people as it takes them. Radius, horizon and share of the
/// avoiding were chosen on the validation crowds by `examples/tune_positions.rs`
/// (docs/planners.md).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OrcaRobotConfig {
    /// Radius of the robot's disc (m): its crash range, and a margin.
    pub radius: f32,
    /// Radius of a pedestrian's disc (m): its square of 0.5 m lies within it.
    pub pedestrian_radius: f32,
    /// For how long velocities are kept free of collisions with people (s).
    pub time_horizon: f32,
    /// The same for walls and obstacles (s).
    pub time_horizon_obstacles: f32,
    /// Share of the avoiding that the robot takes on itself: ½ is reciprocal, 1 expects nothing of
    /// others.
    pub responsibility: f32,
}

impl Default for OrcaRobotConfig {
    fn default() -> Self {
        Self {
            radius: 0.8,
            pedestrian_radius: 0.35,
            time_horizon: 3.0,
            time_horizon_obstacles: 1.0,
            responsibility: 1.0,
        }
    }
}

/// The planner in the rooms of a plan.
pub struct OrcaRobot {
    robot: RobotConfig,
    dt: f32,
    own: AgentParameters,
    theirs: AgentParameters,
    empty: OrcaSimulator,
}

impl OrcaRobot {
    /// The planner of a plan's robot.
    ///
    /// # Errors
    ///
    /// A parameter out of its range.
    pub fn new(plan: &RoomPlan, config: &OrcaRobotConfig) -> Result<Self, ArenaError> {
        let (robot, dt) = (plan.config.sim.robot.clone(), plan.config.sim.episode.dt);
        let own = AgentParameters {
            neighbour_distance: 10.0,
            max_neighbours: 10,
            time_horizon: config.time_horizon,
            time_horizon_obstacles: config.time_horizon_obstacles,
            radius: config.radius,
            max_speed: robot.v_max,
        };
        own.validate()?;
        let theirs = AgentParameters { radius: config.pedestrian_radius, ..own };
        theirs.validate()?;
        let obstacles = Arc::new(Obstacles::new(&plan.scenario.boundary())?);
        let mut empty = OrcaSimulator::new(dt, obstacles)?;
        empty.set_responsibility(config.responsibility)?;
        Ok(Self { robot, dt, own, theirs, empty })
    }
}

impl RoomPlanner for OrcaRobot {
    type Scratch = OrcaSimulator;

    fn scratch(&self) -> OrcaSimulator {
        self.empty.clone()
    }

    fn plan(&self, view: &RobotView<'_>, simulator: &mut OrcaSimulator) -> Result<[f32; 2], ArenaError> {
        let robot = &view.robot;
        simulator.clear_agents();
        let own = simulator.add_agent(robot.position, robot.velocity, &self.own)?;
        // Slower within a second of the goal, as RVO2's examples have it.
        let to_goal: Vec2 = robot.goal - robot.position;
        simulator.set_preferred_velocity(own, to_goal.clamp_length_max(self.robot.v_max))?;
        for pedestrian in view.pedestrians {
            simulator.add_agent(pedestrian.position, pedestrian.velocity, &self.theirs)?;
        }
        simulator.plan();
        Ok(steer(simulator.planned_velocity(own), robot.heading, &self.robot, self.dt))
    }
}

#[cfg(test)]
mod tests {
    use jostle_peds::CrowdKind;

    use super::super::each_room::testing::under_way;
    use super::*;
    use crate::config::ArenaConfig;

    /// The command of a robot [`under_way`].
    fn plan(config: &OrcaRobotConfig, pedestrians: &[(Vec2, Vec2)]) -> [f32; 2] {
        let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Vo).unwrap();
        let planner = OrcaRobot::new(&plan, config).unwrap();
        under_way(pedestrians, |view| planner.plan(view, &mut planner.scratch()).unwrap())
    }

    #[test]
    fn it_drives_to_its_goal_and_avoids_what_comes() {
        let config = OrcaRobotConfig::default();
        assert_eq!(plan(&config, &[]), [1.0, 0.0]);
        assert_eq!(plan(&config, &[(Vec2::new(0.0, 5.0), Vec2::Y)]), [1.0, 0.0], "who leaves is no matter");
        let [v, w] = plan(&config, &[(Vec2::new(2.0, 0.2), -Vec2::X)]);
        assert!(w < 0.0, "to the right of one who comes on the left: ({v}, {w})");
    }

    #[test]
    fn who_expects_nothing_avoids_more() {
        let crossing = [(Vec2::new(2.0, -2.0), Vec2::Y)];
        let with = |responsibility| {
            plan(&OrcaRobotConfig { responsibility, ..OrcaRobotConfig::default() }, &crossing)
        };
        let ([half, _], [all, _]) = (with(0.5), with(1.0));
        assert!(all < half, "{all} and {half}");
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Vo).unwrap();
        let refused = |config: OrcaRobotConfig| OrcaRobot::new(&plan, &config).is_err();
        let config = OrcaRobotConfig::default();
        assert!(refused(OrcaRobotConfig { radius: -1.0, ..config }));
        assert!(refused(OrcaRobotConfig { pedestrian_radius: f32::NAN, ..config }));
        assert!(refused(OrcaRobotConfig { responsibility: 1.5, ..config }));
    }
}
