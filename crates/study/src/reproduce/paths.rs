//! Figure "paths": where each behaviour token leads from one start to one goal behind a static
//! obstacle.

use anyhow::{Result, bail};
use glam::{DVec2, Vec2};
use jostle_arena::config::ArenaConfig;
use jostle_arena::loaded::LoadedPolicy;
use jostle_arena::robot::{RobotPolicy, TrainedRobot};
use jostle_eval::report::grid::csv_line;
use jostle_sim::{
    CrashRule, Laser, Motion, Observer, Outcome, Pose, RoomConfig, Scenario, Sensor, Shape, StepEnd, Streams,
    apply_limits, clip_action, maps, outcome,
};

use super::Figure;
use super::policies::Found;
use jostle_runs::provenance::workspace;
use jostle_view::draw;
use jostle_view::draw::paths::{PathEnd, PathFigure, PathPoint, RobotPath};

/// The robot starts at the origin and looks at the goal (paper, Fig. "qual").
const GOAL: [f32; 2] = [8.0, 0.0];
/// Steps from one arrow to the next: a second.
const ARROW_EVERY: usize = 10;
/// Room around what is shown (m).
const AROUND: f64 = 1.0;
/// Part of the room that is shown in any case: least and largest corner (m).
const VIEW: ([f64; 2], [f64; 2]) = ([0.0, -1.5], [8.0, 1.5]);

/// One token's way.
struct Way {
    token: u32,
    /// Pose and executed velocity after each step, the start first.
    points: Vec<(Pose, [f32; 2])>,
    end: Outcome,
}

/// The figure of a policy, each of its tokens in turn.
pub(super) fn figure(found: &Found) -> Result<Figure> {
    let policy = &found.policy;
    let map = workspace().join("maps/obstacle.toml");
    let mut room = RoomConfig::default();
    room.map = Some(map);
    let scenario = maps::scenario(&room)?;
    let tokens = 0..policy.file.network.n_behaviours as u32;
    let ways: Vec<Way> = tokens.map(|token| way(policy, token, &scenario)).collect::<Result<_>>()?;
    let note = format!("{}: training seed {}, {} updates", policy.identity.name, found.seed, found.updates);
    let sim = policy.sim_config()?;
    let scene = PathFigure {
        title: "Where each behaviour token leads around a static obstacle".to_owned(),
        view: view(&ways),
        obstacles: scenario
            .obstacles
            .iter()
            .map(|(shape, pose)| corners(shape, *pose))
            .collect::<Result<_>>()?,
        goal: GOAL.map(f64::from),
        goal_radius: f64::from(sim.episode.goal_radius),
        v_max: f64::from(sim.robot.v_max),
        arrow_every: ARROW_EVERY,
        paths: ways.iter().map(|way| drawn(way, f64::from(sim.episode.dt))).collect(),
        note,
    };
    Ok(Figure { csv: csv(&ways), svg: draw::paths::paths(&scene)? })
}

fn csv(ways: &[Way]) -> String {
    let mut csv = csv_line(["token", "step", "x", "y", "heading", "v", "w", "end"]);
    for way in ways {
        for (step, (pose, [v, w])) in way.points.iter().enumerate() {
            let numbers = [pose.position.x, pose.position.y, pose.heading, *v, *w].map(|x| format!("{x:.4}"));
            let ids = [way.token.to_string(), step.to_string()];
            csv += &csv_line(ids.into_iter().chain(numbers).chain([way.end.to_string()]));
        }
    }
    csv
}

/// The extent of the ways, with room around.
fn view(ways: &[Way]) -> ([f64; 2], [f64; 2]) {
    let positions = ways.iter().flat_map(|way| &way.points).map(|(pose, _)| pose.position.as_dvec2());
    let (least, most) = positions
        .fold((VIEW.0.into(), VIEW.1.into()), |(least, most), at: DVec2| (at.min(least), at.max(most)));
    ((least - AROUND).into(), (most + AROUND).into())
}

/// Corners of an obstacle in the room; of those in this scene, which are boxes.
fn corners(shape: &Shape, pose: Pose) -> Result<Vec<[f64; 2]>> {
    let Shape::Box { length, width } = shape else {
        bail!("found {shape:?}, expected a box in the figure's map")
    };
    let signs = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let corner = |[x, y]: [f32; 2]| {
        let offset = pose.direction().rotate(0.5 * Vec2::new(x * length, y * width));
        (pose.position + offset).as_dvec2().into()
    };
    Ok(signs.map(corner).to_vec())
}

fn drawn(way: &Way, dt: f64) -> RobotPath {
    let point = |(pose, [v, _]): &(Pose, [f32; 2])| PathPoint {
        position: pose.position.as_dvec2().into(),
        heading: f64::from(pose.heading),
        speed: f64::from(*v),
    };
    let end = match way.end {
        Outcome::Success => PathEnd::Goal,
        Outcome::CollisionWall | Outcome::CollisionPedestrian => PathEnd::Collision,
        Outcome::Timeout => PathEnd::Timeout,
    };
    let seconds = (way.points.len() - 1) as f64 * dt;
    RobotPath {
        label: format!("z = {}: {seconds:.1} s", way.token),
        points: way.points.iter().map(point).collect(),
        end,
    }
}

/// A robot alone in the scene; the laser's noise is the same for every token.
fn way(policy: &LoadedPolicy, token: u32, scenario: &Scenario) -> Result<Way> {
    let sim = policy.sim_config()?;
    let mut robot = TrainedRobot::new(policy, token, ArenaConfig::default().backend)?;
    let mut world = scenario.build()?;
    world.add_body(&Shape::Box { length: sim.robot.length, width: sim.robot.width }, Pose::default())?;
    let mut laser = Laser::new(&sim.laser)?;
    let mut observer = Observer::new(&sim, Streams::new(0).stream("figure.paths.noise", &[]));
    let (mut ranges, mut row) = (vec![0.0; sim.laser.beams], vec![0.0; sim.observation_len()]);
    let (goal, mut velocity, mut stops) = (Vec2::from(GOAL), [0.0; 2], [None]);
    let crash_rule = CrashRule::new(&sim);
    laser.scan(&world, Sensor::Body(0), |_| true, &mut ranges);
    observer.begin(&ranges, &mut row);
    observer.write_motion(world.pose(0), goal, velocity, &mut row);
    let mut points = vec![(world.pose(0), velocity)];
    loop {
        let mut actions = [[0.0; 2]];
        robot.act(&row, &mut actions);
        let command = clip_action(actions[0], &sim.robot);
        let executed = apply_limits(velocity, command, sim.robot.acceleration.as_ref(), sim.episode.dt);
        let motion = Motion::Drive { v: executed[0], w: executed[1] };
        world.advance_to_stops(&[motion], sim.episode.dt, &mut stops);
        velocity = if stops[0].is_some() { [0.0; 2] } else { executed };
        points.push((world.pose(0), velocity));
        let summary = laser.scan(&world, Sensor::Body(0), |_| true, &mut ranges);
        let distance = world.pose(0).position.distance(goal);
        let crash = crash_rule.crash(summary, &stops, 0, |_| true);
        let reached = outcome(distance, sim.episode.goal_radius, crash);
        let steps = points.len() as u32 - 1;
        if let Some(end) = StepEnd::new(reached, steps, sim.episode.step_limit).outcome() {
            return Ok(Way { token, points, end });
        }
        observer.push(&ranges, &mut row);
        observer.write_motion(world.pose(0), goal, velocity, &mut row);
    }
}
