//! The interval of a difference between two success rates on the same episodes.

use super::{Interval, PairedCounts, wilson};

/// 95 % interval of (second rate − first rate) for paired episodes; `None` without pairs.
///
/// # Formula
///
/// Newcombe's method 10: the two Wilson intervals joined by squares, with the correlation φ of the
/// 2 × 2 table (its numerator reduced by n/2 where positive).
///
/// # References
///
/// R. G. Newcombe, Statistics in Medicine 17 (1998) 2635,
/// `doi:10.1002/(SICI)1097-0258(19981130)17:22<2635::AID-SIM954>3.0.CO;2-C`.
pub fn paired_difference(counts: &PairedCounts) -> Option<Interval> {
    let n = counts.pairs();
    let second = wilson(counts.both + counts.second_only, n)?;
    let first = wilson(counts.both + counts.first_only, n)?;
    let (p2, p1) = (counts.second_rate()?, counts.first_rate()?);
    let difference = p2 - p1;
    let phi = correlation(counts);
    let join = |u: f64, v: f64| (u * u - 2.0 * phi * u * v + v * v).max(0.0).sqrt();
    Some(Interval {
        low: (difference - join(p2 - second.low, first.high - p1)).max(-1.0),
        high: (difference + join(second.high - p2, p1 - first.low)).min(1.0),
    })
}

fn correlation(counts: &PairedCounts) -> f64 {
    let [a, b, c, d] =
        [counts.both, counts.first_only, counts.second_only, counts.neither].map(|count| count as f64);
    let margins = (a + b) * (c + d) * (a + c) * (b + d);
    if margins == 0.0 {
        return 0.0;
    }
    let product = a * d - b * c;
    let numerator = if product > 0.0 { (product - (a + b + c + d) / 2.0).max(0.0) } else { product };
    numerator / margins.sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn newcombes_own_example() {
        // Table II of the article, the 36/12/2/0 case read as (both, first only, second only,
        // neither): first − second lies in (0.0569, 0.3404) by method 10.
        let counts = PairedCounts { both: 36, first_only: 12, second_only: 2, neither: 0 };
        let interval = paired_difference(&counts).unwrap();
        assert!((interval.high + 0.0569).abs() < 5e-5, "{interval:?}");
        assert!((interval.low + 0.3404).abs() < 5e-5, "{interval:?}");
    }

    proptest! {
        #[test]
        fn contains_the_difference(
            both in 0_u64..1000, first_only in 0_u64..1000, second_only in 0_u64..1000, neither in 1_u64..1000,
        ) {
            let counts = PairedCounts { both, first_only, second_only, neither };
            let difference = counts.second_rate().unwrap() - counts.first_rate().unwrap();
            let interval = paired_difference(&counts).unwrap();
            prop_assert!(interval.low <= difference + 1e-12 && difference <= interval.high + 1e-12);
        }
    }
}
