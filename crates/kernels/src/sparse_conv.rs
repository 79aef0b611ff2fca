//! conv2 where zeros are left out.
//!
//! conv2 has kernel 3, stride 2, and 32 channels on either side, channels last: position p reads the rows 2p, 2p + 1 and
//! 2p + 2 of its padded input (`[rows][32]`, row 0 padding). A ReLU stands before it and one behind: about half of its inputs are
//! zero, and in a trained network more than half of its output gradients. As in [`sparse`](crate::sparse) masks say which are
//! not, sums are made in the order of the dense products, and the bits are the same (test
//! `convolutions_that_leave_out_zeros_have_the_bits_of_those_that_do_not`).
//!
//! - Output: each value of an even row is multiplied by its channel's weights for the two positions that read the row, of
//!   an odd row for the one. The sums of a position wait in registers for its next row.
//! - Input gradient: each value is multiplied by its channel's weights for the three rows that its position reads, six
//!   registers of AVX-512. A row that two positions read waits in registers for the second.
//! - Weight gradient: for each output channel, each position's value is multiplied by its whole window, six registers.
//!   The sums are `[channel][window]`, the transpose of the weights' order.

use crate::Isa;
use crate::isa::Level;
use crate::rows::{Grid, HALF, PANEL};

/// Channels on either side.
const CHANNELS: usize = PANEL;
/// Inputs of a position: three rows.
pub(crate) const WINDOW: usize = 3 * CHANNELS;
/// Between the windows of two positions.
pub(crate) const WINDOW_STEP: usize = 2 * CHANNELS;
/// Above this share of inputs that are not zero the dense forward product is faster. Measured on a processor with one 512-bit
/// multiply-add a cycle: 4.8, 5.8 and 6.7 µs a sample at a share of 0.4, 0.5 and 0.6, dense 7.1.
const DENSE_INPUT: f64 = 0.65;
/// Positions of a mask.
const PART: usize = u64::BITS as usize;

/// Which output gradients of one sample are not zero, by position and by channel.
///
/// The memory grows to the longest sample and stays.
#[derive(Debug, Clone, Default)]
pub struct SampleMasks {
    /// Bit c of mask p: position p, channel c.
    positions: Vec<u32>,
    /// Bit i of mask c of part k: position 64·k + i, channel c.
    channels: Vec<[u64; CHANNELS]>,
}

impl SampleMasks {
    /// Takes the masks of a sample's features, position after position, 64 to a mask: two positions.
    pub fn set(&mut self, features: impl Iterator<Item = u64>) {
        self.positions.clear();
        self.positions.extend(features.flat_map(|mask| [mask as u32, (mask >> CHANNELS) as u32]));
        self.channels.clear();
        for part in self.positions.chunks(PART) {
            let [mut front, mut back] = [[0; CHANNELS]; 2];
            let in_front = part.len().min(CHANNELS);
            front[..in_front].copy_from_slice(&part[..in_front]);
            back[..part.len() - in_front].copy_from_slice(&part[in_front..]);
            transpose(&mut front);
            transpose(&mut back);
            self.channels.push(std::array::from_fn(|c| u64::from(front[c]) | u64::from(back[c]) << CHANNELS));
        }
    }
}

/// Transposes 32 × 32 bits: bit j of word i becomes bit i of word j. Halves are exchanged, then halves of halves.
fn transpose(words: &mut [u32; CHANNELS]) {
    let (mut width, mut low) = (CHANNELS / 2, 0x0000_ffff_u32);
    while width > 0 {
        for first in (0..CHANNELS).filter(|word| word & width == 0) {
            let exchanged = (words[first] >> width ^ words[first + width]) & low;
            words[first] ^= exchanged << width;
            words[first + width] ^= exchanged;
        }
        width /= 2;
        low ^= low << width;
    }
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

impl SampleForward<'_> {
    /// Computes the output of so many positions, unless too many inputs are not zero or the processor has no such product: then
    /// it says `false` and writes nothing. `masks` is memory for the masks of the rows.
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
        let kept = match isa.0 {
            // SAFETY: an `Isa` exists only where the processor has it.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { crate::avx512_sparse::mask_rows(input, masks) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { crate::avx2_sparse::mask_rows(input, masks) },
            _ => return false,
        };
        if f64::from(kept) > DENSE_INPUT * (rows * CHANNELS) as f64 {
            return false;
        }
        match isa.0 {
            // SAFETY: an `Isa` exists only where the processor has it; lengths are checked above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { crate::avx512_sparse::conv_forward(self, masks) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { crate::avx2_sparse::conv_forward(self, masks) },
            _ => return false,
        }
        true
    }
}

/// One sample's backward pass.
#[derive(Debug, Clone, Copy)]
pub struct SampleGradient<'a> {
    /// Gradients of the outputs behind the ReLU, `[position][32]`.
    pub d_out: &'a [f32],
    /// Which of them are not zero.
    pub masks: &'a SampleMasks,
    /// The padded input, itself behind a ReLU: rows of 32 values.
    pub input: &'a [f32],
}

impl SampleGradient<'_> {
    pub(crate) fn positions(&self) -> &[u32] {
        &self.masks.positions
    }

    pub(crate) fn channels(&self) -> &[[u64; CHANNELS]] {
        &self.masks.channels
    }

    fn check(&self) {
        let positions = self.masks.positions.len();
        assert!(self.d_out.len() >= positions * CHANNELS, "output gradients: {}", self.d_out.len());
        assert!(self.input.len() >= (2 * positions + 1) * CHANNELS, "inputs: {}", self.input.len());
    }

    /// The gradient of the input where the input is positive, else 0, in the rows 1 … `rows` of `d_input`.
    ///
    /// `transposed` are the weights as `[kernel 2, 0, 1][output channel][input channel]`.
    ///
    /// # Panics
    ///
    /// If zeros may not be left out, or an operand is too short.
    pub fn input_gradient(&self, isa: Isa, transposed: &[f32], d_input: &mut [f32], rows: usize) {
        self.check();
        let positions = self.masks.positions.len();
        assert!(rows == 2 * positions || rows + 1 == 2 * positions, "{rows} rows of {positions} positions");
        assert!(d_input.len() >= (rows + 1) * CHANNELS, "input gradient: {}", d_input.len());
        assert!(transposed.len() >= WINDOW * CHANNELS, "weights: {}", transposed.len());
        match isa.0 {
            // SAFETY: an `Isa` exists only where the processor has it; lengths are checked above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe {
                crate::avx512_sparse::conv_input_gradient(self, transposed, d_input, rows);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe {
                crate::avx2_sparse::conv_input_gradient(self, transposed, d_input, rows);
            },
            _ => unreachable!("callers ask whether this is available"),
        }
    }

    /// Adds the sample's weight gradient, summed from zero, to `gradient` `[output channel][kernel][input channel]`.
    ///
    /// `sums` is memory for as much.
    ///
    /// # Panics
    ///
    /// If zeros may not be left out, or an operand is too short.
    pub fn add_weight_gradient(&self, isa: Isa, sums: &mut [f32], gradient: &mut [f32]) {
        self.check();
        let len = CHANNELS * WINDOW;
        assert!(sums.len() >= len && gradient.len() >= len, "sums: {}, {}", sums.len(), gradient.len());
        match isa.0 {
            // SAFETY: an `Isa` exists only where the processor has it; lengths are checked above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { crate::avx512_sparse::conv_weight_gradient(self, sums, gradient) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { crate::avx2_sparse::conv_weight_gradient(self, sums, gradient) },
            _ => unreachable!("callers ask whether this is available"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_transposed() {
        let words: [u32; 32] = std::array::from_fn(|i| (i as u32 + 1).wrapping_mul(0x9e37_79b9));
        let mut transposed = words;
        transpose(&mut transposed);
        for (i, j) in (0..32).flat_map(|i| (0..32).map(move |j| (i, j))) {
            assert_eq!(transposed[j] >> i & 1, words[i] >> j & 1, "bit {j} of word {i}");
        }
    }

    #[test]
    fn masks_are_found_by_position_and_by_channel() {
        for spans in [1, 15, 16, 17, 33, 64] {
            let features: Vec<u64> =
                (1..=spans).map(|i: u64| i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
            let mut masks = SampleMasks::default();
            masks.set(features.iter().copied());
            assert_eq!(masks.positions.len(), 2 * features.len());
            assert_eq!(masks.channels.len(), (2 * features.len()).div_ceil(64));
            for (p, c) in (0..64 * masks.channels.len()).flat_map(|p| (0..32).map(move |c| (p, c))) {
                let expected = features.get(p / 2).is_some_and(|mask| mask >> (p % 2 * 32 + c) & 1 == 1);
                assert_eq!(masks.channels[p / 64][c] >> (p % 64) & 1 == 1, expected, "{p}, {c}");
                let by_position = masks.positions.get(p).is_some_and(|mask| mask >> c & 1 == 1);
                assert_eq!(by_position, expected, "{p}, {c}");
            }
        }
    }
}
