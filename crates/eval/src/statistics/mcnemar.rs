//! `McNemar`'s test: do two policies succeed equally often on the same episodes?

use serde::{Deserialize, Serialize};

use super::binomial::{cdf_half_lower, chi2_upper};

/// Successes of two policies on the same episodes, counted by pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PairedCounts {
    /// Both succeeded.
    pub both: u64,
    /// Only the first succeeded.
    pub first_only: u64,
    /// Only the second succeeded.
    pub second_only: u64,
    /// Neither succeeded.
    pub neither: u64,
}

/// The p-values of the paired comparison; the χ² ones are `None` without a discordant pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mcnemar {
    /// Exact two-sided binomial test.
    pub p_exact: f64,
    /// χ² approximation, (b − c)²/(b + c).
    pub p_chi2: Option<f64>,
    /// χ² with continuity correction, (|b − c| − 1)²/(b + c).
    pub p_chi2_corrected: Option<f64>,
}

impl PairedCounts {
    /// Counts the pairs of two lists of successes; a pair is an episode's index.
    ///
    /// Returns `None` if the lists differ in length, since then they are not paired.
    pub fn count(first: &[bool], second: &[bool]) -> Option<Self> {
        if first.len() != second.len() {
            return None;
        }
        let mut counts = Self::default();
        for pair in first.iter().zip(second) {
            match pair {
                (true, true) => counts.both += 1,
                (true, false) => counts.first_only += 1,
                (false, true) => counts.second_only += 1,
                (false, false) => counts.neither += 1,
            }
        }
        Some(counts)
    }

    /// Number of pairs.
    pub fn pairs(&self) -> u64 {
        self.both + self.first_only + self.second_only + self.neither
    }

    /// Success rate of the first policy, `None` without pairs.
    pub fn first_rate(&self) -> Option<f64> {
        (self.pairs() > 0).then(|| (self.both + self.first_only) as f64 / self.pairs() as f64)
    }

    /// Success rate of the second policy, `None` without pairs.
    pub fn second_rate(&self) -> Option<f64> {
        (self.pairs() > 0).then(|| (self.both + self.second_only) as f64 / self.pairs() as f64)
    }

    /// The three p-values.
    ///
    /// # Formula
    ///
    /// With b and c the discordant counts: exact p = min(1, 2·P(X ≤ min(b, c))), X binomial (b + c,
    /// ½); 1 where there is no discordant pair.
    ///
    /// # References
    ///
    /// Q. `McNemar`, Psychometrika 12 (1947) 153, doi:10.1007/BF02295996.
    pub fn mcnemar(&self) -> Mcnemar {
        let (b, c) = (self.first_only, self.second_only);
        let discordant = b + c;
        if discordant == 0 {
            return Mcnemar { p_exact: 1.0, p_chi2: None, p_chi2_corrected: None };
        }
        let difference = b.abs_diff(c) as f64;
        let n = discordant as f64;
        // For b = c this is −1, and its square 1: the corrected statistic as it is usually defined,
        // without a floor at 0.
        let corrected = difference - 1.0;
        Mcnemar {
            p_exact: (2.0 * cdf_half_lower(b.min(c), discordant)).min(1.0),
            p_chi2: Some(chi2_upper(difference * difference / n)),
            p_chi2_corrected: Some(chi2_upper(corrected * corrected / n)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn by_hand() {
        let counts = PairedCounts { both: 0, first_only: 1, second_only: 4, neither: 0 };
        // 2·(1 + 5)/32
        assert!((counts.mcnemar().p_exact - 0.375).abs() < 1e-15);
        let even = PairedCounts { both: 3, first_only: 2, second_only: 2, neither: 1 };
        assert_eq!(even.mcnemar().p_exact, 1.0);
        assert_eq!(PairedCounts::default().mcnemar().p_exact, 1.0);
        assert_eq!(PairedCounts::count(&[true], &[]), None);
    }

    proptest! {
        #[test]
        fn is_a_probability_and_symmetric(b in 0_u64..200_000, c in 0_u64..200_000) {
            let counts = PairedCounts { both: 5, first_only: b, second_only: c, neither: 5 };
            let swapped = PairedCounts { both: 5, first_only: c, second_only: b, neither: 5 };
            let p = counts.mcnemar().p_exact;
            prop_assert!((0.0..=1.0).contains(&p));
            prop_assert_eq!(p, swapped.mcnemar().p_exact);
        }
    }
}
