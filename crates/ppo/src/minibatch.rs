//! Minibatches: a shuffled order of a rollout's rows for each epoch, cut into pieces.

use std::ops::Range;

use rand::{Rng, RngExt};

/// Shuffles `0..n` into `rows` (Fisher–Yates, every order equally likely).
pub fn shuffle(rows: &mut Vec<u32>, n: usize, rng: &mut impl Rng) {
    rows.clear();
    rows.extend(0..n as u32);
    for i in (1..n).rev() {
        rows.swap(i, rng.random_range(0..=i as u32) as usize);
    }
}

/// How an epoch's rows are cut into minibatches, where each shard has an order of its own rows.
///
/// One shard: pieces of the length asked for, the last of which may be shorter. Several: as many
/// minibatches, to each of which each shard gives an equal share of its rows, so that all shards
/// have as much to compute.
#[derive(Debug, Clone)]
pub(crate) struct Cut {
    /// Rows of each shard of the run.
    rows: Vec<usize>,
    minibatch: usize,
}

impl Cut {
    /// A cut of shards of so many rows into minibatches of about `minibatch` rows.
    pub(crate) fn new(rows: Vec<usize>, minibatch: usize) -> Self {
        Self { rows, minibatch }
    }

    /// Rows of all shards.
    pub(crate) fn n_rows(&self) -> usize {
        self.rows.iter().sum()
    }

    /// Rows of the shards before this one.
    pub(crate) fn first(&self, shard: usize) -> usize {
        self.rows[..shard].iter().sum()
    }

    /// Minibatches of an epoch.
    pub(crate) fn count(&self) -> usize {
        self.n_rows().div_ceil(self.minibatch)
    }

    /// The part of a minibatch that a shard gives, of its own order of rows.
    pub(crate) fn part(&self, minibatch: usize, shard: usize) -> Range<usize> {
        let n = self.rows[shard];
        if self.rows.len() == 1 {
            let start = minibatch * self.minibatch;
            return start..n.min(start + self.minibatch);
        }
        minibatch * n / self.count()..(minibatch + 1) * n / self.count()
    }

    /// Rows of a minibatch.
    pub(crate) fn len(&self, minibatch: usize) -> usize {
        (0..self.rows.len()).map(|shard| self.part(minibatch, shard).len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_occurs_once_and_orders_differ() {
        let mut rng = jostle_sim::Streams::new(1).stream("test", &[]);
        let (mut first, mut second) = (Vec::new(), Vec::new());
        shuffle(&mut first, 100, &mut rng);
        shuffle(&mut second, 100, &mut rng);
        assert_ne!(first, second);
        first.sort_unstable();
        assert_eq!(first, (0..100).collect::<Vec<u32>>());
    }

    #[test]
    fn one_shard_is_cut_into_pieces_and_several_give_equal_shares() {
        let parts = |cut: &Cut, shard| (0..cut.count()).map(|k| cut.part(k, shard)).collect::<Vec<_>>();
        let one = Cut::new(vec![10], 4);
        assert_eq!(parts(&one, 0), [0..4, 4..8, 8..10]);
        assert_eq!((0..3).map(|k| one.len(k)).collect::<Vec<_>>(), [4, 4, 2]);
        let two = Cut::new(vec![10, 7], 6);
        assert_eq!((two.n_rows(), two.count()), (17, 3));
        assert_eq!(parts(&two, 0), [0..3, 3..6, 6..10]);
        assert_eq!(parts(&two, 1), [0..2, 2..4, 4..7]);
        assert_eq!((0..3).map(|k| two.len(k)).collect::<Vec<_>>(), [5, 5, 7]);
        // A minibatch of as many rows as shards is never empty, whoever has few rows.
        let uneven = Cut::new(vec![1, 9, 2, 1], 4);
        assert!((0..uneven.count()).all(|k| uneven.len(k) > 0));
    }

    #[test]
    fn orders_are_equally_likely() {
        let mut rng = jostle_sim::Streams::new(2).stream("test", &[]);
        let mut counts = std::collections::BTreeMap::new();
        for _ in 0..6000 {
            let mut rows = Vec::new();
            shuffle(&mut rows, 3, &mut rng);
            *counts.entry(rows).or_insert(0) += 1;
        }
        // Six orders, 1000 expected each; 5σ is 144.
        assert!(counts.len() == 6 && counts.values().all(|&n| (856..=1144).contains(&n)), "{counts:?}");
    }
}
