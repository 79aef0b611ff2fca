//! Many rooms at once: the vectorised decision process that the learner uses.
//!
//! Rooms share nothing, so they step in parallel and the number of threads cannot change a bit.
//! Agent `a` of room `r` has the index r·N + a everywhere.

use crate::config::SimConfig;
use crate::episode::Transition;
use crate::error::SimError;
use crate::laser::Laser;
use crate::renewal::Plan;
use crate::rng::Streams;
use crate::room::{Room, RoomBuffers, Whereabouts};
use crate::traits::{Role, TrainingCrowd};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// R rooms of N agents.
///
/// # Shapes
///
/// Observations are `[R·N, observation_len]`, row-major; tokens and transitions `[R·N]`.
///
/// # Examples
///
/// ```
/// use jostle_sim::{Rooms, SimConfig, Streams};
/// let mut rooms = Rooms::new(&SimConfig::default(), 2, 5, 1, &Streams::new(0))?;
/// rooms.step(&[[1.0, 0.0]; 10]);
/// assert_eq!(rooms.observations().len(), 10 * 1540);
/// assert!(rooms.transitions().iter().all(|t| t.executed == [1.0, 0.0]));
/// # Ok::<(), jostle_sim::SimError>(())
/// ```
#[allow(clippy::struct_field_names, reason = "the rooms of `Rooms`")]
#[derive(Clone)]
pub struct Rooms {
    pub(crate) config: Arc<SimConfig>,
    pub(crate) crowd: Arc<TrainingCrowd>,
    pub(crate) streams: Streams,
    /// Number of the first room among all of the run.
    pub(crate) first: usize,
    pub(crate) n_agents: usize,
    pub(crate) n_behaviours: u32,
    pub(crate) rooms: Vec<Room>,
    pub(crate) observations: Vec<f32>,
    pub(crate) finals: Vec<f32>,
    pub(crate) tokens: Vec<u32>,
    pub(crate) transitions: Vec<Transition>,
}

impl Rooms {
    /// Makes the rooms and starts every agent's first episode. Agent (r, a) draws from the streams
    /// "spawn", "token" and "noise" with the indices [r, a].
    ///
    /// # Errors
    ///
    /// When the configuration is refused, a count is 0, or the room is too small for that many
    /// agents.
    pub fn new(
        config: &SimConfig,
        n_rooms: usize,
        n_agents: usize,
        n_behaviours: u32,
        streams: &Streams,
    ) -> Result<Self, SimError> {
        Self::with_crowd(config, &TrainingCrowd::default(), n_rooms, n_agents, n_behaviours, streams)
    }

    /// As [`Rooms::new`], with a training crowd among the agents. What agent (r, a) is in an
    /// episode is drawn from the stream `training_crowd` with the indices [r, a].
    ///
    /// # Errors
    ///
    /// As [`Rooms::new`], and when the crowd is refused.
    pub fn with_crowd(
        config: &SimConfig,
        crowd: &TrainingCrowd,
        n_rooms: usize,
        n_agents: usize,
        n_behaviours: u32,
        streams: &Streams,
    ) -> Result<Self, SimError> {
        crowd.check_rooms(n_rooms)?;
        Self::part(config, crowd, 0..n_rooms, n_agents, n_behaviours, streams)
    }

    /// As [`Rooms::with_crowd`], the rooms of these numbers only: what happens in them is what
    /// would happen in them among all of the run's rooms.
    ///
    /// # Errors
    ///
    /// As [`Rooms::with_crowd`].
    pub fn part(
        config: &SimConfig,
        crowd: &TrainingCrowd,
        numbers: Range<usize>,
        n_agents: usize,
        n_behaviours: u32,
        streams: &Streams,
    ) -> Result<Self, SimError> {
        let mut rooms = Self::unplaced((config, crowd), numbers, n_agents, n_behaviours, *streams)?;
        let mut all = rooms.all_mut();
        all.par_rooms().for_each(|(room, mut buffers)| room.begin(&mut buffers));
        Ok(rooms)
    }

    fn unplaced(
        (config, crowd): (&SimConfig, &TrainingCrowd),
        numbers: Range<usize>,
        n_agents: usize,
        n_behaviours: u32,
        streams: Streams,
    ) -> Result<Self, SimError> {
        config.validate()?;
        crowd.validate()?;
        let (first, n_rooms) = (numbers.start, numbers.len());
        for (field, count) in
            [("n_rooms", n_rooms), ("n_agents", n_agents), ("n_behaviours", n_behaviours as usize)]
        {
            if count == 0 {
                return Err(SimError::field(field, 0, "at least 1"));
            }
        }
        let plans = Plan::all(config, crowd, n_agents)?;
        let config = Arc::new(config.clone());
        let crowd = Arc::new(crowd.clone());
        let laser = Laser::new(&config.laser)?;
        let room = |r: usize| {
            let plan = &plans[r % plans.len()];
            Room::new((&config, &crowd), plan, &laser, n_agents, n_behaviours, streams, r as u64)
        };
        let rooms = numbers.map(room).collect::<Result<Vec<_>, _>>()?;
        let n = n_rooms * n_agents;
        Ok(Self {
            observations: vec![0.0; n * config.observation_len()],
            finals: vec![0.0; n * config.observation_len()],
            tokens: vec![0; n],
            transitions: vec![Transition::default(); n],
            streams,
            first,
            config,
            crowd,
            n_agents,
            n_behaviours,
            rooms,
        })
    }

    /// Number of agents in all rooms: R·N.
    pub fn len(&self) -> usize {
        self.tokens.len()
    }

    /// Never true: there is at least one room with one agent.
    pub fn is_empty(&self) -> bool {
        self.tokens.is_empty()
    }

    /// Rooms, R.
    pub fn n_rooms(&self) -> usize {
        self.rooms.len()
    }

    /// Agents in a room, N.
    pub fn n_agents(&self) -> usize {
        self.n_agents
    }

    /// The configuration.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }

    /// Role of an agent in its present episode.
    pub fn role(&self, agent_idx: usize) -> Role {
        self.rooms[agent_idx / self.n_agents].traits[agent_idx % self.n_agents].role
    }

    /// The number that chooses the frozen policy of an agent with the role [`Role::Opponent`]:
    /// uniform over all u32, drawn for each episode.
    pub fn opponent(&self, agent_idx: usize) -> u32 {
        self.rooms[agent_idx / self.n_agents].traits[agent_idx % self.n_agents].opponent
    }

    /// The observations to act on next; after an episode's end, the first one of the new episode.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// The behaviour token of every agent's present episode.
    pub fn tokens(&self) -> &[u32] {
        &self.tokens
    }

    /// The results of the last step, one for each agent.
    pub fn transitions(&self) -> &[Transition] {
        &self.transitions
    }

    /// The last observation of an episode that ended in the last step, for the bootstrap value of a
    /// truncation.
    ///
    /// # Panics
    ///
    /// When that agent's episode did not end in the last step.
    pub fn final_observation(&self, agent_idx: usize) -> &[f32] {
        assert!(
            !self.transitions[agent_idx].end.is_running(),
            "the episode of agent {agent_idx} did not end in the last step"
        );
        let width = self.config.observation_len();
        &self.finals[agent_idx * width..][..width]
    }

    /// Pose, goal and clearance of an agent: at the end of its episode if that ended in the last
    /// step, else now.
    ///
    /// # Panics
    ///
    /// When there is no such agent.
    pub fn whereabouts(&self, agent_idx: usize) -> Whereabouts {
        let (room, agent) = (&self.rooms[agent_idx / self.n_agents], agent_idx % self.n_agents);
        let running = self.transitions[agent_idx].end.is_running();
        if running { room.whereabouts(agent) } else { room.end(agent) }
    }

    /// Takes an agent out of its room for good, body and all: the others no longer meet or see it,
    /// and from now on its actions and its row mean nothing and its transitions are empty. For
    /// episodes that all begin together and end one by one; training does without it. A batch with
    /// agents taken out has no snapshot that [`Rooms::restore`] would take.
    ///
    /// # Panics
    ///
    /// When there is no such agent.
    pub fn remove(&mut self, agent_idx: usize) {
        self.rooms[agent_idx / self.n_agents].remove(agent_idx % self.n_agents);
    }

    /// Steps every room. The actions are samples as they were drawn; their clipped copies are
    /// executed.
    ///
    /// # Panics
    ///
    /// When there is not one action per agent, or an action is not finite.
    pub fn step(&mut self, actions: &[[f32; 2]]) {
        self.all_mut().step(actions);
    }

    /// Steps some of the rooms; `actions` are those of their agents only.
    ///
    /// # Panics
    ///
    /// When the range goes beyond the rooms, there is not one action per agent in it, or an action
    /// is not finite.
    pub fn step_range(&mut self, rooms: Range<usize>, actions: &[[f32; 2]]) {
        let (_, rest) = self.all_mut().split_at(rooms.start);
        rest.split_at(rooms.len()).0.step(actions);
    }

    /// All rooms as a view that can be split, so that some step while others are read.
    pub fn all_mut(&mut self) -> RoomsMut<'_> {
        RoomsMut {
            n_agents: self.n_agents,
            width: self.config.observation_len(),
            rooms: &mut self.rooms,
            observations: &mut self.observations,
            finals: &mut self.finals,
            tokens: &mut self.tokens,
            transitions: &mut self.transitions,
        }
    }
}

/// Exclusive access to a run of rooms.
pub struct RoomsMut<'a> {
    n_agents: usize,
    width: usize,
    rooms: &'a mut [Room],
    observations: &'a mut [f32],
    finals: &'a mut [f32],
    tokens: &'a mut [u32],
    transitions: &'a mut [Transition],
}

impl<'a> RoomsMut<'a> {
    /// The first `n_rooms` rooms, and the others.
    ///
    /// # Panics
    ///
    /// When there are fewer rooms.
    pub fn split_at(self, n_rooms: usize) -> (RoomsMut<'a>, RoomsMut<'a>) {
        let n = n_rooms * self.n_agents;
        let (rooms, rooms_b) = self.rooms.split_at_mut(n_rooms);
        let (observations, observations_b) = self.observations.split_at_mut(n * self.width);
        let (finals, finals_b) = self.finals.split_at_mut(n * self.width);
        let (tokens, tokens_b) = self.tokens.split_at_mut(n);
        let (transitions, transitions_b) = self.transitions.split_at_mut(n);
        let (n_agents, width) = (self.n_agents, self.width);
        (
            RoomsMut { n_agents, width, rooms, observations, finals, tokens, transitions },
            RoomsMut {
                n_agents,
                width,
                rooms: rooms_b,
                observations: observations_b,
                finals: finals_b,
                tokens: tokens_b,
                transitions: transitions_b,
            },
        )
    }

    /// As [`Rooms::observations`], for these rooms.
    pub fn observations(&self) -> &[f32] {
        self.observations
    }

    /// As [`Rooms::tokens`], for these rooms.
    pub fn tokens(&self) -> &[u32] {
        self.tokens
    }

    /// As [`Rooms::transitions`], for these rooms.
    pub fn transitions(&self) -> &[Transition] {
        self.transitions
    }

    /// As [`Rooms::step`], for these rooms.
    ///
    /// # Panics
    ///
    /// When there is not one action per agent, or an action is not finite.
    pub fn step(&mut self, actions: &[[f32; 2]]) {
        assert_eq!(actions.len(), self.tokens.len(), "one action per agent");
        let n_agents = self.n_agents;
        if let [room] = &mut *self.rooms {
            // One room: no need to wake another thread.
            let mut buffers = RoomBuffers {
                observations: self.observations,
                finals: self.finals,
                tokens: self.tokens,
                transitions: self.transitions,
            };
            room.step(actions, &mut buffers);
            return;
        }
        let actions = actions.par_chunks_exact(n_agents);
        self.par_rooms().zip(actions).for_each(|((room, mut buffers), a)| room.step(a, &mut buffers));
    }

    fn par_rooms(&mut self) -> impl IndexedParallelIterator<Item = (&mut Room, RoomBuffers<'_>)> {
        let (n, row) = (self.n_agents, self.n_agents * self.width);
        self.rooms
            .par_iter_mut()
            .zip(self.observations.par_chunks_exact_mut(row))
            .zip(self.finals.par_chunks_exact_mut(row))
            .zip(self.tokens.par_chunks_exact_mut(n))
            .zip(self.transitions.par_chunks_exact_mut(n))
            .map(|((((room, observations), finals), tokens), transitions)| {
                (room, RoomBuffers { observations, finals, tokens, transitions })
            })
    }
}
