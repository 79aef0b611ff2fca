//! Student's t distribution with any positive number of degrees of freedom, from the incomplete
//! beta function.

/// Terms after which the continued fraction is given up; it needs about √(a + b) of them.
const TERMS_MAX: u32 = 10_000;

/// P(|T| > |t|) with `df` degrees of freedom.
///
/// # Formula
///
/// `I_x(df/2, 1/2)` with x = df/(df + t²), the regularised incomplete beta function.
///
/// # Panics
///
/// If `df` is not positive.
pub fn two_sided(t: f64, df: f64) -> f64 {
    assert!(df > 0.0, "{df} degrees of freedom");
    if t.is_infinite() {
        return 0.0;
    }
    incomplete_beta(df / 2.0, 0.5, df / (df + t * t))
}

/// The t > 0 with P(|T| ≤ t) = `level`, by bisection to the last bits.
///
/// # Panics
///
/// If `level` is not between 0 and 1.
pub fn critical(level: f64, df: f64) -> f64 {
    assert!((0.0..1.0).contains(&level), "level {level}");
    let outside = 1.0 - level;
    let mut high = 1.0;
    while two_sided(high, df) > outside {
        high *= 2.0;
    }
    let mut low = 0.0;
    loop {
        let middle = f64::midpoint(low, high);
        if middle <= low || middle >= high {
            return high;
        }
        if two_sided(middle, df) > outside {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// The regularised incomplete beta function for positive a, b and x in [0, 1].
///
/// # Formula
///
/// The continued fraction DLMF 8.17.22 where it converges fast, x < (a + 1)/(a + b + 2), else 1 −
/// `I_{1−x}(b, a)`.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let ln_beta = libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b);
    let part =
        |a: f64, b: f64, x: f64| (a * x.ln() + b * (-x).ln_1p() - ln_beta).exp() / a / fraction(a, b, x);
    if x > (a + 1.0) / (a + b + 2.0) { 1.0 - part(b, a, 1.0 - x) } else { part(a, b, x) }
}

/// 1 + d₁/(1 + d₂/(1 + …)), evaluated forwards (modified Lentz).
fn fraction(a: f64, b: f64, x: f64) -> f64 {
    let coefficient = |n: u32| {
        let m = f64::from(n / 2);
        if n.is_multiple_of(2) {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        }
    };
    let away_from_zero = |value: f64| if value.abs() < 1e-300 { 1e-300 } else { value };
    let (mut value, mut c, mut d) = (1.0, 1.0, 0.0);
    for n in 1..TERMS_MAX {
        let step = coefficient(n);
        d = 1.0 / away_from_zero(1.0 + step * d);
        c = away_from_zero(1.0 + step / c);
        value *= c * d;
        if (c * d - 1.0).abs() < 1e-16 {
            break;
        }
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(actual: f64, expected: f64, tolerance: f64) {
        assert!((actual - expected).abs() <= tolerance, "{actual} ≠ {expected}");
    }

    #[test]
    fn closed_forms_of_one_and_two_degrees() {
        for t in [0.01, 0.5, 1.0, 3.0, 40.0_f64] {
            // Cauchy, and P(|T| > t) = 1 − t/√(2 + t²).
            close(two_sided(t, 1.0), 1.0 - 2.0 / std::f64::consts::PI * t.atan(), 1e-13);
            close(two_sided(-t, 2.0), 1.0 - t / (2.0 + t * t).sqrt(), 1e-13);
        }
        assert_eq!((two_sided(0.0, 3.0), two_sided(f64::INFINITY, 3.0)), (1.0, 0.0));
    }

    #[test]
    fn critical_values_of_the_tables() {
        for (df, expected) in
            [(1.0, 12.706_204_736), (2.0, 4.302_652_730), (4.0, 2.776_445_105), (10.0, 2.228_138_852)]
        {
            close(critical(0.95, df), expected, 1e-8);
        }
        close(critical(0.95, 1e9), crate::statistics::Z_95, 1e-6);
        close(critical(0.0, 5.0), 0.0, 1e-300);
    }
}
