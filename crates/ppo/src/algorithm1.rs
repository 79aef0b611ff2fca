//! Algorithm 1 of the paper, "Behavior-conditioned policy for N agents", from top to bottom.
//!
//! ```text
//!  1  Initialise policy π_θ, value function V_φ, discriminators q_ψsa and q_ψs
//!  2  Require: hyper-parameters α, γ, λ, ε, M
//!  3  while not converged
//!  4      // Collect data in parallel
//!  5      for i = 1, 2, …, N
//!  6          Sample behaviour z^i ~ p_M(z)
//!  7          Sample the policy π_θ(· , s_t | z) for T_i timesteps, collecting {s_{t+1}, a_t, r_t}
//!  8          r_t ← r_t + α {log q_ψsa(z | s_t, a_t) − log q_ψs(z | s_t)}
//!  9          Compute advantages by GAE
//! 10      end for
//! 11      π_old ← π_θ
//! 12      // Update policy, value function and discriminators
//! 13      for j = 1 to epoch_π
//! 14          ratio k_t = π_θ(a_t | o_t) / π_old(a_t | o_t)
//! 15          L^PPO_clip(θ) = Σ min(k_t Â_t, clip(k_t, 1 − ε, 1 + ε) Â_t)
//! 16          Update θ by Adam on L^PPO_clip(θ)
//! 17      end for
//! 18      for j = 1 to epoch_V
//! 19          L^V(φ) = −Σ (Σ γ^{t'−t} r_t' − V_φ(s_t))²
//! 20          Update φ by Adam on L^V(φ)
//! 21      end for
//! 22      for j = 1 to epoch_D
//! 23          L^D(ψ_sa) = −Σ z log q_ψsa(s_t, a_t)
//! 24          L^D(ψ_s) = −Σ z log q_ψs(s_t)
//! 25          Update ψ_sa, ψ_s by Adam on L^D(ψ_sa), L^D(ψ_s)
//! 26      end for
//! 27  end while
//! ```
//!
//! Line 6 happens at the start of each *episode* (the paper's text below its algorithm), so it
//! lives in the simulator's rooms, with the agents' own episodes.
//!
//! # Departures
//!
//! - Line 9: the sum is over `δ_{t+l}` (see [`crate::gae`]).
//! - Lines 14, 15, 19: actor, critic and ratio are all conditioned on z. Lines 15 and 19 are means
//!   over a minibatch. L^V is minimised, its target is GAE + V, which includes `r_t`.
//! - Line 15: the entropy bonus of the lineage (Long et al. 2018 and its code) is added.
//! - Lines 13–26: given the rollout the four networks are independent, so they learn side by side.

use std::sync::Arc;
use std::time::Instant;

use jostle_diversity::cross_entropy::{self, log_softmax_at};
use jostle_diversity::input::{NoiseLevels, state_action_rows};
use jostle_diversity::{ActionInput, BehaviourActions, DiscriminatorShape, discriminator};
use jostle_policy::backend::{actor_of_inputs, critic_of_inputs};
use jostle_policy::encoder::{Encoder, EncoderScratch};
use jostle_policy::{Batch, DiagonalGaussian, Parameters};
use jostle_sim::{Rooms, Streams};
use rayon::ThreadPool;
use rayon::prelude::*;

use crate::constraint::Standing;
use crate::gae;
use crate::learner::Learner;
use crate::loss::{
    PolicyLoss, PolicyLossWeights, PolicyTargets, explained_variance, policy_loss, value_loss,
};
use crate::minibatch::shuffle;
use crate::population::Population;
use crate::report::DiscriminatorReport;
use crate::rollout::Rollout;
use crate::{Clock, Config, PpoError, UpdateReport};

/// Observations of a rollout on which D is watched: few, so that it costs about a percent of an
/// update.
const DIVERSITY_PROBES: usize = 16;

/// A training run in memory: four learners, the rooms, and how far it has come.
pub struct Trainer {
    pub(crate) config: Config,
    pub(crate) commit: String,
    /// SHA-256 of the map's content at the start, if there is a map.
    pub(crate) map_sha256: Option<String>,
    /// SHA-256 of each of the training crowd's maps.
    pub(crate) training_maps: Vec<String>,
    pub(crate) streams: Streams,
    pub(crate) rooms: Rooms,
    pub(crate) actor: Learner,
    pub(crate) critic: Learner,
    pub(crate) q_state_action: Learner,
    pub(crate) q_state: Learner,
    /// Updates done.
    pub(crate) update: u64,
    /// Transitions seen.
    pub(crate) transitions: u64,
    pub(crate) rollout: Rollout,
    inputs: Inputs,
    pub(crate) population: Option<Population>,
    /// Returns of the behaviours, where their diversity is constrained.
    pub(crate) standing: Option<Standing>,
    /// The agents that the present policy drives in the present step.
    driven: Vec<u32>,
    /// Means of the present step's actions, one for each of those.
    means: Vec<[f32; 2]>,
    /// Rows [observation | action] of the rollout, for `q_state_action`.
    state_action: Vec<f32>,
    pub(crate) pool: Arc<ThreadPool>,
}

/// Observation rows as the networks read them.
struct Inputs {
    encoder: Encoder,
    rows: Vec<f32>,
}

/// Rows that one task encodes.
const ENCODED_AT_ONCE: usize = 32;

impl Inputs {
    fn new(encoder: Encoder) -> Self {
        Self { encoder, rows: Vec::new() }
    }

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

impl Trainer {
    /// A fresh run (lines 1–2).
    ///
    /// # Errors
    ///
    /// The refusal of [`Config::validate`]; [`PpoError::Sim`] when the room has no place for the
    /// agents; [`PpoError::Threads`] when no thread can be started.
    pub fn new(config: Config) -> Result<Self, PpoError> {
        config.validate()?;
        let map = config.sim.room.map_file();
        let map_sha256 = map.map(|map| jostle_sim::maps::sha256(&map)).transpose()?;
        let maps = config.training_crowd.map_files();
        let training_maps = maps.iter().map(|map| jostle_sim::maps::sha256(map)).collect::<Result<_, _>>()?;
        let streams = Streams::new(config.seed);
        let network = config.network_config(); // Alg. 1, line 2: M; α, γ, λ, ε stay in `config`
        let init = |name: &str| streams.stream(name, &[]);
        let theta = Parameters::actor(&network, &mut init("init.actor"));
        let phi = Parameters::critic(&network, &mut init("init.critic"));
        let actor = actor_of_inputs(&network, config.backend, &theta)?; // Alg. 1, line 1: π_θ
        let critic = critic_of_inputs(&network, config.backend, &phi)?; // Alg. 1, line 1: V_φ
        let q = |name, n_inputs| -> Result<Learner, PpoError> {
            let (hidden, n_behaviours) = (config.discriminator.hidden, config.n_behaviours);
            let shape = DiscriminatorShape { n_inputs, hidden, n_behaviours };
            let psi = Parameters::init(shape.layout(), &mut init(&format!("init.{name}")));
            let network = discriminator(shape, config.backend, &psi)?;
            Ok(Learner::new(name, network, config.discriminator.learning_rate))
        };
        let encoder = Encoder::new(&network);
        let width = encoder.input_len();
        let q_state_action = q("discriminator.state_action", width + 2)?; // Alg. 1, line 1: q_ψsa
        let q_state = q("discriminator.state", width)?; // Alg. 1, line 1: q_ψs
        let population = Population::new(&config, &theta)?;
        let pool = thread_pool(config.threads)?;
        let (n_rooms, n_agents, n_behaviours) = (config.n_rooms, config.n_agents, config.n_behaviours as u32);
        let (sim, crowd) = (&config.sim, &config.training_crowd);
        let rooms =
            pool.install(|| Rooms::with_crowd(sim, crowd, n_rooms, n_agents, n_behaviours, &streams))?;
        Ok(Self {
            actor: Learner::new("actor", actor, config.learning_rate),
            critic: Learner::new("critic", critic, config.learning_rate),
            q_state_action,
            q_state,
            rollout: Rollout::new(config.horizon, config.agents_total(), width),
            inputs: Inputs::new(encoder),
            population,
            standing: (config.diversity_margin > 0.0).then(|| Standing::new(config.n_behaviours)),
            driven: Vec::with_capacity(config.agents_total()),
            means: Vec::with_capacity(config.agents_total()),
            state_action: Vec::new(),
            commit: "unknown".to_owned(),
            map_sha256,
            training_maps,
            update: 0,
            transitions: 0,
            config,
            streams,
            rooms,
            pool,
        })
    }

    /// The run's configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Updates done since the start of the run.
    pub fn updates_done(&self) -> u64 {
        self.update
    }

    /// Transitions seen since the start of the run.
    pub fn transitions(&self) -> u64 {
        self.transitions
    }

    /// The commit that checkpoints name as their origin; "unknown" until this is called.
    pub fn set_commit(&mut self, commit: impl Into<String>) {
        self.commit = commit.into();
    }

    /// The policy's present parameters, in canonical order.
    pub fn actor_parameters(&mut self) -> Vec<f32> {
        self.actor.parameters()
    }

    /// True if the configured number of updates is done (line 3).
    pub fn is_done(&self) -> bool {
        self.update >= self.config.updates
    }

    /// One turn of the loop (lines 3–27).
    ///
    /// # Errors
    ///
    /// [`PpoError::NotFinite`] when an observation, action, loss or parameter is not finite. The
    /// trainer is then in the middle of an update and must be dropped; go on from the last
    /// checkpoint.
    pub fn update(&mut self) -> Result<UpdateReport, PpoError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.one_update())
    }

    fn one_update(&mut self) -> Result<UpdateReport, PpoError> {
        let start = Instant::now();
        let mut clock = Clock::default();
        self.update += 1;
        self.rollout.clear();
        for step in 0..self.config.horizon as u64 {
            self.act(step, &mut clock)?; // Alg. 1, lines 5–7: all agents side by side
        }
        self.observe()?;
        self.rollout.keep_learners();
        clock.rollout = start.elapsed().as_secs_f64();
        if let Some(standing) = &mut self.standing {
            standing.take_in(&self.rollout.ended);
        }
        let logits = self.judge();
        self.add_intrinsic_reward(&logits); // Alg. 1, line 8
        let [on_state_action, on_state] = logits.map(|logits| {
            let measured = cross_entropy::evaluate(&logits, self.rollout.tokens());
            DiscriminatorReport { loss: measured.loss, accuracy: measured.accuracy }
        });
        let explained_variance = self.estimate_advantages()?; // Alg. 1, line 9
        let diversity = self.measure_diversity();
        clock.evaluation = start.elapsed().as_secs_f64() - clock.rollout;
        let learning_rate = self.config.learning_rate_at(self.update);
        self.actor.adam.set_learning_rate(learning_rate);
        self.critic.adam.set_learning_rate(learning_rate);
        // Alg. 1, line 11: π_old is the log-probabilities that the rollout keeps.
        let Self { config, streams, rollout, actor, critic, q_state_action, q_state, .. } = self;
        let context = UpdateContext { config, streams, rollout, update: self.update };
        let ((policy, value), (sa, s)) = rayon::join(
            || rayon::join(|| context.improve_policy(actor), || context.fit_value(critic)), // Alg. 1, lines 13–21
            || {
                let noisy = |q: &mut Learner, rows| context.fit_discriminator(q, rows); // Alg. 1, lines 22–26
                rayon::join(
                    || noisy(q_state_action, &self.state_action),
                    || noisy(q_state, rollout.observations()),
                )
            },
        );
        let (policy, value_loss) = (policy?, value?);
        sa.and(s)?;
        if let Some(population) = &mut self.population {
            population.after(self.update, &mut self.actor);
        }
        self.transitions += self.rollout.n_collected() as u64;
        clock.total = start.elapsed().as_secs_f64();
        clock.learning = clock.total - clock.rollout - clock.evaluation;
        let n = self.rollout.len() as f64;
        let log_std = self.actor.log_std();
        Ok(UpdateReport {
            update: self.update,
            transitions: self.transitions,
            task_reward: self.rollout.rewards.iter().sum::<f64>() / n,
            intrinsic_reward: self.rollout.intrinsic.iter().sum::<f64>() / n,
            episodes: self.rollout.episodes,
            episode_return: self.rollout.mean_per_episode(self.rollout.return_sum),
            episode_length: self.rollout.mean_per_episode(self.rollout.length_sum),
            discriminator_state_action: on_state_action,
            discriminator_state: on_state,
            diversity,
            value_loss,
            explained_variance,
            policy_loss: policy.surrogate,
            approx_kl: policy.approx_kl,
            clip_fraction: policy.clip_fraction,
            first_ratio_deviation: policy.ratio_deviation,
            entropy: DiagonalGaussian { mean: [0.0; 2], log_std }.entropy(),
            log_std,
            paid_behaviours: self
                .standing
                .is_some()
                .then(|| self.alphas().iter().filter(|alpha| **alpha > 0.0).count() as u64),
            crowd: (!self.config.training_crowd.is_off()).then_some(self.rollout.crowd),
            clock,
        })
    }

    /// Appends to the rollout what all agents see now, as the networks read it.
    fn observe(&mut self) -> Result<(), PpoError> {
        let rows = self.inputs.encode(self.rooms.observations());
        self.rollout.push_observations(rows, self.rooms.tokens(), self.update)
    }

    /// One step of every agent: observe, sample the policy of its behaviour, execute, collect
    /// (lines 6–7).
    pub(crate) fn act(&mut self, step: u64, clock: &mut Clock) -> Result<(), PpoError> {
        let begin = Instant::now();
        self.observe()?;
        self.infer_means();
        let log_std = self.actor.log_std();
        let mut rng = self.streams.stream("action", &[self.update, step]);
        let first = self.rollout.actions.len();
        let mut driven = self.driven.iter().zip(&self.means).peekable();
        for agent in 0..self.rooms.len() {
            let own = driven.next_if(|(driven, _)| **driven as usize == agent);
            let policy = DiagonalGaussian { mean: own.map_or([0.0; 2], |(_, mean)| *mean), log_std };
            let action = policy.sample(&mut rng);
            if action.iter().any(|a| !a.is_finite()) {
                let (update, tensor) = (self.update, "action".to_owned());
                return Err(PpoError::NotFinite { update, tensor, agent: Some(agent) });
            }
            self.rollout.actions.push(action);
            self.rollout.log_probs.push(policy.log_prob(action));
        }
        if let Some(population) = &mut self.population {
            population.act(&self.rooms, &mut self.rollout.actions[first..]);
        }
        clock.inference += begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        self.rooms.step(&self.rollout.actions[first..]);
        self.rollout.push_transitions(&self.rooms);
        if self.config.bootstrap_truncation {
            self.rollout.keep_truncated(&self.rooms, &self.inputs.encoder);
        }
        clock.simulation += begin.elapsed().as_secs_f64();
        Ok(())
    }

    /// The present policy's means for the agents that it drives: for all but walkers and opponents
    /// of a training crowd.
    fn infer_means(&mut self) {
        let n = self.rooms.len();
        let driven = (0..n as u32).filter(|agent| self.rooms.role(*agent as usize).has_present_policy());
        self.driven.clear();
        self.driven.extend(driven);
        self.means.resize(self.driven.len(), [0.0; 2]);
        let present = self.rollout.present();
        // No rows to choose where all are driven: the common case, and that without a crowd.
        let rows = (self.driven.len() < n).then_some(&self.driven[..]);
        self.actor.network.infer(Batch { rows, ..present }, self.means.as_flattened_mut());
    }

    /// Logits of q(z|s,a) and q(z|s) on the rollout, which they have not seen.
    pub(crate) fn judge(&mut self) -> [Vec<f32>; 2] {
        let rollout = &self.rollout;
        if self.config.n_behaviours < 2 {
            // With one behaviour there is nothing to guess: a single logit has the logarithm 0
            // whatever it is.
            return [vec![0.0; rollout.len()], vec![0.0; rollout.len()]];
        }
        let shown = match self.config.discriminator.action {
            ActionInput::Executed => &rollout.executed,
            ActionInput::Raw => &rollout.actions,
        };
        let scale = self.config.discriminator.action_scale;
        state_action_rows(rollout.observations(), shown, scale, &mut self.state_action);
        let len = rollout.len() * self.config.n_behaviours;
        let (mut on_state_action, mut on_state) = (vec![0.0; len], vec![0.0; len]);
        let (tokens, q_sa, q_s) = (rollout.tokens(), &mut self.q_state_action, &mut self.q_state);
        rayon::join(
            || q_sa.network.infer(Batch::new(&self.state_action, tokens), &mut on_state_action),
            || q_s.network.infer(Batch::new(rollout.observations(), tokens), &mut on_state),
        );
        [on_state_action, on_state]
    }

    /// Line 8, by the logits of q(z|s,a) and q(z|s).
    pub(crate) fn add_intrinsic_reward(&mut self, [on_state_action, on_state]: &[Vec<f32>; 2]) {
        let (rollout, m) = (&mut self.rollout, self.config.n_behaviours);
        let log_q =
            |logits: &[f32], row: usize, token| log_softmax_at(&logits[row * m..(row + 1) * m], token);
        rollout.intrinsic.resize(rollout.len(), 0.0);
        for row in 0..rollout.len() {
            let token = rollout.tokens()[row];
            let (sa, s) = (log_q(on_state_action, row, token), log_q(on_state, row, token));
            rollout.intrinsic[row] = self.config.intrinsic_reward.value(sa, s, self.config.add_log_m, m);
        }
    }

    /// Line 9; returns the explained variance of the values.
    fn estimate_advantages(&mut self) -> Result<f64, PpoError> {
        if self.config.bootstrap_truncation {
            self.rollout.value_truncations();
        }
        let rows = self.rollout.rows_to_value();
        let mut values = vec![0.0; rows.len()];
        self.critic.network.infer(rows, &mut values);
        if values.iter().any(|v| !v.is_finite()) {
            let (update, tensor) = (self.update, "value".to_owned());
            return Err(PpoError::NotFinite { update, tensor, agent: None });
        }
        let (gamma, gae_lambda) = (self.config.gamma, self.config.gae_lambda);
        let alphas = self.alphas();
        let weight = (&alphas[..], self.config.alpha_weighs);
        self.rollout.estimate_advantages(&values, weight, (gamma, gae_lambda));
        gae::normalise(&mut self.rollout.advantages);
        Ok(explained_variance(&self.rollout.values, &self.rollout.returns))
    }

    /// The weight of each behaviour's intrinsic reward: α, or 0 where a constrained behaviour
    /// drives too badly.
    fn alphas(&self) -> Vec<f64> {
        let Config { alpha, diversity_margin, n_behaviours, .. } = self.config;
        let is_paid = |behaviour| {
            self.standing.as_ref().is_none_or(|standing| standing.is_paid(behaviour, diversity_margin))
        };
        (0..n_behaviours).map(|behaviour| if is_paid(behaviour) { alpha } else { 0.0 }).collect()
    }

    /// D over a few evenly spaced observations of the rollout.
    fn measure_diversity(&mut self) -> f64 {
        let (m, n) = (self.config.n_behaviours, self.rollout.len());
        if m < 2 {
            return 0.0;
        }
        let width = self.rollout.observations().len() / n;
        let n_probes = DIVERSITY_PROBES.min(n);
        let mut observations = Vec::with_capacity(n_probes * m * width);
        for probe in 0..n_probes {
            let row = probe * n / n_probes;
            let observation = &self.rollout.observations()[row * width..(row + 1) * width];
            (0..m).for_each(|_| observations.extend_from_slice(observation));
        }
        let tokens: Vec<u32> = (0..n_probes).flat_map(|_| 0..m as u32).collect();
        let mut means = vec![0.0_f32; tokens.len() * 2];
        self.actor.network.infer(Batch::new(&observations, &tokens), &mut means);
        let log_std = self.actor.log_std().map(f64::from);
        let means: Vec<f64> = means.into_iter().map(f64::from).collect();
        let log_stds: Vec<f64> = log_std.iter().copied().cycle().take(means.len()).collect();
        BehaviourActions::new(&means, &log_stds, m, 2).map_or(0.0, |actions| actions.diversity())
    }
}

/// Things that the four learners share while they learn from one rollout.
#[derive(Clone, Copy)]
struct UpdateContext<'a> {
    config: &'a Config,
    streams: &'a Streams,
    rollout: &'a Rollout,
    update: u64,
}

impl UpdateContext<'_> {
    /// Lines 13–17. Returns the surrogate's mean over all minibatches, KL and clip fraction over
    /// the last epoch's, and the ratio's deviation in the first minibatch.
    fn improve_policy(&self, actor: &mut Learner) -> Result<PolicyLoss, PpoError> {
        let Config { clip_coef, ent_coef, epochs_policy, max_grad_norm, .. } = *self.config;
        let weights = PolicyLossWeights { clip_coef, ent_coef };
        let Rollout { actions, log_probs: old_log_probs, advantages, .. } = self.rollout;
        let targets = PolicyTargets { actions, old_log_probs, advantages };
        let mut losses = Vec::new();
        for epoch in 0..epochs_policy {
            // Alg. 1, line 13
            for rows in self.order("minibatch.actor", epoch).chunks(self.config.minibatch) {
                let mut means = vec![[0.0_f32; 2]; rows.len()];
                let mut d_means = means.clone();
                actor.network.forward(self.rollout.batch(rows), means.as_flattened_mut());
                let loss = policy_loss(&means, actor.log_std(), targets, rows, weights, &mut d_means); // lines 14–15
                self.check_loss("policy loss", loss.loss)?;
                actor.network.backward(d_means.as_flattened());
                actor.set_log_std_gradient(loss.d_log_std);
                actor.step(max_grad_norm); // Alg. 1, line 16
                losses.push(loss);
            }
        } // Alg. 1, line 17
        actor.check_finite(self.update)?;
        let mean = |of: &dyn Fn(&PolicyLoss) -> f64, losses: &[PolicyLoss]| {
            losses.iter().map(of).sum::<f64>() / losses.len() as f64
        };
        let last_epoch = &losses[losses.len() - losses.len() / epochs_policy..];
        Ok(PolicyLoss {
            surrogate: mean(&|l| l.surrogate, &losses),
            approx_kl: mean(&|l| l.approx_kl, last_epoch),
            clip_fraction: mean(&|l| l.clip_fraction, last_epoch),
            ..losses[0]
        })
    }

    /// Lines 18–21. Returns the mean value loss over all minibatches.
    fn fit_value(&self, critic: &mut Learner) -> Result<f64, PpoError> {
        let (mut sum, mut n) = (0.0, 0_u32);
        for epoch in 0..self.config.epochs_value {
            // Alg. 1, line 18
            for rows in self.order("minibatch.critic", epoch).chunks(self.config.minibatch) {
                let mut values = vec![0.0; rows.len()];
                let mut d_values = values.clone();
                critic.network.forward(self.rollout.batch(rows), &mut values);
                let loss = value_loss(&values, &self.rollout.returns, rows, &mut d_values); // Alg. 1, line 19
                self.check_loss("value loss", loss)?;
                critic.network.backward(&d_values);
                critic.step(self.config.max_grad_norm); // Alg. 1, line 20
                (sum, n) = (sum + loss, n + 1);
            }
        } // Alg. 1, line 21
        critic.check_finite(self.update)?;
        Ok(sum / f64::from(n))
    }

    /// Lines 22–26 for one of the two discriminators, whose input `inputs` are `[T·A, width]`.
    ///
    /// With one behaviour there is nothing to tell apart: loss and gradient are exactly 0, and
    /// nothing would move.
    fn fit_discriminator(&self, q: &mut Learner, inputs: &[f32]) -> Result<(), PpoError> {
        let m = self.config.n_behaviours;
        if m < 2 {
            return Ok(());
        }
        let width = inputs.len() / self.rollout.len();
        let n_action = width - self.rollout.observations().len() / self.rollout.len();
        let noise = NoiseLevels::new(&self.config.discriminator, inputs, width, n_action);
        let mut noised = Vec::new();
        for epoch in 0..self.config.epochs_discriminator {
            // Alg. 1, line 22
            let mut rng = self.streams.stream(&format!("noise.{}", q.name()), &[self.update, epoch as u64]);
            let order = self.order(&format!("minibatch.{}", q.name()), epoch);
            for rows in order.chunks(self.config.minibatch) {
                noised.resize(rows.len() * width, 0.0);
                for (&row, noised) in rows.iter().zip(noised.chunks_exact_mut(width)) {
                    let clean = &inputs[row as usize * width..(row as usize + 1) * width];
                    match &noise {
                        Some(levels) => levels.add(clean, noised, &mut rng),
                        None => noised.copy_from_slice(clean),
                    }
                }
                let tokens: Vec<u32> = rows.iter().map(|&row| self.rollout.tokens()[row as usize]).collect();
                let mut logits = vec![0.0; rows.len() * m];
                let mut d_logits = logits.clone();
                q.network.forward(Batch::new(&noised, &tokens), &mut logits);
                let loss = cross_entropy::evaluate_with_gradient(&logits, &tokens, &mut d_logits).loss; // 23–24
                self.check_loss(q.name(), loss)?;
                q.network.backward(&d_logits);
                q.step(self.config.max_grad_norm); // Alg. 1, line 25
            }
        } // Alg. 1, line 26
        q.check_finite(self.update)
    }

    /// The shuffled rows of one epoch, from the stream of that name.
    fn order(&self, stream: &str, epoch: usize) -> Vec<u32> {
        let mut rows = Vec::new();
        shuffle(
            &mut rows,
            self.rollout.len(),
            &mut self.streams.stream(stream, &[self.update, epoch as u64]),
        );
        rows
    }

    fn check_loss(&self, tensor: &str, loss: f64) -> Result<(), PpoError> {
        let error = || PpoError::NotFinite { update: self.update, tensor: tensor.to_owned(), agent: None };
        if loss.is_finite() { Ok(()) } else { Err(error()) }
    }
}

/// The run's own threads: `threads`, or one for each core.
fn thread_pool(threads: usize) -> Result<Arc<ThreadPool>, PpoError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(Arc::new).map_err(|error| PpoError::Threads { threads, reason: error.to_string() })
}
