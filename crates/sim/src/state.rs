//! The whole state of [`Rooms`] as plain numbers: what a checkpoint keeps.
//!
//! Poses, with the velocities and commands of robots that have mass, episodes, tokens, observation
//! rows (they hold the scans of the past) and the position of every random stream. Nothing else has
//! a memory, so a restored batch goes on bit for bit.

use crate::dynamics::DriveState;
use crate::error::SimError;
use crate::geometry::Pose;
use crate::renewal::{Renewal, RenewalState};
use crate::rng::Streams;
use crate::room::Episode;
use crate::rooms::Rooms;
use crate::spawn::Spawner;
use crate::traits::{Role, Traits};
use crate::world::World;
use glam::Vec2;
use serde::{Deserialize, Serialize};

/// A snapshot of [`Rooms`]. The formats it is written in must keep f32 and f64 exactly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomsState {
    seed: u64,
    n_rooms: usize,
    n_agents: usize,
    n_behaviours: u32,
    agents: Vec<AgentState>,
    observations: Vec<f32>,
    /// Only where a training crowd changes the rooms.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    rooms: Vec<RenewalState>,
}

/// One agent's part of a snapshot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AgentState {
    pose: Pose,
    episode: Episode,
    token: u32,
    noise_position: u64,
    spawn_position: u64,
    token_position: u64,
    /// Only where there is a training crowd.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    crowd: Option<MemberState>,
    /// Only where rapier moves the robots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    drive: Option<DriveState>,
}

/// The part of an agent's state that only a training crowd has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MemberState {
    traits: Traits,
    position: u64,
}

impl RoomsState {
    /// The snapshot of all rooms, from those of their parts in the order of the rooms; `None`
    /// without a part.
    pub fn join(parts: impl IntoIterator<Item = Self>) -> Option<Self> {
        parts.into_iter().reduce(|mut all, part| {
            all.n_rooms += part.n_rooms;
            all.agents.extend(part.agents);
            all.observations.extend(part.observations);
            all.rooms.extend(part.rooms);
            all
        })
    }

    /// The inverse of [`Self::join`] for `n` parts of as many rooms each.
    ///
    /// # Errors
    ///
    /// When rooms, agents or observations cannot be dealt to so many parts.
    pub fn split(mut self, n: usize) -> Result<Vec<Self>, SimError> {
        let counts = [self.n_rooms, self.agents.len(), self.observations.len(), self.rooms.len()];
        if let Some(odd) = counts.iter().find(|count| !count.is_multiple_of(n)) {
            return Err(SimError::field("state", format!("{odd} values"), format!("a multiple of {n}")));
        }
        let [n_rooms, agents, observations, rooms] = counts.map(|count| count / n);
        let part = |_| Self {
            n_rooms,
            agents: self.agents.drain(..agents).collect(),
            observations: self.observations.drain(..observations).collect(),
            rooms: self.rooms.drain(..rooms).collect(),
            ..self
        };
        Ok((0..n).map(part).collect())
    }
}

impl Rooms {
    /// A snapshot, to be taken between steps.
    pub fn state(&self) -> RoomsState {
        let agent = |(i, token): (usize, &u32)| {
            let (room, a) = (&self.rooms[i / self.n_agents], i % self.n_agents);
            let streams = &room.agents[a];
            AgentState {
                pose: room.world.pose(a),
                episode: room.episodes[a],
                token: *token,
                noise_position: streams.observer.noise_position(),
                spawn_position: streams.spawn.get_word_pos() as u64,
                token_position: streams.token.get_word_pos() as u64,
                crowd: (!self.crowd.is_off()).then(|| MemberState {
                    traits: room.traits[a],
                    position: streams.crowd.get_word_pos() as u64,
                }),
                drive: room.world.drive_state(a).cloned(),
            }
        };
        RoomsState {
            seed: self.streams.seed(),
            n_rooms: self.rooms.len(),
            n_agents: self.n_agents,
            n_behaviours: self.n_behaviours,
            agents: self.tokens.iter().enumerate().map(agent).collect(),
            observations: self.observations.clone(),
            rooms: self.rooms.iter().filter_map(|room| room.renewal.as_ref()).map(Renewal::state).collect(),
        }
    }

    /// Goes to a snapshot of rooms that were made with the same arguments. The transitions of the
    /// step before the snapshot are not part of it: they read as those of a fresh batch.
    ///
    /// # Errors
    ///
    /// When the snapshot is of another seed or shape or holds numbers that are not finite; nothing
    /// is changed then.
    pub fn restore(&mut self, state: RoomsState) -> Result<(), SimError> {
        self.check_state(&state)?;
        let streams = Streams::new(state.seed);
        let furnished = self.furnish(&state.rooms)?;
        for (r, (saved, furnished)) in state.rooms.into_iter().zip(furnished).enumerate() {
            let room = &mut self.rooms[r];
            let mut rng = streams.stream("training_crowd.room", &[(self.first + r) as u64]);
            rng.set_word_pos(u128::from(saved.position));
            let RenewalState { n_present, obstacles, steps_left, .. } = saved;
            room.renewal = Some(Renewal { n_present, obstacles, steps_left, rng });
            room.move_into(furnished);
        }
        for (i, saved) in state.agents.iter().enumerate() {
            let (r, a) = (i / self.n_agents, i % self.n_agents);
            let indices = [(self.first + r) as u64, a as u64];
            let room = &mut self.rooms[r];
            room.world.set_pose(a, saved.pose);
            if let Some(drive) = &saved.drive {
                room.world.set_drive_state(a, drive.clone());
            }
            room.episodes[a] = saved.episode;
            let agent = &mut room.agents[a];
            agent.observer.seek_noise(saved.noise_position);
            agent.spawn = streams.stream("spawn", &indices);
            agent.spawn.set_word_pos(u128::from(saved.spawn_position));
            agent.token = streams.stream("token", &indices);
            agent.token.set_word_pos(u128::from(saved.token_position));
            if let Some(member) = saved.crowd {
                room.traits[a] = member.traits;
                room.absent[a] = member.traits.role == Role::Absent;
                agent.crowd = streams.stream("training_crowd", &indices);
                agent.crowd.set_word_pos(u128::from(member.position));
                room.resize(a);
            }
            self.tokens[i] = saved.token;
        }
        self.observations = state.observations;
        self.transitions.fill_with(Default::default);
        Ok(())
    }

    /// The rooms of a snapshot with their obstacles, where a training crowd changes them.
    fn furnish(&self, rooms: &[RenewalState]) -> Result<Vec<(World, Spawner)>, SimError> {
        let expected = self.rooms.iter().filter(|room| room.renewal.is_some()).count();
        if rooms.len() != expected {
            return Err(SimError::field(
                "state.rooms",
                format!("{} rooms", rooms.len()),
                expected.to_string(),
            ));
        }
        let limits = &self.crowd;
        let sound = |room: &RenewalState| {
            (1..=self.n_agents).contains(&room.n_present)
                && (1..=limits.renew_steps).contains(&room.steps_left)
                && room.obstacles.len() <= limits.obstacles_max as usize
        };
        let furnish = |(r, room): (usize, &RenewalState)| {
            if !sound(room) {
                let found = "a number of agents, obstacles or steps out of range";
                return Err(SimError::field(format!("state.rooms[{r}]"), found, "the state of a room"));
            }
            self.rooms[r].plan.furnish(&room.obstacles)
        };
        rooms.iter().enumerate().map(furnish).collect()
    }

    fn check_state(&self, state: &RoomsState) -> Result<(), SimError> {
        let same = |field: &'static str, found: u64, expected: u64| {
            if found == expected { Ok(()) } else { Err(SimError::OtherRooms { field, found, expected }) }
        };
        same("seed", state.seed, self.streams.seed())?;
        same("n_rooms", state.n_rooms as u64, self.rooms.len() as u64)?;
        same("n_agents", state.n_agents as u64, self.n_agents as u64)?;
        same("n_behaviours", u64::from(state.n_behaviours), u64::from(self.n_behaviours))?;
        same("agents", state.agents.len() as u64, self.tokens.len() as u64)?;
        same("observations", state.observations.len() as u64, self.observations.len() as u64)?;
        let (min, max) = self.rooms[0].world.walls().expect("a room has walls");
        let inside = |p: Vec2| p.cmpge(min).all() && p.cmple(max).all();
        // Distances between two places of the room, with room for rounding.
        let reach = 1.01 * min.distance(max);
        let sound = |a: &AgentState| {
            let e = &a.episode;
            let distances = [e.goal_distance, e.straight_distance];
            let is_absent = a.crowd.is_some_and(|member| member.traits.role == Role::Absent);
            a.pose.is_finite()
                && (is_absent || inside(a.pose.position) && inside(e.goal))
                && e.velocity.iter().all(|x| x.is_finite())
                && distances.iter().all(|x| (0.0..=reach).contains(x))
                && e.path_length.is_finite()
                && e.reward_sum.is_finite()
                && e.steps < u32::MAX
                && a.token < self.n_behaviours
                && a.drive.is_some() != self.config.robot.dynamics.is_kinematic()
                && a.drive.as_ref().is_none_or(DriveState::is_finite)
                && a.crowd.is_none_or(|MemberState { traits, .. }| {
                    (0.0..=100.0).contains(&traits.speed) && (0.1..=10.0).contains(&traits.size)
                })
        };
        if let Some(i) = state.agents.iter().position(|a| !sound(a)) {
            let found = "a place outside the room, a number that is not finite or a token out of range";
            return Err(SimError::field(format!("state.agents[{i}]"), found, "the state of an agent"));
        }
        let (present, expected) = if self.crowd.is_off() { (0, "no") } else { (state.agents.len(), "every") };
        let n_traits = state.agents.iter().filter(|a| a.crowd.is_some()).count();
        if n_traits != present {
            let found = format!("traits of {n_traits} agents");
            return Err(SimError::field("state.agents.crowd", found, format!("those of {expected} agent")));
        }
        if !state.observations.iter().all(|x| x.is_finite()) {
            return Err(SimError::field("state.observations", "a number that is not finite", "observations"));
        }
        Ok(())
    }
}
