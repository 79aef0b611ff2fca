//! The two dense products that everything is made of.
//!
//! # Rows × panel
//!
//! [`rows_times_panel`] is behind every forward pass and every input gradient. With
//! K = `blocks` · `block_len` and k = (block, i),
//!
//! ```text
//! out[m, n] = finish( start[n] + Σ_k a[m·ROW + block·block_stride + i] · panel[k, n] ),   n in 0..32
//! ```
//!
//! The left operand is never copied: a convolution's windows are rows that overlap
//! (`ROW` = stride · channels), a blocked activation has `ROW` = 16. The step between rows is a
//! constant, so that every broadcast is one load from a fixed distance; with a step known at run
//! time only, 14 rows would need 14 pointers in 16 registers. One output is summed in the order of
//! k whatever the tile it falls in, so a row's bits do not depend on its neighbours.
//!
//! # Sums of outer products
//!
//! [`outer_products`] is behind every weight gradient. With k = (segment, step),
//!
//! ```text
//! out[m, n] (+)= Σ_k a[segment·a.segment + step·a.step + m] · b[segment·b.segment + step·b.step + half(n)],
//! half(n) = (n / 16)·b.half + n % 16,   n in 0..32
//! ```
//!
//! A step is a sample (linear layers) or a position (convolutions). The sum over all steps of a
//! call is kept in registers from zero and added to the output once, which is both faster and more
//! exact than adding step by step.
//!
//! # One body
//!
//! `body` has both products for registers of any width; `avx512`, `avx2` and `plain` choose the
//! size of a tile and the order in which memory is read, and compile it.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod body;
mod plain;

use crate::dispatch::{Isa, on_set};
use crate::operands::{Count, Finish, Grid, HALF, PANEL, Start, Steps, Strips};

/// Computes `rows` rows of the product of rows and a panel (see the module).
///
/// # Panics
///
/// If an operand is too short for its shape.
pub fn rows_times_panel<const ROW: usize>(
    isa: Isa,
    rows: usize,
    a: Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    mut out: Grid<&mut [f32]>,
) {
    if rows == 0 || a.blocks == 0 || a.block_len == 0 {
        assert!(rows == 0, "a product over nothing");
        return;
    }
    let a_needed = (rows - 1) * ROW + (a.blocks - 1) * a.block_stride + a.block_len;
    assert!(a.data.len() >= a_needed, "left operand: {} < {a_needed}", a.data.len());
    assert!(panel.len() >= a.blocks * a.block_len * PANEL, "panel too short: {}", panel.len());
    assert!(out.data.len() >= out.needed(rows), "output too short: {}", out.data.len());
    if let Start::Bias(bias) = start {
        assert!(bias.len() >= PANEL, "bias too short: {}", bias.len());
    }
    if let Finish::Mask(mask) = finish {
        assert!(mask.data.len() >= mask.needed(rows), "mask too short: {}", mask.data.len());
    }
    // SAFETY: the lengths are checked above.
    unsafe { on_set!(isa, rows::<ROW>(rows, &a, panel, start, finish, &mut out)) }
}

/// Computes `rows` rows of 32 sums of outer products, rows side by side in `out` (see the module).
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
    // SAFETY: the lengths are checked above.
    unsafe { on_set!(isa, outer(rows, count, &a, &b, accumulate, out)) }
}
