//! Products that leave out the zeros of a ReLU.
//!
//! Behind a ReLU about half of the activations are zero, and of the gradients that come back
//! through it two thirds. A dense product multiplies them all the same. Here each value of a row
//! that is not zero has a bit in a mask; those values are broadcast, one after the other, and
//! multiplied by 64 values of the other operand, which stay in the first-level cache. That reads an
//! operand of the multiply-add from memory each time, where the tiles of
//! [`dense`](crate::dense) keep it in a register for 14 rows, so it pays where the share of values
//! that are not zero is below `DENSE`; above it the dense product is used.
//!
//! # The same bits
//!
//! Sums are made in the order of the dense products, and a term that is left out would have added a
//! zero to a sum that is no negative zero. So which of the two is used changes no bit of a finite
//! result (test `products_that_leave_out_zeros_have_the_bits_of_those_that_do_not`).
//!
//! # Shapes
//!
//! A *span* is 64 features, outputs or rows: the bits of a mask, and four blocks of 16.
//!
//! # One body
//!
//! `span_body` and `sample_body` have the products for registers of any width, which `avx512`,
//! `avx2` and `plain` below compile. One row or column is taken at a time, its 64 sums in
//! registers. While the sums of one wait for each other, the processor is already at the next, for
//! no branch depends on a sum. Each register that a value is multiplied by is read from the
//! first-level cache: with AVX2 two a cycle, as many as a core can multiply and add anyway.

mod masks;
mod operands;
mod sample;
mod sample_body;
mod span_body;

pub use masks::SampleMasks;
pub(crate) use operands::{After, QUARTERS, SPAN, SpanGradient, SpanProduct};
pub use operands::{SampleForward, SampleGradient};

use crate::blocked::{BLOCK, Chunks};
use crate::dispatch::{Isa, on_set};
use crate::operands::{PANEL, Start};

/// The products for AVX-512.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use crate::lanes::avx512 as lanes;
    super::span_body::span_products!(#[target_feature(enable = "avx512f,bmi1,popcnt")]);
    super::sample_body::sample_products!(#[target_feature(enable = "avx512f,bmi1,popcnt")]);
}

/// The products for AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use crate::lanes::avx2 as lanes;
    super::span_body::span_products!(#[target_feature(enable = "avx2,fma,bmi1,popcnt")]);
    super::sample_body::sample_products!(#[target_feature(enable = "avx2,fma,bmi1,popcnt")]);
}

/// The products in plain Rust.
mod plain {
    use crate::lanes::plain as lanes;
    super::span_body::span_products!();
    super::sample_body::sample_products!();
}

/// Above this share of values that are not zero the dense product is faster. Measured at 4096 × 256
/// on a processor with one 512-bit multiply-add a cycle: about 1.4 times faster at a share of 0.5,
/// even at 0.7 to 0.75. conv2's backward pass of a sample: 7.2 µs at 0.4, 13.0 at 0.75, dense 13.8.
const DENSE: f64 = 0.75;
/// Fewer rows than this are bound by reading the weights, not by arithmetic.
const ROWS_MIN: usize = 16;

/// `true` if leaving out zeros may pay in products of `rows` rows.
pub(crate) fn is_worth_a_look(rows: usize) -> bool {
    rows >= ROWS_MIN
}

/// `true` if so few of `all` values have a bit in the masks that leaving out the others pays.
pub(crate) fn are_few<'a>(masks: impl Iterator<Item = &'a [u64]>, all: usize) -> bool {
    let kept: u32 = masks.flatten().map(|mask| mask.count_ones()).sum();
    f64::from(kept) < DENSE * all as f64
}

/// Sets bit i of mask number `span · step` where feature i of that span is not zero. `x` is a row
/// in blocks, `block_stride` floats apart, with `spans` spans.
///
/// # Panics
///
/// If an operand is too short for `spans` spans.
pub(crate) fn mask_row(
    isa: Isa,
    spans: usize,
    x: &[f32],
    block_stride: usize,
    masks: &mut [u64],
    step: usize,
) {
    let needed = (spans * QUARTERS).saturating_sub(1) * block_stride + BLOCK;
    assert!(x.len() >= needed, "activations: {} < {needed}", x.len());
    let masks = masks.iter_mut().step_by(step).take(spans);
    assert!(masks.len() == spans, "{} masks of {spans} spans", masks.len());
    // SAFETY: the length of `x` is checked above.
    unsafe { on_set!(isa, mask_row(x, block_stride, masks)) }
}

/// One mask for each output and chunk of output gradients in blocks: number
/// `chunk · outputs + output`. Bit i is row i of the chunk.
pub(crate) fn mask_columns(isa: Isa, chunks: &Chunks, outputs: usize, dy: &[f32], masks: &mut Vec<u64>) {
    assert!(chunks.size <= SPAN && outputs.is_multiple_of(BLOCK), "{chunks:?}, {outputs} outputs");
    masks.clear();
    masks.resize(chunks.count * outputs, 0);
    let (masks, _) = masks.as_chunks_mut::<BLOCK>();
    for (block, masks) in masks.iter_mut().enumerate() {
        let (chunk, block) = (block * BLOCK / outputs, block * BLOCK % outputs / BLOCK);
        let dy = &dy[chunk * chunks.chunk_len(outputs) + block * chunks.block_stride()..];
        let (dy, _) = dy[..chunks.rows(chunk) * BLOCK].as_chunks::<BLOCK>();
        // SAFETY: no condition but the set.
        unsafe { on_set!(isa, mask_block(dy, masks)) }
    }
}

/// `out[row, 0..64] = after(start + Σ_i x[row, i] · panels[i, 0..64])`.
///
/// # Panics
///
/// If an operand is too short for its shape.
pub(crate) fn rows_times_span(isa: Isa, mut product: SpanProduct<'_>) {
    let SpanProduct { x, block_stride, masks, panels, start, after, out, .. } = &product;
    let rows = masks.len();
    assert!(rows > 0, "a product of no rows");
    let needed = (QUARTERS - 1) * block_stride + rows * BLOCK;
    assert!(x.len() >= needed, "left operand: {} < {needed}", x.len());
    assert!(panels.iter().all(|panel| panel.len() >= SPAN * PANEL), "a panel is too short");
    let needed = (rows - 1) * out.row + (QUARTERS - 1) * out.half + BLOCK;
    assert!(out.data.len() >= needed, "output: {} < {needed}", out.data.len());
    if let Start::Bias(bias) = start {
        assert!(bias.len() >= SPAN, "bias too short: {}", bias.len());
    }
    if let After::Keep(kept) = after {
        assert!(kept.len() == rows, "{} masks for {rows} rows of output", kept.len());
    }
    // SAFETY: the lengths are checked above.
    unsafe { on_set!(isa, span_rows(&mut product)) }
}

/// `gradient[output panel][input][32] = Σ_row x[row, input] · dy[row, output]`, summed as by
/// [`Linear::weight_gradient`](crate::Linear::weight_gradient).
///
/// # Panics
///
/// If an operand is too short for its shape.
pub(crate) fn span_gradient(isa: Isa, mut product: SpanGradient<'_>) {
    let SpanGradient { chunks, outputs, dy, columns, x, x_chunk, gradient, panel_stride } = &product;
    assert!(
        outputs.is_multiple_of(SPAN) && *outputs > 0 && chunks.count > 0,
        "{outputs} outputs, {chunks:?}"
    );
    assert!(columns.len() == chunks.count * outputs, "{} masks of columns", columns.len());
    let of_chunk = |blocks: usize| (blocks - 1) * chunks.block_stride() + chunks.size * BLOCK;
    let needed = (chunks.count - 1) * x_chunk + of_chunk(QUARTERS);
    assert!(x.len() >= needed, "inputs: {} < {needed}", x.len());
    let needed = (chunks.count - 1) * chunks.chunk_len(*outputs) + of_chunk(outputs / BLOCK);
    assert!(dy.len() >= needed, "output gradients: {} < {needed}", dy.len());
    let needed = (outputs / PANEL - 1) * panel_stride + SPAN * PANEL;
    assert!(gradient.len() >= needed, "gradient: {} < {needed}", gradient.len());
    let fits = |mask: &u64| mask >> chunks.size == 0;
    assert!(chunks.size == SPAN || columns.iter().all(fits), "rows beyond a chunk");
    // SAFETY: the lengths are checked above, and a mask has bits for rows of a chunk only.
    unsafe { on_set!(isa, span_gradient(&mut product)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operands::{Finish, Grid};
    use crate::tests::values;
    use crate::{Forward, HALF, Linear};

    /// Irregular values of which about `share` are positive and the others zero, as behind a ReLU.
    fn behind_relu(len: usize, share: f32, seed: u32) -> Vec<f32> {
        let keep = values(len, seed + 100);
        values(len, seed)
            .iter()
            .zip(keep)
            .map(|(x, k)| if k < 2.0 * share - 1.0 { x.abs() } else { 0.0 })
            .collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    fn check(isa: Isa, layer: Linear, batch: usize, share: f32) {
        let chunks = Chunks::new(batch);
        let weights = values(layer.weights(), 1);
        let bias = values(layer.outputs(), 2);
        let x = behind_relu(chunks.len(layer.inputs()), share, 3);
        let dy = behind_relu(chunks.len(layer.outputs()), share, 4);
        let name = format!("{layer:?}, {batch} rows, {share}");

        let mut transposed = vec![0.0; layer.transposed_len()];
        layer.transpose(isa, &weights, &mut transposed);
        let (mut masks, mut dy_masks) = (vec![0; layer.spans() * chunks.size], Vec::new());
        for chunk in 0..chunks.count {
            let rows = chunks.rows(chunk);
            let part = |data, features| -> &[f32] {
                let (data, len): (&[f32], _) = (data, chunks.chunk_len(features));
                &data[chunk * len..(chunk + 1) * len]
            };
            let (x, dy) = (part(&x, layer.inputs()), part(&dy, layer.outputs()));
            let mut expected = vec![0.0; chunks.chunk_len(layer.outputs())];
            let mut found = expected.clone();
            layer.forward(isa, &weights, &bias, Forward::new(&chunks, chunk, x, &mut expected, true));
            let forward = Forward::new(&chunks, chunk, x, &mut found, true);
            layer.mask_chunk(isa, &chunks, rows, x, &mut masks);
            layer.forward_behind_relu(isa, &weights, &bias, forward, &masks);
            assert_eq!(bits(&found), bits(&expected), "{name}: forward");

            let row = layer.inputs() + 32;
            let mut expected = vec![0.5; rows * row];
            let mut found = expected.clone();
            let stride = chunks.block_stride();
            for panel in 0..layer.transposed_panels() {
                let mask = Grid { data: &x[panel * 2 * stride..], row: BLOCK, half: stride };
                let dx = Grid { data: &mut expected[panel * PANEL..], row, half: HALF };
                layer.input_gradient(isa, &transposed, panel, &chunks, rows, dy, Finish::Mask(mask), dx);
            }
            let dx = &mut found[..];
            layer.input_gradient_between_relus(
                isa,
                &transposed,
                &chunks,
                rows,
                dy,
                x,
                &masks,
                dx,
                row,
                &mut dy_masks,
            );
            assert_eq!(bits(&found), bits(&expected), "{name}: input gradient");
        }
        let mut expected = vec![0.0; layer.weights()];
        let (mut found, mut columns) = (values(layer.weights(), 5), Vec::new());
        layer.weight_gradient(isa, &chunks, &x, &dy, &mut expected);
        layer.weight_gradient_behind_relu(isa, &chunks, &x, &dy, &mut found, &mut columns);
        assert_eq!(bits(&found), bits(&expected), "{name}: weight gradient");
    }

    #[test]
    fn products_that_leave_out_zeros_have_the_bits_of_those_that_do_not() {
        for isa in Isa::available() {
            for layer in
                [Linear::new(64, 64), Linear::new(320, 128), Linear::new(576, 64), Linear::new(340, 64)]
            {
                for batch in [1, 15, 16, 29, 67, 200, 640] {
                    for share in [0.0, 0.1, 0.6, 1.0] {
                        check(isa, layer, batch, share);
                    }
                }
            }
        }
    }

    #[test]
    fn masks_say_what_is_not_zero() {
        Isa::available().into_iter().for_each(check_masks);
    }

    fn check_masks(isa: Isa) {
        // Two chunks, the second of which is a row shorter.
        let (chunks, features) = (Chunks::new(79), 2 * SPAN);
        let (stride, chunk_len) = (chunks.block_stride(), chunks.chunk_len(features));
        let mut x = behind_relu(chunks.len(features), 0.4, 6);
        (x[0], x[1]) = (f32::NAN, -0.0);
        let is_kept = |chunk: usize, row: usize, feature: usize| {
            x[chunk * chunk_len + feature / BLOCK * stride + row * BLOCK + feature % BLOCK] != 0.0
        };
        let mut columns = vec![7; 3];
        mask_columns(isa, &chunks, features, &x, &mut columns);
        assert_eq!(columns.len(), 2 * features);
        for chunk in 0..2 {
            let rows = chunks.rows(chunk);
            let mut masks = vec![u64::MAX; 2 * chunks.size];
            for row in 0..rows {
                mask_row(
                    isa,
                    2,
                    &x[chunk * chunk_len + row * BLOCK..],
                    stride,
                    &mut masks[row..],
                    chunks.size,
                );
            }
            for (row, feature) in (0..rows).flat_map(|row| (0..features).map(move |feature| (row, feature))) {
                let expected = is_kept(chunk, row, feature);
                let mask = masks[feature / SPAN * chunks.size + row];
                assert_eq!(mask >> (feature % SPAN) & 1 == 1, expected, "row {row}, feature {feature}");
                let mask = columns[chunk * features + feature];
                assert_eq!(mask >> row & 1 == 1, expected, "column {feature}, row {row}");
            }
            let beyond = columns[chunk * features..][..features].iter().any(|mask| mask >> rows != 0);
            assert!(!beyond, "a column of chunk {chunk} has a bit behind its {rows} rows");
        }
        let kept = columns.iter().map(|mask| mask.count_ones() as usize).sum::<usize>();
        let share = kept as f64 / (79 * features) as f64;
        assert!((0.3..0.5).contains(&share), "{share}");
        assert!(are_few([&columns[..]].into_iter(), 79 * features));
        assert!(!are_few([&columns[..]].into_iter(), (kept as f64 / DENSE) as usize));
    }
}
