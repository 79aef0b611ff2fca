//! A sum of means over training seeds with its interval: Welch's test of a difference, and what
//! follows from it for any linear combination of rows.

use serde::{Deserialize, Serialize};

use super::{Interval, student};

/// A sum of group means with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contrast {
    /// The sum of the groups' means.
    pub estimate: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Degrees of freedom (Welch and Satterthwaite); `None` where no group varies.
    pub df: Option<f64>,
}

impl Contrast {
    /// The sum of the means of independent groups; the values of a group are already multiplied by
    /// its weight, so that a difference is two groups of which one is negated. `None` unless every
    /// group has at least two values: the spread between seeds cannot be known from one.
    ///
    /// # Formula
    ///
    /// SE² = Σ s²/n, df = (Σ s²/n)² / Σ (s²/n)²/(n − 1), with the sample variances s² of the
    /// groups.
    ///
    /// # References
    ///
    /// B. L. Welch, Biometrika 34 (1947) 28, doi:10.1093/biomet/34.1-2.28.
    pub fn from_groups(groups: &[Vec<f64>]) -> Option<Self> {
        let (mut estimate, mut variance, mut denominator) = (0.0, 0.0, 0.0);
        for group in groups {
            if group.len() < 2 {
                return None;
            }
            let n = group.len() as f64;
            let mean = group.iter().sum::<f64>() / n;
            let squares: f64 = group.iter().map(|value| (value - mean) * (value - mean)).sum();
            let of_mean = squares / (n - 1.0) / n;
            estimate += mean;
            variance += of_mean;
            denominator += of_mean * of_mean / (n - 1.0);
        }
        let df = (denominator > 0.0).then(|| variance * variance / denominator);
        (!groups.is_empty()).then(|| Self { estimate, standard_error: variance.sqrt(), df })
    }

    /// The interval that holds the true sum with probability `level`; a point where no group
    /// varies.
    pub fn interval(&self, level: f64) -> Interval {
        let half = self.df.map_or(0.0, |df| student::critical(level, df) * self.standard_error);
        Interval { low: self.estimate - half, high: self.estimate + half }
    }

    /// Two-sided p-value of the sum being `null`; `None` where no group varies.
    pub fn p_value(&self, null: f64) -> Option<f64> {
        self.df.map(|df| student::two_sided((self.estimate - null) / self.standard_error, df))
    }
}

/// Most ways of dealing values to two groups that are counted one by one.
const SPLITS_MAX: u64 = 1 << 20;

/// The exact test of two groups by permutation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Permutation {
    /// Share of all ways of dealing the values to the groups whose means differ at least as much.
    pub p: f64,
    /// The least p that groups of these sizes can give: with 3 against 3 it is 0.1, so that no
    /// result is significant.
    pub least_p: f64,
}

impl Permutation {
    /// Two-sided test of equal means; `None` for an empty group or for too many ways.
    pub fn new(first: &[f64], second: &[f64]) -> Option<Self> {
        let (n, total) = (first.len(), first.len() + second.len());
        if first.is_empty() || second.is_empty() || total > 24 {
            return None;
        }
        let values: Vec<f64> = first.iter().chain(second).copied().collect();
        let sum: f64 = values.iter().sum();
        // The means differ the more, the farther the first group's sum is from its expectation.
        let distance = |chosen: f64| (chosen - sum * n as f64 / total as f64).abs();
        let observed = distance(first.iter().sum());
        let tolerance = 1e-12 * values.iter().map(|value| value.abs()).sum::<f64>();
        let (mut extreme, mut ways) = (0_u64, 0_u64);
        for mask in 0_u32..1 << total {
            if mask.count_ones() as usize != n {
                continue;
            }
            let chosen = (0..total).filter(|i| mask >> i & 1 == 1).map(|i| values[i]).sum();
            extreme += u64::from(distance(chosen) >= observed - tolerance);
            ways += 1;
            if ways > SPLITS_MAX {
                return None;
            }
        }
        // A deal and its mirror image are equally extreme where the groups are equally large.
        let least = if n == second.len() { 2.0 } else { 1.0 };
        Some(Self { p: extreme as f64 / ways as f64, least_p: (least / ways as f64).min(1.0) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_by_hand() {
        // Means 2 and 5, variances 1 and 4, n = 3 each: SE² = 1/3 + 4/3, df = (5/3)²/((1/9 +
        // 16/9)/2).
        let contrast = Contrast::from_groups(&[vec![-1.0, -2.0, -3.0], vec![3.0, 5.0, 7.0]]).unwrap();
        assert_eq!(contrast.estimate, 3.0);
        assert!((contrast.standard_error - (5.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((contrast.df.unwrap() - 50.0 / 17.0).abs() < 1e-12);
        let interval = contrast.interval(0.95);
        assert!((interval.low + interval.high - 6.0).abs() < 1e-12);
        // p is 0.05 where the interval ends.
        assert!((contrast.p_value(interval.low).unwrap() - 0.05).abs() < 1e-9);
        assert_eq!(contrast.p_value(3.0), Some(1.0));
    }

    #[test]
    fn one_seed_has_no_spread_and_equal_seeds_a_point() {
        assert_eq!(Contrast::from_groups(&[vec![1.0, 2.0], vec![1.0]]), None);
        assert_eq!(Contrast::from_groups(&[]), None);
        let point = Contrast::from_groups(&[vec![0.5, 0.5]]).unwrap();
        assert_eq!((point.df, point.interval(0.95)), (None, Interval { low: 0.5, high: 0.5 }));
        // A group that does not vary adds nothing to the degrees of freedom.
        let with_constant = Contrast::from_groups(&[vec![0.0, 0.0], vec![1.0, 2.0, 3.0]]).unwrap();
        assert!((with_constant.df.unwrap() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn three_against_three_cannot_be_significant() {
        let test = Permutation::new(&[1.0, 2.0, 3.0], &[7.0, 8.0, 9.0]).unwrap();
        assert_eq!((test.p, test.least_p), (0.1, 0.1));
        // Of the 6 splits of {1, 2, 3, 4} into pairs, {1, 3} and {2, 4} are as extreme as observed,
        // {1, 2} and {3, 4} more.
        let test = Permutation::new(&[1.0, 3.0], &[2.0, 4.0]).unwrap();
        assert_eq!((test.p, test.least_p), (4.0 / 6.0, 2.0 / 6.0));
        assert_eq!(Permutation::new(&[], &[1.0]), None);
    }
}
