//! One-dimensional convolution of stride 2 and padding 1, only from matrix products.
//!
//! candle 0.11.1 has a `conv1d`, but on the CPU its backward pass copies a transposed gradient to
//! contiguous memory and then multiplies by the original (huggingface/candle #3836): the losses
//! still fall, with wrong gradients. So the windows are made here from one zero-padded buffer, and
//! only `matmul`, whose gradient is right, sees them.
//!
//! Channels come last, so a step of the stride, two positions, is one contiguous row of
//! `2·channels` values. A window of an odd kernel is then a run of (kernel + 1)/2 rows, the last
//! tap of the last row having weight 0:
//!
//! ```text
//! positions  0 x₀ | x₁ x₂ | x₃ x₄ | x₅ …      (a 0 before and at least one behind)
//! rows         0  |   1   |   2   | …
//! window 0   [ 0 x₀  x₁ x₂  x₃ ]              kernel 5: rows 0, 1, 2
//! window 1           [ x₁ x₂  x₃ x₄  x₅ ]               rows 1, 2, 3
//! ```
//!
//! The output is the sum over the kernel's row pairs j of (all rows, from row j on)·(weights of
//! pair j). A view that starts j rows later is contiguous, for the whole batch at once; the few
//! windows that reach from one sample into the next are dropped.
//!
//! # Rejected
//!
//! An im2col buffer by `Tensor::cat` of one view per tap: the same numbers, three times slower on
//! the CPU.

use candle_core::{Result, Tensor};

use super::Weights;

/// Cross-correlation as in PyTorch, with channels last.
///
/// # Shapes
///
/// `xs` `[B, positions, inputs]`, weight `[outputs, inputs, kernel]` (odd
/// kernel) → `[B, windows, outputs]` with ⌊(positions + 2 − kernel)/2⌋ + 1 windows
pub fn conv1d(xs: &Tensor, weights: &Weights, name: &str) -> Result<Tensor> {
    let weight = weights.get(&format!("{name}.weight"))?;
    let bias = weights.get(&format!("{name}.bias"))?;
    let (batch, positions, inputs) = xs.dims3()?;
    let (outputs, _inputs, kernel) = weight.dims3()?;
    let n_windows = (positions + 2 - kernel) / 2 + 1;
    let n_pairs = kernel.div_ceil(2);
    let n_rows = n_windows + n_pairs - 1;

    // [B, positions, inputs] → [B·rows, 2·inputs]
    let rows = xs.pad_with_zeros(1, 1, 2 * n_rows - 1 - positions)?.reshape((batch * n_rows, 2 * inputs))?;
    // [outputs, inputs, kernel] → [pairs, 2·inputs, outputs]
    let taps = weight
        .pad_with_zeros(2, 0, 2 * n_pairs - kernel)?
        .permute((2, 1, 0))?
        .contiguous()?
        .reshape((n_pairs, 2 * inputs, outputs))?;

    let n_products = batch * n_rows - (n_pairs - 1);
    let mut sum = rows.narrow(0, 0, n_products)?.matmul(&taps.get(0)?)?;
    for pair in 1..n_pairs {
        sum = (sum + rows.narrow(0, pair, n_products)?.matmul(&taps.get(pair)?)?)?;
    }
    sum.pad_with_zeros(0, 0, n_pairs - 1)?
        .reshape((batch, n_rows, outputs))?
        .narrow(1, 0, n_windows)?
        .broadcast_add(bias)
}
