//! The score interval of a binomial proportion.

use serde::{Deserialize, Serialize};

use super::Z_95;

/// A closed interval of rates or of differences of rates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Half the width of the 95 % interval of a mean of independent values, by the normal distribution,
/// with the variance of each from its own interval.
pub(crate) fn half_width_of_mean(intervals: &[Interval]) -> f64 {
    let variance = |ends: &Interval| ((ends.high - ends.low) / (2.0 * Z_95)).powi(2);
    let n = intervals.len().max(1) as f64;
    Z_95 * intervals.iter().map(variance).sum::<f64>().sqrt() / n
}

/// The 95 % Wilson interval of `successes` out of `episodes`, without continuity correction; `None`
/// for no episode.
///
/// The lower end is exactly 0 for no success and the upper end exactly 1 for no failure.
///
/// # Formula
///
/// (p + z²/2n ± z·√(p(1 − p)/n + z²/4n²)) / (1 + z²/n) with z = [`Z_95`].
///
/// # Panics
///
/// If there are more successes than episodes.
///
/// # References
///
/// E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209, doi:10.1080/01621459.1927.10502953.
pub fn wilson(successes: u64, episodes: u64) -> Option<Interval> {
    assert!(successes <= episodes, "{successes} successes out of {episodes} episodes");
    if episodes == 0 {
        return None;
    }
    let n = episodes as f64;
    let rate = successes as f64 / n;
    let z2 = Z_95 * Z_95;
    let centre = rate + z2 / (2.0 * n);
    let half = Z_95 * (rate * (1.0 - rate) / n + z2 / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z2 / n;
    let low = if successes == 0 { 0.0 } else { ((centre - half) / scale).max(0.0) };
    let high = if successes == episodes { 1.0 } else { ((centre + half) / scale).min(1.0) };
    Some(Interval { low, high })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn ends_are_exact_at_none_and_at_all() {
        assert_eq!(wilson(0, 0), None);
        let none = wilson(0, 10).unwrap();
        // z²/(n + z²) by hand.
        let expected = Z_95 * Z_95 / (10.0 + Z_95 * Z_95);
        assert_eq!(none.low, 0.0);
        assert!((none.high - expected).abs() < 1e-15);
        let all = wilson(10, 10).unwrap();
        assert_eq!(all.high, 1.0);
        assert!((all.low - (1.0 - expected)).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn contains_the_rate_and_mirrors(n in 1_u64..5_000_000, share in 0.0_f64..=1.0) {
            let k = ((n as f64 * share) as u64).min(n);
            let rate = k as f64 / n as f64;
            let here = wilson(k, n).unwrap();
            let there = wilson(n - k, n).unwrap();
            prop_assert!(here.low <= rate && rate <= here.high);
            prop_assert!((here.low - (1.0 - there.high)).abs() < 1e-12);
        }
    }
}
