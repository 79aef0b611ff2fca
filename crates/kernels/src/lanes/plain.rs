//! 16 floats in plain Rust, for processors without vector kernels; the compiler spreads them over
//! what registers there are.
//!
//! Multiplication and addition are rounded one after the other: where no instruction does both, a
//! fused one is a slow function.

use std::array::from_fn;

/// The array in the place of a register.
pub(crate) type V = [f32; LANES];

/// Floats of it.
pub(crate) const LANES: usize = 16;

/// Zeros.
#[inline]
pub(crate) fn zero() -> V {
    [0.0; LANES]
}

/// One value in every lane.
#[inline]
pub(crate) fn splat(value: f32) -> V {
    [value; LANES]
}

/// One value in every lane.
#[inline]
pub(crate) fn broadcast(value: f32) -> V {
    [value; LANES]
}

/// # Safety
///
/// 16 floats may be read.
#[inline]
pub(crate) unsafe fn load(from: *const f32) -> V {
    // SAFETY: the caller's promise; an array of floats has their alignment.
    unsafe { from.cast::<V>().read() }
}

/// # Safety
///
/// 16 floats may be written.
#[inline]
pub(crate) unsafe fn store(to: *mut f32, values: V) {
    // SAFETY: the caller's promise; an array of floats has their alignment.
    unsafe { to.cast::<V>().write(values) }
}

/// a + b.
#[inline]
pub(crate) fn add(a: V, b: V) -> V {
    from_fn(|i| a[i] + b[i])
}

/// a · b + c, rounded twice.
#[inline]
pub(crate) fn fma(a: V, b: V, c: V) -> V {
    from_fn(|i| c[i] + a[i] * b[i])
}

/// max(x, 0) in every lane; 0 for NaN, as the vector instructions have it.
#[inline]
pub(crate) fn relu(values: V) -> V {
    keep_positive(values, values)
}

/// Bit i is set where lane i is not zero.
#[inline]
pub(crate) fn not_zero(values: V) -> u64 {
    values.iter().rev().fold(0, |bits, value| bits << 1 | u64::from(*value != 0.0))
}

/// Lane i where bit i is set, else 0; higher bits are ignored.
#[inline]
pub(crate) fn keep(bits: u64, values: V) -> V {
    from_fn(|i| if bits >> i & 1 == 1 { values[i] } else { 0.0 })
}

/// Lane i where lane i of `activations` is positive, else 0.
#[inline]
pub(crate) fn keep_positive(activations: V, values: V) -> V {
    from_fn(|i| if activations[i] > 0.0 { values[i] } else { 0.0 })
}

/// Does nothing.
#[inline]
pub(crate) fn prefetch_near(_: *const f32) {}

/// Does nothing.
#[inline]
pub(crate) fn prefetch_far(_: *const f32) {}

/// The columns of 16 rows of 16 values.
#[inline]
pub(crate) fn transpose(rows: &[V; LANES]) -> [V; LANES] {
    from_fn(|column| from_fn(|row| rows[row][column]))
}
