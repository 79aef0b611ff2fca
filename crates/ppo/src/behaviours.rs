//! Each behaviour's conduct in the training world, and its pay for it: a look at a trainer without
//! learning.
//!
//! The curves of a run are means over all behaviours. They do not show one that stands still for
//! its intrinsic reward while the others arrive.

use std::sync::Arc;

use jostle_diversity::cross_entropy::log_softmax_at;
use serde::{Deserialize, Serialize};

use crate::algorithm1::Trainer;
use crate::report::EpisodeCounts;
use crate::{Clock, PpoError};

/// One behaviour over all its transitions.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BehaviourReport {
    /// Transitions made with this token.
    pub transitions: u64,
    /// The outcomes of its episodes.
    pub episodes: EpisodeCounts,
    /// Mean executed forward speed, m/s.
    pub speed: f64,
    /// Mean executed |ω|, rad/s.
    pub turn_rate: f64,
    /// Mean task reward of a step.
    pub task_reward: f64,
    /// Mean log q(z | s, a) of the token that acted, nats; −ln M for a guess.
    pub log_q_state_action: f64,
    /// Mean log q(z | s), nats.
    pub log_q_state: f64,
    /// Mean intrinsic reward of a step, before its weight α, by the run's variant.
    pub intrinsic_reward: f64,
}

impl BehaviourReport {
    /// Sums to means.
    fn finish(&mut self) {
        let n = (self.transitions as f64).max(1.0);
        for sum in [
            &mut self.speed,
            &mut self.turn_rate,
            &mut self.task_reward,
            &mut self.log_q_state_action,
            &mut self.log_q_state,
            &mut self.intrinsic_reward,
        ] {
            *sum /= n;
        }
    }
}

impl Trainer {
    /// Acts for `rollouts` rollouts without learning and reports each of the M behaviours, by its
    /// token.
    ///
    /// The policy acts as in training, by samples, among the run's training crowd, which is not
    /// counted. The rooms go on from where they are, so the trainer is used up.
    ///
    /// # Errors
    ///
    /// [`PpoError::NotFinite`] as in training.
    pub fn behaviours(mut self, rollouts: usize) -> Result<Vec<BehaviourReport>, PpoError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| {
            let mut reports = vec![BehaviourReport::default(); self.config.n_behaviours];
            for _ in 0..rollouts {
                self.update += 1;
                self.look(&mut reports)?;
            }
            reports.iter_mut().for_each(BehaviourReport::finish);
            Ok(reports)
        })
    }

    /// One rollout, added up.
    fn look(&mut self, reports: &mut [BehaviourReport]) -> Result<(), PpoError> {
        self.shards.iter_mut().for_each(|shard| shard.rollout.clear());
        for step in 0..self.config.horizon as u64 {
            let acting: Vec<Vec<u32>> =
                self.shards.iter().map(|shard| shard.rooms.tokens().to_vec()).collect();
            self.act(step, &mut Clock::default())?;
            for (shard, acting) in self.shards.iter().zip(&acting) {
                let steps = shard.rooms.transitions().iter().zip(acting);
                for (transition, &token) in steps.filter(|(transition, _)| transition.role.learns()) {
                    let report = &mut reports[token as usize];
                    report.transitions += 1;
                    report.episodes.count(transition.end);
                    report.speed += f64::from(transition.executed[0]);
                    report.turn_rate += f64::from(transition.executed[1].abs());
                    report.task_reward += f64::from(transition.reward);
                }
            }
        }
        for number in 0..self.shards.len() {
            self.shards[number].rollout.keep_learners();
            let logits = self.judge(number);
            let shard = &mut self.shards[number];
            shard.add_intrinsic_reward(&self.config, &logits);
            let (m, tokens) = (self.config.n_behaviours, shard.rollout.tokens());
            let mut add = |to: fn(&mut BehaviourReport) -> &mut f64, logits: &[f32]| {
                for (&token, logits) in tokens.iter().zip(logits.chunks_exact(m)) {
                    *to(&mut reports[token as usize]) += log_softmax_at(logits, token);
                }
            };
            add(|report| &mut report.log_q_state_action, &logits[0]);
            add(|report| &mut report.log_q_state, &logits[1]);
            for (&token, intrinsic) in tokens.iter().zip(&shard.rollout.intrinsic) {
                reports[token as usize].intrinsic_reward += intrinsic;
            }
        }
        Ok(())
    }
}
