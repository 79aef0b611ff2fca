//! The symmetric binomial distribution and the χ² distribution with one degree of freedom, accurate
//! in relative terms far into their tails and for counts of any size.

use std::f64::consts::{LN_2, TAU};

/// P(X = k) for X binomial with n trials of probability ½.
///
/// # Formula
///
/// Loader's saddle-point form: √(n / 2πk(n−k)) · exp(δ(n) − δ(k) − δ(n−k) − d(k) − d(n−k)), δ the
/// error of Stirling's formula and d(x) = x·ln(2x/n) + n/2 − x. Differences of log-gammas would
/// lose digits that grow with n·ln n.
///
/// # Panics
///
/// If k > n.
///
/// # References
///
/// C. Loader, "Fast and accurate computation of binomial probabilities" (2000).
pub fn pmf_half(k: u64, n: u64) -> f64 {
    assert!(k <= n, "{k} of {n} trials");
    if k == 0 || k == n {
        return (-(n as f64) * LN_2).exp();
    }
    let (a, b, total) = (k as f64, (n - k) as f64, n as f64);
    let exponent = stirling_error(n)
        - stirling_error(k)
        - stirling_error(n - k)
        - deviance(a, total / 2.0)
        - deviance(b, total / 2.0);
    (total / (TAU * a * b)).sqrt() * exponent.exp()
}

/// P(X ≤ k) for X binomial with n trials of probability ½ and k ≤ n/2.
///
/// The sum starts at its largest term, k, and walks down by the ratio of neighbours until a term no
/// longer counts.
///
/// # Panics
///
/// If k > n/2, where the sum would have to start elsewhere.
pub fn cdf_half_lower(k: u64, n: u64) -> f64 {
    assert!(k <= n / 2, "{k} is beyond the middle of {n} trials");
    let mut term = 1.0;
    let mut sum = 1.0;
    for i in (1..=k).rev() {
        // P(X = i − 1) / P(X = i) = i / (n − i + 1)
        term *= i as f64 / (n - i + 1) as f64;
        sum += term;
        if term < sum * 1e-18 {
            break;
        }
    }
    pmf_half(k, n) * sum
}

/// P(χ² > x) with one degree of freedom: erfc(√(x/2)).
pub fn chi2_upper(x: f64) -> f64 {
    libm::erfc((x / 2.0).sqrt())
}

/// ln n! − ((n + ½)·ln n − n + ½·ln 2π), for n ≥ 1.
fn stirling_error(n: u64) -> f64 {
    let x = n as f64;
    if n <= 15 {
        // Factorials up to 15! are exact in f64.
        let ln_factorial = (1..=n).map(|i| i as f64).product::<f64>().ln();
        return ln_factorial - ((x + 0.5) * x.ln() - x + 0.5 * TAU.ln());
    }
    let x2 = x * x;
    (1.0 / 12.0 - (1.0 / 360.0 - (1.0 / 1260.0 - (1.0 / 1680.0 - 1.0 / 1188.0 / x2) / x2) / x2) / x2) / x
}

/// x·ln(x/m) + m − x, without cancellation where x is near m.
fn deviance(x: f64, m: f64) -> f64 {
    let difference = x - m;
    if difference.abs() >= 0.1 * (x + m) {
        return x * (x / m).ln() - difference;
    }
    let v = difference / (x + m);
    let v2 = v * v;
    let mut term = 2.0 * x * v;
    let mut sum = difference * v;
    for j in 1..1000 {
        term *= v2;
        let next = sum + term / f64::from(2 * j + 1);
        if next == sum {
            break;
        }
        sum = next;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(actual: f64, expected: f64, relative: f64) {
        assert!((actual - expected).abs() <= relative * expected.abs(), "{actual:e} ≠ {expected:e}");
    }

    #[test]
    fn small_cases_by_hand() {
        close(pmf_half(2, 4), 6.0 / 16.0, 1e-14);
        close(cdf_half_lower(1, 4), 5.0 / 16.0, 1e-14);
        close(cdf_half_lower(0, 10), 1.0 / 1024.0, 1e-14);
        // Σ_{i ≤ 10} C(40, i) = 1 221 246 132 (a sum of integers).
        close(cdf_half_lower(10, 40), 1_221_246_132.0 / 2.0_f64.powi(40), 1e-13);
    }

    #[test]
    fn large_counts_agree_with_the_normal_limit_and_add_up() {
        // P(X = n/2) → √(2/πn)·(1 − 1/4n + 1/32n²).
        for n in [1_000_u64, 1_000_000, 1_000_000_000] {
            let x = n as f64;
            let limit = (2.0 / (std::f64::consts::PI * x)).sqrt() * (1.0 - 0.25 / x + 1.0 / (32.0 * x * x));
            close(pmf_half(n / 2, n), limit, 1e-9);
        }
        // By symmetry P(X ≤ (n−1)/2) = ½ for odd n.
        for n in [1_u64, 15, 101, 100_001, 1_000_001] {
            close(cdf_half_lower((n - 1) / 2, n), 0.5, 1e-9);
        }
    }

    #[test]
    fn chi2_at_known_points() {
        close(chi2_upper(super::super::Z_95.powi(2)), 0.05, 1e-12);
        assert_eq!(chi2_upper(0.0), 1.0);
    }
}
