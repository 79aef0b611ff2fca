//! The data of one update: preallocated buffers over T steps and A agents, step after step.

use jostle_policy::encoder::EncoderScratch;
use jostle_policy::{Batch, Encoder};
use jostle_sim::{Outcome, Role, Rooms, StepEnd};

use crate::PpoError;
use crate::config::AlphaWeighs;
use crate::gae::{self, StepFate};
use crate::report::{CrowdReport, EpisodeCounts};

/// T steps of A agents.
///
/// # Shapes
///
/// All buffers are row-major `[T, A]` with row index t·A + a, until `keep_learners` leaves out the
/// rows of a training crowd; the others keep their order. `observations` and `tokens` hold rows
/// beyond T·A: first the A observations after the last step, then the last observations of
/// truncated episodes, whose values are needed, too. `fates` and `places` are `[T, A]` always.
#[derive(Debug)]
pub struct Rollout {
    n_steps: usize,
    n_agents: usize,
    width: usize,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    /// Sampled actions, unclipped.
    pub(crate) actions: Vec<[f32; 2]>,
    /// The actions that the robots executed.
    pub(crate) executed: Vec<[f32; 2]>,
    /// `log π_old(a | s, z)`.
    pub(crate) log_probs: Vec<f64>,
    /// Task rewards.
    pub(crate) rewards: Vec<f64>,
    /// Intrinsic rewards, without α.
    pub(crate) intrinsic: Vec<f64>,
    fates: Vec<StepFate>,
    /// Place of the row of a step and an agent among the learners' rows; `None` where nobody learns
    /// from it.
    places: Vec<Option<u32>>,
    n_learned: usize,
    /// Rows whose episode was truncated, with its last observation (kept where truncation is
    /// bootstrapped).
    truncated: Vec<(usize, Vec<f32>)>,
    /// V of the observations acted on.
    pub(crate) values: Vec<f64>,
    /// GAE, normalised over the rollout.
    pub(crate) advantages: Vec<f64>,
    /// Targets of the value function: GAE before normalisation, plus V.
    pub(crate) returns: Vec<f64>,
    pub(crate) episodes: EpisodeCounts,
    pub(crate) return_sum: f64,
    /// The learners' episodes that ended: behaviour and undiscounted task return.
    pub(crate) ended: Vec<(u32, f64)>,
    pub(crate) length_sum: f64,
    /// The rows and episodes that nobody learns from.
    pub(crate) crowd: CrowdReport,
}

impl Rollout {
    /// Buffers for `n_steps` steps of `n_agents` agents with input rows of `width` values.
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
            places: Vec::with_capacity(n),
            n_learned: n,
            truncated: Vec::new(),
            values: vec![0.0; n],
            advantages: vec![0.0; n],
            returns: vec![0.0; n],
            episodes: EpisodeCounts::default(),
            return_sum: 0.0,
            ended: Vec::new(),
            length_sum: 0.0,
            crowd: CrowdReport::default(),
        }
    }

    /// Number of transitions that are learned from: T·A where there is no training crowd.
    pub fn len(&self) -> usize {
        self.n_learned
    }

    /// Number of transitions that were collected, T·A.
    pub(crate) fn n_collected(&self) -> usize {
        self.n_steps * self.n_agents
    }

    /// True if there is no transition.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Observations that were acted on, `[len, width]`.
    pub fn observations(&self) -> &[f32] {
        &self.observations[..self.len() * self.width]
    }

    /// Behaviour tokens that were acted with, `[len]`.
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
        self.places.clear();
        self.n_learned = 0;
        self.truncated.clear();
        self.episodes = EpisodeCounts::default();
        (self.return_sum, self.length_sum) = (0.0, 0.0);
        self.ended.clear();
        self.crowd = CrowdReport::default();
    }

    /// Appends what all agents see, [A, width], and which behaviour they follow, [A].
    ///
    /// # Errors
    ///
    /// [`PpoError::NotFinite`] naming the agent whose observation is not finite; nothing is
    /// appended then.
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
        let first = self.tokens.len() - self.n_agents;
        for (agent, transition) in rooms.transitions().iter().enumerate() {
            self.executed.push(transition.executed);
            self.rewards.push(f64::from(transition.reward));
            self.fates.push(match transition.end {
                StepEnd::Running => StepFate::Running,
                StepEnd::Ended(Outcome::Timeout) => StepFate::Truncated { bootstrap_value: 0.0 },
                StepEnd::Ended(_) => StepFate::Terminated,
            });
            if !transition.role.learns() {
                self.places.push(None);
                let is_away = transition.role == Role::Absent;
                self.crowd.transitions += u64::from(!is_away);
                self.crowd.away += u64::from(is_away);
                self.crowd.episodes.count(transition.end);
                continue;
            }
            self.places.push(Some(self.n_learned as u32));
            self.n_learned += 1;
            if transition.end == StepEnd::Running {
                continue;
            }
            self.episodes.count(transition.end);
            if let Some(episode) = &transition.episode {
                self.return_sum += episode.episode_return;
                self.length_sum += f64::from(episode.steps);
                self.ended.push((self.tokens[first + agent], episode.episode_return));
            }
        }
    }

    /// Keeps the last observations of the episodes that the last step cut, so that their values can
    /// be had.
    pub(crate) fn keep_truncated(&mut self, rooms: &Rooms, encoder: &Encoder) {
        let first = self.fates.len() - self.n_agents;
        for agent in 0..self.n_agents {
            let learns = self.places[first + agent].is_some();
            if learns && matches!(self.fates[first + agent], StepFate::Truncated { .. }) {
                let mut input = Vec::with_capacity(self.width);
                encoder.append(rooms.final_observation(agent), &mut EncoderScratch::default(), &mut input);
                self.truncated.push((first + agent, input));
            }
        }
    }

    /// Leaves out the rows that nobody learns from, so that all that follows (rewards, advantages,
    /// losses) is of the learners' rows alone. To be called once all steps are there; without a
    /// training crowd nothing is moved.
    pub(crate) fn keep_learners(&mut self) {
        let n = self.n_collected();
        if self.n_learned == n {
            return;
        }
        let (width, rows) = (self.width, self.observations.len() / self.width);
        // The rows behind the steps are values' alone, and stay.
        let kept = (0..rows).filter(|row| *row >= n || self.places[*row].is_some());
        let mut n_kept = 0;
        for (to, from) in kept.enumerate() {
            self.observations.copy_within(from * width..(from + 1) * width, to * width);
            self.tokens[to] = self.tokens[from];
            n_kept = to + 1;
        }
        self.observations.truncate(n_kept * width);
        self.tokens.truncate(n_kept);
        keep(&mut self.actions, &self.places);
        keep(&mut self.executed, &self.places);
        keep(&mut self.log_probs, &self.places);
        keep(&mut self.rewards, &self.places);
    }

    /// Appends the kept last observations to the rows that will be valued.
    pub(crate) fn value_truncations(&mut self) {
        for (row, observation) in &self.truncated {
            self.observations.extend_from_slice(observation);
            let row = self.places[*row].expect("only learners' last observations are kept");
            self.tokens.push(self.tokens[row as usize]);
        }
    }

    /// Algorithm 1, line 9, for each agent's own sequence: advantages and the value targets.
    ///
    /// Where α weighs rewards, of r + α·intrinsic; where it weighs advantages, of r alone, and the
    /// advantages of the intrinsic rewards are returned, to be added by
    /// [`Self::add_intrinsic_advantages`] once both are normalised.
    ///
    /// # Shapes
    ///
    /// `values` is [len + A (+ truncations)], as [`Self::rows_to_value`] orders them; `alphas` [M],
    /// one for each behaviour.
    pub(crate) fn estimate_advantages(
        &mut self,
        values: &[f32],
        (alphas, weighs): (&[f64], AlphaWeighs),
        discounts: (f64, f64),
    ) -> Option<Vec<f64>> {
        let (n, n_agents) = (self.len(), self.n_agents);
        for buffer in [&mut self.values, &mut self.advantages, &mut self.returns] {
            buffer.resize(n, 0.0);
        }
        let (acted, behind) = values.split_at(n);
        let (last, truncations) = behind.split_at(n_agents);
        self.values.iter_mut().zip(acted).for_each(|(to, &v)| *to = f64::from(v));
        // Without the switch no truncation was valued, and its bootstrap value stays 0.
        for ((row, _), &v) in self.truncated.iter().zip(truncations) {
            self.fates[*row] = StepFate::Truncated { bootstrap_value: f64::from(v) };
        }
        let of_reward = |row: usize| match weighs {
            AlphaWeighs::Reward => alphas[self.tokens[row] as usize],
            AlphaWeighs::Advantage => 0.0,
        };
        let mut advantages = std::mem::take(&mut self.advantages);
        self.of_sequences(
            discounts,
            &mut advantages,
            |agent| f64::from(last[agent]),
            |row, fate| (self.rewards[row] + of_reward(row) * self.intrinsic[row], self.values[row], fate),
        );
        self.advantages = advantages;
        for ((to, advantage), value) in self.returns.iter_mut().zip(&self.advantages).zip(&self.values) {
            *to = advantage + value;
        }
        (weighs == AlphaWeighs::Advantage).then(|| self.intrinsic_advantages(discounts))
    }

    /// Advantages of the intrinsic rewards, without a value function.
    fn intrinsic_advantages(&self, discounts: (f64, f64)) -> Vec<f64> {
        let mut intrinsic = vec![0.0; self.len()];
        self.of_sequences(
            discounts,
            &mut intrinsic,
            |_| 0.0,
            |row, fate| {
                let fate = match fate {
                    StepFate::Truncated { .. } => StepFate::Terminated,
                    fate => fate,
                };
                (self.intrinsic[row], 0.0, fate)
            },
        );
        intrinsic
    }

    /// Adds α times the advantages of the intrinsic rewards.
    pub(crate) fn add_intrinsic_advantages(&mut self, alphas: &[f64], intrinsic: &[f64]) {
        for ((sum, advantage), token) in self.advantages.iter_mut().zip(intrinsic).zip(&self.tokens) {
            *sum += alphas[*token as usize] * advantage;
        }
    }

    /// The values' errors: targets minus values.
    pub(crate) fn value_errors(&self) -> Vec<f64> {
        self.returns.iter().zip(&self.values).map(|(target, value)| target - value).collect()
    }

    /// Advantages of each agent's own sequence: `of` gives reward, value and fate of a row with its
    /// fate, `last_value` what stands behind an agent's last step. A step that nobody learns from
    /// ends a sequence: an episode is one's or the other's.
    fn of_sequences(
        &self,
        discounts: (f64, f64),
        advantages: &mut [f64],
        last_value: impl Fn(usize) -> f64,
        of: impl Fn(usize, StepFate) -> (f64, f64, StepFate),
    ) {
        let mut sequence = Sequence::new(self.n_steps);
        for agent in 0..self.n_agents {
            for t in 0..self.n_steps {
                let at = t * self.n_agents + agent;
                let step = self.places[at].map(|row| of(row as usize, self.fates[at]));
                (sequence.rewards[t], sequence.values[t], sequence.fates[t]) =
                    step.unwrap_or((0.0, 0.0, StepFate::Terminated));
            }
            sequence.advantages(last_value(agent), discounts);
            for (t, &advantage) in sequence.advantages.iter().enumerate() {
                if let Some(row) = self.places[t * self.n_agents + agent] {
                    advantages[row as usize] = advantage;
                }
            }
        }
    }
}

/// Leaves out the values of steps without a place.
fn keep<T>(values: &mut Vec<T>, places: &[Option<u32>]) {
    let mut places = places.iter();
    values.retain(|_| places.next().is_some_and(Option::is_some));
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
        rollout.tokens = vec![0, 1, 0, 1, 0, 1];
        rollout.rewards = vec![1.0, 0.0, 2.0, 1.0, -1.0, 3.0];
        rollout.intrinsic = vec![0.5, 0.0, 0.25, 1.0, 0.0, 2.0];
        rollout.fates = vec![StepFate::Running; 6];
        rollout.places = (0..6).map(Some).collect();
        rollout.fates[2] = StepFate::Truncated { bootstrap_value: 0.0 };
        rollout
    }

    const VALUES: [f32; 8] = [0.5, 1.0, -0.5, 2.0, 1.0, 0.25, 3.0, -1.0];
    const HALF: (f64, f64) = (0.5, 1.0);

    /// Algorithm 1, line 9, where one shard is the whole rollout.
    fn estimate(
        rollout: &mut Rollout,
        values: &[f32],
        (alphas, weighs): (&[f64], AlphaWeighs),
        discounts: (f64, f64),
    ) {
        if let Some(mut intrinsic) = rollout.estimate_advantages(values, (alphas, weighs), discounts) {
            gae::normalise(&mut rollout.advantages);
            gae::normalise(&mut intrinsic);
            rollout.add_intrinsic_advantages(alphas, &intrinsic);
        }
    }

    fn advantages(alpha: f64, weighs: AlphaWeighs, scale: f64) -> (Vec<f64>, Vec<f64>) {
        let mut rollout = rollout();
        rollout.intrinsic.iter_mut().for_each(|reward| *reward *= scale);
        estimate(&mut rollout, &VALUES, (&[alpha; 8], weighs), HALF);
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

    /// The rollout above with agent 1 a member of a crowd in its second step, between two episodes
    /// of a learner.
    fn crowded(garbage: f64) -> Rollout {
        let mut rollout = rollout();
        rollout.observations = [0.0, 1.0, 2.0, garbage as f32, 4.0, 5.0, 6.0, 7.0].to_vec();
        rollout.tokens = vec![0, 1, 2, 99, 4, 5, 6, 7];
        rollout.actions = (0..6).map(|i| [i as f32; 2]).collect();
        rollout.executed = rollout.actions.clone();
        rollout.log_probs = (0..6).map(f64::from).collect();
        (rollout.rewards[3], rollout.log_probs[3], rollout.actions[3]) = (garbage, garbage, [99.0; 2]);
        rollout.fates[1] = StepFate::Terminated;
        rollout.fates[3] = StepFate::Truncated { bootstrap_value: garbage };
        rollout.places = vec![Some(0), Some(1), Some(2), None, Some(3), Some(4)];
        rollout.n_learned = 5;
        rollout
    }

    #[test]
    fn rows_that_nobody_learns_from_are_left_out() {
        let mut rollout = crowded(7.0);
        rollout.keep_learners();
        assert_eq!((rollout.len(), rollout.n_collected()), (5, 6));
        assert_eq!(rollout.observations(), [0.0, 1.0, 2.0, 4.0, 5.0]);
        assert_eq!(rollout.rows_to_value().len(), 7, "and what stands behind the last step");
        assert_eq!(rollout.tokens, [0, 1, 2, 4, 5, 6, 7]);
        assert_eq!(rollout.actions, [0.0, 1.0, 2.0, 4.0, 5.0].map(|x| [x; 2]));
        assert_eq!(rollout.executed, rollout.actions);
        assert_eq!(rollout.log_probs, [0.0, 1.0, 2.0, 4.0, 5.0]);
        assert_eq!(rollout.rewards, [1.0, 0.0, 2.0, -1.0, 3.0]);
    }

    #[test]
    fn what_nobody_learns_from_changes_no_advantage() {
        for weighs in [AlphaWeighs::Reward, AlphaWeighs::Advantage] {
            let [(advantages, returns), other] = [7.0, -1e6].map(|garbage| {
                let mut rollout = crowded(garbage);
                rollout.keep_learners();
                rollout.intrinsic = vec![0.5, 0.0, 0.25, 0.0, 2.0];
                estimate(&mut rollout, &[0.5, 1.0, -0.5, 1.0, 0.25, 3.0, -1.0], (&[0.5; 8], weighs), HALF);
                (rollout.advantages, rollout.returns)
            });
            assert_eq!((&advantages, &returns), (&other.0, &other.1));
            assert_eq!(advantages.len(), 5);
            if weighs == AlphaWeighs::Reward {
                // Agent 1: a step that ends its episode, then the last step of another, with −1
                // behind it.
                let agent = [0.0 + 0.5 * 0.0 - 1.0, 3.0 + 0.5 * 2.0 + -0.5 - 0.25];
                assert_eq!([advantages[1], advantages[4]], agent);
                // Agent 0 as ever: 1 + 0.25 and 2 + 0.125 up to the cut, then −1 with 3 behind it.
                let agent = [1.25 + 0.5 * 2.125 - 0.5, 2.125 + 0.5, -1.0 + 0.5 * 3.0 - 1.0];
                assert_eq!([advantages[0], advantages[2], advantages[3]], agent);
            }
        }
    }

    #[test]
    fn weighed_rewards_are_one_reward() {
        let (found, returns) = advantages(2.0, AlphaWeighs::Reward, 1.0);
        // γ = 0.5, λ = 1. Agent 0: r + 2·int = 2, 2.5 | −1 with V = 0.5, −0.5 | 1 and 3 behind the
        // last step.
        assert_eq!([found[0], found[2], found[4]], [2.0 + 0.5 * 2.5 - 0.5, 2.5 + 0.5, -1.0 + 1.5 - 1.0]);
        assert_eq!(returns[0], found[0] + 0.5);
    }

    #[test]
    fn each_behaviour_has_its_own_weight() {
        let mut rollout = rollout();
        estimate(&mut rollout, &VALUES, (&[2.0, 0.0], AlphaWeighs::Reward), HALF);
        let (paid, unpaid) =
            (advantages(2.0, AlphaWeighs::Reward, 1.0).0, advantages(0.0, AlphaWeighs::Reward, 1.0).0);
        let agents = |of: &[f64], first: usize| [of[first], of[first + 2], of[first + 4]];
        assert_eq!(agents(&rollout.advantages, 0), agents(&paid, 0));
        assert_eq!(agents(&rollout.advantages, 1), agents(&unpaid, 1));
        assert_ne!(agents(&paid, 1), agents(&unpaid, 1));

        estimate(&mut rollout, &VALUES, (&[0.5, 0.0], AlphaWeighs::Advantage), HALF);
        let mut task = unpaid;
        gae::normalise(&mut task);
        assert_eq!(agents(&rollout.advantages, 1), agents(&task, 1));
        assert_ne!(agents(&rollout.advantages, 0), agents(&task, 0));
    }

    #[test]
    fn weighed_advantages_are_shares_whatever_the_scale() {
        let (task, targets) = advantages(0.0, AlphaWeighs::Reward, 1.0);
        let (found, returns) = advantages(0.25, AlphaWeighs::Advantage, 1.0);
        assert_eq!(returns, targets, "V is the task's");
        // Discounted intrinsic rewards to the episode's end: agent 0: 0.5 + 0.5·0.25, 0.25 | 0;
        // agent 1: 0 + 0.5·2, 2, 2.
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
