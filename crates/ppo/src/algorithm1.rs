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
//! - Lines 13–26: given the rollout the four networks are independent, so they learn side by side;
//!   one after the other where several processes make one run ([`crate::ranks`]).

use std::sync::Arc;
use std::time::Instant;

use jostle_diversity::input::{NoiseLevels, column_squares, column_sums};
use jostle_diversity::{BehaviourActions, DiscriminatorShape, cross_entropy, discriminator};
use jostle_policy::backend::{actor_of_inputs, critic_of_inputs};
use jostle_policy::{Batch, DiagonalGaussian, Parameters};
use jostle_sim::Streams;
use rayon::ThreadPool;

use crate::constraint::Standing;
use crate::gae;
use crate::learner::Learner;
use crate::loss::{
    PolicyLoss, PolicyLossWeights, PolicyTargets, explained_variance, policy_loss_of_part, value_loss_of_part,
};
use crate::minibatch::{Cut, shuffle};
use crate::population::Population;
use crate::ranks::{Alone, Communicator, Ranks, Tree};
use crate::report::Totals;
use crate::rollout::Rollout;
use crate::shard::{Acting, Shard};
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
    pub(crate) actor: Learner,
    pub(crate) critic: Learner,
    pub(crate) q_state_action: Learner,
    pub(crate) q_state: Learner,
    /// Updates done.
    pub(crate) update: u64,
    /// Transitions seen.
    pub(crate) transitions: u64,
    /// The shards of this process: all of them unless it is one of several.
    pub(crate) shards: Vec<Shard>,
    pub(crate) ranks: Ranks,
    pub(crate) population: Option<Population>,
    /// Returns of the behaviours, where their diversity is constrained.
    pub(crate) standing: Option<Standing>,
    pub(crate) pool: Arc<ThreadPool>,
}

impl Trainer {
    /// A fresh run (lines 1–2).
    ///
    /// # Errors
    ///
    /// The refusal of [`Config::validate`]; [`PpoError::Sim`] when the room has no place for the
    /// agents; [`PpoError::Threads`] when no thread can be started.
    pub fn new(config: Config) -> Result<Self, PpoError> {
        Self::among(config, Arc::new(Alone))
    }

    /// As [`Self::new`], as one of the processes of a run: each makes such a trainer and calls the
    /// same functions of it in the same order.
    ///
    /// # Errors
    ///
    /// As [`Self::new`], and [`PpoError::Ranks`] when the shards cannot be dealt to so many ranks.
    pub fn among(config: Config, ranks: Arc<dyn Communicator>) -> Result<Self, PpoError> {
        config.validate()?;
        let ranks = Ranks::new(ranks, config.shards)?;
        let map = config.sim.room.map_file();
        let map_sha256 = map.map(|map| jostle_sim::maps::sha256(&map)).transpose()?;
        let maps = config.training_crowd.map_files();
        let training_maps = maps.iter().map(|map| jostle_sim::maps::sha256(map)).collect::<Result<_, _>>()?;
        let streams = Streams::new(config.seed);
        let network = config.network_config(); // Alg. 1, line 2: M; α, γ, λ, ε stay in `config`
        let init = |name: &str| streams.stream(name, &[]);
        let theta = Parameters::actor(&network, &mut init("init.actor"));
        let phi = Parameters::critic(&network, &mut init("init.critic"));
        let actor = actor_of_inputs(&network, config.engine(), &theta)?; // Alg. 1, line 1: π_θ
        let critic = critic_of_inputs(&network, config.engine(), &phi)?; // Alg. 1, line 1: V_φ
        let q = |name, n_inputs| -> Result<Learner, PpoError> {
            let (hidden, n_behaviours) = (config.discriminator.hidden, config.n_behaviours);
            let shape = DiscriminatorShape { n_inputs, hidden, n_behaviours };
            let psi = Parameters::init(shape.layout(), &mut init(&format!("init.{name}")));
            let network = discriminator(shape, config.engine(), &psi)?;
            Ok(Learner::new(name, network, config.discriminator.learning_rate))
        };
        let width = network.input_len();
        let q_state_action = q("discriminator.state_action", width + 2)?; // Alg. 1, line 1: q_ψsa
        let q_state = q("discriminator.state", width)?; // Alg. 1, line 1: q_ψs
        let population = Population::new(&config, &theta)?;
        let pool = thread_pool(config.threads)?;
        let shards = pool.install(|| {
            let shard = |number| Shard::new(number, &config, &network, streams);
            ranks.own_shards().map(shard).collect::<Result<_, _>>()
        })?;
        Ok(Self {
            actor: Learner::new("actor", actor, config.learning_rate),
            critic: Learner::new("critic", critic, config.learning_rate),
            q_state_action,
            q_state,
            shards,
            ranks,
            population,
            standing: (config.diversity_margin > 0.0).then(|| Standing::new(config.n_behaviours)),
            commit: "unknown".to_owned(),
            map_sha256,
            training_maps,
            update: 0,
            transitions: 0,
            config,
            streams,
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
    /// [`PpoError::NotFinite`] when an observation, action, loss or parameter is not finite, on
    /// every rank the same error. The trainer is then in the middle of an update and must be
    /// dropped; go on from the last checkpoint.
    pub fn update(&mut self) -> Result<UpdateReport, PpoError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.one_update())
    }

    fn one_update(&mut self) -> Result<UpdateReport, PpoError> {
        let start = Instant::now();
        let mut clock = Clock::default();
        self.update += 1;
        let collected = self.collect(&mut clock); // Alg. 1, lines 5–7: all agents side by side
        clock.rollout = start.elapsed().as_secs_f64();
        let values = collected.and_then(|()| {
            for number in 0..self.shards.len() {
                let logits = self.judge(number);
                self.shards[number].add_intrinsic_reward(&self.config, &logits); // Alg. 1, line 8
            }
            let Self { shards, config, critic, update, .. } = self;
            shards.iter_mut().map(|shard| shard.values(config, critic, *update)).collect()
        });
        let values: Vec<Vec<f32>> = self.ranks.agree(values)?;
        self.follow_returns()?;
        let own_rows: Vec<u64> = self.shards.iter().map(|shard| shard.rollout.len() as u64).collect();
        let rows = self.ranks.gather_values(&own_rows)?.into_iter().map(|rows| rows as usize).collect();
        let cut = Cut::new(rows, self.config.minibatch);
        let totals = self.ranks.sum(self.shards.iter().map(|shard| Totals::of(shard).to_vec()))?;
        let totals = Totals::from_slice(&totals);
        let explained_variance = self.estimate_advantages(&values, cut.n_rows())?; // Alg. 1, line 9
        let diversity = self.measure_diversity(&cut)?;
        clock.evaluation = start.elapsed().as_secs_f64() - clock.rollout;
        let (policy, value_loss) = self.learn(&cut)?;
        if let Some(population) = &mut self.population {
            population.after(self.update, &mut self.actor);
        }
        self.transitions += self.config.rollout_len() as u64;
        clock.total = start.elapsed().as_secs_f64();
        clock.learning = clock.total - clock.rollout - clock.evaluation;
        let n = cut.n_rows() as f64;
        let log_std = self.actor.log_std();
        let [discriminator_state_action, discriminator_state] = totals.discriminators(n);
        Ok(UpdateReport {
            update: self.update,
            transitions: self.transitions,
            task_reward: totals.rewards / n,
            intrinsic_reward: totals.intrinsic / n,
            episodes: totals.episodes,
            episode_return: totals.mean_per_episode(totals.returns),
            episode_length: totals.mean_per_episode(totals.lengths),
            discriminator_state_action,
            discriminator_state,
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
            crowd: (!self.config.training_crowd.is_off()).then_some(totals.crowd),
            clock,
        })
    }

    /// Lines 5–7: a rollout in every room.
    fn collect(&mut self, clock: &mut Clock) -> Result<(), PpoError> {
        let (shards, mut by) = self.acting();
        for shard in shards {
            shard.rollout.clear();
            for step in 0..by.config.horizon as u64 {
                shard.act(&mut by, step, clock)?;
            }
            shard.observe(by.update)?;
            shard.rollout.keep_learners();
        }
        Ok(())
    }

    /// One step of every agent.
    pub(crate) fn act(&mut self, step: u64, clock: &mut Clock) -> Result<(), PpoError> {
        let (shards, mut by) = self.acting();
        shards.iter_mut().try_for_each(|shard| shard.act(&mut by, step, clock))
    }

    /// The shards, and who acts in their rooms.
    fn acting(&mut self) -> (&mut [Shard], Acting<'_>) {
        let Self { shards, config, streams, actor, population, update, .. } = self;
        (shards, Acting { config, streams, actor, population: population.as_mut(), update: *update })
    }

    /// Logits of q(z|s,a) and q(z|s) on the rollout of one of this process's shards.
    pub(crate) fn judge(&mut self, number: usize) -> [Vec<f32>; 2] {
        let Self { shards, config, q_state_action, q_state, .. } = self;
        shards[number].judge(config, [q_state_action, q_state])
    }

    /// Where diversity is constrained, takes in the returns of the episodes that ended.
    fn follow_returns(&mut self) -> Result<(), PpoError> {
        let Some(standing) = &mut self.standing else { return Ok(()) };
        let ended = || self.shards.iter().flat_map(|shard| &shard.rollout.ended);
        let tokens: Vec<u32> = ended().map(|(token, _)| *token).collect();
        let returns: Vec<f64> = ended().map(|(_, of_episode)| *of_episode).collect();
        let tokens = self.ranks.gather_values(&tokens)?;
        let returns = self.ranks.gather_values(&returns)?;
        standing.take_in(&tokens.into_iter().zip(returns).collect::<Vec<_>>());
        Ok(())
    }

    /// Line 9, by the values of each shard and the number of rows of all of them; returns the
    /// explained variance of the values.
    fn estimate_advantages(&mut self, values: &[Vec<f32>], n_rows: usize) -> Result<f64, PpoError> {
        let discounts = (self.config.gamma, self.config.gae_lambda);
        let alphas = self.alphas();
        let Self { shards, ranks, config, .. } = self;
        let weight = (&alphas[..], config.alpha_weighs);
        let mut intrinsic = Vec::new();
        for (shard, values) in shards.iter_mut().zip(values) {
            intrinsic.extend(shard.rollout.estimate_advantages(values, weight, discounts));
        }
        if !intrinsic.is_empty() {
            let columns: Vec<[&[f64]; 2]> = shards
                .iter()
                .zip(&intrinsic)
                .map(|(shard, of)| [&shard.rollout.advantages[..], of])
                .collect();
            let [task, diverse] = moments(ranks, n_rows, &columns)?;
            for (shard, intrinsic) in shards.iter_mut().zip(&mut intrinsic) {
                gae::shift_and_scale(&mut shard.rollout.advantages, task.mean, task.variance);
                gae::shift_and_scale(intrinsic, diverse.mean, diverse.variance);
                shard.rollout.add_intrinsic_advantages(&alphas, intrinsic);
            }
        }
        let errors: Vec<Vec<f64>> = shards.iter().map(|shard| shard.rollout.value_errors()).collect();
        let columns: Vec<[&[f64]; 3]> = shards
            .iter()
            .zip(&errors)
            .map(|(shard, errors)| [&shard.rollout.advantages[..], errors, &shard.rollout.returns])
            .collect();
        let [advantages, errors, returns] = moments(ranks, n_rows, &columns)?;
        for shard in shards {
            gae::shift_and_scale(&mut shard.rollout.advantages, advantages.mean, advantages.variance);
        }
        Ok(explained_variance(errors.variance, returns.variance))
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

    /// D over a few evenly spaced observations of the rollout, each of which is looked at where it
    /// lies.
    fn measure_diversity(&mut self, cut: &Cut) -> Result<f64, PpoError> {
        let (m, n) = (self.config.n_behaviours, cut.n_rows());
        if m < 2 {
            return Ok(0.0);
        }
        let n_probes = DIVERSITY_PROBES.min(n);
        let mut own_means: Vec<f32> = Vec::new();
        for shard in &self.shards {
            let (observations, rows) = (shard.rollout.observations(), shard.rollout.len());
            let (width, first) = (observations.len() / rows, cut.first(shard.number));
            let probes = (0..n_probes).map(|probe| probe * n / n_probes);
            let here: Vec<usize> = probes.filter(|row| (first..first + rows).contains(row)).collect();
            let mut shown = Vec::with_capacity(here.len() * m * width);
            for row in here.iter().map(|row| row - first) {
                let observation = &observations[row * width..(row + 1) * width];
                (0..m).for_each(|_| shown.extend_from_slice(observation));
            }
            let tokens: Vec<u32> = here.iter().flat_map(|_| 0..m as u32).collect();
            let mut means = vec![0.0_f32; tokens.len() * 2];
            self.actor.network.infer(Batch::new(&shown, &tokens), &mut means);
            own_means.extend(means);
        }
        let means = self.ranks.gather_values(&own_means)?;
        let log_std = self.actor.log_std().map(f64::from);
        let means: Vec<f64> = means.into_iter().map(f64::from).collect();
        let log_stds: Vec<f64> = log_std.iter().copied().cycle().take(means.len()).collect();
        Ok(BehaviourActions::new(&means, &log_stds, m, 2).map_or(0.0, |actions| actions.diversity()))
    }

    /// Lines 11–26: all four learners, side by side where no network's order of messages depends on
    /// it. Returns the policy's measures and the mean value loss.
    fn learn(&mut self, cut: &Cut) -> Result<(PolicyLoss, f64), PpoError> {
        let learning_rate = self.config.learning_rate_at(self.update);
        self.actor.adam.set_learning_rate(learning_rate);
        self.critic.adam.set_learning_rate(learning_rate);
        // Alg. 1, line 11: π_old is the log-probabilities that the rollout keeps.
        let Self { config, streams, shards, ranks, actor, critic, q_state_action, q_state, .. } = self;
        let context = UpdateContext { config, streams, shards, ranks, cut, update: self.update };
        let mut policy = || context.improve_policy(actor); // Alg. 1, lines 13–17
        let mut value = || context.fit_value(critic); // Alg. 1, lines 18–21
        let mut sa = || context.fit_discriminator(q_state_action, |shard| &shard.state_action); // lines 22–26
        let mut s = || context.fit_discriminator(q_state, |shard| shard.rollout.observations());
        if ranks.are_several() {
            let learned = (policy()?, value()?);
            sa().and_then(|()| s())?;
            return Ok(learned);
        }
        let ((policy, value), (sa, s)) = rayon::join(|| rayon::join(policy, value), || rayon::join(sa, s));
        let learned = (policy?, value?);
        sa.and(s)?;
        Ok(learned)
    }
}

/// Mean and population variance of a column.
#[derive(Debug, Clone, Copy)]
struct Moments {
    mean: f64,
    variance: f64,
}

/// Those of columns that lie in several shards, of `n_rows` rows in all.
fn moments<const N: usize>(
    ranks: &Ranks,
    n_rows: usize,
    shards: &[[&[f64]; N]],
) -> Result<[Moments; N], PpoError> {
    let n = n_rows as f64;
    let sums =
        ranks.sum(shards.iter().map(|columns| columns.iter().map(|x| x.iter().sum::<f64>()).collect()))?;
    let means: [f64; N] = std::array::from_fn(|i| sums[i] / n);
    let squares = ranks.sum(
        shards
            .iter()
            .map(|columns| columns.iter().zip(means).map(|(x, mean)| gae::squares(x, mean)).collect()),
    )?;
    Ok(std::array::from_fn(|i| Moments { mean: means[i], variance: squares[i] / n }))
}

/// Things that the four learners share while they learn from one rollout.
#[derive(Clone, Copy)]
struct UpdateContext<'a> {
    config: &'a Config,
    streams: &'a Streams,
    shards: &'a [Shard],
    ranks: &'a Ranks,
    cut: &'a Cut,
    update: u64,
}

impl UpdateContext<'_> {
    /// Lines 13–17. Returns the surrogate's mean over all minibatches, KL and clip fraction over
    /// the last epoch's, and the ratio's deviation in the first minibatch.
    fn improve_policy(&self, actor: &mut Learner) -> Result<PolicyLoss, PpoError> {
        let Config { clip_coef, ent_coef, epochs_policy, .. } = *self.config;
        let weights = PolicyLossWeights { clip_coef, ent_coef };
        let mut measured = vec![Vec::new(); self.shards.len()];
        let mut deviations = vec![0.0_f64; self.shards.len()];
        let mut entropies = Vec::new();
        for epoch in 0..epochs_policy {
            // Alg. 1, line 13
            let orders = self.orders("minibatch.actor", epoch);
            for minibatch in 0..self.cut.count() {
                let (n, log_std) = (self.cut.len(minibatch), actor.log_std());
                self.step(actor, |actor, i, shard| {
                    let Rollout { actions, log_probs: old_log_probs, advantages, .. } = &shard.rollout;
                    let targets = PolicyTargets { actions, old_log_probs, advantages };
                    let rows = &orders[i][self.cut.part(minibatch, shard.number)];
                    let mut means = vec![[0.0_f32; 2]; rows.len()];
                    let mut d_means = means.clone();
                    actor.forward(shard.rollout.batch(rows), means.as_flattened_mut());
                    let mut loss =
                        policy_loss_of_part(&means, log_std, targets, (rows, n), weights, &mut d_means); // 14–15
                    if shard.number == 0 {
                        loss.add_entropy(log_std, weights);
                    }
                    actor.backward(d_means.as_flattened());
                    actor.set_log_std_gradient(loss.d_log_std);
                    measured[i].extend([loss.surrogate, loss.approx_kl, loss.clip_fraction]);
                    if entropies.is_empty() {
                        deviations[i] = loss.ratio_deviation;
                    }
                })?; // Alg. 1, line 16
                entropies.push(DiagonalGaussian { mean: [0.0; 2], log_std }.entropy());
            }
        } // Alg. 1, line 17
        let sums = self.ranks.sum(measured)?;
        let (losses, _) = sums.as_chunks::<3>();
        for ([surrogate, ..], entropy) in losses.iter().zip(&entropies) {
            self.check_loss("policy loss", surrogate - ent_coef * entropy)?;
        }
        let deviations = self.ranks.gather_values(&deviations)?;
        actor.check_finite(self.update)?;
        let mean = |of: usize, losses: &[[f64; 3]]| {
            losses.iter().map(|loss| loss[of]).sum::<f64>() / losses.len() as f64
        };
        let last_epoch = &losses[losses.len() - losses.len() / epochs_policy..];
        Ok(PolicyLoss {
            surrogate: mean(0, losses),
            approx_kl: mean(1, last_epoch),
            clip_fraction: mean(2, last_epoch),
            ratio_deviation: deviations.into_iter().fold(0.0, f64::max),
            ..PolicyLoss::default()
        })
    }

    /// Lines 18–21. Returns the mean value loss over all minibatches.
    fn fit_value(&self, critic: &mut Learner) -> Result<f64, PpoError> {
        let mut measured = vec![Vec::new(); self.shards.len()];
        for epoch in 0..self.config.epochs_value {
            // Alg. 1, line 18
            let orders = self.orders("minibatch.critic", epoch);
            for minibatch in 0..self.cut.count() {
                let n = self.cut.len(minibatch);
                self.step(critic, |critic, i, shard| {
                    let rows = &orders[i][self.cut.part(minibatch, shard.number)];
                    let mut values = vec![0.0; rows.len()];
                    let mut d_values = values.clone();
                    critic.forward(shard.rollout.batch(rows), &mut values);
                    let returns = &shard.rollout.returns;
                    measured[i].push(value_loss_of_part(&values, returns, (rows, n), &mut d_values)); // line 19
                    critic.backward(&d_values);
                })?; // Alg. 1, line 20
            }
        } // Alg. 1, line 21
        let losses = self.ranks.sum(measured)?;
        losses.iter().try_for_each(|loss| self.check_loss("value loss", *loss))?;
        critic.check_finite(self.update)?;
        Ok(losses.iter().fold(0.0, |sum, loss| sum + loss) / losses.len() as f64)
    }

    /// Lines 22–26 for one of the two discriminators, whose inputs of a shard are `[rows, width]`.
    ///
    /// With one behaviour there is nothing to tell apart: loss and gradient are exactly 0, and
    /// nothing would move.
    fn fit_discriminator(&self, q: &mut Learner, inputs: impl Fn(&Shard) -> &[f32]) -> Result<(), PpoError> {
        let m = self.config.n_behaviours;
        if m < 2 {
            return Ok(());
        }
        let width_of = |rows: &[f32], shard: &Shard| rows.len() / shard.rollout.len();
        let width = width_of(inputs(&self.shards[0]), &self.shards[0]);
        let n_action = width - width_of(self.shards[0].rollout.observations(), &self.shards[0]);
        let noise = self.noise_levels(width, n_action, &inputs)?;
        let mut measured = vec![Vec::new(); self.shards.len()];
        let mut noised = Vec::new();
        for epoch in 0..self.config.epochs_discriminator {
            // Alg. 1, line 22
            let stream = format!("noise.{}", q.name());
            let mut rngs: Vec<_> =
                self.shards.iter().map(|shard| self.stream(&stream, shard, epoch)).collect();
            let orders = self.orders(&format!("minibatch.{}", q.name()), epoch);
            for minibatch in 0..self.cut.count() {
                let n = self.cut.len(minibatch);
                self.step(q, |q, i, shard| {
                    let rows = &orders[i][self.cut.part(minibatch, shard.number)];
                    noised.resize(rows.len() * width, 0.0);
                    for (&row, noised) in rows.iter().zip(noised.chunks_exact_mut(width)) {
                        let clean = &inputs(shard)[row as usize * width..(row as usize + 1) * width];
                        match &noise {
                            Some(levels) => levels.add(clean, noised, &mut rngs[i]),
                            None => noised.copy_from_slice(clean),
                        }
                    }
                    let tokens: Vec<u32> =
                        rows.iter().map(|&row| shard.rollout.tokens()[row as usize]).collect();
                    let mut logits = vec![0.0; rows.len() * m];
                    let mut d_logits = logits.clone();
                    q.forward(Batch::new(&noised, &tokens), &mut logits);
                    let mut loss = 0.0;
                    if !rows.is_empty() {
                        cross_entropy::write_gradient(&logits, &tokens, n, &mut d_logits); // lines 23–24
                        loss = cross_entropy::totals(&logits, &tokens).0 / n as f64;
                    }
                    measured[i].push(loss);
                    q.backward(&d_logits);
                })?; // Alg. 1, line 25
            }
        } // Alg. 1, line 26
        let losses = self.ranks.sum(measured)?;
        losses.iter().try_for_each(|loss| self.check_loss(q.name(), *loss))?;
        q.check_finite(self.update)
    }

    /// The standard deviation of the noise on each of a discriminator's inputs.
    fn noise_levels(
        &self,
        width: usize,
        n_action: usize,
        inputs: impl Fn(&Shard) -> &[f32],
    ) -> Result<Option<NoiseLevels>, PpoError> {
        let n = self.cut.n_rows() as f64;
        let mut outcome = Ok(());
        let variance = || -> Result<Vec<f64>, PpoError> {
            let sums = self.ranks.sum(self.shards.iter().map(|shard| column_sums(inputs(shard), width)))?;
            let mean: Vec<f64> = sums.iter().map(|sum| sum / n).collect();
            let squares =
                self.ranks.sum(self.shards.iter().map(|shard| column_squares(inputs(shard), &mean)))?;
            Ok(squares.iter().map(|sum| sum / n).collect())
        };
        let or_zeros = || {
            variance().unwrap_or_else(|error| {
                outcome = Err(error);
                vec![0.0; width]
            })
        };
        let levels = NoiseLevels::of_variance(&self.config.discriminator, or_zeros, width, n_action);
        outcome.map(|()| levels)
    }

    /// One step of Adam down the gradient of a minibatch, which `backward` leaves in the learner
    /// for one shard after the other.
    fn step(
        &self,
        learner: &mut Learner,
        mut backward: impl FnMut(&mut Learner, usize, &Shard),
    ) -> Result<(), PpoError> {
        if let [shard] = self.shards {
            backward(learner, 0, shard);
        } else {
            let mut tree = Tree::default();
            for (i, shard) in self.shards.iter().enumerate() {
                backward(learner, i, shard);
                tree.push(learner.gradient().to_vec());
            }
            learner.gradient().copy_from_slice(&tree.take());
        }
        self.ranks.sum_over_ranks(learner.gradient())?;
        learner.step(self.config.max_grad_norm);
        Ok(())
    }

    /// Each shard's rows of one epoch, shuffled, from the stream of that name.
    fn orders(&self, stream: &str, epoch: usize) -> Vec<Vec<u32>> {
        let order = |shard: &Shard| {
            let mut rows = Vec::new();
            shuffle(&mut rows, shard.rollout.len(), &mut self.stream(stream, shard, epoch));
            rows
        };
        self.shards.iter().map(order).collect()
    }

    /// A random stream of a shard for an epoch.
    fn stream(&self, name: &str, shard: &Shard, epoch: usize) -> jostle_sim::StreamRng {
        self.streams.stream(name, &shard.indices([self.update, epoch as u64]))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn explained_variance_of_simple_critics() {
        let explained = |values: &[f64], returns: &[f64]| {
            let errors: Vec<f64> = returns.iter().zip(values).map(|(to, value)| to - value).collect();
            let alone = Ranks::new(Arc::new(Alone), 1).unwrap();
            let [errors, returns] = moments(&alone, returns.len(), &[[&errors, returns]]).unwrap();
            explained_variance(errors.variance, returns.variance)
        };
        let returns = [1.0, 2.0, 4.0];
        assert_eq!(explained(&returns, &returns), 1.0);
        assert_eq!(explained(&[7.0; 3], &returns), 0.0);
        assert_eq!(explained(&[1.0, 2.0, 3.0], &[5.0; 3]), 0.0);
        // Returns −1 … 1 about 10 vary by 2/3, the errors (−1, 0, 1)/2 by 1/6.
        assert!((explained(&[9.5, 10.0, 10.5], &[9.0, 10.0, 11.0]) - 0.75).abs() < 1e-12);
    }
}
