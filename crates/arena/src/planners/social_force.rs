//! `social-force`: Helbing and Molnár's forces from everyone's true position and velocity.
//!
//! It knows positions, which a robot with a laser does not: a yardstick, no competitor. It does not
//! know where others want to go: they are taken to go on as they do.

use glam::{DVec2, Vec2};
use jostle_peds::social_force::{Border, DesiredSpeed, SocialForce, SocialForceConfig, Walker};
use jostle_sim::RobotConfig;
use serde::Serialize;

use super::each_room::RoomPlanner;
use super::steering::steer;
use crate::error::ArenaError;
use crate::robot::RobotView;
use crate::room::RoomPlan;

/// Distance at which the goal of others is taken to be, in the direction that they walk (m).
const GOAL_OF_OTHERS: f32 = 10.0;

/// The differences from the pedestrians of crowd SF, which are points: the robot crashes at 0.5 m.
/// Range and potential between the robot and a pedestrian were chosen on the validation crowds by
/// `examples/tune_positions.rs` (docs/planners.md).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SocialForceRobotConfig {
    /// Range σ of the potential between the robot and a pedestrian (m).
    pub sigma: f64,
    /// Potential V⁰ between them (m²/s²).
    pub v0: f64,
    /// Range R of the borders' potential (m).
    pub border_range: f64,
}

impl Default for SocialForceRobotConfig {
    fn default() -> Self {
        Self { sigma: 1.2, v0: 12.0, border_range: 0.2 }
    }
}

/// The planner in the rooms of a plan.
pub struct SocialForceRobot {
    robot: RobotConfig,
    dt: f32,
    model: SocialForce,
    borders: Vec<Border>,
}

impl SocialForceRobot {
    /// The planner of a plan's robot.
    ///
    /// # Errors
    ///
    /// A parameter out of its range.
    pub fn new(plan: &RoomPlan, config: &SocialForceRobotConfig) -> Result<Self, ArenaError> {
        let (robot, dt) = (plan.config.sim.robot.clone(), plan.config.sim.episode.dt);
        let model = SocialForce::new(&SocialForceConfig {
            desired_speed: DesiredSpeed::Fixed(f64::from(robot.v_max)),
            max_speed_factor: 1.0,
            sigma: config.sigma,
            v0: config.v0,
            r: config.border_range,
            ..SocialForceConfig::default()
        })?;
        Ok(Self { robot, dt, model, borders: Border::from_polygons(&plan.scenario.boundary())? })
    }

    fn walker(&self, position: Vec2, velocity: Vec2, goal: Vec2) -> Walker {
        Walker {
            position: position.as_dvec2(),
            velocity: velocity.as_dvec2(),
            goal: goal.as_dvec2(),
            desired_speed: f64::from(self.robot.v_max),
        }
    }
}

impl RoomPlanner for SocialForceRobot {
    type Scratch = Vec<Walker>;

    fn scratch(&self) -> Vec<Walker> {
        Vec::new()
    }

    fn plan(&self, view: &RobotView<'_>, walkers: &mut Vec<Walker>) -> Result<[f32; 2], ArenaError> {
        let robot = &view.robot;
        walkers.clear();
        walkers.push(self.walker(robot.position, robot.velocity, robot.goal));
        walkers.extend(view.pedestrians.iter().map(|other| {
            let ahead = other.velocity.normalize_or_zero() * GOAL_OF_OTHERS;
            self.walker(other.position, other.velocity, other.position + ahead)
        }));
        let velocity: DVec2 = self.model.next_velocity(0, walkers, &self.borders, f64::from(self.dt));
        Ok(steer(velocity.as_vec2(), robot.heading, &self.robot, self.dt))
    }
}

#[cfg(test)]
mod tests {
    use jostle_peds::{CrowdKind, Pedestrian};

    use super::super::each_room::testing::under_way;
    use super::*;
    use crate::config::ArenaConfig;

    /// The command of a robot [`under_way`].
    fn plan(pedestrians: &[(Vec2, Vec2)]) -> [f32; 2] {
        let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Sf).unwrap();
        let planner = SocialForceRobot::new(&plan, &SocialForceRobotConfig::default()).unwrap();
        under_way(pedestrians, |view| planner.plan(view, &mut Vec::new()).unwrap())
    }

    #[test]
    fn it_drives_to_its_goal_and_yields_to_what_is_near() {
        let [v, w] = plan(&[]);
        assert!((v - 1.0).abs() < 1e-3 && w.abs() < 1e-3, "({v}, {w})");
        let near = plan(&[(Vec2::new(1.0, 0.4), Vec2::ZERO)]);
        assert!(near[0] < 1.0 && near[1] < 0.0, "slower, and away from it: {near:?}");
    }

    #[test]
    fn it_does_not_know_where_others_want_to_go() {
        let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Sf).unwrap();
        let planner = SocialForceRobot::new(&plan, &SocialForceRobotConfig::default()).unwrap();
        let act = |goal: Vec2| {
            let body =
                |position: Vec2, goal: Vec2| Pedestrian { position, velocity: Vec2::Y, heading: 0.0, goal };
            let (robot, other) = (body(Vec2::ZERO, 8.0 * Vec2::X), [body(Vec2::new(1.5, -1.0), goal)]);
            planner.plan(&RobotView { row: &[], robot, pedestrians: &other }, &mut Vec::new()).unwrap()
        };
        assert_eq!(act(Vec2::new(9.0, 9.0)), act(Vec2::new(-9.0, 2.0)));
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        let plan = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Sf).unwrap();
        let config = SocialForceRobotConfig { sigma: 0.0, ..SocialForceRobotConfig::default() };
        assert!(SocialForceRobot::new(&plan, &config).is_err());
    }
}
