//! Numbers as a table shows them.

/// Seconds in the unit in which they have one to three digits before the point.
pub(super) fn duration(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s >= 1.0 => (s, "s"),
        s if s >= 1e-3 => (1e3 * s, "ms"),
        s if s >= 1e-6 => (1e6 * s, "µs"),
        s => (1e9 * s, "ns"),
    };
    format!("{} {unit}", significant(value))
}

/// Three digits that matter, but every digit before the point.
pub(super) fn significant(value: f64) -> String {
    let decimals = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    format!("{value:.decimals$}")
}

/// A count with its thousands set apart.
pub(super) fn count(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A share of one.
pub(super) fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_and_a_unit() {
        assert_eq!(duration(1.234_5), "1.23 s");
        assert_eq!(duration(0.0567), "56.7 ms");
        assert_eq!(duration(1.5e-4), "150 µs");
        assert_eq!(duration(2.5e-9), "2.50 ns");
        assert_eq!(count(1_234_567.2), "1,234,567");
        assert_eq!(count(99.6), "100");
        assert_eq!(percent(0.256), "26 %");
    }
}
