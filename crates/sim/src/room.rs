//! One room of the decision process: N robots, each with its own episode, in one world.
//!
//! A step: clip the actions, move the robots one after the other, scan, reward; then those whose
//! episode ended are placed anew, in index order, and take their first scan. A training crowd may
//! change the room before that (`renewal`). The others see a re-placed robot from their next scan
//! on.

use crate::config::{SimConfig, SpawnConfig};
use crate::crash::{CrashRule, crash};
use crate::episode::{EpisodeSummary, Outcome, StepEnd, Transition};
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::laser::{Laser, ScanSummary, Sensor};
use crate::motion::{Motion, apply_limits, clip_action};
use crate::observation::Observer;
use crate::renewal::{Plan, Renewal};
use crate::reward::{ZoneBody, outcome, reward, safety_zone};
use crate::rng::{StreamRng, Streams};
use crate::spawn::Spawner;
use crate::traits::{Role, TrainingCrowd, Traits};
use crate::world::{Stop, World};
use glam::Vec2;
use rand::RngExt;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The running episode of one robot: all of its state but pose, observation row and token.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Episode {
    pub(crate) goal: Vec2,
    pub(crate) velocity: [f32; 2],
    pub(crate) goal_distance: f32,
    pub(crate) straight_distance: f32,
    pub(crate) steps: u32,
    pub(crate) path_length: f64,
    pub(crate) reward_sum: f64,
}

/// One robot's random streams and observer.
#[derive(Clone)]
pub(crate) struct Agent {
    pub(crate) observer: Observer,
    pub(crate) spawn: StreamRng,
    pub(crate) token: StreamRng,
    /// Draws of the agent's role in its next episodes.
    pub(crate) crowd: StreamRng,
}

/// The slices of the batch's buffers that belong to one room.
pub(crate) struct RoomBuffers<'a> {
    pub(crate) observations: &'a mut [f32],
    pub(crate) finals: &'a mut [f32],
    pub(crate) tokens: &'a mut [u32],
    pub(crate) transitions: &'a mut [Transition],
}

/// A robot's place in its episode: for onlookers, no policy sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Whereabouts {
    /// Its pose.
    pub pose: Pose,
    /// Its goal in the world, m.
    pub goal: Vec2,
    /// Distance from its outline to the nearest robot, obstacle or wall, m.
    pub clearance: f32,
}

#[derive(Clone)]
pub(crate) struct Room {
    config: Arc<SimConfig>,
    crowd: Arc<TrainingCrowd>,
    pub(crate) plan: Arc<Plan>,
    /// Only where the crowd changes the room.
    pub(crate) renewal: Option<Renewal>,
    n_behaviours: u32,
    pub(crate) world: World,
    spawner: Spawner,
    crash_rule: CrashRule,
    laser: Laser,
    pub(crate) agents: Vec<Agent>,
    pub(crate) episodes: Vec<Episode>,
    pub(crate) traits: Vec<Traits>,
    motions: Vec<Motion>,
    stops: Vec<Option<Stop>>,
    /// Robots that were taken out of the room, or have left it for a while.
    pub(crate) absent: Vec<bool>,
    /// Robots that begin an episode, or leave the room, in the present step.
    begins: Vec<bool>,
    ranges: Vec<f32>,
    /// Each robot's place when its last episode ended.
    ends: Vec<Whereabouts>,
}

impl Room {
    /// A room whose robots are not placed yet: [`Room::begin`] or a restored state does that.
    pub(crate) fn new(
        (config, crowd): (&Arc<SimConfig>, &Arc<TrainingCrowd>),
        plan: &Arc<Plan>,
        laser: &Laser,
        n_agents: usize,
        n_behaviours: u32,
        streams: Streams,
        room: u64,
    ) -> Result<Self, SimError> {
        let mut world = plan.scenario.build()?;
        let body = body_shape(config, 1.0);
        let agent = |agent: u64| Agent {
            observer: Observer::new(config, streams.stream("noise", &[room, agent])),
            spawn: streams.stream("spawn", &[room, agent]),
            token: streams.stream("token", &[room, agent]),
            crowd: streams.stream("training_crowd", &[room, agent]),
        };
        for agent in 0..n_agents {
            world.add_body(&body, Pose::default())?;
            if let Some(base) = config.robot.dynamic_base() {
                world.set_base(agent, &base)?;
            }
        }
        Ok(Self {
            config: Arc::clone(config),
            crowd: Arc::clone(crowd),
            plan: Arc::clone(plan),
            renewal: crowd
                .renews()
                .then(|| Renewal::new(n_agents, streams.stream("training_crowd.room", &[room]))),
            n_behaviours,
            world,
            spawner: plan.spawner.clone(),
            crash_rule: CrashRule::new(config),
            laser: laser.sibling(),
            agents: (0..n_agents as u64).map(agent).collect(),
            episodes: vec![Episode::default(); n_agents],
            traits: vec![Traits::default(); n_agents],
            motions: vec![Motion::Still; n_agents],
            stops: vec![None; n_agents],
            absent: vec![false; n_agents],
            begins: vec![false; n_agents],
            ranges: vec![0.0; config.laser.beams],
            ends: vec![Whereabouts::default(); n_agents],
        })
    }

    /// Places all robots and writes their first observations.
    pub(crate) fn begin(&mut self, buffers: &mut RoomBuffers<'_>) {
        if let Some(mut renewal) = self.renewal.take() {
            let furnished = renewal.draw(&self.plan, &self.crowd, &[], &[]);
            renewal.stagger(&self.crowd);
            self.renewal = Some(renewal);
            self.move_into(furnished);
        }
        for agent in 0..self.agents.len() {
            self.place_or_leave(agent, agent, buffers.tokens);
        }
        for agent in 0..self.agents.len() {
            self.observe_first(agent, buffers.observations);
        }
    }

    /// One control period.
    pub(crate) fn step(&mut self, actions: &[[f32; 2]], buffers: &mut RoomBuffers<'_>) {
        self.drive(actions, buffers.transitions);
        let n_agents = self.agents.len();
        for agent in 0..n_agents {
            if self.absent[agent] {
                let role = self.traits[agent].role;
                buffers.transitions[agent] = Transition { role, ..Transition::default() };
            } else {
                self.judge(agent, buffers);
            }
        }
        self.renew();
        for agent in 0..n_agents {
            let returns = self.traits[agent].role == Role::Absent && agent < self.n_present();
            self.begins[agent] = !buffers.transitions[agent].end.is_running() || returns;
        }
        for agent in 0..n_agents {
            if self.begins[agent] {
                self.place_or_leave(agent, n_agents, buffers.tokens);
            }
        }
        for agent in 0..n_agents {
            if self.begins[agent] {
                self.observe_first(agent, buffers.observations);
            }
        }
    }

    /// Number of agents that are to be in the room.
    fn n_present(&self) -> usize {
        self.renewal.as_ref().map_or(self.agents.len(), |renewal| renewal.n_present)
    }

    /// Draws obstacles and number of agents anew where that is due.
    fn renew(&mut self) {
        let Some(mut renewal) = self.renewal.take() else { return };
        renewal.steps_left -= 1;
        if renewal.steps_left == 0 {
            let SpawnConfig { body_clearance, wall_clearance, .. } = self.plan.roomy.spawn;
            let present = || (0..self.agents.len()).filter(|agent| !self.absent[*agent]);
            let place = |agent: usize| self.world.pose(agent).position;
            // Twice what a start keeps: nobody is to be hit by an obstacle that falls from the sky.
            let bodies = present().map(|agent| (place(agent), 2.0 * body_clearance));
            let goals = present().map(|agent| (self.episodes[agent].goal, wall_clearance));
            let in_the_way: Vec<(Vec2, f32)> = bodies.chain(goals).collect();
            let ways: Vec<(Vec2, Vec2)> =
                present().map(|agent| (place(agent), self.episodes[agent].goal)).collect();
            let furnished = renewal.draw(&self.plan, &self.crowd, &in_the_way, &ways);
            self.move_into(furnished);
        }
        self.renewal = Some(renewal);
    }

    /// Takes all bodies over into a room that is furnished in another way.
    pub(crate) fn move_into(&mut self, (world, spawner): (World, Spawner)) {
        let old = std::mem::replace(&mut self.world, world);
        for agent in 0..old.n_bodies() {
            let copied = self.world.add_body(old.shape(agent), old.pose(agent));
            copied.expect("a body of the one world is a body of the other");
            if let (Some(base), Some(state)) = (self.config.robot.dynamic_base(), old.drive_state(agent)) {
                self.world.set_base(agent, &base).expect("the base was checked with the configuration");
                self.world.set_drive_state(agent, state.clone());
            }
        }
        self.spawner = spawner;
    }

    /// Begins an agent's next episode, or has it leave a room that is to have fewer agents.
    fn place_or_leave(&mut self, agent: usize, n_placed: usize, tokens: &mut [u32]) {
        if agent < self.n_present() {
            self.place(agent, n_placed, tokens);
        } else {
            self.remove(agent);
            self.traits[agent] = Traits { role: Role::Absent, ..Traits::default() };
            self.resize(agent);
        }
    }

    /// Puts a robot beyond the walls, each at a place of its own: no beam and no body gets there.
    pub(crate) fn remove(&mut self, agent: usize) {
        let (min, max) = self.world.walls().expect("a room has walls");
        let body = &self.config.robot;
        let apart = 2.0 * (body.length + body.width) * (agent + 1) as f32;
        self.world.set_pose(agent, Pose::new(max + (max - min) + apart, 0.0));
        self.absent[agent] = true;
    }

    /// Clips, limits and executes the actions; velocities are what then holds, (0, 0) for a stalled
    /// robot.
    fn drive(&mut self, actions: &[[f32; 2]], transitions: &mut [Transition]) {
        let (robot, dt) = (&self.config.robot, self.config.episode.dt);
        let limits = robot.acceleration.as_ref();
        for (agent, action) in actions.iter().enumerate() {
            let traits = &mut self.traits[agent];
            let executed = if traits.role.has_policy() {
                clip_action(*action, robot)
            } else {
                let way = (self.world.pose(agent), self.episodes[agent].goal);
                traits.walk(&self.crowd, way, robot, dt, &mut self.agents[agent].crowd)
            };
            let command = traits.command(executed);
            let [v, w] = apply_limits(self.episodes[agent].velocity, command, limits, dt);
            transitions[agent].executed = executed;
            self.episodes[agent].velocity = [v, w];
            self.motions[agent] = if self.absent[agent] { Motion::Still } else { Motion::Drive { v, w } };
        }
        self.world.advance_to_stops(&self.motions, dt, &mut self.stops);
        for (agent, ((episode, traits), stop)) in
            self.episodes.iter_mut().zip(&mut self.traits).zip(&self.stops).enumerate()
        {
            traits.count_stall(stop.is_some());
            if let Some(measured) = self.world.measured(agent) {
                episode.velocity = measured;
            } else if stop.is_some() {
                episode.velocity = [0.0, 0.0];
            }
            let [v, _] = episode.velocity;
            episode.path_length += f64::from(v.abs() * dt);
        }
    }

    /// Scan and observation of an agent that a policy drives, after the move.
    fn observe(&mut self, agent: usize, row: &mut [f32]) -> ScanSummary {
        let role = self.traits[agent].role;
        let scan =
            self.laser.scan(&self.world, Sensor::Body(agent), |_| role.sees_agents(), &mut self.ranges);
        let (episode, observer) = (&self.episodes[agent], &mut self.agents[agent].observer);
        observer.push(&self.ranges, row);
        observer.write_motion(self.world.pose(agent), episode.goal, episode.velocity, row);
        scan
    }

    /// The crash of a member of the training crowd that has been stopped for too long.
    fn stopped(&self, agent: usize) -> Option<Outcome> {
        if self.traits[agent].stalled_steps < self.crowd.stall_limit {
            return None;
        }
        // Further from walls and obstacles than a step and half its body it can have met bodies
        // only.
        let step = self.traits[agent].speed * self.config.robot.v_max * self.config.episode.dt;
        let reach = self.world.shape(agent).circumradius() + step;
        let at_wall = self.world.clearance(self.world.pose(agent).position) <= reach;
        Some(if at_wall { Outcome::CollisionWall } else { Outcome::CollisionPedestrian })
    }

    /// Scan, observation, outcome and reward of one robot after the move.
    fn judge(&mut self, agent: usize, buffers: &mut RoomBuffers<'_>) {
        let width = self.config.observation_len();
        let row = &mut buffers.observations[agent * width..][..width];
        let role = self.traits[agent].role;
        let scan = role.has_policy().then(|| self.observe(agent, row));
        let episode = self.episodes[agent];
        let goal_distance = self.world.pose(agent).position.distance(episode.goal);
        let limits = &self.config.episode;
        // A member of the crowd that has been stopped has a rule of its own.
        let rule = |scan| {
            if role.learns() {
                self.crash_rule.crash(scan, &self.stops, agent, |_| true)
            } else {
                crash(scan, limits.crash_range)
            }
        };
        let crashed = scan.and_then(rule).or_else(|| self.stopped(agent));
        let mut ended = outcome(goal_distance, limits.goal_radius, crashed);
        let w = buffers.transitions[agent].executed[1];
        let mut worth = reward(&self.config.reward, ended, episode.goal_distance - goal_distance, w);
        if let (Some(zones), Some(scan)) = (&self.config.reward.safety_zone, scan) {
            let others = (0..self.agents.len()).filter(|i| *i != agent).map(|i| self.zone_body(i));
            worth += safety_zone(zones, scan.min_range, limits.crash_range, self.zone_body(agent), others);
        }
        assert!(worth.is_finite() && row[width - 4..].iter().all(|x| x.is_finite()), "a finite observation");

        let mut goal_distance = goal_distance;
        if !role.learns() && self.walks_on(agent, ended) {
            ended = None;
            goal_distance = self.renew_goal(agent);
        }
        let (limits, episode) = (&self.config.episode, &mut self.episodes[agent]);
        episode.goal_distance = goal_distance;
        episode.steps += 1;
        episode.reward_sum += f64::from(worth);
        let end = StepEnd::new(ended, episode.steps, limits.step_limit);
        let transition = &mut buffers.transitions[agent];
        (transition.reward, transition.end, transition.episode) = (worth, end, None);
        transition.role = role;
        if !end.is_running() {
            transition.episode = Some(summary(episode, buffers.tokens[agent]));
            self.ends[agent] = self.whereabouts(agent);
            buffers.finals[agent * width..][..width].copy_from_slice(row);
        }
    }

    /// True if a member of the crowd goes on to another goal: it has arrived, or has changed its
    /// mind.
    fn walks_on(&mut self, agent: usize, ended: Option<Outcome>) -> bool {
        let (crowd, rng) = (&self.crowd, &mut self.agents[agent].crowd);
        match ended {
            Some(Outcome::Success) => crowd.walk_on,
            Some(_) => false,
            None => crowd.changes_goal(self.config.episode.dt, rng),
        }
    }

    /// Gives a member a new goal from where it is and lets it face it at once where the crowd does;
    /// returns the distance to the goal.
    fn renew_goal(&mut self, agent: usize) -> f32 {
        let pose = self.world.pose(agent);
        let goal = self.spawner.goal(&self.world, pose.position, &mut self.agents[agent].crowd);
        self.episodes[agent].goal = goal;
        if self.crowd.turn_at_once {
            let to_goal = goal - pose.position;
            self.world.set_pose(agent, Pose::new(pose.position, libm::atan2f(to_goal.y, to_goal.x)));
            if self.world.is_blocked(agent) {
                self.world.set_pose(agent, pose);
            }
        }
        pose.position.distance(goal)
    }

    /// Starts a new episode for one robot: what it is, start, goal and token. The first `n_placed`
    /// bodies but itself are in the way.
    fn place(&mut self, agent: usize, n_placed: usize, tokens: &mut [u32]) {
        let streams = &mut self.agents[agent];
        if agent > 0 && !self.crowd.is_off() {
            self.traits[agent] = self.crowd.draw(&mut streams.crowd);
        }
        self.resize(agent);
        self.absent[agent] = false;
        let streams = &mut self.agents[agent];
        let in_the_way = |body: usize| body != agent && body < n_placed;
        let (start, goal) = self.spawner.start_and_goal(&self.world, in_the_way, &mut streams.spawn);
        let goal_distance = start.position.distance(goal);
        self.world.set_pose(agent, start);
        self.episodes[agent] =
            Episode { goal, goal_distance, straight_distance: goal_distance, ..Episode::default() };
        tokens[agent] = streams.token.random_range(0..self.n_behaviours);
    }

    /// Gives an agent's body the size of its traits, where bodies differ in size.
    pub(crate) fn resize(&mut self, agent: usize) {
        if !self.crowd.resizes() {
            return;
        }
        let shape = body_shape(&self.config, self.traits[agent].size);
        self.world.set_shape(agent, &shape).expect("sizes were checked with the configuration");
    }

    fn observe_first(&mut self, agent: usize, observations: &mut [f32]) {
        let width = self.config.observation_len();
        let row = &mut observations[agent * width..][..width];
        let role = self.traits[agent].role;
        if !role.has_policy() {
            return;
        }
        self.laser.scan(&self.world, Sensor::Body(agent), |_| role.sees_agents(), &mut self.ranges);
        let (episode, observer) = (&self.episodes[agent], &mut self.agents[agent].observer);
        observer.begin(&self.ranges, row);
        observer.write_motion(self.world.pose(agent), episode.goal, episode.velocity, row);
    }

    /// A robot's place now.
    pub(crate) fn whereabouts(&self, agent: usize) -> Whereabouts {
        let (pose, goal) = (self.world.pose(agent), self.episodes[agent].goal);
        Whereabouts { pose, goal, clearance: self.world.body_clearance(agent) }
    }

    /// A robot's place when its last episode ended.
    pub(crate) fn end(&self, agent: usize) -> Whereabouts {
        self.ends[agent]
    }

    fn zone_body(&self, agent: usize) -> ZoneBody {
        let pose = self.world.pose(agent);
        ZoneBody { position: pose.position, velocity: pose.direction() * self.episodes[agent].velocity[0] }
    }
}

/// The body of a robot, or of a member of the crowd that is so many times as long and as wide.
fn body_shape(config: &SimConfig, size: f32) -> Shape {
    Shape::Box { length: config.robot.length * size, width: config.robot.width * size }
}

fn summary(episode: &Episode, token: u32) -> EpisodeSummary {
    EpisodeSummary {
        steps: episode.steps,
        path_length: episode.path_length,
        straight_distance: episode.straight_distance,
        episode_return: episode.reward_sum,
        token,
    }
}
