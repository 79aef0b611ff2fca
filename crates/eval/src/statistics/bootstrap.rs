//! The hierarchical bootstrap: training seeds are drawn again, and within them the test episodes,
//! which are the same for all policies.
//!
//! Episode k has one start, goal and spawn for every policy and crowd; a round therefore draws one
//! set of episodes and applies it to all of them (paired). Seeds are drawn for each row by itself,
//! since runs of different rows have nothing in common. Every draw comes from a fixed ChaCha8
//! stream, so that a report is the same bytes each time.
//!
//! # Caveat
//!
//! With three seeds the percentile interval is too short: drawing three of three understates the
//! spread between seeds by a third, and there are ten different draws in all. The test
//! `coverage_is_what_the_documentation_says` measures it. A verdict therefore asks for Welch's
//! interval, too ([`Contrast`](super::Contrast)).

use jostle_sim::Streams;
use rand::Rng;

use super::Interval;

/// Rounds of every bootstrap of a report.
pub const ROUNDS: usize = 10_000;
/// Root seed of its streams.
const SEED: u64 = 0;

/// Number of times that each episode is drawn in each round.
#[derive(Clone, Debug)]
pub struct EpisodeDraws {
    n_episodes: usize,
    /// Row-major [rounds, episodes].
    counts: Vec<u8>,
}

impl EpisodeDraws {
    /// Draws `n_episodes` of `n_episodes` with replacement in every round.
    ///
    /// # Panics
    ///
    /// Without an episode.
    pub fn new(n_episodes: usize, rounds: usize) -> Self {
        assert!(n_episodes > 0, "no episode to draw from");
        let mut rng = Streams::new(SEED).stream("eval.bootstrap.episodes", &[n_episodes as u64]);
        let mut counts = vec![0_u8; n_episodes * rounds];
        for round in counts.chunks_exact_mut(n_episodes) {
            for _ in 0..n_episodes {
                let count = &mut round[below(&mut rng, n_episodes)];
                *count = count.saturating_add(1);
            }
        }
        Self { n_episodes, counts }
    }

    /// The mean of the values that are there, in every round; NaN in a round that draws none of
    /// them.
    ///
    /// # Panics
    ///
    /// If there is not one value (or `None`) for each episode.
    pub fn means(&self, values: &[Option<f64>]) -> Vec<f64> {
        assert_eq!(values.len(), self.n_episodes, "one value for each episode");
        let terms: Vec<(f64, f64)> =
            values.iter().map(|value| (value.unwrap_or(0.0), f64::from(u8::from(value.is_some())))).collect();
        let mean = |round: &[u8]| {
            let (sum, n) = round.iter().zip(&terms).fold((0.0, 0.0), |(sum, n), (count, (value, there))| {
                let count = f64::from(*count);
                (sum + count * value, n + count * there)
            });
            sum / n
        };
        self.counts.chunks_exact(self.n_episodes).map(mean).collect()
    }
}

/// The sum over groups of the mean over drawn seeds, in every round.
///
/// # Shapes
///
/// `groups[g][s][b]`: the weighted value of seed s of group g in round b; all of one length.
pub fn over_seeds(groups: &[Vec<Vec<f64>>]) -> Vec<f64> {
    let rounds = groups.iter().flatten().map(Vec::len).min().unwrap_or(0);
    let mut rng = Streams::new(SEED).stream("eval.bootstrap.seeds", &[]);
    (0..rounds)
        .map(|round| {
            let drawn = |group: &Vec<Vec<f64>>, rng: &mut jostle_sim::StreamRng| {
                let sum: f64 = (0..group.len()).map(|_| group[below(rng, group.len())][round]).sum();
                sum / group.len() as f64
            };
            groups.iter().map(|group| drawn(group, &mut rng)).sum()
        })
        .collect()
}

/// The percentile interval of bootstrap samples; `None` where a sample is not a number or there are
/// none.
pub fn percentile_interval(samples: &[f64], level: f64) -> Option<Interval> {
    if samples.is_empty() || samples.iter().any(|sample| sample.is_nan()) {
        return None;
    }
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let quantile = |p: f64| {
        let at = p * (sorted.len() - 1) as f64;
        let (below, share) = (at.floor() as usize, at.fract());
        let above = (below + 1).min(sorted.len() - 1);
        sorted[below] + share * (sorted[above] - sorted[below])
    };
    let tail = (1.0 - level) / 2.0;
    Some(Interval { low: quantile(tail), high: quantile(1.0 - tail) })
}

/// An index below n: the multiply-shift of a 32-bit draw, whose bias of n/2³² does not matter here.
fn below(rng: &mut impl Rng, n: usize) -> usize {
    ((u64::from(rng.next_u32()) * n as u64) >> 32) as usize
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::statistics::Contrast;

    #[test]
    fn means_by_hand_and_the_same_each_time() {
        let draws = EpisodeDraws { n_episodes: 3, counts: vec![1, 1, 1, 3, 0, 0, 0, 3, 0] };
        let means = draws.means(&[Some(1.0), None, Some(4.0)]);
        assert_eq!(means[..2], [2.5, 1.0]);
        assert!(means[2].is_nan(), "only the episode without a value was drawn");
        let (first, again) = (EpisodeDraws::new(7, 50), EpisodeDraws::new(7, 50));
        assert_eq!(first.counts, again.counts);
        assert!(first.counts.chunks(7).all(|round| round.iter().map(|n| u32::from(*n)).sum::<u32>() == 7));
    }

    #[test]
    fn percentiles_interpolate() {
        let samples: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        let interval = percentile_interval(&samples, 0.95).unwrap();
        assert!((interval.low - 2.5).abs() < 1e-12 && (interval.high - 97.5).abs() < 1e-12);
        assert_eq!(percentile_interval(&[1.0, f64::NAN], 0.95), None);
        assert_eq!(percentile_interval(&[], 0.95), None);
    }

    #[test]
    fn the_episodes_alone_give_the_binomial_spread() {
        // One seed, 400 episodes, rate ½: the standard deviation is √(¼/400) = 0.025.
        let values: Vec<Option<f64>> = (0..400).map(|k| Some(f64::from(k % 2))).collect();
        let draws = EpisodeDraws::new(400, 4000);
        let interval = percentile_interval(&over_seeds(&[vec![draws.means(&values)]]), 0.95).unwrap();
        assert!((interval.high - interval.low - 2.0 * 1.96 * 0.025).abs() < 0.006, "{interval:?}");
    }

    /// Share of simulated studies whose interval holds the true difference, by Welch, by bootstrap,
    /// and by both.
    fn coverage(n_seeds: usize) -> [f64; 3] {
        const STUDIES: u32 = 300;
        let mut rng = Streams::new(1).stream("test.coverage", &[n_seeds as u64]);
        let draws = EpisodeDraws::new(50, 400);
        let mut held = [0_u32; 3];
        for _ in 0..STUDIES {
            // Rates vary between seeds with a standard deviation of 0.1; the true difference is 0.
            let mut group = |sign: f64| -> Vec<Vec<Option<f64>>> {
                (0..n_seeds)
                    .map(|_| {
                        let offset: f64 = StandardNormal.sample(&mut rng);
                        let rate = (0.5 + 0.1 * offset).clamp(0.0, 1.0);
                        let success =
                            |rng: &mut jostle_sim::StreamRng| below(rng, 1 << 20) as f64 / 1_048_576.0 < rate;
                        (0..50).map(|_| Some(if success(&mut rng) { sign } else { 0.0 })).collect()
                    })
                    .collect()
            };
            let groups = [group(1.0), group(-1.0)];
            let mean = |values: &Vec<Option<f64>>| values.iter().flatten().sum::<f64>() / 50.0;
            let by_seed: Vec<Vec<f64>> =
                groups.iter().map(|group| group.iter().map(mean).collect()).collect();
            let rounds: Vec<Vec<Vec<f64>>> =
                groups.iter().map(|group| group.iter().map(|values| draws.means(values)).collect()).collect();
            let holds = |interval: Interval| interval.low <= 0.0 && 0.0 <= interval.high;
            let welch = holds(Contrast::from_groups(&by_seed).unwrap().interval(0.95));
            let bootstrap = holds(percentile_interval(&over_seeds(&rounds), 0.95).unwrap());
            // A verdict needs both intervals off 0.
            for (count, holds) in held.iter_mut().zip([welch, bootstrap, welch || bootstrap]) {
                *count += u32::from(holds);
            }
        }
        held.map(|count| f64::from(count) / f64::from(STUDIES))
    }

    #[test]
    fn coverage_is_what_the_documentation_says() {
        // 300 studies: the standard error of a coverage of 0.95 is 0.013.
        let [welch, bootstrap, both] = coverage(3);
        assert!(welch > 0.92, "Welch holds its level with three seeds: {welch}");
        assert!((0.78..0.97).contains(&bootstrap), "{bootstrap}");
        assert!(both > 0.92, "{both}");
        let [welch, bootstrap, _] = coverage(10);
        assert!(welch > 0.92 && bootstrap > 0.89, "{welch} {bootstrap}");
    }
}
