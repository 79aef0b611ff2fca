//! Figure "paths": where each behaviour token leads from one start to one goal behind a static obstacle.

use anyhow::Result;
use glam::Vec2;
use jostle_eval::config::EvalConfig;
use jostle_eval::loaded::LoadedPolicy;
use jostle_eval::outcome::EpisodeOutcome;
use jostle_eval::report::grid::csv_line;
use jostle_eval::robot::{RobotPolicy, TrainedRobot};
use jostle_sim::{
    Laser, Motion, Observer, Outcome, Pose, RoomConfig, Scenario, Sensor, Shape, Streams, apply_limits,
    clip_action, crash, outcome,
};

use crate::provenance::workspace;

/// The robot starts at the origin and looks at the goal (paper, Fig. "qual").
const GOAL: [f32; 2] = [8.0, 0.0];
/// One token's way.
struct Way {
    token: u32,
    /// Pose and executed velocity after each step, the start first.
    points: Vec<(Pose, [f32; 2])>,
    end: EpisodeOutcome,
}

/// The figure's data as CSV.
pub(super) fn figure(policy: &LoadedPolicy) -> Result<String> {
    let map = workspace().join("maps/obstacle.toml");
    let scenario = Scenario::new(&RoomConfig { map: Some(map), ..RoomConfig::default() })?;
    let tokens = 0..policy.file.network.n_behaviours as u32;
    let ways: Vec<Way> = tokens.map(|token| way(policy, token, &scenario)).collect::<Result<_>>()?;
    let mut csv = csv_line(["token", "step", "x", "y", "heading", "v", "w", "end"]);
    for way in &ways {
        for (step, (pose, [v, w])) in way.points.iter().enumerate() {
            let numbers = [pose.position.x, pose.position.y, pose.heading, *v, *w].map(|x| format!("{x:.4}"));
            let ids = [way.token.to_string(), step.to_string()];
            csv += &csv_line(ids.into_iter().chain(numbers).chain([way.end.to_string()]));
        }
    }
    Ok(csv)
}

/// A robot alone in the scene; the laser's noise is the same for every token.
fn way(policy: &LoadedPolicy, token: u32, scenario: &Scenario) -> Result<Way> {
    let sim = policy.sim_config()?;
    let mut robot = TrainedRobot::new(policy, token, EvalConfig::default().backend)?;
    let mut world = scenario.build()?;
    world.add_body(&Shape::Box { length: sim.robot.length, width: sim.robot.width }, Pose::default())?;
    let mut laser = Laser::new(&sim.laser)?;
    let mut observer = Observer::new(&sim, Streams::new(0).stream("figure.paths.noise", &[]));
    let (mut ranges, mut row) = (vec![0.0; sim.laser.beams], vec![0.0; sim.observation_len()]);
    let (goal, mut velocity, mut stalled) = (Vec2::from(GOAL), [0.0; 2], [false]);
    laser.scan(&world, Sensor::Body(0), |_| true, &mut ranges);
    observer.begin(&ranges, &mut row);
    observer.write_motion(world.pose(0), goal, velocity, &mut row);
    let mut points = vec![(world.pose(0), velocity)];
    loop {
        let mut actions = [[0.0; 2]];
        robot.act(&row, &mut actions);
        let command = clip_action(actions[0], &sim.robot);
        let executed = apply_limits(velocity, command, sim.robot.acceleration.as_ref(), sim.episode.dt);
        world.advance(&[Motion::Drive { v: executed[0], w: executed[1] }], sim.episode.dt, &mut stalled);
        velocity = if stalled[0] { [0.0; 2] } else { executed };
        points.push((world.pose(0), velocity));
        let summary = laser.scan(&world, Sensor::Body(0), |_| true, &mut ranges);
        let distance = world.pose(0).position.distance(goal);
        let end = match outcome(distance, sim.episode.goal_radius, crash(summary, sim.episode.crash_range)) {
            Some(Outcome::Success) => Some(EpisodeOutcome::Success),
            Some(Outcome::CollisionWall | Outcome::CollisionAgent) => Some(EpisodeOutcome::CollisionWall),
            None => (points.len() > sim.episode.step_limit as usize).then_some(EpisodeOutcome::Timeout),
        };
        if let Some(end) = end {
            return Ok(Way { token, points, end });
        }
        observer.push(&ranges, &mut row);
        observer.write_motion(world.pose(0), goal, velocity, &mut row);
    }
}
