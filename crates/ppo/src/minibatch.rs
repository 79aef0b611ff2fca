//! Minibatches: a shuffled order of a rollout's rows for each epoch, cut into pieces.

use rand::{Rng, RngExt};

/// Shuffles `0..n` into `rows` (Fisher–Yates, every order equally likely).
pub fn shuffle(rows: &mut Vec<u32>, n: usize, rng: &mut impl Rng) {
    rows.clear();
    rows.extend(0..n as u32);
    for i in (1..n).rev() {
        rows.swap(i, rng.random_range(0..=i as u32) as usize);
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
