//! The worst part of a set of values.

/// Conditional value at risk of success rates: the mean of the lowest `share` of them. Where that
/// is no whole number of values, the last one counts for the part that is left.
///
/// # Formula
///
/// With x₁ ≤ x₂ ≤ … ≤ xₙ and k = share · n: (x₁ + … + x_⌊k⌋ + (k − ⌊k⌋) x_⌊k⌋₊₁) / k.
///
/// # Examples
///
/// ```
/// use jostle_eval::statistics::cvar;
/// // k = 1.5: (0.2 + 0.5 · 0.4) / 1.5.
/// assert!((cvar(&[1.0, 0.4, 0.2, 0.9, 0.8, 0.7], 0.25).unwrap() - 0.4 / 1.5).abs() < 1e-12);
/// assert_eq!(cvar(&[], 0.25), None);
/// ```
pub fn cvar(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let weight = share * sorted.len() as f64;
    let part = |i: usize| (weight - i as f64).clamp(0.0, 1.0);
    let sum: f64 = sorted.iter().enumerate().map(|(i, value)| part(i) * value).sum();
    (weight > 0.0).then(|| sum / weight)
}
