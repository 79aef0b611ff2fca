//! One test room: a robot (body 0) among pedestrians (bodies 1 …), for one episode.
//!
//! Reading order: [`ArenaRoom::new`] (spawn), [`ArenaRoom::step`] (a control period, in the order
//! of its calls); `live` (a room that someone changes while it runs), `elsewhere` (a room whose
//! robot another simulator moves).
//!
//! The robot may have mass (`sim.robot.dynamics`); pedestrians walk as they will, as people do.
//!
//! Every draw comes from a stream named by its purpose and by the episode's index, so that episode
//! k starts the same in every crowd, for every policy and at any lock step. What pedestrians draw
//! later (goals, re-spawns) has a stream for each pedestrian.

mod elsewhere;
mod live;

use glam::Vec2;
use jostle_peds::validation::Gait;
use jostle_peds::{Command, Crowd, CrowdKind, CrowdName, Pedestrian, RoomView, Visibility};
use jostle_sim::{
    CrashRule, Hit, Laser, Motion, Observer, Outcome, Pose, ScanSummary, Scenario, Sensor, Shape, SimConfig,
    SpawnConfig, Spawner, StepEnd, Stop, StreamRng, Streams, World, apply_limits, clip_action, maps, outcome,
};

use crate::config::{ArenaConfig, PedestrianCrash};
use crate::driving::{Driving, DrivingMeter, Neighbour};
use crate::error::ArenaError;
use crate::metrics::{EpisodeMetrics, MetricScale, distance};
use crate::recording::{Playback, Played, RecordingConfig};
use crate::robot::RobotView;

/// The robot's index among the bodies.
const ROBOT: usize = 0;

/// The things that all rooms of a cell have in common.
#[derive(Debug)]
pub struct RoomPlan {
    /// Settings.
    pub config: ArenaConfig,
    /// Name of the crowd.
    pub crowd: CrowdName,
    /// The bodies that its pedestrians see.
    pub visibility: Visibility,
    /// True if they sense by laser.
    pub senses_by_laser: bool,
    /// Walls and obstacles.
    pub scenario: Scenario,
    /// The places where starts and goals may be.
    pub spawner: Spawner,
    /// When the robot, and a pedestrian that goes by its scan, has crashed.
    pub crash_rule: CrashRule,
    /// Control period, goal radius and speed as the metrics take them.
    pub scale: MetricScale,
}

impl RoomPlan {
    /// The plan of a cell with a built-in crowd.
    ///
    /// # Errors
    ///
    /// Settings out of range; a map that cannot be read; a room without places for so many. What
    /// passes here never fails to find a start, a goal or a place for a re-spawn.
    pub fn new(config: &ArenaConfig, crowd: CrowdKind) -> Result<Self, ArenaError> {
        Self::with(config, crowd.into(), config.crowds.visibility.row(crowd), crowd.is_learned())
    }

    /// The plan of a cell with the given crowd, which may be of one's own: it says itself what its
    /// pedestrians see and whether they sense by laser.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn among(config: &ArenaConfig, crowd: &dyn Crowd) -> Result<Self, ArenaError> {
        Self::with(config, crowd.name(), crowd.visibility(), crowd.senses_by_laser())
    }

    fn with(
        config: &ArenaConfig,
        crowd: CrowdName,
        visibility: Visibility,
        senses_by_laser: bool,
    ) -> Result<Self, ArenaError> {
        config.validate()?;
        if crowd == CrowdKind::Recorded && config.recording.is_none() {
            let (found, expected) = ("none".to_owned(), "people to play back (crowd recorded)".to_owned());
            return Err(ArenaError::Setting { field: "recording", found, expected });
        }
        let scenario = match &config.scene {
            Some(scene) => scene.scenario(),
            None => maps::scenario(&config.sim.room)?,
        };
        let world = scenario.build()?;
        let spawner = Spawner::new(&spawn_settings(config), &world)?;
        match &config.scene {
            Some(scene) => scene.check_ways(&config.sim, &world, &spawner)?,
            // Recorded people are put where they were; only the robot needs a place.
            None if crowd == CrowdKind::Recorded => spawner.check_room(1)?,
            None => spawner.check_room(config.n_agents)?,
        }
        Ok(Self {
            config: config.clone(),
            crowd,
            visibility,
            senses_by_laser,
            scenario,
            spawner,
            crash_rule: CrashRule::new(&config.sim),
            scale: metric_scale(config),
        })
    }

    /// The people who are played back, where the crowd is recorded.
    fn recording(&self) -> Option<&RecordingConfig> {
        self.config.recording.as_ref().filter(|_| self.crowd == CrowdKind::Recorded)
    }

    /// Number of pedestrians that sense by laser.
    fn n_sensing(&self) -> usize {
        if self.senses_by_laser { self.config.n_pedestrians() } else { 0 }
    }

    /// A pedestrian's speed factor for an episode; 1 in a crowd of one's own.
    fn draw_speed_factor(&self, rng: &mut StreamRng) -> f32 {
        self.crowd.built_in().map_or(1.0, |kind| self.config.crowds.draw_speed_factor(kind, rng))
    }

    fn crash(&self) -> PedestrianCrash {
        self.config.crash_of(self.senses_by_laser)
    }
}

/// A scene places its bodies itself; what is added to it later may be put anywhere.
pub(crate) fn spawn_settings(config: &ArenaConfig) -> SimConfig {
    let mut sim = config.sim.clone();
    if config.scene.is_some() {
        let wall_clearance = sim.passing_radius();
        sim.spawn = SpawnConfig { goal_distance: 0.0, wall_clearance, ..sim.spawn };
    }
    sim
}

/// The settings as decimal numbers: 0.1, not the f32 nearest to it.
pub fn metric_scale(config: &ArenaConfig) -> MetricScale {
    let decimal = |value: f32| value.to_string().parse().expect("a printed number can be read");
    MetricScale {
        dt: decimal(config.sim.episode.dt),
        goal_radius: decimal(config.sim.episode.goal_radius),
        v_max: decimal(config.sim.robot.v_max),
    }
}

/// A finished episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinishedEpisode {
    /// Its index.
    pub episode: u64,
    /// Its outcome.
    pub outcome: Outcome,
    /// Steps until then.
    pub steps: u64,
    /// The robot's start.
    pub start: [f32; 2],
    /// Its goal.
    pub goal: [f32; 2],
    /// Time, way and extras.
    pub metrics: EpisodeMetrics,
    /// Nearness, smoothness, stalling.
    pub driving: Driving,
}

/// A room in one episode.
#[derive(Clone)]
pub struct ArenaRoom {
    episode: u64,
    world: World,
    laser: Laser,
    start: Pose,
    goal: Vec2,
    velocity: [f32; 2],
    pedestrians: Vec<Pedestrian>,
    /// The robot's, then those of the pedestrians that sense.
    observers: Vec<Observer>,
    /// One row per observer.
    observations: Vec<f32>,
    /// Drawn for the episode.
    speed_factor: Vec<f32>,
    /// Recorded people, and the moment of their recording.
    playback: Option<Playback>,
    /// In a scene: for each pedestrian the time from which on it stands whatever the crowd says
    /// (s), if there is one.
    stands_from: Vec<Option<f32>>,
    /// The gaits of pedestrians that walk and stand in turns, each with the stream of its draws.
    gaits: Vec<(Gait, StreamRng)>,
    /// The speed factors of the next step: 0 for those that stand.
    pace: Vec<f32>,
    streams: Vec<StreamRng>,
    ranges: Vec<f32>,
    summaries: Vec<ScanSummary>,
    motions: Vec<Motion>,
    /// The thing that stopped each body in the last step.
    stops: Vec<Option<Stop>>,
    respawned: Vec<bool>,
    steps: u32,
    path_length: f64,
    meter: DrivingMeter,
}

impl ArenaRoom {
    /// Spawns episode `episode`: the robot first, so that its start and goal do not depend on the
    /// number of pedestrians, then each pedestrian.
    ///
    /// # Errors
    ///
    /// Walls or obstacles that the world refuses.
    pub fn new(plan: &RoomPlan, laser: &Laser, episode: u64) -> Result<Self, ArenaError> {
        Self::seeded(plan, laser, plan.config.seed, episode)
    }

    /// As [`Self::new`], with a root seed of its own: for rooms that one trains in, whose episodes
    /// are not the test's.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn seeded(plan: &RoomPlan, laser: &Laser, seed: u64, episode: u64) -> Result<Self, ArenaError> {
        let (config, sim) = (&plan.config, &plan.config.sim);
        let streams = Streams::new(seed);
        let shape = Shape::Box { length: sim.robot.length, width: sim.robot.width };
        let mut world = plan.scenario.build()?;
        let mut spawn = streams.stream("eval.spawn", &[episode]);
        let mut goals = Vec::with_capacity(config.n_agents);
        let mut stands_from = Vec::new();
        let mut playback = None;
        if let Some(recording) = plan.recording() {
            let mut rng = streams.stream("eval.recording", &[episode]);
            let limit = sim.episode.step_limit;
            let mut played = Playback::new(recording, limit, sim.episode.dt, plan.scenario.walls, &mut rng);
            // The robot's place is drawn when the people are there.
            world.add_body(&shape, Pose::new(plan.scenario.walls.1 + 50.0, 0.0))?;
            let bodies: Vec<Played> =
                (0..config.n_pedestrians()).map(|slot| played.play(slot, 0, None)).collect();
            for body in &bodies {
                world.add_body(&shape, body.pose)?;
            }
            let (pose, goal) = plan.spawner.start_and_goal(&world, |body| body != ROBOT, &mut spawn);
            world.set_pose(ROBOT, pose);
            goals.push(goal);
            goals.extend(bodies.iter().map(|body| body.goal));
            playback = Some(played);
        } else if let Some(scene) = &config.scene {
            let placing = scene.place(sim, &world, &mut spawn);
            for pose in placing.poses {
                world.add_body(&shape, pose)?;
            }
            (goals, stands_from) = (placing.goals, placing.stands_from);
        } else {
            for _ in 0..config.n_agents {
                let (pose, goal) = plan.spawner.start_and_goal(&world, |_| true, &mut spawn);
                world.add_body(&shape, pose)?;
                goals.push(goal);
            }
        }
        if let Some(base) = sim.robot.dynamic_base() {
            world.set_base(ROBOT, &base)?;
        }
        let pedestrian = |body: usize| {
            let Pose { position, heading } = world.pose(body);
            Pedestrian { position, velocity: Vec2::ZERO, heading, goal: goals[body] }
        };
        let indexed = |name: &str, body: usize| streams.stream(name, &[episode, body as u64]);
        let n_observers = 1 + plan.n_sensing();
        let mut factors = streams.stream("eval.speed_factor", &[episode]);
        let draw = |_| plan.draw_speed_factor(&mut factors);
        let mut room = Self {
            episode,
            laser: laser.sibling(),
            start: world.pose(ROBOT),
            goal: goals[ROBOT],
            velocity: [0.0; 2],
            pedestrians: (1..config.n_agents).map(pedestrian).collect(),
            observers: (0..n_observers).map(|body| Observer::new(sim, indexed("eval.noise", body))).collect(),
            observations: vec![0.0; n_observers * sim.observation_len()],
            speed_factor: (1..config.n_agents).map(draw).collect(),
            stands_from,
            playback,
            gaits: Vec::new(),
            pace: Vec::new(),
            streams: (1..config.n_agents).map(|body| indexed("eval.pedestrian", body)).collect(),
            ranges: vec![0.0; config.n_agents * sim.laser.beams],
            summaries: vec![ScanSummary { min_range: 0.0, nearest: Hit::None }; config.n_agents],
            motions: vec![Motion::Still; config.n_agents],
            stops: vec![None; config.n_agents],
            respawned: vec![false; config.n_agents],
            steps: 0,
            path_length: 0.0,
            meter: DrivingMeter::new(plan.scale.dt),
            world,
        };
        for body in 1..config.n_agents {
            room.begin_gait(plan, indexed("eval.gait", body));
        }
        room.set_pace();
        for body in 0..n_observers {
            room.observe_first(plan, body);
        }
        Ok(room)
    }

    /// The episode's index.
    pub fn episode(&self) -> u64 {
        self.episode
    }

    /// The robot's observation.
    pub fn robot_observation(&self) -> &[f32] {
        &self.observations[..self.observations.len() / self.observers.len()]
    }

    /// The robot's last noise-free scan, one range a beam.
    pub fn robot_ranges(&self) -> &[f32] {
        &self.ranges[..self.ranges.len() / self.motions.len()]
    }

    /// Noise-free distance from the robot's centre to the nearest thing all round, which its crash
    /// is judged by (m); for a laser that sees all round, the least of [`Self::robot_ranges`].
    pub fn robot_nearest(&self) -> f32 {
        self.summaries[ROBOT].min_range
    }

    /// Linear and angular velocity that the robot executed in the last step; 0 before the first and
    /// where it was stopped. Of a robot that has mass, what it moves with at the step's end.
    pub fn robot_velocity(&self) -> [f32; 2] {
        self.velocity
    }

    /// The pedestrians as they stand; [`Self::is_present`] says of recorded ones whether they are
    /// in the room.
    pub fn pedestrians(&self) -> &[Pedestrian] {
        &self.pedestrians
    }

    /// True while a pedestrian is in the room. A recorded one that has not come yet or has gone
    /// waits beyond the walls.
    pub fn is_present(&self, pedestrian: usize) -> bool {
        self.playback.as_ref().is_none_or(|playback| playback.is_shown(pedestrian))
    }

    /// The pedestrians' speed factors, as drawn for the episode.
    pub fn speed_factors(&self) -> &[f32] {
        &self.speed_factor
    }

    /// The robot as others may see it.
    pub fn robot(&self) -> Pedestrian {
        let pose = self.world.pose(ROBOT);
        let velocity = pose.direction() * self.velocity[0];
        Pedestrian { position: pose.position, velocity, heading: pose.heading, goal: self.goal }
    }

    /// Distance from the robot's outline to the nearest pedestrian, obstacle or wall, m; 0 where it
    /// touches one.
    pub fn robot_clearance(&self) -> f32 {
        self.world.body_clearance(ROBOT)
    }

    /// Everything that the robot's driver can know.
    pub fn robot_view(&self) -> RobotView<'_> {
        RobotView { row: self.robot_observation(), robot: self.robot(), pedestrians: &self.pedestrians }
    }

    /// Everything that the crowd may know; `others` holds the robot where the visibility matrix
    /// lets it be seen, else nothing.
    pub fn view<'a>(&'a self, others: &'a [Pedestrian]) -> RoomView<'a> {
        RoomView {
            pedestrians: &self.pedestrians,
            others,
            observations: &self.observations[self.robot_observation().len()..],
            speed_factor: &self.pace,
        }
    }

    /// True if the scene makes a pedestrian stand by now.
    fn stands(&self, plan: &RoomPlan, pedestrian: usize) -> bool {
        let now = self.steps as f32 * plan.config.sim.episode.dt;
        self.stands_from.get(pedestrian).is_some_and(|from| from.is_some_and(|from| now >= from))
    }

    /// Gives the next pedestrian a gait, where the crowd has one.
    fn begin_gait(&mut self, plan: &RoomPlan, mut rng: StreamRng) {
        if plan.crowd == CrowdKind::StopAndGo {
            let gait = Gait::draw(&plan.config.crowds.walkers, plan.config.sim.episode.dt, &mut rng);
            self.gaits.push((gait, rng));
        }
    }

    /// The factors of the next step from the episode's and the gaits.
    fn set_pace(&mut self) {
        self.pace.clone_from(&self.speed_factor);
        for (factor, (gait, _)) in self.pace.iter_mut().zip(&self.gaits) {
            *factor = if gait.walks() { *factor } else { 0.0 };
        }
    }

    /// One control period of all gaits, whatever happened to their pedestrians.
    fn advance_gaits(&mut self, plan: &RoomPlan) {
        for (gait, rng) in &mut self.gaits {
            gait.advance(&plan.config.crowds.walkers, plan.config.sim.episode.dt, rng);
        }
        self.set_pace();
    }

    /// One control period: everyone moves and scans, the robot's end is looked for, everyone
    /// observes, and pedestrians that arrived or crashed get new goals and places. As in training,
    /// the others see a re-placed body from their next scan on. Returns the result once the episode
    /// has ended; the room is spent then.
    ///
    /// # Errors
    ///
    /// An action that is not finite.
    pub fn step(
        &mut self,
        plan: &RoomPlan,
        action: [f32; 2],
        walks: &[Command],
    ) -> Result<Option<FinishedEpisode>, ArenaError> {
        self.advance(plan, action, walks)?;
        self.scan_all(plan);
        if let Some(outcome) = self.outcome(plan) {
            return Ok(Some(self.finished(plan, outcome)));
        }
        self.renew_pedestrians(plan);
        self.observe(plan, ROBOT);
        self.observe_pedestrians(plan);
        Ok(None)
    }

    /// New goals and places for the pedestrians that need them, and the next step of all gaits.
    fn renew_pedestrians(&mut self, plan: &RoomPlan) {
        // Recorded people neither crash nor get new goals.
        let n_driven = if self.playback.is_some() { 1 } else { self.motions.len() };
        let crashed: Vec<bool> = (1..n_driven).map(|body| self.has_crashed(plan, body)).collect();
        for (i, crashed) in crashed.into_iter().enumerate() {
            self.renew_pedestrian(plan, i, crashed);
        }
        self.advance_gaits(plan);
    }

    /// The rows of the pedestrians that sense.
    fn observe_pedestrians(&mut self, plan: &RoomPlan) {
        for body in 1..self.observers.len() {
            self.observe(plan, body);
        }
        for body in 1..self.motions.len() {
            if std::mem::take(&mut self.respawned[body]) && body < self.observers.len() {
                self.observe_first(plan, body);
            }
        }
    }

    /// The robot's observation in the state that ended its episode, which a value after a cut-off
    /// may need. A test never does, so that [`Self::step`] leaves it out.
    pub fn observe_end(&mut self, plan: &RoomPlan) {
        self.observe(plan, ROBOT);
    }

    /// Moves all bodies, the robot first.
    fn advance(&mut self, plan: &RoomPlan, action: [f32; 2], walks: &[Command]) -> Result<(), ArenaError> {
        let sim = &plan.config.sim;
        let [v, w] = action;
        if !(v.is_finite() && w.is_finite()) {
            return Err(ArenaError::Action { episode: self.episode, step: self.steps, v, w });
        }
        let dt = sim.episode.dt;
        let command = clip_action(action, &sim.robot);
        let executed = apply_limits(self.velocity, command, sim.robot.acceleration.as_ref(), dt);
        self.motions[ROBOT] = Motion::Drive { v: executed[0], w: executed[1] };
        self.set_walks(plan, walks);
        let start = self.world.pose(ROBOT);
        let heading = start.direction();
        self.advance_bodies(dt);
        let commanded = if self.stops[ROBOT].is_some() { [0.0; 2] } else { executed };
        self.velocity = self.world.measured(ROBOT).unwrap_or(commanded);
        // Not the distance of the positions: in f32 their rounding adds up to 1e-5 m over an
        // episode, and the way would exceed what the speed allows. (A robot that has mass goes as
        // it goes.)
        self.path_length += if self.world.measured(ROBOT).is_some() {
            self.world.pose(ROBOT).position.as_dvec2().distance(start.position.as_dvec2())
        } else {
            f64::from(self.velocity[0].abs()) * plan.scale.dt
        };
        self.measure(plan, heading);
        Ok(())
    }

    /// What the crowd wants, but for those that stand by the scene's will.
    fn set_walks(&mut self, plan: &RoomPlan, walks: &[Command]) {
        for (motion, walk) in self.motions[1..].iter_mut().zip(walks) {
            *motion = match *walk {
                Command::Walk { velocity } => Motion::Walk { velocity },
                Command::Drive { v, w } => Motion::Drive { v, w },
            };
        }
        for i in 0..self.pedestrians.len() {
            if self.stands(plan, i) {
                self.motions[i + 1] = Motion::Still;
            }
        }
    }

    /// Executes the motions, and tells the pedestrians where they are then.
    fn advance_bodies(&mut self, dt: f32) {
        let directions: Vec<Vec2> =
            (1..self.motions.len()).map(|body| self.world.pose(body).direction()).collect();
        self.world.advance_to_stops(&self.motions, dt, &mut self.stops);
        self.steps += 1;
        for (i, pedestrian) in self.pedestrians.iter_mut().enumerate() {
            let pose = self.world.pose(i + 1);
            pedestrian.position = pose.position;
            pedestrian.heading = pose.heading;
            pedestrian.velocity = match self.motions[i + 1] {
                Motion::Walk { velocity } if self.stops[i + 1].is_none() => velocity,
                Motion::Drive { v, .. } if self.stops[i + 1].is_none() => directions[i] * v,
                _ => Vec2::ZERO,
            };
        }
        self.play_back();
    }

    /// Puts recorded people where they were at this step, whoever is in the way.
    fn play_back(&mut self) {
        let Some(playback) = &mut self.playback else { return };
        let robot = self.world.pose(ROBOT).position;
        for (slot, pedestrian) in self.pedestrians.iter_mut().enumerate() {
            let Played { pose, velocity, goal } = playback.play(slot, self.steps, Some(robot));
            self.world.set_pose(slot + 1, pose);
            let Pose { position, heading } = pose;
            *pedestrian = Pedestrian { position, velocity, heading, goal };
        }
    }

    /// Measures the step that was just made, along the heading that the robot had before it turned.
    fn measure(&mut self, plan: &RoomPlan, heading: Vec2) {
        let crash_range = plan.config.sim.episode.crash_range;
        let (world, robot) = (&self.world, self.world.pose(ROBOT));
        let velocity = heading.as_dvec2() * f64::from(self.velocity[0]);
        // From here on it drives where it heads now.
        let onwards = robot.direction().as_dvec2() * f64::from(self.velocity[0]);
        let playback = self.playback.as_ref();
        let is_present = |i: usize| playback.is_none_or(|playback| playback.is_shown(i));
        let present = self.pedestrians.iter().enumerate().filter(|(i, _)| is_present(*i));
        let neighbours = present.map(|(i, pedestrian)| Neighbour {
            clearance: f64::from(world.body_distance(ROBOT, i + 1)),
            position: pedestrian.position.as_dvec2() - robot.position.as_dvec2(),
            velocity: pedestrian.velocity.as_dvec2() - onwards,
            reach: f64::from(crash_range) + f64::from(world.shape(i + 1).least_half_width()),
        });
        self.meter.step(velocity, neighbours);
    }

    /// Noise-free scans of the robot and of those pedestrians whose scan is needed.
    fn scan_all(&mut self, plan: &RoomPlan) {
        self.scan(plan, ROBOT);
        self.scan_pedestrians(plan);
    }

    /// The scans of those pedestrians who need one.
    fn scan_pedestrians(&mut self, plan: &RoomPlan) {
        if plan.senses_by_laser || plan.crash() == PedestrianCrash::Scan {
            for body in 1..self.motions.len() {
                self.scan(plan, body);
            }
        }
    }

    fn scan(&mut self, plan: &RoomPlan, body: usize) {
        let beams = plan.config.sim.laser.beams;
        let Visibility { pedestrians, robot } = plan.visibility;
        let visible = |other| body == ROBOT || if other == ROBOT { robot } else { pedestrians };
        let ranges = &mut self.ranges[body * beams..(body + 1) * beams];
        self.summaries[body] = self.laser.scan(&self.world, Sensor::Body(body), visible, ranges);
    }

    /// Goal, then crash, then time limit.
    fn outcome(&self, plan: &RoomPlan) -> Option<Outcome> {
        let limits = &plan.config.sim.episode;
        let goal_distance = self.world.pose(ROBOT).position.distance(self.goal);
        let crash = plan.crash_rule.crash(self.summaries[ROBOT], &self.stops, ROBOT, |_| true);
        let reached = outcome(goal_distance, limits.goal_radius, crash);
        StepEnd::new(reached, self.steps, limits.step_limit).outcome()
    }

    fn finished(&self, plan: &RoomPlan, outcome: Outcome) -> FinishedEpisode {
        let (start, goal) = (self.start.position.to_array(), self.goal.to_array());
        let straight = distance(start.map(f64::from), goal.map(f64::from));
        let steps = u64::from(self.steps);
        FinishedEpisode {
            episode: self.episode,
            outcome,
            steps,
            start,
            goal,
            metrics: EpisodeMetrics::from_totals(&plan.scale, outcome, steps, self.path_length, straight),
            driving: self.meter.driving(),
        }
    }

    /// A new goal for a pedestrian that arrived, a new place and goal for one that crashed.
    fn renew_pedestrian(&mut self, plan: &RoomPlan, i: usize, crashed: bool) {
        let body = i + 1;
        let position = self.pedestrians[i].position;
        let arrived = position.distance(self.pedestrians[i].goal) < plan.config.sim.episode.goal_radius;
        if !(crashed || arrived) || self.stands(plan, i) {
            return;
        }
        let (sim, clearance) = (&plan.config.sim, plan.config.respawn_clearance);
        let (world, rng) = (&self.world, &mut self.streams[i]);
        let scene = plan.config.scene.as_ref();
        if crashed {
            let others =
                || (0..world.n_bodies()).filter(|other| *other != body).map(|other| world.pose(other));
            let restart = scene.and_then(|s| s.restart(i, others().collect(), clearance, sim, world, rng));
            let (pose, goal) =
                restart.unwrap_or_else(|| plan.spawner.respawn(world, |other| other != body, clearance, rng));
            self.world.set_pose(body, pose);
            let pedestrian = &mut self.pedestrians[i];
            (pedestrian.position, pedestrian.heading) = (pose.position, pose.heading);
            pedestrian.goal = goal;
            pedestrian.velocity = Vec2::ZERO;
            self.motions[body] = Motion::Still;
            self.respawned[body] = true;
        } else {
            let goal = scene.and_then(|scene| scene.next_goal(i, position, sim, world, rng));
            self.pedestrians[i].goal = goal.unwrap_or_else(|| plan.spawner.goal(world, position, rng));
        }
    }

    /// True if a pedestrian ran into a wall, an obstacle or another pedestrian. The robot does not
    /// count, and one that stands by the scene's will runs into nobody.
    fn has_crashed(&mut self, plan: &RoomPlan, body: usize) -> bool {
        // Who stands is run into by others.
        if self.stands(plan, body - 1) {
            return false;
        }
        match plan.crash() {
            PedestrianCrash::Contact => self.stops[body].is_some() && !self.touches_robot_alone(plan, body),
            PedestrianCrash::Scan if self.has_touched(plan, body) => true,
            PedestrianCrash::Scan => {
                let limit = plan.config.sim.episode.crash_range;
                let seen = self.summaries[body];
                if plan.visibility.pedestrians && seen.nearest != Hit::Body(ROBOT) {
                    return seen.min_range < limit;
                }
                if plan.visibility.pedestrians && seen.min_range >= limit {
                    return false;
                }
                let beams = plan.config.sim.laser.beams;
                let mut ranges = vec![0.0; beams];
                let without_robot = |other| other != ROBOT;
                self.laser.scan(&self.world, Sensor::Body(body), without_robot, &mut ranges).min_range < limit
            }
        }
    }

    /// True if a pedestrian that goes by its scan was stopped by something which no scan is certain
    /// to show.
    fn has_touched(&self, plan: &RoomPlan, body: usize) -> bool {
        plan.crash_rule.bodies_touch()
            && match self.stops[body] {
                Some(Stop::Wall | Stop::Obstacle(_)) => true,
                Some(Stop::Body(other)) => other != ROBOT && plan.visibility.pedestrians,
                Some(Stop::Command) | None => false,
            }
    }

    /// True if the robot may be what stopped a body: it is near, and nothing else is within reach
    /// of one step.
    fn touches_robot_alone(&self, plan: &RoomPlan, body: usize) -> bool {
        let reach = 2.0 * self.world.shape(body).circumradius() + step_length(self.motions[body], plan);
        let position = self.world.pose(body).position;
        let near = |other: usize| self.world.pose(other).position.distance(position) <= reach;
        let others = (1..self.motions.len()).filter(|other| *other != body);
        near(ROBOT) && !others.into_iter().any(near) && self.world.clearance(position) > reach / 2.0
    }

    /// The next row of an observer, from the scan that was taken.
    fn observe(&mut self, plan: &RoomPlan, body: usize) {
        self.write_row(plan, body, Observer::push);
    }

    /// The first row of an observer, from a scan of its own.
    fn observe_first(&mut self, plan: &RoomPlan, body: usize) {
        self.scan(plan, body);
        self.write_row(plan, body, Observer::begin);
    }

    fn write_row(&mut self, plan: &RoomPlan, body: usize, frame: fn(&mut Observer, &[f32], &mut [f32])) {
        let (beams, row_len) = (plan.config.sim.laser.beams, plan.config.sim.observation_len());
        let row = &mut self.observations[body * row_len..(body + 1) * row_len];
        frame(&mut self.observers[body], &self.ranges[body * beams..(body + 1) * beams], row);
        self.write_motion(plan, body);
    }

    /// Goal and velocity of an observer's row.
    fn write_motion(&mut self, plan: &RoomPlan, body: usize) {
        let row_len = plan.config.sim.observation_len();
        let row = &mut self.observations[body * row_len..(body + 1) * row_len];
        let (goal, velocity) = if body == ROBOT {
            // What its odometry measures: of a robot that has mass, not what it was told.
            (self.goal, self.velocity)
        } else {
            let velocity = match self.motions[body] {
                Motion::Drive { v, w } if self.stops[body].is_none() => [v, w],
                _ => [0.0; 2],
            };
            (self.pedestrians[body - 1].goal, velocity)
        };
        self.observers[body].write_motion(self.world.pose(body), goal, velocity, row);
    }
}

fn step_length(motion: Motion, plan: &RoomPlan) -> f32 {
    let dt = plan.config.sim.episode.dt;
    match motion {
        Motion::Still => 0.0,
        Motion::Drive { v, .. } => v.abs() * dt,
        Motion::Walk { velocity } => velocity.length() * dt,
    }
}
