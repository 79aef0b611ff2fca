//! Rooms to train in: one robot among a crowd in each, with the reward of the decision process.
//!
//! They are the rooms of the test (`jostle_arena::room`), one episode after another. What the test
//! does not need is added here: the reward, which is that of `jostle-sim`, and the observation in
//! which an episode ends.

use std::sync::Arc;

use jostle_arena::room::{ArenaRoom, FinishedEpisode, RoomPlan};
use jostle_arena::{PolicyIdentity, RoomStepper};
use jostle_eval::{EvalError, Protocol, Subject};
use jostle_peds::Crowd;
use jostle_sim::{Laser, Pose, Scenario, Shape, Streams, ZoneBody, clip_action, reward, safety_zone};
use rand::Rng as _;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::picture::{PEDESTRIAN, Painter, Picture, ROBOT};
use crate::settings::Settings;

/// One room's share of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomStep {
    /// The environment's reward.
    pub reward: f32,
    /// Distance from the robot's outline to the nearest pedestrian, obstacle or wall after the
    /// step, m.
    pub clearance: f32,
    /// The episode, where it ended.
    pub end: Option<EpisodeEnd>,
}

/// An episode that ended, with what only these rooms measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpisodeEnd {
    /// Outcome, steps and the metrics of the test.
    pub finished: FinishedEpisode,
    /// The least clearance of the episode, its start included, m.
    pub min_clearance: f32,
}

/// The snapshot with which other rooms go on where these were: their settings, and the actions of
/// each since its episode began. They are deterministic, so that this is all of their state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// Hash of everything that an episode depends on but seed and index: settings, crowd, the
    /// pedestrians' policies.
    settings: String,
    rooms: Vec<RoomSnapshot>,
}

/// A room's part of a [`Snapshot`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RoomSnapshot {
    seed: u64,
    episode: u64,
    actions: Vec<[f32; 2]>,
}

/// The episodes of one room.
#[derive(Clone, Debug)]
struct Course {
    /// Root seed of this and the next episodes.
    seed: u64,
    goal_distance: f32,
    min_clearance: f32,
    ended: bool,
    /// All actions of this episode.
    actions: Vec<[f32; 2]>,
}

/// R rooms with one robot each.
///
/// # Shapes
///
/// Actions `[R]` of (v, ω).
pub struct CrowdRooms {
    protocol: Arc<Protocol>,
    plan: Arc<RoomPlan>,
    crowd: Box<dyn Crowd>,
    laser: Laser,
    stepper: RoomStepper,
    rooms: Vec<ArenaRoom>,
    courses: Vec<Course>,
}

/// The root seed of the episodes that one trains in with a seed. It differs from the seed itself,
/// so that nobody trains in the episodes of a test of the same seed without meaning to.
pub fn training_seed(seed: u64) -> u64 {
    Streams::new(seed).stream("python.training", &[]).next_u64()
}

impl CrowdRooms {
    /// Makes the rooms; room i is in its first episode of seed i.
    ///
    /// # Errors
    ///
    /// No room asked for; a crowd without its policies; a room that is too small.
    pub fn new(settings: Settings, n_rooms: usize) -> Result<Self, EvalError> {
        if n_rooms == 0 {
            let expected = "at least 1".to_owned();
            return Err(EvalError::Setting { field: "num_envs", found: "0".to_owned(), expected });
        }
        let Settings { config, crowd, pools } = settings;
        let protocol = Protocol::new(config, pools)?;
        let plan = RoomPlan::new(protocol.config(), crowd)?;
        let crowd = protocol.crowd(&plan)?;
        let laser = Laser::new(&plan.config.sim.laser)?;
        let seeds = (0..n_rooms as u64).map(training_seed);
        let rooms = seeds
            .clone()
            .map(|seed| ArenaRoom::seeded(&plan, &laser, seed, 0))
            .collect::<Result<Vec<_>, _>>()?;
        let courses = seeds.zip(&rooms).map(|(seed, room)| Course::new(seed, room)).collect();
        let (protocol, plan) = (Arc::new(protocol), Arc::new(plan));
        Ok(Self { protocol, plan, crowd, laser, stepper: RoomStepper::default(), rooms, courses })
    }

    /// The same rooms once more, each where it stands.
    ///
    /// # Errors
    ///
    /// As the crowd was made without one, none are known.
    pub fn try_clone(&self) -> Result<Self, EvalError> {
        Ok(Self {
            protocol: Arc::clone(&self.protocol),
            plan: Arc::clone(&self.plan),
            crowd: self.protocol.crowd(&self.plan)?,
            laser: self.laser.sibling(),
            stepper: RoomStepper::default(),
            rooms: self.rooms.clone(),
            courses: self.courses.clone(),
        })
    }

    /// The snapshot with which other rooms of the same settings go on as these do.
    pub fn snapshot(&self) -> Snapshot {
        let room = |(room, course): (&ArenaRoom, &Course)| RoomSnapshot {
            seed: course.seed,
            episode: room.episode(),
            actions: course.actions.clone(),
        };
        Snapshot {
            settings: self.settings(),
            rooms: self.rooms.iter().zip(&self.courses).map(room).collect(),
        }
    }

    /// Goes to where other rooms were when their snapshot was taken, by driving through their
    /// present episodes again.
    ///
    /// # Errors
    ///
    /// A snapshot of another number of rooms, of other settings or other policies; nothing is
    /// changed then.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), EvalError> {
        let refuse =
            |found: String, expected: String| Err(EvalError::Setting { field: "snapshot", found, expected });
        let (n, expected) = (snapshot.rooms.len(), self.rooms.len());
        if n != expected {
            return refuse(format!("{n} rooms"), expected.to_string());
        }
        if snapshot.settings != self.settings() {
            let expected = "those of these rooms: a file that they were made from has changed".to_owned();
            return refuse("other settings, map or policies".to_owned(), expected);
        }
        let (mut rooms, mut courses) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for saved in &snapshot.rooms {
            let mut room = [ArenaRoom::seeded(&self.plan, &self.laser, saved.seed, saved.episode)?];
            let mut course = Course::new(saved.seed, &room[0]);
            for action in &saved.actions {
                let ends = self.stepper.step_with(&self.plan, &mut *self.crowd, &mut room, &[*action])?;
                course.follow(&self.plan, &mut room[0], *action, ends[0]);
            }
            rooms.extend(room);
            courses.push(course);
        }
        (self.rooms, self.courses) = (rooms, courses);
        Ok(())
    }

    /// Hash of everything that an episode depends on but its seed and its index.
    fn settings(&self) -> String {
        let identity = PolicyIdentity::custom("", "");
        self.protocol.key(Subject { identity: &identity, token: 0 }, self.plan.crowd).hash()
    }

    /// Starts an episode of a root seed in room `i`; the next ones follow it.
    ///
    /// # Errors
    ///
    /// If the room is too full for another body.
    pub fn begin(&mut self, i: usize, seed: u64, episode: u64) -> Result<(), EvalError> {
        self.rooms[i] = ArenaRoom::seeded(&self.plan, &self.laser, seed, episode)?;
        self.courses[i] = Course::new(seed, &self.rooms[i]);
        Ok(())
    }

    /// Starts the next episode in room `i`.
    ///
    /// # Errors
    ///
    /// As [`Self::begin`].
    pub fn begin_next(&mut self, i: usize) -> Result<(), EvalError> {
        self.begin(i, self.courses[i].seed, self.rooms[i].episode() + 1)
    }

    /// One control period of every room; rooms whose episode ends have to be begun anew before the
    /// next. What the robots see then, also at an episode's end, is in [`Self::rooms`].
    ///
    /// # Errors
    ///
    /// Actions that are not finite and rooms whose episode has ended are refused before anything
    /// moves.
    pub fn step(&mut self, actions: &[[f32; 2]]) -> Result<Vec<RoomStep>, EvalError> {
        self.check(actions)?;
        let ends = self.stepper.step_with(&self.plan, &mut *self.crowd, &mut self.rooms, actions)?;
        let plan = &self.plan;
        let one = |(i, (room, course)): (usize, (&mut ArenaRoom, &mut Course))| {
            course.follow(plan, room, actions[i], ends[i])
        };
        if self.rooms.len() == 1 {
            // One room: no need to wake another thread.
            return Ok(self.rooms.iter_mut().zip(&mut self.courses).enumerate().map(one).collect());
        }
        Ok(self.rooms.par_iter_mut().zip(&mut self.courses).enumerate().map(one).collect())
    }

    fn check(&self, actions: &[[f32; 2]]) -> Result<(), EvalError> {
        let refuse =
            |field, found: String, expected: String| Err(EvalError::Setting { field, found, expected });
        let n = self.rooms.len();
        if actions.len() != n {
            return refuse("actions", format!("{} rows", actions.len()), format!("{n}, one for each room"));
        }
        if let Some(i) = actions.iter().position(|[v, w]| !(v.is_finite() && w.is_finite())) {
            let [v, w] = actions[i];
            return refuse("actions", format!("({v}, {w}) for room {i}"), "finite numbers".to_owned());
        }
        if let Some(i) = self.courses.iter().position(|course| course.ended) {
            return refuse("step", format!("an ended episode in room {i}"), "a reset before it".to_owned());
        }
        Ok(())
    }

    /// True if a step hands work to other threads.
    pub fn needs_threads(&self) -> bool {
        self.rooms.len() > 1 || self.plan.senses_by_laser
    }

    /// Rooms.
    pub fn rooms(&self) -> &[ArenaRoom] {
        &self.rooms
    }

    /// The things that the rooms have in common.
    pub fn plan(&self) -> &RoomPlan {
        &self.plan
    }

    /// Room `i` from above, if there is one.
    pub fn picture(&self, i: usize) -> Option<Picture> {
        let (room, sim) = (self.rooms.get(i)?, &self.plan.config.sim);
        let body = Shape::Box { length: sim.robot.length, width: sim.robot.width };
        let pose = |p: &jostle_peds::Pedestrian| Pose { position: p.position, heading: p.heading };
        let (mut painter, robot) = (Painter::new(&self.plan.scenario), room.robot());
        painter.goal(robot.goal, sim.episode.goal_radius, ROBOT);
        for pedestrian in room.pedestrians() {
            painter.body(&body, pose(pedestrian), PEDESTRIAN);
        }
        painter.body(&body, pose(&robot), ROBOT);
        Some(painter.finish())
    }

    /// The least and the largest observation row.
    pub fn bounds(&self) -> [Vec<f32>; 2] {
        bounds(&self.plan.config.sim, &self.plan.scenario)
    }
}

/// The least and the largest observation row: scans within ±½, the goal nowhere farther than the
/// room's diagonal, and the robot's speeds.
pub fn bounds(sim: &jostle_sim::SimConfig, scenario: &Scenario) -> [Vec<f32>; 2] {
    let (min, max) = scenario.walls;
    let reach = min.distance(max);
    let (scans, robot) = (sim.observation_len() - jostle_sim::EXTRAS, &sim.robot);
    let row = |scan: f32, rest: [f32; 4]| [vec![scan; scans], rest.to_vec()].concat();
    [row(-0.5, [-reach, -reach, 0.0, -robot.w_max]), row(0.5, [reach, reach, robot.v_max, robot.w_max])]
}

impl Course {
    fn new(seed: u64, room: &ArenaRoom) -> Self {
        let (goal_distance, min_clearance) = (goal_distance(room), room.robot_clearance());
        Self { seed, goal_distance, min_clearance, ended: false, actions: Vec::new() }
    }

    /// Follows a step that the room has made with an action, and whose result is `end`.
    fn follow(
        &mut self,
        plan: &RoomPlan,
        room: &mut ArenaRoom,
        action: [f32; 2],
        end: Option<FinishedEpisode>,
    ) -> RoomStep {
        self.actions.push(action);
        let clearance = room.robot_clearance();
        self.min_clearance = self.min_clearance.min(clearance);
        let before = std::mem::replace(&mut self.goal_distance, goal_distance(room));
        let (sim, progress) = (&plan.config.sim, before - self.goal_distance);
        let outcome = end.as_ref().map(|end| end.outcome);
        let [_, w] = clip_action(action, &sim.robot);
        let mut worth = reward(&sim.reward, outcome, progress, w);
        if let Some(zones) = &sim.reward.safety_zone {
            let body = |p: &jostle_peds::Pedestrian| ZoneBody { position: p.position, velocity: p.velocity };
            let others = room.pedestrians().iter().map(body);
            worth += safety_zone(
                zones,
                room.robot_nearest(),
                sim.episode.crash_range,
                body(&room.robot()),
                others,
            );
        }
        if end.is_some() {
            room.observe_end(plan);
            self.ended = true;
        }
        let end = end.map(|finished| EpisodeEnd { finished, min_clearance: self.min_clearance });
        RoomStep { reward: worth, clearance, end }
    }
}

fn goal_distance(room: &ArenaRoom) -> f32 {
    let robot = room.robot();
    robot.position.distance(robot.goal)
}
