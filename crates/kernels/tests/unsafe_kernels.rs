//! Every unsafe kernel over operands that end where the last value that is needed ends, small
//! enough for Miri.
//!
//! An element read or written outside its operand is an error under Miri and under an address
//! sanitiser, and a changed guard value elsewhere (the commands: `docs/reliability.md`). Sizes are
//! such that every kernel has full and partial tiles; values are checked against sums in double
//! precision.

use jostle_kernels::{
    AdamStep, AlignedVec, Chunks, Count, Finish, Forward, Grid, HALF, Isa, Linear, PANEL, SampleForward,
    SampleGradient, SampleMasks, Start, Steps, Strips, adam_step, outer_products, rows_times_panel,
};

/// A fixed, irregular sequence in −1 … 1, in memory of exactly this length.
fn values(len: usize, seed: u32) -> Box<[f32]> {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    (0..len)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn assert_near(found: f32, expected: f64) {
    assert!((f64::from(found) - expected).abs() <= 2e-6 * (1.0 + expected.abs()), "{found} {expected}");
}

/// Numbers of rows: AVX2, which Miri knows, has tiles of up to 6 rows, AVX-512 of up to 14.
const ROWS: &[usize] = if cfg!(miri) { &[1, 7] } else { &[1, 7, 13, 15] };

/// The start and the finish of a product.
#[derive(Clone, Copy, Debug)]
enum Mode {
    ZeroStore,
    BiasRelu,
    AccumulateMask,
}

fn check_rows<const ROW: usize>(isa: Isa, rows: usize, (blocks, block_len): (usize, usize), mode: Mode) {
    let block_stride = rows * ROW + 1;
    let a = values((rows - 1) * ROW + (blocks - 1) * block_stride + block_len, 1);
    let panel = values(blocks * block_len * PANEL, 2);
    let bias = values(PANEL, 3);
    // The halves of a row are side by side, or each in a grid of its own.
    let (row, half) = if matches!(mode, Mode::ZeroStore) { (PANEL, HALF) } else { (HALF, rows * HALF + 1) };
    let before = values((rows - 1) * row + half + HALF, 4);
    let activations = values(before.len(), 5);
    let mut out = before.clone();
    let (start, finish) = match mode {
        Mode::ZeroStore => (Start::Zero, Finish::Store),
        Mode::BiasRelu => (Start::Bias(&bias), Finish::Relu),
        Mode::AccumulateMask => (Start::Accumulate, Finish::Mask(Grid { data: &activations[..], row, half })),
    };
    let strips = Strips { data: &a, blocks, block_len, block_stride };
    rows_times_panel::<ROW>(isa, rows, strips, &panel, start, finish, Grid { data: &mut out, row, half });

    let mut expected: Vec<f64> = before.iter().map(|value| f64::from(*value)).collect();
    for m in 0..rows {
        for n in 0..PANEL {
            let at = m * row + n / HALF * half + n % HALF;
            let product: f64 = (0..blocks * block_len)
                .map(|k| {
                    let x = a[m * ROW + k / block_len * block_stride + k % block_len];
                    f64::from(x) * f64::from(panel[k * PANEL + n])
                })
                .sum();
            expected[at] = match mode {
                Mode::ZeroStore => product,
                Mode::BiasRelu => (f64::from(bias[n]) + product).max(0.0),
                Mode::AccumulateMask if activations[at] > 0.0 => expected[at] + product,
                Mode::AccumulateMask => 0.0,
            };
        }
    }
    out.iter().zip(expected).for_each(|(found, expected)| assert_near(*found, expected));
}

#[test]
fn rows_read_and_write_their_operands_alone() {
    for isa in Isa::available() {
        for &rows in ROWS {
            for mode in [Mode::ZeroStore, Mode::BiasRelu, Mode::AccumulateMask] {
                check_rows::<2>(isa, rows, (2, 3), mode);
                check_rows::<16>(isa, rows, (2, 2), mode);
            }
        }
    }
}

#[test]
fn outer_products_read_and_write_their_operands_alone() {
    for isa in Isa::available() {
        for rows in [1, 6, 14, 15] {
            for (segments, steps, accumulate) in [(1, 3, false), (2, 2, true)] {
                let (a_step, b_step, b_half) = (rows, PANEL + 1, HALF + 1);
                let (a_segment, b_segment) = (steps * a_step + 1, steps * b_step + 2);
                let last = |step: usize, segment: usize| (segments - 1) * segment + (steps - 1) * step;
                let a = values(last(a_step, a_segment) + rows, 1);
                let b = values(last(b_step, b_segment) + b_half + HALF, 2);
                let before = values(rows * PANEL, 3);
                let mut out = before.clone();
                let left = Steps { data: &a, step: a_step, segment: a_segment, half: 0 };
                let right = Steps { data: &b, step: b_step, segment: b_segment, half: b_half };
                outer_products(isa, rows, Count { segments, steps }, left, right, accumulate, &mut out);
                for (at, found) in out.iter().enumerate() {
                    let (m, n) = (at / PANEL, at % PANEL);
                    let mut sum = if accumulate { f64::from(before[at]) } else { 0.0 };
                    for k in 0..segments * steps {
                        let x = a[k / steps * a_segment + k % steps * a_step + m];
                        let y = b[k / steps * b_segment + k % steps * b_step + n / HALF * b_half + n % HALF];
                        sum += f64::from(x) * f64::from(y);
                    }
                    assert_near(*found, sum);
                }
            }
        }
    }
}

/// The values of a row of activations that are zero. Half of them in each case: with many more the
/// dense products would be used.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Zeros {
    /// Here and there, as behind a ReLU.
    Irregular,
    /// All of every second row: the masks of the others are full.
    Rows,
    /// Every second column: the masks of the other columns are full.
    Columns,
}

const ZEROS: [Zeros; 3] = [Zeros::Irregular, Zeros::Rows, Zeros::Columns];

impl Zeros {
    fn activation(self, row: usize, column: usize, x: f32) -> f32 {
        match self {
            Self::Irregular => x.max(0.0),
            Self::Rows if row % 2 == 1 => 0.0,
            Self::Columns if column % 2 == 1 => 0.0,
            Self::Rows | Self::Columns => x.abs() + 0.1,
        }
    }
}

/// One span of inputs and one of outputs, of which half are zero: all operands of the products that
/// leave out zeros end with the last value needed.
#[test]
fn products_that_leave_out_zeros_read_and_write_their_operands_alone() {
    ZEROS.into_iter().for_each(leave_out_zeros);
}

fn leave_out_zeros(zeros: Zeros) {
    let layer = Linear::new(64, 64);
    for isa in Isa::available() {
        for batch in if cfg!(miri) { [17, 18] } else { [17, 90] } {
            let chunks = Chunks::new(batch);
            let (weights, bias) = (values(layer.weights(), 1), values(64, 2));
            let behind_relu = |seed| {
                let mut data = values(chunks.len(64), seed);
                for chunk in 0..chunks.count {
                    let blocks =
                        data[chunk * chunks.chunk_len(64)..].chunks_mut(chunks.block_stride()).take(4);
                    for (i, x) in blocks
                        .enumerate()
                        .flat_map(|(b, block)| block.iter_mut().enumerate().map(move |(i, x)| ((b, i), x)))
                    {
                        let (block, i) = i;
                        *x = zeros.activation(i / HALF, block * HALF + i % HALF, *x);
                    }
                }
                data
            };
            let (x, dy) = (behind_relu(3), behind_relu(4));
            let mut transposed = values(layer.transposed_len(), 5);
            layer.transpose(isa, &weights, &mut transposed);
            let (mut masks, mut dy_masks, mut columns) = (vec![0; chunks.size], Vec::new(), Vec::new());
            let mut full_rows = 0;
            let at = |row: usize, feature: usize| {
                let row_in_chunk = row % chunks.size;
                let block = feature / HALF * chunks.block_stride() + row_in_chunk * HALF + feature % HALF;
                row / chunks.size * chunks.chunk_len(64) + block
            };
            let (mut y, mut dx) = (values(chunks.len(64), 6), values(batch * 64, 7));
            for chunk in 0..chunks.count {
                let len = chunks.chunk_len(64);
                let part = chunk * len..(chunk + 1) * len;
                let forward = Forward::new(&chunks, chunk, &x[part.clone()], &mut y[part.clone()], true);
                layer.mask_chunk(isa, &chunks, forward.rows, forward.x, &mut masks);
                full_rows += masks[..forward.rows].iter().filter(|mask| **mask == u64::MAX).count();
                layer.forward_behind_relu(isa, &weights, &bias, forward, &masks);
                let (dy, x, rows) = (&dy[part.clone()], &x[part], chunks.rows(chunk));
                let dx = &mut dx[chunks.first(chunk) * 64..][..rows * 64];
                layer.input_gradient_between_relus(
                    isa,
                    &transposed,
                    &chunks,
                    rows,
                    dy,
                    x,
                    &masks,
                    dx,
                    64,
                    &mut dy_masks,
                );
            }
            let mut gradient = values(layer.weights(), 8);
            layer.weight_gradient_behind_relu(isa, &chunks, &x, &dy, &mut gradient, &mut columns);
            if layer.may_leave_out_zeros(batch) {
                // The case is what its name says.
                let full = |chunk: usize| u64::MAX >> (64 - chunks.rows(chunk));
                let is_full = |(i, mask): (usize, &u64)| *mask == full(i / 64);
                let full_columns = columns.iter().enumerate().filter(|column| is_full(*column)).count();
                let expected_rows = (0..chunks.count).map(|chunk| chunks.rows(chunk).div_ceil(2)).sum();
                assert_eq!(full_rows, if zeros == Zeros::Rows { expected_rows } else { 0 }, "{zeros:?}");
                let expected_columns = if zeros == Zeros::Columns { 32 * chunks.count } else { 0 };
                assert_eq!(full_columns, expected_columns, "{zeros:?}");
            }
            let weight = |input, output| f64::from(weights[layer.index(input, output)]);
            let of = |data: &[f32], row, feature| f64::from(data[at(row, feature)]);
            let sum = |term: &dyn Fn(usize) -> f64, n: usize| (0..n).map(term).sum::<f64>();
            for (row, n) in (0..batch).flat_map(|row| (0..64).map(move |n| (row, n))) {
                let forward = f64::from(bias[n]) + sum(&|i| of(&x, row, i) * weight(i, n), 64);
                assert_near(y[at(row, n)], forward.max(0.0));
                let back = sum(&|output| of(&dy, row, output) * weight(n, output), 64);
                assert_near(dx[row * 64 + n], if of(&x, row, n) > 0.0 { back } else { 0.0 });
            }
            for (input, output) in (0..64).flat_map(|input| (0..64).map(move |output| (input, output))) {
                let expected = sum(&|row| of(&x, row, input) * of(&dy, row, output), batch);
                assert_near(gradient[layer.index(input, output)], expected);
            }
        }
    }
}

#[test]
fn adam_steps_every_parameter_and_no_other() {
    for isa in Isa::available() {
        for len in [1, 16, 19] {
            let (mut parameters, gradient) = (values(len, 1), values(len, 2));
            let (mut m, mut v) = (vec![0.0; len].into_boxed_slice(), vec![0.0; len].into_boxed_slice());
            let before = parameters.clone();
            let step = AdamStep { learning_rate: 0.5, beta1: 0.9, beta2: 0.999, epsilon: 1e-8, step: 1 };
            adam_step(isa, &mut parameters, &gradient, &mut m, &mut v, &step);
            for ((found, before), g) in parameters.iter().zip(before).zip(gradient) {
                // The first step has the length of the learning rate.
                assert!((found - (before - 0.5 * g.signum())).abs() < 1e-5, "{found} {before} {g}");
            }
        }
    }
}

#[test]
fn a_transpose_fills_its_panels() {
    for isa in Isa::available() {
        let layer = Linear::new(35, PANEL);
        let weights = values(layer.weights(), 1);
        let mut transposed = vec![f32::NAN; layer.transposed_len()].into_boxed_slice();
        layer.transpose(isa, &weights, &mut transposed);
        for input in 0..2 * PANEL {
            for output in 0..PANEL {
                let found = transposed[input / PANEL * PANEL * PANEL + output * PANEL + input % PANEL];
                assert_eq!(found, if input < 35 { weights[layer.index(input, output)] } else { 0.0 });
            }
        }
    }
}

#[test]
fn aligned_memory_is_as_long_as_it_says() {
    for len in [0, 1, 16, 17] {
        let mut memory = AlignedVec::zeros(len);
        memory.iter_mut().zip(1_u16..).for_each(|(value, i)| *value = f32::from(i));
        assert_eq!(memory.len(), len);
        assert_eq!(memory.clone().iter().sum::<f32>(), (len * (len + 1) / 2) as f32);
        memory.reserve_len(40);
        assert_eq!(memory.len(), 40);
        assert!(memory.iter().all(|value| *value == 0.0));
    }
}

/// Positions of a sample whose operands end with the last value needed: conv2 where zeros are left
/// out.
#[test]
fn convolutions_that_leave_out_zeros_read_and_write_their_operands_alone() {
    ZEROS.into_iter().for_each(convolve);
}

fn convolve(zeros: Zeros) {
    let with_zeros = |len, seed| -> Box<[f32]> {
        let activation = |(i, x): (usize, &f32)| zeros.activation(i / 32, i % 32, *x);
        values(len, seed).iter().enumerate().map(activation).collect()
    };
    for isa in Isa::available() {
        for (positions, even) in if cfg!(miri) { vec![(2, false)] } else { vec![(2, true), (66, false)] } {
            let rows = 2 * positions - usize::from(!even);
            let d_out = with_zeros(positions * 32, 1);
            let input = with_zeros((2 * positions + 1) * 32, 2);
            let transposed = values(3 * 32 * 32, 3);
            let mut masks = SampleMasks::default();
            let mask =
                |values: &[f32]| values.iter().rev().fold(0, |mask, x| mask << 1 | u64::from(*x != 0.0));
            masks.set(d_out.chunks(64).map(mask));
            let sample = SampleGradient { d_out: &d_out, masks: &masks, input: &input };
            let mut d_input = values((rows + 1) * 32, 4);
            let before = d_input.clone();
            sample.input_gradient(isa, &transposed, &mut d_input, rows);
            assert_eq!(d_input[..32], before[..32], "the padding is left alone");
            // Half of the inputs are zero; the halves of an output lie 16 apart.
            let (bias, mut out) = (values(32, 7), values(positions * 32, 8));
            let grid = Grid { data: &mut out[..], row: 32, half: HALF };
            let mut forward = SampleForward { input: &input, weights: &transposed, bias: &bias, out: grid };
            assert!(forward.run_if_few(isa, positions, &mut Vec::new()));
            for (position, n) in (0..positions).flat_map(|position| (0..32).map(move |n| (position, n))) {
                let window = input[position * 64..].iter().take(96).enumerate();
                let sum = window.map(|(k, x)| f64::from(*x) * f64::from(transposed[k * 32 + n]));
                let expected = f64::from(bias[n]) + sum.sum::<f64>();
                assert_near(out[position * 32 + n], expected.max(0.0));
            }
            let (mut sums, mut gradient) = (values(3 * 32 * 32, 5), values(3 * 32 * 32, 6));
            let before = gradient.clone();
            sample.add_weight_gradient(isa, &mut sums, &mut gradient);

            let d = |position: usize, channel: usize| f64::from(d_out[position * 32 + channel]);
            for (row, n) in (1..=rows).flat_map(|row| (0..32).map(move |n| (row, n))) {
                let mut sum = 0.0;
                // Kernel index k of position p reads row 2p + k; the weights are in the order 2, 0,
                // 1.
                for (k, place) in [(0, 1), (1, 2), (2, 0)] {
                    if row >= k && (row - k) % 2 == 0 && (row - k) / 2 < positions {
                        for c in 0..32 {
                            sum += d((row - k) / 2, c) * f64::from(transposed[(place * 32 + c) * 32 + n]);
                        }
                    }
                }
                assert_near(d_input[row * 32 + n], if input[row * 32 + n] > 0.0 { sum } else { 0.0 });
            }
            for (c, k) in (0..32).flat_map(|c| (0..96).map(move |k| (c, k))) {
                let sum: f64 = (0..positions).map(|p| d(p, c) * f64::from(input[p * 64 + k])).sum();
                assert_near(gradient[c * 96 + k], f64::from(before[c * 96 + k]) + sum);
            }
        }
    }
}
