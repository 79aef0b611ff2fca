//! Lines 5–8 of Algorithm 1 for the rooms of one shard: they act, and what they do is judged.
//!
//! A run has one shard unless its configuration says otherwise; [`crate::ranks`] says what shards
//! are for. What happens in a shard depends on no other: its rows go through the networks in
//! batches of their own, and its random numbers come from streams of its own.

use std::ops::Deref;
use std::time::Instant;

use jostle_diversity::cross_entropy::log_softmax_at;
use jostle_diversity::input::state_action_rows;
use jostle_diversity::{ActionInput, cross_entropy};
use jostle_policy::encoder::{Encoder, EncoderScratch};
use jostle_policy::{Batch, DiagonalGaussian, NetworkConfig};
use jostle_sim::{Rooms, Streams};
use rayon::prelude::*;

use crate::learner::Learner;
use crate::population::Population;
use crate::rollout::Rollout;
use crate::{Clock, Config, PpoError};

/// The rooms of a shard and what they have done in the present update.
pub(crate) struct Shard {
    /// Its number among all shards of the run.
    pub(crate) number: usize,
    /// True if the run has no other.
    is_only: bool,
    pub(crate) rooms: Rooms,
    pub(crate) rollout: Rollout,
    inputs: Inputs,
    /// The agents that the present policy drives in the present step.
    driven: Vec<u32>,
    /// Means of the present step's actions, one for each of those.
    means: Vec<[f32; 2]>,
    /// Rows [observation | action] of the rollout, for `q_state_action`.
    pub(crate) state_action: Vec<f32>,
    /// What both discriminators say of the rollout.
    pub(crate) judged: [Judged; 2],
}

/// A discriminator on a rollout that it has not seen, in sums over its rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Judged {
    pub(crate) loss: f64,
    pub(crate) hits: f64,
}

/// Whoever acts in a shard's rooms.
pub(crate) struct Acting<'a> {
    pub(crate) config: &'a Config,
    pub(crate) streams: &'a Streams,
    pub(crate) actor: &'a mut Learner,
    pub(crate) population: Option<&'a mut Population>,
    pub(crate) update: u64,
}

/// Observation rows as the networks read them.
struct Inputs {
    encoder: Encoder,
    rows: Vec<f32>,
}

/// Rows that one task encodes.
const ENCODED_AT_ONCE: usize = 32;

impl Inputs {
    /// The rows encoded, or as they are where the network reads them so.
    fn encode<'a>(&'a mut self, observations: &'a [f32]) -> &'a [f32] {
        if self.encoder.is_identity() {
            return observations;
        }
        let (width, len) = (self.encoder.observation_len(), self.encoder.input_len());
        let Self { encoder, rows } = self;
        rows.resize(observations.len() / width * len, 0.0);
        rows.par_chunks_mut(len * ENCODED_AT_ONCE)
            .zip(observations.par_chunks(width * ENCODED_AT_ONCE))
            .for_each_init(EncoderScratch::default, |scratch, (rows, observations)| {
                for (row, observation) in rows.chunks_exact_mut(len).zip(observations.chunks_exact(width)) {
                    encoder.encode(observation, scratch, row);
                }
            });
        rows
    }
}

/// Indices of a random stream, kept without memory of their own: one is asked for in every step.
pub(crate) struct Indices {
    all: [u64; 3],
    len: usize,
}

impl Deref for Indices {
    type Target = [u64];

    fn deref(&self) -> &[u64] {
        &self.all[..self.len]
    }
}

impl Shard {
    /// The shard of that number, with its rooms at their start.
    ///
    /// # Errors
    ///
    /// [`PpoError::Sim`] when a room has no place for the agents.
    pub(crate) fn new(
        number: usize,
        config: &Config,
        network: &NetworkConfig,
        streams: Streams,
    ) -> Result<Self, PpoError> {
        let (n_agents, n_behaviours) = (config.n_agents, config.n_behaviours as u32);
        let n_rooms = config.n_rooms / config.shards;
        let numbers = number * n_rooms..(number + 1) * n_rooms;
        let rooms =
            Rooms::part(&config.sim, &config.training_crowd, numbers, n_agents, n_behaviours, &streams)?;
        let agents = n_rooms * n_agents;
        let encoder = Encoder::new(network);
        Ok(Self {
            number,
            is_only: config.shards == 1,
            rooms,
            rollout: Rollout::new(config.horizon, agents, encoder.input_len()),
            inputs: Inputs { encoder, rows: Vec::new() },
            driven: Vec::with_capacity(agents),
            means: Vec::with_capacity(agents),
            state_action: Vec::new(),
            judged: [Judged::default(); 2],
        })
    }

    /// Indices of a random stream of this shard: these, and its number where there are others.
    pub(crate) fn indices(&self, [first, second]: [u64; 2]) -> Indices {
        Indices { all: [first, second, self.number as u64], len: if self.is_only { 2 } else { 3 } }
    }

    /// Appends to the rollout what all agents see now, as the networks read it.
    pub(crate) fn observe(&mut self, update: u64) -> Result<(), PpoError> {
        let rows = self.inputs.encode(self.rooms.observations());
        let first = self.number * self.rooms.len();
        self.rollout.push_observations(rows, self.rooms.tokens(), update).map_err(|error| match error {
            PpoError::NotFinite { update, tensor, agent } => {
                PpoError::NotFinite { update, tensor, agent: agent.map(|agent| first + agent) }
            }
            error => error,
        })
    }

    /// One step of every agent: observe, sample the policy of its behaviour, execute, collect
    /// (lines 6–7).
    pub(crate) fn act(&mut self, by: &mut Acting<'_>, step: u64, clock: &mut Clock) -> Result<(), PpoError> {
        let begin = Instant::now();
        self.observe(by.update)?;
        self.infer_means(by.actor);
        let log_std = by.actor.log_std();
        let mut rng = by.streams.stream("action", &self.indices([by.update, step]));
        let first = self.rollout.actions.len();
        let mut driven = self.driven.iter().zip(&self.means).peekable();
        for agent in 0..self.rooms.len() {
            let own = driven.next_if(|(driven, _)| **driven as usize == agent);
            let policy = DiagonalGaussian { mean: own.map_or([0.0; 2], |(_, mean)| *mean), log_std };
            let action = policy.sample(&mut rng);
            if action.iter().any(|a| !a.is_finite()) {
                let (update, tensor) = (by.update, "action".to_owned());
                let agent = Some(self.number * self.rooms.len() + agent);
                return Err(PpoError::NotFinite { update, tensor, agent });
            }
            self.rollout.actions.push(action);
            self.rollout.log_probs.push(policy.log_prob(action));
        }
        if let Some(population) = &mut by.population {
            population.act(&self.rooms, &mut self.rollout.actions[first..]);
        }
        clock.inference += begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        self.rooms.step(&self.rollout.actions[first..]);
        self.rollout.push_transitions(&self.rooms);
        if by.config.bootstrap_truncation {
            self.rollout.keep_truncated(&self.rooms, &self.inputs.encoder);
        }
        clock.simulation += begin.elapsed().as_secs_f64();
        Ok(())
    }

    /// The present policy's means for the agents that it drives: for all but walkers and opponents
    /// of a training crowd.
    fn infer_means(&mut self, actor: &mut Learner) {
        let n = self.rooms.len();
        let driven = (0..n as u32).filter(|agent| self.rooms.role(*agent as usize).has_present_policy());
        self.driven.clear();
        self.driven.extend(driven);
        self.means.resize(self.driven.len(), [0.0; 2]);
        let present = self.rollout.present();
        // No rows to choose where all are driven: the common case, and that without a crowd.
        let rows = (self.driven.len() < n).then_some(&self.driven[..]);
        actor.network.infer(Batch { rows, ..present }, self.means.as_flattened_mut());
    }

    /// Logits of q(z|s,a) and q(z|s) on the rollout, which they have not seen.
    pub(crate) fn judge(&mut self, config: &Config, [q_sa, q_s]: [&mut Learner; 2]) -> [Vec<f32>; 2] {
        let (rollout, m) = (&self.rollout, config.n_behaviours);
        let len = rollout.len() * m;
        let (mut on_state_action, mut on_state) = (vec![0.0; len], vec![0.0; len]);
        let tokens = rollout.tokens();
        // With one behaviour there is nothing to guess: a single logit has the logarithm 0 whatever
        // it is.
        if m > 1 {
            let shown = match config.discriminator.action {
                ActionInput::Executed => &rollout.executed,
                ActionInput::Raw => &rollout.actions,
            };
            let scale = config.discriminator.action_scale;
            state_action_rows(rollout.observations(), shown, scale, &mut self.state_action);
            rayon::join(
                || q_sa.network.infer(Batch::new(&self.state_action, tokens), &mut on_state_action),
                || q_s.network.infer(Batch::new(rollout.observations(), tokens), &mut on_state),
            );
        }
        self.judged = [&on_state_action, &on_state].map(|logits| {
            let (loss, hits) = cross_entropy::totals(logits, tokens);
            Judged { loss, hits }
        });
        [on_state_action, on_state]
    }

    /// Line 8, by the logits of q(z|s,a) and q(z|s).
    pub(crate) fn add_intrinsic_reward(
        &mut self,
        config: &Config,
        [on_state_action, on_state]: &[Vec<f32>; 2],
    ) {
        let (rollout, m) = (&mut self.rollout, config.n_behaviours);
        let log_q =
            |logits: &[f32], row: usize, token| log_softmax_at(&logits[row * m..(row + 1) * m], token);
        rollout.intrinsic.resize(rollout.len(), 0.0);
        for row in 0..rollout.len() {
            let token = rollout.tokens()[row];
            let (sa, s) = (log_q(on_state_action, row, token), log_q(on_state, row, token));
            rollout.intrinsic[row] = config.intrinsic_reward.value(sa, s, config.add_log_m, m);
        }
    }

    /// Values of the rollout's rows, of the observations behind its last step and of the last
    /// observations of truncated episodes.
    ///
    /// # Errors
    ///
    /// [`PpoError::NotFinite`] when a value is not finite.
    pub(crate) fn values(
        &mut self,
        config: &Config,
        critic: &mut Learner,
        update: u64,
    ) -> Result<Vec<f32>, PpoError> {
        if config.bootstrap_truncation {
            self.rollout.value_truncations();
        }
        let rows = self.rollout.rows_to_value();
        let mut values = vec![0.0; rows.len()];
        critic.network.infer(rows, &mut values);
        if values.iter().any(|v| !v.is_finite()) {
            return Err(PpoError::NotFinite { update, tensor: "value".to_owned(), agent: None });
        }
        Ok(values)
    }
}
