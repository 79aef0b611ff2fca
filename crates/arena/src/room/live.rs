//! A room that someone changes while it runs: another goal for the robot, one more pedestrian, one
//! more obstacle.
//!
//! All draws come from named streams, as in a test; so a room is a function of its seed and of the
//! changes with the steps between them. Episodes that start later in the same plan have the
//! pedestrians and obstacles that were added.

use glam::Vec2;
use jostle_peds::Pedestrian;
use jostle_sim::{Hit, Motion, Observer, Pose, ScanSummary, Shape, Spawner, Streams};

use super::{ArenaRoom, ROBOT, RoomPlan, spawn_settings};
use crate::driving::DrivingMeter;
use crate::error::ArenaError;

/// Distance from the robot's crash range that things put into a running room keep (m).
const MARGIN: f32 = 0.5;

impl ArenaRoom {
    /// Gives the robot another goal. The time limit and the way count from here.
    ///
    /// # Errors
    ///
    /// A goal that the robot cannot reach without a crash: too near to a wall or an obstacle, or
    /// beyond one.
    pub fn set_goal(&mut self, plan: &RoomPlan, goal: Vec2) -> Result<(), ArenaError> {
        let least = plan.config.sim.episode.crash_range;
        if !goal.is_finite() || self.world.clearance(goal) < least {
            return refuse("goal", goal, format!("a point at least {least} m from walls and obstacles"));
        }
        if !plan.spawner.connects(self.world.pose(ROBOT).position, goal) {
            return refuse("goal", goal, "a point that the robot can get to".to_owned());
        }
        self.goal = goal;
        self.start = self.world.pose(ROBOT);
        (self.steps, self.path_length) = (0, 0.0);
        self.meter = DrivingMeter::new(plan.scale.dt);
        self.write_motion(plan, ROBOT);
        Ok(())
    }

    /// Puts one more pedestrian into the room and the plan; it gets a heading, a goal and a speed
    /// factor of its own.
    ///
    /// # Errors
    ///
    /// A place that is taken or too near to the robot; a room that is too full for one more.
    pub fn add_pedestrian(&mut self, plan: &mut RoomPlan, position: Vec2) -> Result<(), ArenaError> {
        let body = self.motions.len();
        if self.playback.is_some() {
            return refuse("pedestrian", position, "none: a recording has its own people".to_owned());
        }
        let (config, shape) = (&plan.config, self.world.shape(ROBOT).clone());
        let size = shape.circumradius();
        self.check_place(plan, "pedestrian", position, size)?;
        if config.scene.is_none() {
            plan.spawner.check_room(config.n_agents + 1)?;
        }
        let streams = Streams::new(config.seed);
        let indexed = |name: &str| streams.stream(name, &[self.episode, body as u64]);
        let mut rng = indexed("eval.added");
        let goal = plan.spawner.goal(&self.world, position, &mut rng);
        // It sets out towards its goal.
        let pose = Pose::new(position, (goal - position).to_angle());
        self.world.add_body(&shape, pose)?;
        self.speed_factor.push(plan.draw_speed_factor(&mut rng));
        self.streams.push(indexed("eval.pedestrian"));
        let (gait, noise) = (indexed("eval.gait"), indexed("eval.noise"));
        self.begin_gait(plan, gait);
        self.set_pace();
        self.pedestrians.push(Pedestrian { position, velocity: Vec2::ZERO, heading: pose.heading, goal });
        self.ranges.resize(self.ranges.len() + config.sim.laser.beams, 0.0);
        self.summaries.push(ScanSummary { min_range: 0.0, nearest: Hit::None });
        self.motions.push(Motion::Still);
        self.stops.push(None);
        self.respawned.push(false);
        if plan.senses_by_laser {
            self.observers.push(Observer::new(&config.sim, noise));
            self.observations.resize(self.observations.len() + config.sim.observation_len(), 0.0);
            self.observe_first(plan, body);
        }
        plan.config.n_agents += 1;
        Ok(())
    }

    /// Puts an obstacle into the room and the plan. Pedestrians whose goals it covers get new ones.
    /// A crowd that knows obstacles has to be made anew from the plan.
    ///
    /// # Errors
    ///
    /// A place that is taken, too near to the robot or on its goal, or that would cut the robot off
    /// from it; a room in which starts and goals would no longer find their places; a shape that
    /// the world refuses. Nothing is changed then.
    pub fn add_obstacle(&mut self, plan: &mut RoomPlan, shape: &Shape, pose: Pose) -> Result<(), ArenaError> {
        shape.validate("obstacle")?;
        let size = shape.circumradius();
        self.check_place(plan, "obstacle", pose.position, size)?;
        let reach = size + plan.config.sim.episode.crash_range;
        if self.goal.distance(pose.position) < reach {
            return refuse("obstacle", pose.position, format!("a point at least {reach:.2} m from the goal"));
        }
        let mut scenario = plan.scenario.clone();
        scenario.obstacles.push((shape.clone(), pose));
        let spawner = Spawner::new(&spawn_settings(&plan.config), &scenario.build()?)?;
        if plan.config.scene.is_none() {
            spawner.check_room(plan.config.n_agents)?;
        }
        if !spawner.connects(self.world.pose(ROBOT).position, self.goal) {
            let expected = "a point that leaves the robot a way to its goal".to_owned();
            return refuse("obstacle", pose.position, expected);
        }
        self.world.add_obstacle(shape, pose)?;
        (plan.scenario, plan.spawner) = (scenario, spawner);
        let least = plan.config.sim.episode.crash_range;
        for (pedestrian, rng) in self.pedestrians.iter_mut().zip(&mut self.streams) {
            if self.world.clearance(pedestrian.goal) < least {
                pedestrian.goal = plan.spawner.goal(&self.world, pedestrian.position, rng);
            }
        }
        Ok(())
    }

    /// Refuses a place for a thing that reaches `size` around it where it would touch something or
    /// crash the robot.
    fn check_place(
        &self,
        plan: &RoomPlan,
        field: &'static str,
        position: Vec2,
        size: f32,
    ) -> Result<(), ArenaError> {
        let from_robot = size + plan.config.sim.episode.crash_range + MARGIN;
        let far = |body: usize| {
            let least = if body == ROBOT { from_robot } else { size + self.world.shape(body).circumradius() };
            self.world.pose(body).position.distance(position) >= least
        };
        if position.is_finite() && self.world.clearance(position) >= size && (0..self.motions.len()).all(far)
        {
            return Ok(());
        }
        refuse(field, position, format!("a free place, at least {from_robot:.2} m from the robot"))
    }
}

fn refuse(field: &'static str, found: Vec2, expected: String) -> Result<(), ArenaError> {
    Err(ArenaError::Setting { field, found: format!("({:.2}, {:.2})", found.x, found.y), expected })
}

#[cfg(test)]
mod tests {
    use jostle_peds::{Command, CrowdKind};
    use jostle_sim::{Laser, Outcome};

    use super::*;
    use crate::config::ArenaConfig;

    fn room() -> (RoomPlan, ArenaRoom) {
        let config = ArenaConfig { n_agents: 3, ..ArenaConfig::default() };
        let plan = RoomPlan::new(&config, CrowdKind::Nh).unwrap();
        let laser = Laser::new(&config.sim.laser).unwrap();
        let room = ArenaRoom::new(&plan, &laser, 0).unwrap();
        (plan, room)
    }

    /// Points that are free, the nearest to the robot first.
    fn free_points(room: &ArenaRoom) -> Vec<Vec2> {
        let robot = room.robot().position;
        let grid = (0..81).map(|k| Vec2::new((k % 9) as f32 - 4.0, (k / 9) as f32 - 4.0) * 2.0);
        let mut points: Vec<Vec2> = grid
            .filter(|point| {
                point.distance(robot) > 2.0
                    && point.distance(room.goal) > 2.0
                    && room.pedestrians.iter().all(|p| p.position.distance(*point) > 2.0)
            })
            .collect();
        points.sort_by(|a, b| a.distance(robot).total_cmp(&b.distance(robot)));
        points
    }

    #[test]
    fn a_goal_is_seen_at_once_and_starts_the_time_anew() {
        let (plan, mut room) = room();
        let still = vec![Command::STILL; 2];
        for _ in 0..5 {
            assert!(room.step(&plan, [0.0, 0.0], &still).unwrap().is_none());
        }
        let robot = room.robot();
        let goal = robot.position * 0.5;
        room.set_goal(&plan, goal).unwrap();
        let row = room.robot_observation();
        let seen = Pose::new(robot.position, robot.heading).point_in_frame(goal);
        assert_eq!(row[row.len() - 4..row.len() - 2], seen.to_array());
        assert_eq!((room.steps, room.robot().goal), (0, goal));
        let message = room.set_goal(&plan, Vec2::new(50.0, 0.0)).unwrap_err().to_string();
        assert_eq!(
            message,
            "goal: found (50.00, 0.00), expected a point at least 0.5 m from walls and obstacles"
        );
    }

    #[test]
    fn a_pedestrian_that_is_added_is_seen_observes_and_walks() {
        let (mut plan, mut room) = room();
        let place = free_points(&room)[0];
        room.add_pedestrian(&mut plan, place).unwrap();
        assert_eq!((plan.config.n_agents, room.pedestrians().len()), (4, 3));
        let row = plan.config.sim.observation_len();
        assert_eq!(room.view(&[]).observations.len(), 3 * row);
        assert!(room.view(&[]).observations[2 * row..].iter().any(|value| *value != 0.0));
        let walks = [Command::STILL, Command::STILL, Command::Drive { v: 1.0, w: 0.0 }];
        room.step(&plan, [0.0, 0.0], &walks).unwrap();
        assert!((room.pedestrians()[2].position.distance(place) - 0.1).abs() < 1e-5);
        let near = room.robot().position + Vec2::new(0.2, 0.0);
        assert!(room.add_pedestrian(&mut plan, near).is_err());
        assert_eq!(plan.config.n_agents, 4);
        // The next episode of the plan has it from its start.
        let laser = Laser::new(&plan.config.sim.laser).unwrap();
        assert_eq!(ArenaRoom::new(&plan, &laser, 1).unwrap().pedestrians().len(), 3);
    }

    #[test]
    fn changes_after_which_nobody_could_be_placed_are_refused_and_change_nothing() {
        let (mut plan, mut room) = room();
        let wall = Shape::Box { length: 0.4, width: 21.0 };
        let (start, goal) = (room.robot().position, room.goal);
        // A wall from side to side, between the robot and its goal.
        let middle = Vec2::new(f32::midpoint(start.x, goal.x), 0.0);
        let far = |p: &Pedestrian| (p.position.x - middle.x).abs() > 1.0;
        assert!((start.x - goal.x).abs() > 2.0 && room.pedestrians.iter().all(far));
        room.world.add_obstacle(&wall, Pose::new(middle, 0.0)).unwrap();
        plan.scenario.obstacles.push((wall, Pose::new(middle, 0.0)));
        plan.spawner = Spawner::new(&plan.config.sim, &room.world).unwrap();
        let message = room.set_goal(&plan, goal).unwrap_err().to_string();
        assert!(message.ends_with("expected a point that the robot can get to"), "{message}");
        let obstacles = plan.scenario.obstacles.len();
        let (disc, place) = (Shape::Circle { radius: 0.1 }, Pose::new(free_points(&room)[0], 0.0));
        let message = room.add_obstacle(&mut plan, &disc, place).unwrap_err().to_string();
        assert!(message.ends_with("expected a point that leaves the robot a way to its goal"), "{message}");
        assert_eq!((plan.scenario.obstacles.len(), room.world.n_obstacles()), (obstacles, obstacles));
        // As many pedestrians as the room holds: each keeps a metre from the others.
        let full = (2..100).find(|n| plan.spawner.check_room(*n).is_err()).unwrap();
        plan.config.n_agents = full - 1;
        let message = room.add_pedestrian(&mut plan, place.position).unwrap_err().to_string();
        assert!(message.starts_with(&format!("n_agents: found {full}, expected so few")), "{message}");
        assert_eq!((plan.config.n_agents, room.pedestrians.len()), (full - 1, 2));
    }

    #[test]
    fn an_obstacle_is_solid_and_covers_no_goal() {
        let (mut plan, mut room) = room();
        let points = free_points(&room);
        let (ahead, covered, disc) = (points[0], points[points.len() - 1], Shape::Circle { radius: 0.4 });
        room.pedestrians[0].goal = covered;
        room.add_obstacle(&mut plan, &disc, Pose::new(covered, 0.0)).unwrap();
        // As far from the disc as any start or goal.
        assert!(room.pedestrians[0].goal.distance(covered) >= 1.4 - 1e-4);
        room.add_obstacle(&mut plan, &disc, Pose::new(ahead, 0.0)).unwrap();
        assert!(room.add_obstacle(&mut plan, &disc, Pose::new(room.goal, 0.0)).is_err());
        assert!(room.add_pedestrian(&mut plan, ahead).is_err());
        assert_eq!(plan.scenario.build().unwrap().clearance(ahead), 0.0);
        // The robot that drives towards it hits it.
        room.goal = Vec2::splat(100.0);
        let mut outcome = None;
        for _ in 0..300 {
            let seen = Pose::new(room.robot().position, room.robot().heading).point_in_frame(ahead);
            let turn = seen.to_angle();
            let action = [if turn.abs() < 0.1 { 1.0 } else { 0.0 }, turn.clamp(-1.0, 1.0)];
            outcome = room.step(&plan, action, &[Command::STILL; 2]).unwrap();
            if outcome.is_some() {
                break;
            }
        }
        assert_eq!(outcome.unwrap().outcome, Outcome::CollisionWall);
    }
}
