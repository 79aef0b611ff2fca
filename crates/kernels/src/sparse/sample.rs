//! conv2 where zeros are left out.
//!
//! conv2 has kernel 3, stride 2, and 32 channels on either side, channels last: position p reads
//! the rows 2p, 2p + 1 and 2p + 2 of its padded input (`[rows][32]`, row 0 padding). There is a
//! ReLU before it and one behind: about half of its inputs are zero, and in a trained network more
//! than half of its output gradients. As in [`sparse`](super) masks have a bit for each value that
//! is not, sums are made in the order of the dense products, and the bits are the same (test
//! `convolutions_that_leave_out_zeros_have_the_bits_of_those_that_do_not`).
//!
//! - Output: each value of an even row is multiplied by its channel's weights for the two positions
//!   that read the row, of an odd row for the one. The sums of a position wait in registers for its
//!   next row.
//! - Input gradient: each value is multiplied by its channel's weights for the three rows that its
//!   position reads, six registers of AVX-512. A row that two positions read waits in registers for
//!   the second.
//! - Weight gradient: for each output channel, each position's value is multiplied by its whole
//!   window, six registers. The sums are `[channel][window]`, the transpose of the weights' order.

use super::masks::CHANNELS;
use super::operands::{SampleForward, SampleGradient, WINDOW};
use super::plain;
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use crate::dispatch::{Isa, on_set};
use crate::operands::HALF;

/// Above this share of inputs that are not zero the dense forward product is faster. Measured on a
/// processor with one 512-bit multiply-add a cycle: 4.8, 5.8 and 6.7 µs a sample at a share of 0.4,
/// 0.5 and 0.6, dense 7.1.
const DENSE_INPUT: f64 = 0.65;

impl SampleForward<'_> {
    /// Computes the output of `positions` positions and answers `true`, unless too many inputs are
    /// not zero: then it answers `false` and writes nothing. `masks` is memory for the masks of the
    /// rows.
    ///
    /// # Panics
    ///
    /// If an operand is too short.
    pub fn run_if_few(&mut self, isa: Isa, positions: usize, masks: &mut Vec<u32>) -> bool {
        let rows = 2 * positions + 1;
        assert!(positions > 0 && self.input.len() >= rows * CHANNELS, "inputs: {}", self.input.len());
        assert!(self.weights.len() >= WINDOW * CHANNELS, "weights: {}", self.weights.len());
        assert!(self.bias.len() >= CHANNELS, "bias: {}", self.bias.len());
        let needed = (positions - 1) * self.out.row + self.out.half + HALF;
        assert!(self.out.data.len() >= needed, "output: {} < {needed}", self.out.data.len());
        masks.clear();
        masks.resize(rows, 0);
        let (input, _) = self.input.as_chunks::<CHANNELS>();
        // SAFETY: no condition but the set.
        let kept = unsafe { on_set!(isa, mask_rows(input, masks)) };
        if f64::from(kept) > DENSE_INPUT * (rows * CHANNELS) as f64 {
            return false;
        }
        // SAFETY: the lengths are checked above.
        unsafe { on_set!(isa, sample_forward(self, masks)) }
        true
    }
}

impl SampleGradient<'_> {
    fn check(&self) {
        let positions = self.masks.positions.len();
        assert!(self.d_out.len() >= positions * CHANNELS, "output gradients: {}", self.d_out.len());
        assert!(self.input.len() >= (2 * positions + 1) * CHANNELS, "inputs: {}", self.input.len());
    }

    /// The gradient of the input where the input is positive, else 0, in the rows 1 … `rows` of
    /// `d_input`.
    ///
    /// `transposed` are the weights as `[kernel 2, 0, 1][output channel][input channel]`.
    ///
    /// # Panics
    ///
    /// If an operand is too short.
    pub fn input_gradient(&self, isa: Isa, transposed: &[f32], d_input: &mut [f32], rows: usize) {
        self.check();
        let positions = self.masks.positions.len();
        assert!(rows == 2 * positions || rows + 1 == 2 * positions, "{rows} rows of {positions} positions");
        assert!(d_input.len() >= (rows + 1) * CHANNELS, "input gradient: {}", d_input.len());
        assert!(transposed.len() >= WINDOW * CHANNELS, "weights: {}", transposed.len());
        // SAFETY: the lengths are checked above.
        unsafe { on_set!(isa, sample_input_gradient(self, transposed, d_input, rows)) }
    }

    /// Adds the sample's weight gradient, summed from zero, to `gradient`
    /// `[output channel][kernel][input channel]`.
    ///
    /// `sums` is memory for as much.
    ///
    /// # Panics
    ///
    /// If an operand is too short.
    pub fn add_weight_gradient(&self, isa: Isa, sums: &mut [f32], gradient: &mut [f32]) {
        self.check();
        let len = CHANNELS * WINDOW;
        assert!(sums.len() >= len && gradient.len() >= len, "sums: {}, {}", sums.len(), gradient.len());
        // SAFETY: the lengths are checked above.
        unsafe { on_set!(isa, sample_weight_gradient(self, sums, gradient)) }
    }
}
