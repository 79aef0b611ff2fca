//! Rows × panel: the product behind every forward pass and every input gradient.
//!
//! # Formula
//!
//! With K = `blocks` · `block_len` and k = (block, i),
//!
//! ```text
//! out[m, n] = finish( start[n] + Σ_k a[m·ROW + block·block_stride + i] · panel[k, n] ),   n in 0..32
//! ```
//!
//! The left operand is never copied: a convolution's windows are rows that overlap (`ROW` = stride · channels), a
//! blocked activation has `ROW` = 16. The step between rows is a constant, so that every broadcast is one load from a
//! fixed distance; with a step known at run time only, 14 rows would need 14 pointers in 16 registers.
//! One output is summed in the order of k whatever the tile it falls in, so a row's bits do not depend on its
//! neighbours.

use crate::Isa;
use crate::isa::Level;
use crate::tile::Tiles;

/// Columns of a panel: two registers of 16 floats.
pub const PANEL: usize = 32;
/// Floats in a half of a panel: one register.
pub const HALF: usize = 16;

/// The left operand: rows whose elements are broadcast.
#[derive(Debug, Clone, Copy)]
pub struct Strips<'a> {
    /// Element (m, block, i) stands at `m·ROW + block·block_stride + i`.
    pub data: &'a [f32],
    /// Number of blocks of a row.
    pub blocks: usize,
    /// Elements of a block, side by side.
    pub block_len: usize,
    /// Distance between two blocks of a row.
    pub block_stride: usize,
}

/// What the sums start from.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    /// Zero.
    Zero,
    /// One value for each column.
    Bias(&'a [f32]),
    /// What stands in the output.
    Accumulate,
}

/// What is done to a finished sum.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a> {
    /// Nothing.
    Store,
    /// max(sum, 0).
    Relu,
    /// The backward pass of a ReLU: the sum where the activation is positive, else 0. The activation is addressed
    /// like an output.
    Mask(Grid<&'a [f32]>),
}

/// Rows of 32 values in two halves: element (m, half, i) stands at `m·row + half·half_stride + i`.
#[derive(Debug, Clone, Copy)]
pub struct Grid<T> {
    /// The values.
    pub data: T,
    /// Distance between two rows.
    pub row: usize,
    /// Distance between the two halves of a row.
    pub half: usize,
}

impl<T> Grid<T> {
    /// Smallest length that holds `rows` rows.
    fn needed(&self, rows: usize) -> usize {
        (rows - 1) * self.row + self.half + HALF
    }
}

/// Computes `rows` rows of the product (see the module).
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
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it; the lengths are checked above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe {
            crate::avx512::rows::<ROW>(Tiles::new(rows, 14), &a, panel, start, finish, &mut out);
        },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe {
            crate::avx2::rows::<ROW>(Tiles::new(rows, 6), &a, panel, start, finish, &mut out);
        },
        _ => plain::<ROW>(rows, a, panel, start, finish, &mut out),
    }
}

/// The same in plain Rust: the reference of the vector kernels, and the path of other processors.
fn plain<const ROW: usize>(
    rows: usize,
    a: Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    out: &mut Grid<&mut [f32]>,
) {
    for m in 0..rows {
        let mut sums = [0.0_f32; PANEL];
        match start {
            Start::Zero => {}
            Start::Bias(bias) => sums.copy_from_slice(&bias[..PANEL]),
            Start::Accumulate => {
                for (half, sums) in sums.chunks_exact_mut(HALF).enumerate() {
                    sums.copy_from_slice(&out.data[m * out.row + half * out.half..][..HALF]);
                }
            }
        }
        let (columns, _) = panel.as_chunks::<PANEL>();
        for block in 0..a.blocks {
            let strip = &a.data[m * ROW + block * a.block_stride..][..a.block_len];
            for (x, column) in strip.iter().zip(&columns[block * a.block_len..]) {
                for (sum, w) in sums.iter_mut().zip(column) {
                    *sum += x * w;
                }
            }
        }
        for (half, sums) in sums.chunks_exact_mut(HALF).enumerate() {
            match finish {
                Finish::Store => {}
                Finish::Relu => sums.iter_mut().for_each(|sum| *sum = sum.max(0.0)),
                Finish::Mask(mask) => {
                    let mask = &mask.data[m * mask.row + half * mask.half..][..HALF];
                    for (sum, activation) in sums.iter_mut().zip(mask) {
                        *sum = if *activation > 0.0 { *sum } else { 0.0 };
                    }
                }
            }
            out.data[m * out.row + half * out.half..][..HALF].copy_from_slice(sums);
        }
    }
}
