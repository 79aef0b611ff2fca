//! The report of one update: results, which are the same bytes in every repetition, and seconds,
//! which are not.

use jostle_sim::{Outcome, StepEnd};
use serde::{Deserialize, Serialize};

use crate::shard::{Judged, Shard};

/// One update's measures, ready to be logged as one record.
///
/// Rewards, returns and lengths are those of the learners in the rollout; discriminator losses and
/// accuracies are measured on the new rollout *before* training on it, so that they tell of unseen
/// data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UpdateReport {
    /// Number of this update, counted from 1.
    pub update: u64,
    /// Transitions collected since the start of the run: steps · agents · rooms. Those of a
    /// training crowd are among them, and the steps of agents that it keeps away.
    pub transitions: u64,
    /// Mean task reward of a step.
    pub task_reward: f64,
    /// Mean intrinsic reward of a step, before its weight α.
    pub intrinsic_reward: f64,
    /// Learners' episodes that ended in this rollout.
    pub episodes: EpisodeCounts,
    /// Mean undiscounted task return of those episodes; `None` when there was none.
    pub episode_return: Option<f64>,
    /// Mean length of those episodes in steps; `None` when there was none.
    pub episode_length: Option<f64>,
    /// q(z | s, a) on the new rollout.
    pub discriminator_state_action: DiscriminatorReport,
    /// q(z | s) on the new rollout.
    pub discriminator_state: DiscriminatorReport,
    /// D over a few of the rollout's observations, before the update: mean KL between behaviours,
    /// nats.
    pub diversity: f64,
    /// Mean value loss over the epochs' minibatches.
    pub value_loss: f64,
    /// 1 − Var(returns − V)/Var(returns), before the update.
    pub explained_variance: f64,
    /// Mean clipped surrogate loss over the epochs' minibatches.
    pub policy_loss: f64,
    /// Estimated `KL(π_old ‖ π)`, mean over the last epoch's minibatches.
    pub approx_kl: f64,
    /// Share of ratios outside 1 ± ε, mean over the last epoch's minibatches.
    pub clip_fraction: f64,
    /// Largest |ratio − 1| in the first minibatch, where π is still `π_old`: 0 but for rounding
    /// between batch sizes.
    pub first_ratio_deviation: f64,
    /// Entropy of the policy after the update, nats.
    pub entropy: f64,
    /// Log standard deviations of v and ω after the update.
    pub log_std: [f32; 2],
    /// Behaviours whose diversity was paid in this update; `None` where diversity is not
    /// constrained.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paid_behaviours: Option<u64>,
    /// Agents that nobody learned from; `None` where there is no training crowd.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crowd: Option<CrowdReport>,
    /// Seconds by their use.
    pub clock: Clock,
}

/// The members of a training crowd in a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CrowdReport {
    /// Transitions that were theirs.
    pub transitions: u64,
    /// Steps of agents that were not in the room.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub away: u64,
    /// The outcomes of their episodes.
    pub episodes: EpisodeCounts,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &u64) -> bool {
    *value == 0
}

/// The outcomes of the episodes of a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct EpisodeCounts {
    /// Ended in this rollout, in any way.
    pub ended: u64,
    /// Reached the goal.
    pub success: u64,
    /// Crashed into a wall or an obstacle.
    pub collision_wall: u64,
    /// Crashed into another agent.
    pub collision_agent: u64,
    /// Cut by the time limit.
    pub timeout: u64,
}

impl EpisodeCounts {
    /// Counts an episode's end; a step that ends none changes nothing.
    pub(crate) fn count(&mut self, end: StepEnd) {
        match end {
            StepEnd::Running => return,
            StepEnd::Ended(Outcome::Success) => self.success += 1,
            StepEnd::Ended(Outcome::CollisionWall) => self.collision_wall += 1,
            StepEnd::Ended(Outcome::CollisionPedestrian) => self.collision_agent += 1,
            StepEnd::Ended(Outcome::Timeout) => self.timeout += 1,
        }
        self.ended += 1;
    }
}

/// One discriminator on data it has not seen.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DiscriminatorReport {
    /// Cross-entropy, nats; ln M for one that knows nothing.
    pub loss: f64,
    /// Share of rows whose behaviour is guessed; 1/M for one that knows nothing.
    pub accuracy: f64,
}

/// Seconds per phase, by the wall clock: the only fields that differ between repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Clock {
    /// Inference and simulation (Algorithm 1, lines 5–7).
    pub rollout: f64,
    /// Of the rollout: inference of the actor.
    pub inference: f64,
    /// Of the rollout: the simulator.
    pub simulation: f64,
    /// Values, intrinsic rewards, advantages and D (lines 8–9).
    pub evaluation: f64,
    /// Training of all networks (lines 13–26).
    pub learning: f64,
    /// The whole update.
    pub total: f64,
}

impl UpdateReport {
    /// The same report with its clock at zero: what repetitions and resumed runs have in common.
    #[must_use]
    pub fn without_clock(&self) -> Self {
        Self { clock: Clock::default(), ..self.clone() }
    }
}

/// What is summed over the shards of a rollout for the report.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Totals {
    pub(crate) rewards: f64,
    pub(crate) intrinsic: f64,
    pub(crate) returns: f64,
    pub(crate) lengths: f64,
    pub(crate) episodes: EpisodeCounts,
    pub(crate) crowd: CrowdReport,
    judged: [Judged; 2],
}

impl Totals {
    /// Of one shard.
    pub(crate) fn of(shard: &Shard) -> Self {
        let rollout = &shard.rollout;
        Self {
            rewards: rollout.rewards.iter().sum(),
            intrinsic: rollout.intrinsic.iter().sum(),
            returns: rollout.return_sum,
            lengths: rollout.length_sum,
            episodes: rollout.episodes,
            crowd: rollout.crowd,
            judged: shard.judged,
        }
    }

    /// All of it as numbers; counts are exact in them.
    pub(crate) fn to_vec(self) -> Vec<f64> {
        let Self { rewards, intrinsic, returns, lengths, episodes, crowd, judged } = self;
        let sums = [rewards, intrinsic, returns, lengths];
        let counts = [crowd.transitions, crowd.away]
            .into_iter()
            .chain([episodes, crowd.episodes].into_iter().flat_map(EpisodeCounts::to_array));
        let judged = judged.into_iter().flat_map(|Judged { loss, hits }| [loss, hits]);
        sums.into_iter().chain(counts.map(|count| count as f64)).chain(judged).collect()
    }

    /// The inverse of [`Self::to_vec`].
    pub(crate) fn from_slice(values: &[f64]) -> Self {
        let mut values = values.iter().copied();
        let mut next = || values.next().expect("as many numbers as `to_vec` gives");
        let [rewards, intrinsic, returns, lengths] = std::array::from_fn(|_| next());
        let [transitions, away] = std::array::from_fn(|_| next() as u64);
        let [episodes, of_crowd] =
            std::array::from_fn(|_| EpisodeCounts::from_array(std::array::from_fn(|_| next() as u64)));
        let judged = std::array::from_fn(|_| Judged { loss: next(), hits: next() });
        let crowd = CrowdReport { transitions, away, episodes: of_crowd };
        Self { rewards, intrinsic, returns, lengths, episodes, crowd, judged }
    }

    /// A sum over the ended episodes as a mean.
    pub(crate) fn mean_per_episode(&self, sum: f64) -> Option<f64> {
        (self.episodes.ended > 0).then(|| sum / self.episodes.ended as f64)
    }

    /// Both discriminators over `n` rows.
    pub(crate) fn discriminators(&self, n: f64) -> [DiscriminatorReport; 2] {
        self.judged.map(|Judged { loss, hits }| DiscriminatorReport { loss: loss / n, accuracy: hits / n })
    }
}

impl EpisodeCounts {
    fn to_array(self) -> [u64; 5] {
        [self.ended, self.success, self.collision_wall, self.collision_agent, self.timeout]
    }

    fn from_array([ended, success, collision_wall, collision_agent, timeout]: [u64; 5]) -> Self {
        Self { ended, success, collision_wall, collision_agent, timeout }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_are_what_they_were_as_numbers() {
        let counts = |first: u64| EpisodeCounts::from_array(std::array::from_fn(|i| first + i as u64));
        let totals = Totals {
            rewards: 1.5,
            intrinsic: -2.0,
            returns: 3.25,
            lengths: 4.0,
            episodes: counts(10),
            crowd: CrowdReport { transitions: 7, away: 8, episodes: counts(20) },
            judged: [Judged { loss: 0.5, hits: 3.0 }, Judged { loss: 0.25, hits: 4.0 }],
        };
        assert_eq!(Totals::from_slice(&totals.to_vec()), totals);
        assert_eq!(totals.discriminators(2.0)[1], DiscriminatorReport { loss: 0.125, accuracy: 2.0 });
    }
}
