//! Trigonometry whose bits depend neither on the platform's C library nor on CPU features.
//!
//! `f32::sin` calls the platform's libm, which may pick another routine per CPU. Rust's `libm` port
//! has one routine.
// Called a few times per shape and scan.
#![allow(clippy::inline_always)]

use std::f64::consts::TAU;

/// Sine and cosine of an angle, as (sin, cos).
pub(crate) fn sin_cos(angle: f32) -> (f32, f32) {
    libm::sincosf(angle)
}

/// The same angle in (−π, π]; the rounding happens once, from f64.
///
/// A non-finite angle stays non-finite.
pub fn wrap_angle(angle: f64) -> f32 {
    let wrapped = angle - TAU * libm::round(angle / TAU);
    let wrapped = if wrapped <= -std::f64::consts::PI { wrapped + TAU } else { wrapped };
    wrapped as f32
}

/// The direction of (x, y) in turns, within [0, 1], off by at most 2e-6 turns: for culling, never
/// for ranges.
///
/// The zero vector gives a quarter turn.
///
/// # Formula
///
/// The smaller of |x|, |y| over the larger, then an odd minimax polynomial of degree 9 for atan on
/// [0, 1] (Abramowitz and Stegun 4.4.49, error 1e-5 rad), unfolded by octant.
#[inline(always)]
pub(crate) fn approximate_turn(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (low, high) = if ay < ax { (ay, ax) } else { (ax, ay) };
    let q = if high > 0.0 { low / high } else { 0.0 };
    let s = q * q;
    let atan = q * (0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1))));
    let turn = atan * std::f32::consts::FRAC_1_PI * 0.5;
    let turn = if ay < ax { turn } else { 0.25 - turn };
    let turn = if x < 0.0 { 0.5 - turn } else { turn };
    if y < 0.0 { 1.0 - turn } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrap_keeps_the_half_open_interval() {
        assert_eq!(wrap_angle(0.0), 0.0);
        assert_eq!(wrap_angle(-std::f64::consts::PI), std::f32::consts::PI);
        assert_eq!(wrap_angle(std::f64::consts::PI), std::f32::consts::PI);
        assert!((wrap_angle(100.0) - (100.0 - 16.0 * TAU) as f32).abs() < 1e-6);
        assert!(wrap_angle(f64::NAN).is_nan());
    }

    #[test]
    fn approximate_turn_is_near_atan2_all_round() {
        for i in 0..10_000 {
            let turn = f64::from(i) / 10_000.0;
            let (y, x) = libm::sincos(turn * TAU);
            let error = f64::from(approximate_turn((x * 3.0) as f32, (y * 3.0) as f32)) - turn;
            assert!(error.abs() < 4e-6 || (error.abs() - 1.0).abs() < 4e-6, "{turn}: {error}");
        }
        assert_eq!(approximate_turn(0.0, 0.0), 0.25);
    }
}
