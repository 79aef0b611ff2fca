//! Constrained diversity: a behaviour is paid for being different only while it drives nearly as
//! well as the best.
//!
//! The idea is SMERL's (Kumar et al. 2020, "One solution is not all you need") and DGPO's (Chen et
//! al. 2024): diversity must not be bought with the task. Here each behaviour's mean return is
//! followed over its last few hundred episodes. While it is further than `diversity_margin` below
//! the best that any behaviour has had, that behaviour's α is 0 and it learns the task alone.
//!
//! # Formula
//!
//! After an update with n episodes of behaviour z that ended, of mean return R:
//!
//! ```text
//! mean_z ← mean_z + (1 − 2^(−n/200)) (R − mean_z)        the first R as it is
//! best   ← max(best, max_z mean_z)                       once every behaviour has ended 200 episodes
//! α_z    = α where mean_z ≥ best − margin, else 0
//! ```

use serde::{Deserialize, Serialize};

/// Episodes in which the memory of a mean halves.
const HALF_LIFE: f64 = 200.0;

/// The return of each behaviour, and the best that any has had.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Standing {
    /// Mean return of each behaviour's last episodes; `None` before its first.
    means: Vec<Option<f64>>,
    /// Episodes of each behaviour that ended so far.
    ended: Vec<u64>,
    /// The best mean so far; `None` while some behaviour has ended fewer than [`HALF_LIFE`]
    /// episodes.
    best: Option<f64>,
}

impl Standing {
    /// Nothing known of `n_behaviours` behaviours.
    pub(crate) fn new(n_behaviours: usize) -> Self {
        Self { means: vec![None; n_behaviours], ended: vec![0; n_behaviours], best: None }
    }

    /// Number of behaviours.
    pub(crate) fn len(&self) -> usize {
        self.means.len()
    }

    /// True if it can be the state of a run: as many counts as means, all of them finite.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = |mean: &Option<f64>| mean.is_none_or(f64::is_finite);
        self.ended.len() == self.means.len() && self.means.iter().chain([&self.best]).all(finite)
    }

    /// Takes in a rollout's ended episodes, each a behaviour and its return.
    pub(crate) fn take_in(&mut self, episodes: &[(u32, f64)]) {
        for (behaviour, (mean, ended)) in self.means.iter_mut().zip(&mut self.ended).enumerate() {
            let own = episodes.iter().filter(|(token, _)| *token as usize == behaviour);
            let (n, sum) = own.fold((0_u64, 0.0), |(n, sum), (_, of_episode)| (n + 1, sum + of_episode));
            if n == 0 {
                continue;
            }
            let of_rollout = sum / n as f64;
            let share = 1.0 - libm::exp2(-(n as f64) / HALF_LIFE);
            *mean = Some(mean.map_or(of_rollout, |mean| mean + share * (of_rollout - mean)));
            *ended += n;
        }
        if self.ended.iter().all(|&ended| ended as f64 >= HALF_LIFE) {
            self.best = self.means.iter().copied().flatten().chain(self.best).reduce(f64::max);
        }
    }

    /// True if a behaviour drives well enough to be paid for its difference; before the best is
    /// known everyone is.
    pub(crate) fn is_paid(&self, behaviour: usize, margin: f64) -> bool {
        match (self.means[behaviour], self.best) {
            (Some(mean), Some(best)) => mean >= best - margin,
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 episodes of each of two behaviours with these returns.
    fn episodes(returns: [f64; 2]) -> Vec<(u32, f64)> {
        (0..400).map(|i| (i % 2, returns[i as usize % 2])).collect()
    }

    fn paid(standing: &Standing, margin: f64) -> [bool; 2] {
        [0, 1].map(|behaviour| standing.is_paid(behaviour, margin))
    }

    #[test]
    fn who_falls_behind_is_not_paid_until_it_is_back() {
        let mut standing = Standing::new(2);
        standing.take_in(&episodes([10.0, 8.0]));
        assert_eq!(paid(&standing, 3.0), [true, true]);
        assert_eq!(paid(&standing, 1.0), [true, false]);
        // Half of the memory is gone: (8 + 12)/2 = 10 is the best of before.
        standing.take_in(&episodes([10.0, 12.0]));
        assert_eq!(paid(&standing, 1.0), [true, true]);
    }

    #[test]
    fn the_best_is_remembered_when_all_get_worse() {
        let mut standing = Standing::new(2);
        standing.take_in(&episodes([10.0, 10.0]));
        standing.take_in(&episodes([6.0, 6.0]));
        // Both means are 8, 2 below the best.
        assert_eq!((paid(&standing, 1.9), paid(&standing, 2.1)), ([false, false], [true, true]));
    }

    #[test]
    fn before_every_behaviour_is_known_everyone_is_paid() {
        let mut standing = Standing::new(2);
        standing.take_in(&episodes([10.0, 0.0])[..398]);
        assert_eq!(paid(&standing, 1.0), [true, true], "199 episodes each");
        standing.take_in(&[(0, 10.0), (1, 0.0)]);
        assert_eq!(paid(&standing, 1.0), [true, false]);
    }

    #[test]
    fn a_rollout_in_parts_is_nearly_the_rollout_at_once() {
        let (mut at_once, mut in_parts) = (Standing::new(2), Standing::new(2));
        for standing in [&mut at_once, &mut in_parts] {
            standing.take_in(&episodes([1.0, 1.0]));
        }
        at_once.take_in(&episodes([2.0, 0.0]));
        episodes([2.0, 0.0]).chunks(40).for_each(|part| in_parts.take_in(part));
        for (a, b) in at_once.means.iter().zip(&in_parts.means) {
            assert!((a.unwrap() - b.unwrap()).abs() < 1e-12);
        }
    }
}
