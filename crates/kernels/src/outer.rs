//! Sums of outer products: the product behind every weight gradient.
//!
//! # Formula
//!
//! With k = (segment, step),
//!
//! ```text
//! out[m, n] (+)= Σ_k a[segment·a.segment + step·a.step + m] · b[segment·b.segment + step·b.step + half(n)],
//! half(n) = (n / 16)·b.half + n % 16,   n in 0..32
//! ```
//!
//! A step is a sample (linear layers) or a position (convolutions). The sum over all steps of a call is kept in
//! registers from zero and added to the output once, which is both faster and more exact than adding step by step.

use crate::Isa;
use crate::isa::Level;
use crate::rows::{HALF, PANEL};
use crate::tile::Tiles;

/// One operand: where a step's values stand.
#[derive(Debug, Clone, Copy)]
pub struct Steps<'a> {
    /// The values.
    pub data: &'a [f32],
    /// Distance between two steps of a segment.
    pub step: usize,
    /// Distance between two segments.
    pub segment: usize,
    /// Distance between the two halves of a step (right operand alone).
    pub half: usize,
}

/// How many products are summed.
#[derive(Debug, Clone, Copy)]
pub struct Count {
    /// Number of segments.
    pub segments: usize,
    /// Steps in each.
    pub steps: usize,
}

/// Computes `rows` rows of 32 values, rows side by side in `out` (see the module).
///
/// # Panics
///
/// If an operand is too short for its shape.
pub fn outer_products(
    isa: Isa,
    rows: usize,
    count: Count,
    a: Steps<'_>,
    b: Steps<'_>,
    accumulate: bool,
    out: &mut [f32],
) {
    if rows == 0 || count.segments == 0 || count.steps == 0 {
        assert!(rows == 0, "a product over nothing");
        return;
    }
    let last = |x: &Steps<'_>| (count.segments - 1) * x.segment + (count.steps - 1) * x.step;
    assert!(a.data.len() >= last(&a) + rows, "left operand too short: {}", a.data.len());
    assert!(b.data.len() >= last(&b) + b.half + HALF, "right operand too short: {}", b.data.len());
    assert!(out.len() >= rows * PANEL, "output too short: {}", out.len());
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it; the lengths are checked above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe {
            crate::avx512::outer(Tiles::new(rows, 14), count, &a, &b, accumulate, out);
        },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe { crate::avx2::outer(Tiles::new(rows, 6), count, &a, &b, accumulate, out) },
        _ => plain(rows, count, a, b, accumulate, out),
    }
}

/// The same in plain Rust: the reference of the vector kernels, and the path of other processors.
fn plain(rows: usize, count: Count, a: Steps<'_>, b: Steps<'_>, accumulate: bool, out: &mut [f32]) {
    for (m, out) in out.chunks_exact_mut(PANEL).take(rows).enumerate() {
        let mut sums = [0.0_f32; PANEL];
        for segment in 0..count.segments {
            for step in 0..count.steps {
                let x = a.data[segment * a.segment + step * a.step + m];
                let start = segment * b.segment + step * b.step;
                for (half, sums) in sums.chunks_exact_mut(HALF).enumerate() {
                    for (sum, y) in sums.iter_mut().zip(&b.data[start + half * b.half..][..HALF]) {
                        *sum += x * y;
                    }
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = if accumulate { *out + sum } else { sum };
        }
    }
}
