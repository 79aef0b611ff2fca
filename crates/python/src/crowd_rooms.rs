//! Rooms to train in: one robot among a crowd in each, with the reward of the decision process.
//!
//! They are the rooms of the test (`jostle_eval::room`), one episode after another. What the test does not need is added here:
//! the reward, which is that of `jostle-sim`, and the observation in which an episode ends.

use jostle_eval::lock_step::Walks;
use jostle_eval::room::{EvalRoom, FinishedEpisode, RoomPlan};
use jostle_eval::{EpisodeOutcome, EvalError, Protocol};
use jostle_peds::{Crowd, Motion};
use jostle_sim::{Laser, Outcome, Scenario, Streams, ZoneBody, clip_action, reward, safety_zone};
use rand::Rng as _;
use rayon::prelude::*;

use crate::settings::Settings;

/// What one step gave one room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomStep {
    /// The environment's reward.
    pub reward: f32,
    /// The episode, where it ended.
    pub end: Option<FinishedEpisode>,
}

/// The episodes of one room.
#[derive(Clone, Copy, Debug)]
struct Course {
    /// Root seed of this and the next episodes.
    seed: u64,
    goal_distance: f32,
    ended: bool,
}

/// R rooms with one robot each.
///
/// # Shapes
///
/// Actions `[R]` of (v, ω).
pub struct CrowdRooms {
    plan: RoomPlan,
    crowd: Box<dyn Crowd>,
    laser: Laser,
    walks: Walks,
    rooms: Vec<EvalRoom>,
    courses: Vec<Course>,
}

/// The root seed of the episodes that one trains in with a seed. It differs from the seed itself, so that nobody trains in
/// the episodes of a test of the same seed without meaning to.
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
            .map(|seed| EvalRoom::seeded(&plan, &laser, seed, 0))
            .collect::<Result<Vec<_>, _>>()?;
        let courses = seeds.zip(&rooms).map(|(seed, room)| Course::new(seed, room)).collect();
        Ok(Self { plan, crowd, laser, walks: Walks::default(), rooms, courses })
    }

    /// Starts an episode of a root seed in room `i`; the next ones follow it.
    ///
    /// # Errors
    ///
    /// If the room is too full for another body.
    pub fn begin(&mut self, i: usize, seed: u64, episode: u64) -> Result<(), EvalError> {
        self.rooms[i] = EvalRoom::seeded(&self.plan, &self.laser, seed, episode)?;
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

    /// One control period of every room; rooms whose episode ends have to be begun anew before the next. What the robots
    /// see then, also at an episode's end, is in [`Self::rooms`].
    ///
    /// # Errors
    ///
    /// Actions that are not finite and rooms whose episode has ended are refused before anything moves.
    pub fn step(&mut self, actions: &[[f32; 2]]) -> Result<Vec<RoomStep>, EvalError> {
        self.check(actions)?;
        self.walks.decide(&self.plan, &mut *self.crowd, &self.rooms)?;
        let (plan, walks) = (&self.plan, &self.walks);
        let one = |(i, (room, course)): (usize, (&mut EvalRoom, &mut Course))| {
            course.step(plan, room, actions[i], walks.of(i))
        };
        if self.rooms.len() == 1 {
            // One room: no need to wake another thread.
            return self.rooms.iter_mut().zip(&mut self.courses).enumerate().map(one).collect();
        }
        self.rooms.par_iter_mut().zip(&mut self.courses).enumerate().map(one).collect()
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

    /// Whether a step hands work to other threads.
    pub fn needs_threads(&self) -> bool {
        self.rooms.len() > 1 || self.plan.senses_by_laser
    }

    /// Rooms.
    pub fn rooms(&self) -> &[EvalRoom] {
        &self.rooms
    }

    /// What the rooms have in common.
    pub fn plan(&self) -> &RoomPlan {
        &self.plan
    }

    /// The least and the largest observation row.
    pub fn bounds(&self) -> [Vec<f32>; 2] {
        bounds(&self.plan.config.sim, &self.plan.scenario)
    }
}

/// The least and the largest observation row: scans within ±½, the goal nowhere farther than the room's diagonal, and
/// the robot's speeds.
pub fn bounds(sim: &jostle_sim::SimConfig, scenario: &Scenario) -> [Vec<f32>; 2] {
    let (min, max) = scenario.walls;
    let reach = min.distance(max);
    let (scans, robot) = (sim.observation_len() - jostle_sim::EXTRAS, &sim.robot);
    let row = |scan: f32, rest: [f32; 4]| [vec![scan; scans], rest.to_vec()].concat();
    [row(-0.5, [-reach, -reach, 0.0, -robot.w_max]), row(0.5, [reach, reach, robot.v_max, robot.w_max])]
}

impl Course {
    fn new(seed: u64, room: &EvalRoom) -> Self {
        Self { seed, goal_distance: goal_distance(room), ended: false }
    }

    fn step(
        &mut self,
        plan: &RoomPlan,
        room: &mut EvalRoom,
        action: [f32; 2],
        walks: &[Motion],
    ) -> Result<RoomStep, EvalError> {
        let end = room.step(plan, action, walks)?;
        let before = std::mem::replace(&mut self.goal_distance, goal_distance(room));
        let (sim, progress) = (&plan.config.sim, before - self.goal_distance);
        let outcome = end.as_ref().and_then(|end| match end.outcome {
            EpisodeOutcome::Success => Some(Outcome::Success),
            EpisodeOutcome::CollisionWall => Some(Outcome::CollisionWall),
            EpisodeOutcome::CollisionPedestrian => Some(Outcome::CollisionAgent),
            EpisodeOutcome::Timeout => None,
        });
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
        Ok(RoomStep { reward: worth, end })
    }
}

fn goal_distance(room: &EvalRoom) -> f32 {
    let robot = room.robot();
    robot.position.distance(robot.goal)
}
