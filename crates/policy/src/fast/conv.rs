//! The two convolutions of the trunk, one sample at a time, channels last.
//!
//! Both have stride 2 and padding 1. With channels last and rows of zeros around, the window of a
//! position is one contiguous slice, and the windows of consecutive positions are rows a fixed
//! distance apart: a convolution is a product of overlapping rows and a panel of 32 output
//! channels. Nothing is gathered.
//!
//! | | left operand | distance of rows |
//! |---|---|---|
//! | conv1 | padded scans, one block of 5 beams a frame | 2 |
//! | conv2 | padded output of conv1, 96 values | 64 |
//! | input gradient of conv2, even rows | gradients of two neighbours, 64 values | 32 |
//! | input gradient of conv2, odd rows | gradient of one position, 32 values | 32 |
//!
//! Row r of the padded output of conv1 (position r − 1) is read by position ⌊r/2⌋ with kernel index
//! r mod 2 and, for even r, by position r/2 − 1 with kernel index 2.
//!
//! conv1 is computed again in the backward pass: 2.6 % more arithmetic instead of 21 MB written and
//! read for 640 samples. conv1 needs no input gradient.

use jostle_kernels::{
    AlignedVec, BLOCK, Count, Finish, Grid, HALF, Isa, PANEL, SampleForward, SampleGradient, SampleMasks,
    Start, Steps, Strips, outer_products, rows_times_panel,
};

use crate::config::{CONV_CHANNELS, CONV1_KERNEL, CONV2_KERNEL, NetworkConfig};

// The kernels are made for 32 channels, one panel.
const _: () = assert!(CONV_CHANNELS == PANEL);

/// Distance between two rows of conv1's left operand.
const CONV1_ROW: usize = 2;
/// Distance between two rows of conv2's left operand.
const CONV2_ROW: usize = 2 * CONV_CHANNELS;

/// Sizes of the convolutions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Convolutions {
    frames: usize,
    beams: usize,
    /// Distance between two padded scans.
    scan_stride: usize,
    /// Positions behind conv1.
    len1: usize,
    /// Positions behind conv2.
    len2: usize,
}

/// Parameters (or gradients) of both convolutions: `[frame][kernel][channel]`, bias,
/// `[kernel][input][channel]`, bias.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConvParts<T> {
    pub(super) weight1: T,
    pub(super) bias1: T,
    pub(super) weight2: T,
    pub(super) bias2: T,
}

/// Memory for one sample at a time.
#[derive(Debug, Clone)]
pub(super) struct ConvScratch {
    /// Output of conv1 with a row of zeros at either end.
    hidden: AlignedVec,
    /// A bit for each of its values that is not zero.
    rows: Vec<u32>,
    /// Its gradient.
    d_hidden: AlignedVec,
    /// A bit for each of a sample's gradients behind conv2 that is not zero.
    pub(super) masks: SampleMasks,
    /// A sample's sums of conv2's weight gradient where zeros are left out.
    sums: AlignedVec,
    /// The chunk's, `[channel][kernel][input]`.
    weight2: AlignedVec,
}

impl Convolutions {
    pub(super) fn new(config: &NetworkConfig) -> Self {
        let (frames, beams) = (config.frames, config.input_beams());
        let scan_stride = (beams + 2).next_multiple_of(8);
        Self { frames, beams, scan_stride, len1: config.conv1_len(), len2: config.conv2_len() }
    }

    /// Weights of conv1.
    pub(super) fn weights1(&self) -> usize {
        self.frames * CONV1_KERNEL * CONV_CHANNELS
    }

    /// Length of one sample's padded scans.
    pub(super) fn scans_len(&self) -> usize {
        self.frames * self.scan_stride
    }

    /// Features behind conv2.
    pub(super) fn features(&self) -> usize {
        self.len2 * CONV_CHANNELS
    }

    pub(super) fn scratch(&self) -> ConvScratch {
        // Rows 0 to 2·len2 are read by conv2; behind the last position they stay zero.
        let rows = (self.len1 + 2).max(2 * self.len2 + 1);
        let hidden = AlignedVec::zeros(rows * CONV_CHANNELS);
        let sums = AlignedVec::zeros(TRANSPOSED2_LEN);
        ConvScratch {
            d_hidden: hidden.clone(),
            hidden,
            rows: Vec::new(),
            masks: SampleMasks::default(),
            weight2: sums.clone(),
            sums,
        }
    }

    /// Copies an observation's scans, each behind one zero. What lies behind a scan is zero from
    /// the start.
    pub(super) fn pad(&self, observation: &[f32], padded: &mut [f32]) {
        let scans = observation[..self.frames * self.beams].chunks_exact(self.beams);
        for (scan, padded) in scans.zip(padded.chunks_exact_mut(self.scan_stride)) {
            padded[1..=self.beams].copy_from_slice(scan);
        }
    }

    /// conv1 and ReLU into the rows 1 … of `hidden`.
    fn conv1(&self, isa: Isa, parameters: ConvParts<&[f32]>, padded: &[f32], hidden: &mut [f32]) {
        let a = Strips {
            data: padded,
            blocks: self.frames,
            block_len: CONV1_KERNEL,
            block_stride: self.scan_stride,
        };
        let out = Grid { data: &mut hidden[CONV_CHANNELS..], row: CONV_CHANNELS, half: HALF };
        let start = Start::Bias(parameters.bias1);
        rows_times_panel::<CONV1_ROW>(isa, self.len1, a, parameters.weight1, start, Finish::Relu, out);
    }

    /// Both convolutions of one sample; conv2 leaves out zeros where that is faster. `out` begins
    /// with the row of this sample in the chunk's first block.
    pub(super) fn forward(
        &self,
        isa: Isa,
        parameters: ConvParts<&[f32]>,
        padded: &[f32],
        scratch: &mut ConvScratch,
        out: &mut [f32],
        block_stride: usize,
    ) {
        let ConvScratch { hidden, rows, .. } = scratch;
        self.conv1(isa, parameters, padded, hidden);
        let (weights, bias) = (parameters.weight2, parameters.bias2);
        let out = Grid { data: out, row: PANEL / BLOCK * block_stride, half: block_stride };
        let mut sample = SampleForward { input: hidden, weights, bias, out };
        if sample.run_if_few(isa, self.len2, rows) {
            return;
        }
        let out = sample.out;
        let a = Strips { data: hidden, blocks: 1, block_len: CONV2_KERNEL * CONV_CHANNELS, block_stride: 0 };
        rows_times_panel::<CONV2_ROW>(isa, self.len2, a, weights, Start::Bias(bias), Finish::Relu, out);
    }

    /// Adds one sample's gradients; `d_out` `[len2, 32]` is already behind the ReLU of conv2.
    ///
    /// `transposed2` is [`transpose2`](Self::transpose2) of the present weights. If zeros are to be
    /// left out, the scratch memory has the sample's masks, and the gradient of conv2's weights
    /// stays there until [`take_weight2`](Self::take_weight2).
    #[allow(clippy::too_many_arguments)] // What the forward pass kept, what comes in, what goes out.
    pub(super) fn backward(
        &self,
        isa: Isa,
        parameters: ConvParts<&[f32]>,
        transposed2: &[f32],
        padded: &[f32],
        d_out: &[f32],
        leave_out_zeros: bool,
        scratch: &mut ConvScratch,
        gradient: &mut ConvParts<&mut [f32]>,
    ) {
        let ConvScratch { hidden, d_hidden, masks, sums, weight2, .. } = scratch;
        self.conv1(isa, parameters, padded, hidden);
        let steps = |data, step| Steps { data, step, segment: 0, half: HALF };
        let count = |steps| Count { segments: 1, steps };

        add_rows(&d_out[..self.len2 * CONV_CHANNELS], gradient.bias2);
        if leave_out_zeros {
            let sample = SampleGradient { d_out, masks, input: hidden };
            sample.add_weight_gradient(isa, sums, weight2);
            sample.input_gradient(isa, transposed2, d_hidden, self.len1);
        } else {
            let (a, b) = (steps(&hidden[..], CONV2_ROW), steps(d_out, CONV_CHANNELS));
            let window = CONV2_KERNEL * CONV_CHANNELS;
            outer_products(isa, window, count(self.len2), a, b, true, gradient.weight2);
            self.input_gradient(isa, transposed2, d_out, hidden, d_hidden);
        }
        let d_hidden = &d_hidden[CONV_CHANNELS..(self.len1 + 1) * CONV_CHANNELS];
        let b = steps(d_hidden, CONV_CHANNELS);
        let frames = gradient.weight1.chunks_exact_mut(CONV1_KERNEL * CONV_CHANNELS);
        for (scan, gradient) in padded.chunks_exact(self.scan_stride).zip(frames) {
            let a = steps(scan, CONV1_ROW);
            outer_products(isa, CONV1_KERNEL, count(self.len1), a, b, true, gradient);
        }
        add_rows(d_hidden, gradient.bias1);
    }

    /// Adds what samples have left in the scratch memory to the gradient of conv2's weights, and
    /// leaves zeros there.
    pub(super) fn take_weight2(scratch: &mut ConvScratch, gradient: &mut [f32]) {
        let window = CONV2_KERNEL * CONV_CHANNELS;
        for (channel, of_channel) in scratch.weight2.chunks_exact_mut(window).enumerate() {
            for (k, sum) in of_channel.iter_mut().enumerate() {
                gradient[k * CONV_CHANNELS + channel] += std::mem::take(sum);
            }
        }
    }

    /// Gradient of conv1's output behind its ReLU, in the rows 1 … `len1` of `d_hidden`.
    fn input_gradient(
        &self,
        isa: Isa,
        transposed2: &[f32],
        d_out: &[f32],
        hidden: &[f32],
        d_hidden: &mut [f32],
    ) {
        let square = CONV_CHANNELS * CONV_CHANNELS;
        let mut product = |first_row: usize, rows: usize, d_out: &[f32], len: usize, weights: &[f32]| {
            if rows == 0 {
                return;
            }
            let at = first_row * CONV_CHANNELS;
            let a = Strips { data: d_out, blocks: 1, block_len: len, block_stride: 0 };
            let finish = Finish::Mask(Grid { data: &hidden[at..], row: CONV2_ROW, half: HALF });
            let out = Grid { data: &mut d_hidden[at..], row: CONV2_ROW, half: HALF };
            rows_times_panel::<CONV_CHANNELS>(isa, rows, a, weights, Start::Zero, finish, out);
        };
        // Rows 1, 3, …: only kernel index 1.
        product(1, self.len2, d_out, CONV_CHANNELS, &transposed2[2 * square..]);
        // Rows 2, 4, … between two positions: kernel index 2 of the one before, 0 of the one
        // behind.
        product(2, self.len2 - 1, d_out, 2 * CONV_CHANNELS, transposed2);
        // An even number of rows ends with one that has a single reader; for 512 beams (255 rows)
        // there is none.
        if 2 * self.len2 == self.len1 {
            product(self.len1, 1, &d_out[(self.len2 - 1) * CONV_CHANNELS..], CONV_CHANNELS, transposed2);
        }
    }

    /// conv2's weights for its input gradient: `[kernel 2, 0, 1][channel][input]`.
    pub(super) fn transpose2(weight2: &[f32], transposed2: &mut [f32]) {
        let square = CONV_CHANNELS * CONV_CHANNELS;
        for (kernel, to) in [2, 0, 1].into_iter().zip(transposed2.chunks_exact_mut(square)) {
            let from = &weight2[kernel * square..][..square];
            for (at, to) in to.iter_mut().enumerate() {
                *to = from[at % CONV_CHANNELS * CONV_CHANNELS + at / CONV_CHANNELS];
            }
        }
    }
}

/// Length of [`Convolutions::transpose2`].
pub(super) const TRANSPOSED2_LEN: usize = CONV2_KERNEL * CONV_CHANNELS * CONV_CHANNELS;

/// Adds the rows of 32 values to `sums`, from a sum of their own that starts at zero.
fn add_rows(rows: &[f32], sums: &mut [f32]) {
    let (rows, _) = rows.as_chunks::<CONV_CHANNELS>();
    let mut partial = [0.0_f32; CONV_CHANNELS];
    for row in rows {
        partial.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
    sums.iter_mut().zip(partial).for_each(|(sum, value)| *sum += value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fast::tests::values;

    /// One chunk of samples of which this share of the gradients is not zero: the gradient of all
    /// parameters, in bits.
    fn gradient(isa: Isa, beams: usize, share: f32, leave_out_zeros: bool) -> Vec<u32> {
        let config = NetworkConfig { beams, ..NetworkConfig::default() };
        let conv = Convolutions::new(&config);
        let (len1, len2) = (conv.weights1(), TRANSPOSED2_LEN);
        let (weight1, bias1, weight2, bias2) =
            (values(len1, 1), values(PANEL, 2), values(len2, 3), values(PANEL, 4));
        let parameters = ConvParts { weight1: &weight1[..], bias1: &bias1, weight2: &weight2, bias2: &bias2 };
        let mut transposed2 = vec![0.0; TRANSPOSED2_LEN];
        Convolutions::transpose2(&weight2, &mut transposed2);
        let mut parts = [vec![0.0; len1], vec![0.0; PANEL], vec![0.0; len2], vec![0.0; PANEL]];
        let mut scratch = conv.scratch();
        for sample in 0..3 {
            let mut padded = vec![0.0; conv.scans_len()];
            conv.pad(&values(config.frames * beams, 10 + sample), &mut padded);
            let keep = values(conv.features(), 20 + sample);
            let d_out: Vec<f32> = values(conv.features(), 30 + sample)
                .into_iter()
                .zip(keep)
                .map(|(d, keep)| if keep < 2.0 * share - 1.0 { d } else { 0.0 })
                .collect();
            let mask = |values: &[f32]| {
                values.iter().rev().fold(0, |mask, value| mask << 1 | u64::from(*value != 0.0))
            };
            scratch.masks.set(d_out.chunks(64).map(mask));
            let [weight1, bias1, weight2, bias2] = &mut parts;
            let mut gradient = ConvParts {
                weight1: &mut weight1[..],
                bias1: &mut bias1[..],
                weight2: &mut weight2[..],
                bias2: &mut bias2[..],
            };
            conv.backward(
                isa,
                parameters,
                &transposed2,
                &padded,
                &d_out,
                leave_out_zeros,
                &mut scratch,
                &mut gradient,
            );
        }
        if leave_out_zeros {
            Convolutions::take_weight2(&mut scratch, &mut parts[2]);
        }
        parts.iter().flatten().map(|value| value.to_bits()).collect()
    }

    /// conv2 of so many positions, of whose inputs this share is not zero, written row by row: in
    /// bits, without and with zeros.
    fn outputs(isa: Isa, positions: usize, share: f32) -> [Option<Vec<u32>>; 2] {
        let (weights, bias) = (values(TRANSPOSED2_LEN, 1), values(PANEL, 2));
        let keep = values((2 * positions + 1) * CONV_CHANNELS, 3);
        let input: Vec<f32> = values(keep.len(), 4)
            .into_iter()
            .zip(keep)
            .map(|(x, keep)| if keep < 2.0 * share - 1.0 { x.abs() } else { 0.0 })
            .collect();
        let (row, half) = (40, 20);
        let before = values(positions * row, 5);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let mut found = before.clone();
        let out = Grid { data: &mut found[..], row, half };
        let mut sample = SampleForward { input: &input, weights: &weights, bias: &bias, out };
        let has_run = sample.run_if_few(isa, positions, &mut vec![7]);
        assert!(has_run || found == before, "an output is written although zeros were not left out");
        let mut expected = before.clone();
        let out = Grid { data: &mut expected[..], row, half };
        let (blocks, block_len, block_stride) = (1, CONV2_KERNEL * CONV_CHANNELS, 0);
        let a = Strips { data: &input[..], blocks, block_len, block_stride };
        let start = Start::Bias(&bias);
        rows_times_panel::<CONV2_ROW>(isa, positions, a, &weights, start, Finish::Relu, out);
        [has_run.then(|| bits(&found)), Some(bits(&expected))]
    }

    #[test]
    fn convolutions_that_leave_out_zeros_have_the_bits_of_those_that_do_not() {
        for isa in Isa::available() {
            for positions in [1, 2, 6, 75, 128] {
                for share in [0.0, 0.1, 0.5] {
                    let [found, expected] = outputs(isa, positions, share);
                    assert!(found == expected, "{positions} positions, {share}");
                }
                assert_eq!(outputs(isa, positions, 1.0)[0], None);
            }
            // 6, 6, 76, 128 and 128 positions; with 25 and 513 beams the last row has a single
            // reader.
            for beams in [24, 25, 304, 512, 513] {
                for share in [0.0, 0.3, 1.0] {
                    let found = gradient(isa, beams, share, true);
                    assert!(found == gradient(isa, beams, share, false), "{beams} beams, {share}");
                }
            }
        }
    }
}
