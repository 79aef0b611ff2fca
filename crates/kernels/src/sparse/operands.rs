//! The operands of the products that leave out zeros.

use super::masks::{CHANNELS, SampleMasks};
use crate::blocked::{BLOCK, Chunks};
use crate::operands::{Grid, Start};

/// Features that a value is multiplied by, and bits of a mask: four registers of 16 floats, eight
/// of 8.
pub(crate) const SPAN: usize = 64;
/// Blocks of a span.
pub(crate) const QUARTERS: usize = SPAN / BLOCK;
/// Inputs of a position of conv2: three rows.
pub(super) const WINDOW: usize = 3 * CHANNELS;
/// Distance between the windows of two positions.
pub(super) const WINDOW_STEP: usize = 2 * CHANNELS;

/// The function of a finished sum that is stored.
#[derive(Debug, Clone, Copy)]
pub(crate) enum After<'a> {
    /// The sum itself.
    Store,
    /// max(sum, 0).
    Relu,
    /// The sum where the row's mask has a bit, else 0.
    Keep(&'a [u64]),
}

/// One span of a product of rows and 64 columns.
#[derive(Debug)]
pub(crate) struct SpanProduct<'a> {
    /// The rows from the span's first block on.
    pub(crate) x: &'a [f32],
    /// Distance between two blocks of `x`.
    pub(crate) block_stride: usize,
    /// For each row, one bit for each of its 64 values that is not zero.
    pub(crate) masks: &'a [u64],
    /// Two panels of 32 columns, a row for each feature of the span.
    pub(crate) panels: [&'a [f32]; 2],
    /// The panels of the next product, to be fetched meanwhile.
    pub(crate) next: [&'a [f32]; 2],
    /// The value that the sums start from.
    pub(crate) start: Start<'a>,
    /// The function of a finished sum that is stored.
    pub(crate) after: After<'a>,
    /// The output; its four blocks are `half` apart.
    pub(crate) out: Grid<&'a mut [f32]>,
}

/// A span of inputs of a weight gradient.
#[derive(Debug)]
pub(crate) struct SpanGradient<'a> {
    /// The division of the batch.
    pub(crate) chunks: &'a Chunks,
    /// Number of outputs.
    pub(crate) outputs: usize,
    /// The output gradients of the batch.
    pub(crate) dy: &'a [f32],
    /// Their masks by [`mask_columns`](super::mask_columns).
    pub(crate) columns: &'a [u64],
    /// The inputs of the batch from the span's first block on.
    pub(crate) x: &'a [f32],
    /// Distance between two chunks of inputs.
    pub(crate) x_chunk: usize,
    /// The gradient from the span's first input on: panels of 32 outputs, `panel_stride` apart.
    pub(crate) gradient: &'a mut [f32],
    /// Distance between two panels.
    pub(crate) panel_stride: usize,
}

/// conv2 and its ReLU for one sample, whose input is behind a ReLU itself.
#[derive(Debug)]
pub struct SampleForward<'a> {
    /// The padded input, rows of 32 values: two for each position, and one.
    pub input: &'a [f32],
    /// Weights `[kernel][input channel][output channel]`.
    pub weights: &'a [f32],
    /// Bias of each output channel.
    pub bias: &'a [f32],
    /// The output; a row for each position.
    pub out: Grid<&'a mut [f32]>,
}

/// One sample's backward pass.
#[derive(Debug, Clone, Copy)]
pub struct SampleGradient<'a> {
    /// Gradients of the outputs behind the ReLU, `[position][32]`.
    pub d_out: &'a [f32],
    /// One bit for each of them that is not zero.
    pub masks: &'a SampleMasks,
    /// The padded input, itself behind a ReLU: rows of 32 values.
    pub input: &'a [f32],
}
