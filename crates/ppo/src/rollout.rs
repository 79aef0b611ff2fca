//! The data of one update: preallocated buffers over T steps and A agents, step after step.

use jostle_policy::Batch;
use jostle_sim::{Rooms, StepEnd};

use crate::PpoError;
use crate::config::AlphaWeighs;
use crate::gae::{self, StepFate};
use crate::report::EpisodeCounts;

/// T steps of A agents.
///
/// # Shapes
///
/// All buffers are row-major `[T, A]` with row index t·A + a. `observations` and `tokens` hold rows beyond T·A: first the
/// A observations after the last step, then the last observations of truncated episodes, whose values are needed, too.
#[derive(Debug)]
pub struct Rollout {
    n_steps: usize,
    n_agents: usize,
    width: usize,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    /// Sampled actions, unclipped.
    pub(crate) actions: Vec<[f32; 2]>,
    /// What the robots executed.
    pub(crate) executed: Vec<[f32; 2]>,
    /// `log π_old(a | s, z)`.
    pub(crate) log_probs: Vec<f64>,
    /// Task rewards.
    pub(crate) rewards: Vec<f64>,
    /// Intrinsic rewards, without α.
    pub(crate) intrinsic: Vec<f64>,
    fates: Vec<StepFate>,
    /// Rows whose episode was truncated, with its last observation (kept where truncation is bootstrapped).
    truncated: Vec<(usize, Vec<f32>)>,
    /// V of the observations acted on.
    pub(crate) values: Vec<f64>,
    /// GAE, normalised over the rollout.
    pub(crate) advantages: Vec<f64>,
    /// Targets of the value function: GAE before normalisation, plus V.
    pub(crate) returns: Vec<f64>,
    pub(crate) episodes: EpisodeCounts,
    pub(crate) return_sum: f64,
    pub(crate) length_sum: f64,
}

impl Rollout {
    /// Buffers for `n_steps` steps of `n_agents` agents with observations of `width` values.
    pub fn new(n_steps: usize, n_agents: usize, width: usize) -> Self {
        let n = n_steps * n_agents;
        Self {
            n_steps,
            n_agents,
            width,
            observations: Vec::with_capacity((n + 2 * n_agents) * width),
            tokens: Vec::with_capacity(n + 2 * n_agents),
            actions: Vec::with_capacity(n),
            executed: Vec::with_capacity(n),
            log_probs: Vec::with_capacity(n),
            rewards: Vec::with_capacity(n),
            intrinsic: vec![0.0; n],
            fates: Vec::with_capacity(n),
            truncated: Vec::new(),
            values: vec![0.0; n],
            advantages: vec![0.0; n],
            returns: vec![0.0; n],
            episodes: EpisodeCounts::default(),
            return_sum: 0.0,
            length_sum: 0.0,
        }
    }

    /// Number of transitions, T·A.
    pub fn len(&self) -> usize {
        self.n_steps * self.n_agents
    }

    /// Whether there is no transition.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Observations that were acted on, `[T·A, width]`.
    pub fn observations(&self) -> &[f32] {
        &self.observations[..self.len() * self.width]
    }

    /// Behaviour tokens that were acted with, `[T·A]`.
    pub fn tokens(&self) -> &[u32] {
        &self.tokens[..self.len()]
    }

    /// A minibatch by its rows.
    pub fn batch<'a>(&'a self, rows: &'a [u32]) -> Batch<'a> {
        Batch::subset(self.observations(), self.tokens(), rows)
    }

    /// Every row whose value is needed: acted on, after the last step, and at truncations.
    pub(crate) fn rows_to_value(&self) -> Batch<'_> {
        Batch::new(&self.observations, &self.tokens)
    }

    /// Forgets the last update's steps.
    pub(crate) fn clear(&mut self) {
        self.observations.clear();
        self.tokens.clear();
        self.actions.clear();
        self.executed.clear();
        self.log_probs.clear();
        self.rewards.clear();
        self.fates.clear();
        self.truncated.clear();
        self.episodes = EpisodeCounts::default();
        (self.return_sum, self.length_sum) = (0.0, 0.0);
    }

    /// Appends what all agents see, [A, width], and which behaviour they follow, [A].
    ///
    /// # Errors
    ///
    /// [`PpoError::NotFinite`] naming the agent whose observation is not finite; nothing is appended then.
    pub(crate) fn push_observations(
        &mut self,
        observations: &[f32],
        tokens: &[u32],
        update: u64,
    ) -> Result<(), PpoError> {
        for (agent, row) in observations.chunks_exact(self.width).enumerate() {
            if row.iter().any(|x| !x.is_finite()) {
                return Err(PpoError::NotFinite { update, tensor: "observation".into(), agent: Some(agent) });
            }
        }
        self.observations.extend_from_slice(observations);
        self.tokens.extend_from_slice(tokens);
        Ok(())
    }

    /// The last [A, width] observations pushed, with their tokens.
    pub(crate) fn present(&self) -> Batch<'_> {
        let n = self.tokens.len() - self.n_agents;
        Batch::new(&self.observations[n * self.width..], &self.tokens[n..])
    }

    /// Appends what the simulator answered to the step's actions.
    pub(crate) fn push_transitions(&mut self, rooms: &Rooms) {
        for transition in rooms.transitions() {
            self.executed.push(transition.executed);
            self.rewards.push(f64::from(transition.reward));
            self.fates.push(match transition.end {
                StepEnd::Running => StepFate::Running,
                StepEnd::Terminated(_) => StepFate::Terminated,
                StepEnd::Truncated => StepFate::Truncated { bootstrap_value: 0.0 },
            });
            if transition.end == StepEnd::Running {
                continue;
            }
            self.episodes.count(transition.end);
            if let Some(episode) = &transition.episode {
                self.return_sum += episode.episode_return;
                self.length_sum += f64::from(episode.steps);
            }
        }
    }

    /// Keeps the last observations of the episodes that the last step cut, so that their values can be had.
    pub(crate) fn keep_truncated(&mut self, rooms: &Rooms) {
        let first = self.fates.len() - self.n_agents;
        for agent in 0..self.n_agents {
            if matches!(self.fates[first + agent], StepFate::Truncated { .. }) {
                self.truncated.push((first + agent, rooms.final_observation(agent).to_vec()));
            }
        }
    }

    /// Appends the kept last observations to the rows that will be valued.
    pub(crate) fn value_truncations(&mut self) {
        for (row, observation) in &self.truncated {
            self.observations.extend_from_slice(observation);
            self.tokens.push(self.tokens[*row]);
        }
    }

    /// Algorithm 1, line 9, for each agent's own sequence: advantages and the value targets.
    ///
    /// Where α weighs rewards, of r + α·intrinsic; where it weighs advantages, those of r, normalised, plus α times those of the
    /// intrinsic rewards, normalised, and targets of r alone.
    ///
    /// # Shapes
    ///
    /// `values` is [T·A + A (+ truncations)], as [`Self::rows_to_value`] orders them.
    pub(crate) fn estimate_advantages(
        &mut self,
        values: &[f32],
        (alpha, weighs): (f64, AlphaWeighs),
        discounts: (f64, f64),
    ) {
        let (n, n_agents) = (self.len(), self.n_agents);
        let (acted, behind) = values.split_at(n);
        let (last, truncations) = behind.split_at(n_agents);
        self.values.iter_mut().zip(acted).for_each(|(to, &v)| *to = f64::from(v));
        // Without the switch no truncation was valued, and its bootstrap value stays 0.
        for ((row, _), &v) in self.truncated.iter().zip(truncations) {
            self.fates[*row] = StepFate::Truncated { bootstrap_value: f64::from(v) };
        }
        let of_reward = if weighs == AlphaWeighs::Reward { alpha } else { 0.0 };
        let mut advantages = std::mem::take(&mut self.advantages);
        self.of_sequences(
            discounts,
            &mut advantages,
            |agent| f64::from(last[agent]),
            |row| (self.rewards[row] + of_reward * self.intrinsic[row], self.values[row], self.fates[row]),
        );
        self.advantages = advantages;
        for ((to, advantage), value) in self.returns.iter_mut().zip(&self.advantages).zip(&self.values) {
            *to = advantage + value;
        }
        if weighs == AlphaWeighs::Advantage {
            self.add_intrinsic_advantages(alpha, discounts);
        }
    }

    /// Normalises the advantages and adds α times the normalised ones of the intrinsic rewards.
    fn add_intrinsic_advantages(&mut self, alpha: f64, discounts: (f64, f64)) {
        let mut intrinsic = vec![0.0; self.len()];
        self.of_sequences(
            discounts,
            &mut intrinsic,
            |_| 0.0,
            |row| {
                let fate = match self.fates[row] {
                    StepFate::Truncated { .. } => StepFate::Terminated,
                    fate => fate,
                };
                (self.intrinsic[row], 0.0, fate)
            },
        );
        gae::normalise(&mut self.advantages);
        gae::normalise(&mut intrinsic);
        self.advantages.iter_mut().zip(&intrinsic).for_each(|(sum, advantage)| *sum += alpha * advantage);
    }

    /// Advantages of each agent's own sequence: `of` gives a row's reward, value and fate, `last_value` what stands behind an
    /// agent's last step.
    fn of_sequences(
        &self,
        discounts: (f64, f64),
        advantages: &mut [f64],
        last_value: impl Fn(usize) -> f64,
        of: impl Fn(usize) -> (f64, f64, StepFate),
    ) {
        let mut sequence = Sequence::new(self.n_steps);
        for agent in 0..self.n_agents {
            for t in 0..self.n_steps {
                (sequence.rewards[t], sequence.values[t], sequence.fates[t]) = of(t * self.n_agents + agent);
            }
            sequence.advantages(last_value(agent), discounts);
            for (t, &advantage) in sequence.advantages.iter().enumerate() {
                advantages[t * self.n_agents + agent] = advantage;
            }
        }
    }

    /// A sum over the ended episodes as a mean.
    pub(crate) fn mean_per_episode(&self, sum: f64) -> Option<f64> {
        (self.episodes.ended > 0).then(|| sum / self.episodes.ended as f64)
    }
}

/// One agent's steps side by side, as [`gae::advantages`] reads them.
struct Sequence {
    rewards: Vec<f64>,
    values: Vec<f64>,
    fates: Vec<StepFate>,
    advantages: Vec<f64>,
}

impl Sequence {
    fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self { rewards: zeros(), values: zeros(), fates: vec![StepFate::Running; n], advantages: zeros() }
    }

    fn advantages(&mut self, last_value: f64, discounts: (f64, f64)) {
        let Self { rewards, values, fates, advantages } = self;
        gae::advantages(rewards, values, fates, last_value, discounts, advantages);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two agents, three steps each; agent 0's episode ends at its second step.
    fn rollout() -> Rollout {
        let mut rollout = Rollout::new(3, 2, 1);
        rollout.rewards = vec![1.0, 0.0, 2.0, 1.0, -1.0, 3.0];
        rollout.intrinsic = vec![0.5, 0.0, 0.25, 1.0, 0.0, 2.0];
        rollout.fates = vec![StepFate::Running; 6];
        rollout.fates[2] = StepFate::Truncated { bootstrap_value: 0.0 };
        rollout
    }

    const VALUES: [f32; 8] = [0.5, 1.0, -0.5, 2.0, 1.0, 0.25, 3.0, -1.0];
    const HALF: (f64, f64) = (0.5, 1.0);

    fn advantages(alpha: f64, weighs: AlphaWeighs, scale: f64) -> (Vec<f64>, Vec<f64>) {
        let mut rollout = rollout();
        rollout.intrinsic.iter_mut().for_each(|reward| *reward *= scale);
        rollout.estimate_advantages(&VALUES, (alpha, weighs), HALF);
        (rollout.advantages, rollout.returns)
    }

    #[test]
    fn an_observation_that_is_not_finite_is_named_with_its_agent_and_left_out() {
        let mut rollout = Rollout::new(3, 2, 3);
        rollout.push_observations(&[0.0; 6], &[4, 0], 7).unwrap();
        for (at, value) in [(0, f32::NAN), (2, f32::INFINITY), (3, f32::NEG_INFINITY), (5, f32::NAN)] {
            let mut observations = [0.5; 6];
            observations[at] = value;
            let refusal = rollout.push_observations(&observations, &[1, 2], 7).unwrap_err();
            assert_eq!(
                refusal.to_string(),
                format!("update 7: observation of agent {} is not finite", at / 3)
            );
            assert_eq!((rollout.observations.len(), rollout.tokens.len()), (6, 2));
        }
    }

    #[test]
    fn weighed_rewards_are_one_reward() {
        let (found, returns) = advantages(2.0, AlphaWeighs::Reward, 1.0);
        // γ = 0.5, λ = 1. Agent 0: r + 2·int = 2, 2.5 | −1 with V = 0.5, −0.5 | 1 and 3 behind the last step.
        assert_eq!([found[0], found[2], found[4]], [2.0 + 0.5 * 2.5 - 0.5, 2.5 + 0.5, -1.0 + 1.5 - 1.0]);
        assert_eq!(returns[0], found[0] + 0.5);
    }

    #[test]
    fn weighed_advantages_are_shares_whatever_the_scale() {
        let (task, targets) = advantages(0.0, AlphaWeighs::Reward, 1.0);
        let (found, returns) = advantages(0.25, AlphaWeighs::Advantage, 1.0);
        assert_eq!(returns, targets, "V is the task's");
        // Discounted intrinsic rewards to the episode's end: agent 0: 0.5 + 0.5·0.25, 0.25 | 0; agent 1: 0 + 0.5·2, 2, 2.
        let mut intrinsic = vec![0.625, 1.0, 0.25, 2.0, 0.0, 2.0];
        let mut expected = task;
        gae::normalise(&mut expected);
        gae::normalise(&mut intrinsic);
        for (sum, part) in expected.iter_mut().zip(&intrinsic) {
            *sum += 0.25 * part;
        }
        assert_eq!(found, expected);
        for (louder, found) in advantages(0.25, AlphaWeighs::Advantage, 1e3).0.iter().zip(&found) {
            assert!((louder - found).abs() < 1e-6, "{louder} {found}");
        }
        let (silent, _) = advantages(0.25, AlphaWeighs::Advantage, 0.0);
        assert!(silent.iter().sum::<f64>().abs() < 1e-9, "no intrinsic reward: the task's advantages alone");
    }
}
