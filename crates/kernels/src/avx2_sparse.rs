//! The products of [`sparse`](crate::sparse) for AVX2 and FMA: one row or column at a time, its 64 sums in eight registers.
//!
//! Each value costs eight multiply-adds that read their partner from the first-level cache, two a cycle, as many as a core can
//! do anyway.

use std::arch::asm;
use std::arch::x86_64::{
    __m256, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T0, _MM_HINT_T1, _mm_prefetch, _mm256_add_ps, _mm256_and_ps,
    _mm256_and_si256, _mm256_castsi256_ps, _mm256_cmp_ps, _mm256_cmpeq_epi32, _mm256_fmadd_ps,
    _mm256_loadu_ps, _mm256_max_ps, _mm256_movemask_ps, _mm256_set1_epi32, _mm256_set1_ps, _mm256_setr_epi32,
    _mm256_setzero_ps, _mm256_storeu_ps,
};

use crate::blocked::BLOCK;
use crate::linear::begins_run;
use crate::rows::{PANEL, Start};
use crate::sparse::{After, QUARTERS, SPAN, SpanGradient, SpanProduct};
use crate::sparse_conv::{SampleForward, SampleGradient, WINDOW, WINDOW_STEP};
use crate::transpose::eight_by_eight;

/// Floats of a register.
const LANES: usize = 8;
/// Registers of a span.
const EIGHTHS: usize = SPAN / LANES;

/// The sums of a span.
type Sums = [__m256; EIGHTHS];

/// Where an eighth of a span starts whose blocks lie so far apart.
fn within(block_stride: usize, eighth: usize) -> usize {
    eighth / 2 * block_stride + eighth % 2 * LANES
}

/// [`mask_row`](crate::sparse::mask_row).
///
/// # Safety
///
/// AVX2. For each mask, `x` has four blocks of 16 values, `block_stride` apart.
#[target_feature(enable = "avx2")]
pub(crate) unsafe fn mask_row<'a>(x: &[f32], block_stride: usize, masks: impl Iterator<Item = &'a mut u64>) {
    let mut x = x.as_ptr();
    for mask in masks {
        *mask = 0;
        for eighth in 0..EIGHTHS {
            // SAFETY: the caller's promise.
            let values = unsafe { _mm256_loadu_ps(x.wrapping_add(within(block_stride, eighth))) };
            let kept = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(values, _mm256_setzero_ps()));
            *mask |= u64::from(kept as u32) << (eighth * LANES);
        }
        x = x.wrapping_add(QUARTERS * block_stride);
    }
}

/// [`mask_block`](crate::sparse::mask_block).
///
/// # Safety
///
/// AVX2.
#[target_feature(enable = "avx2")]
pub(crate) unsafe fn mask_block(rows: &[[f32; BLOCK]], masks: &mut [u64; BLOCK]) {
    crate::sparse::mask_block(rows, masks);
}

/// A value in all lanes, by way of a general register: the loops here are bound by loads of vector registers, of which a
/// processor makes two a cycle, and this load is none. The compiler would make it one.
#[inline]
#[target_feature(enable = "avx2")]
fn in_all_lanes(value: f32) -> __m256 {
    if cfg!(miri) {
        return _mm256_set1_ps(value);
    }
    let all;
    // SAFETY: from one register into another.
    unsafe {
        asm!(
            "vmovd {all:x}, {bits:e}",
            "vpbroadcastd {all}, {all:x}",
            all = out(ymm_reg) all,
            bits = in(reg) value.to_bits(),
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    all
}

/// Adds `value(k) · partner[k · STEP]` to the sums of each partner for all bits k of the mask, in their order.
///
/// # Safety
///
/// AVX2, FMA and BMI1; for each bit, `value(k)` can be read, and 8 values at each partner.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
unsafe fn add<const N: usize, const STEP: usize>(
    mut sums: [__m256; N],
    mut mask: u64,
    value: impl Fn(usize) -> *const f32,
    partners: [*const f32; N],
) -> [__m256; N] {
    while mask != 0 {
        let k = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        // SAFETY: the caller's promise.
        unsafe {
            let value = in_all_lanes(*value(k));
            for (sum, partner) in sums.iter_mut().zip(partners) {
                *sum = _mm256_fmadd_ps(value, _mm256_loadu_ps(partner.add(k * STEP)), *sum);
            }
        }
    }
    sums
}

/// [`rows_times_span`](crate::sparse::rows_times_span).
///
/// # Safety
///
/// AVX2, FMA and BMI1, and operands as long as `rows_times_span` checks.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(crate) unsafe fn rows(product: &mut SpanProduct<'_>) {
    let SpanProduct { x, block_stride, masks, panels, next, start, after, out } = product;
    let (x, start, after) = (x.as_ptr(), *start, *after);
    let base = out.data.as_mut_ptr();
    let partners = std::array::from_fn(|eighth| panels[eighth / 4].as_ptr().wrapping_add(eighth % 4 * LANES));
    let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    // From one block to the next, beyond its values.
    let gap = block_stride.wrapping_sub(BLOCK);
    // Lines of the next two panels that each row fetches: what hides the time that the third-level cache takes.
    let ahead = (SPAN * PANEL / BLOCK).div_ceil(masks.len());
    for (row, mask) in masks.iter().enumerate() {
        for line in row * ahead..(row + 1) * ahead {
            for next in &*next {
                // A prefetch has no effect but on the cache, wherever it points.
                _mm_prefetch::<_MM_HINT_T1>(next.as_ptr().wrapping_add(line * BLOCK).cast());
            }
        }
        // SAFETY: the caller has checked the operands.
        unsafe {
            let c = base.add(row * out.row);
            let sums: Sums = std::array::from_fn(|eighth| match start {
                Start::Zero => _mm256_setzero_ps(),
                Start::Bias(bias) => _mm256_loadu_ps(bias.as_ptr().add(eighth * LANES)),
                Start::Accumulate => _mm256_loadu_ps(c.add(within(out.half, eighth))),
            });
            let x = x.add(row * BLOCK);
            let value = |k: usize| x.wrapping_add(k.wrapping_add((k / BLOCK).wrapping_mul(gap)));
            let sums = add::<EIGHTHS, PANEL>(sums, *mask, value, partners);
            for (eighth, mut sum) in sums.into_iter().enumerate() {
                match after {
                    After::Store => {}
                    After::Relu => sum = _mm256_max_ps(sum, _mm256_setzero_ps()),
                    After::Keep(kept) => {
                        let kept = (kept.get_unchecked(row) >> (eighth * LANES)) as u8;
                        let own = _mm256_and_si256(_mm256_set1_epi32(i32::from(kept)), bits);
                        sum = _mm256_and_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(own, bits)), sum);
                    }
                }
                _mm256_storeu_ps(c.add(within(out.half, eighth)), sum);
            }
        }
    }
}

/// Sums of 64 outputs for 64 inputs.
#[repr(align(64))]
struct Square([[f32; SPAN]; SPAN]);

/// [`span_gradient`](crate::sparse::span_gradient): 64 outputs at a time, chunk by chunk, so that a chunk's inputs (16 KB)
/// stay in the first-level cache for 64 outputs; then rows of inputs are turned into rows of outputs.
///
/// # Safety
///
/// AVX2, FMA and BMI1, and operands as `span_gradient` checks.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(crate) unsafe fn gradient(product: &mut SpanGradient<'_>) {
    let SpanGradient { chunks, outputs, dy, columns, x, x_chunk, panel_stride, .. } = *product;
    let stride = chunks.block_stride();
    let row = |square: &mut Square, output: usize| square.0[output].as_mut_ptr();
    let (mut run, mut total) = (Square([[0.0; SPAN]; SPAN]), Square([[0.0; SPAN]; SPAN]));
    for first in (0..outputs).step_by(SPAN) {
        let mut has_total = false;
        for chunk in 0..chunks.count {
            let begins = begins_run(chunks, chunk);
            let ends = chunk + 1 == chunks.count || begins_run(chunks, chunk + 1);
            let x = x.as_ptr().wrapping_add(chunk * x_chunk);
            let partners = std::array::from_fn(|eighth| x.wrapping_add(within(stride, eighth)));
            // Each output fetches its share of the next chunk's inputs: what hides the way from the second-level cache.
            let next = x.wrapping_add(x_chunk);
            for output in 0..SPAN {
                let lines = SPAN / BLOCK;
                let share = next.wrapping_add(output / BLOCK * stride + output % BLOCK * lines * BLOCK);
                for line in 0..lines {
                    // A prefetch has no effect but on the cache, wherever it points.
                    _mm_prefetch::<_MM_HINT_T0>(share.wrapping_add(line * BLOCK).cast());
                }
                let column = first + output;
                let at = chunk * chunks.chunk_len(outputs) + column / BLOCK * stride + column % BLOCK;
                let mask = columns[chunk * outputs + column];
                // SAFETY: the rows that a mask has bits of lie within the chunk; a row of a square is eight registers.
                unsafe {
                    let load = |row: *mut f32| -> Sums {
                        std::array::from_fn(|eighth| _mm256_loadu_ps(row.add(eighth * LANES)))
                    };
                    let (run, total) = (row(&mut run, output), row(&mut total, output));
                    let sums = if begins { [_mm256_setzero_ps(); EIGHTHS] } else { load(run) };
                    let dy = dy.as_ptr().add(at);
                    let mut sums =
                        add::<EIGHTHS, BLOCK>(sums, mask, |k| dy.wrapping_add(k * BLOCK), partners);
                    if ends && has_total {
                        let before = load(total);
                        sums = std::array::from_fn(|eighth| _mm256_add_ps(before[eighth], sums[eighth]));
                    }
                    let to = if ends { total } else { run };
                    for (eighth, sum) in sums.into_iter().enumerate() {
                        _mm256_storeu_ps(to.add(eighth * LANES), sum);
                    }
                }
            }
            has_total |= ends;
        }
        for (of_outputs, inputs) in
            (0..EIGHTHS).flat_map(|outputs| (0..EIGHTHS).map(move |inputs| (outputs, inputs)))
        {
            let output = first + of_outputs * LANES;
            let at = output / PANEL * panel_stride + inputs * LANES * PANEL + output % PANEL;
            let sums: [__m256; LANES] = std::array::from_fn(|output| {
                let row = &total.0[of_outputs * LANES + output];
                // SAFETY: a row is eight registers.
                unsafe { _mm256_loadu_ps(row.as_ptr().add(inputs * LANES)) }
            });
            for (input, sum) in eight_by_eight(sums).into_iter().enumerate() {
                // SAFETY: a span of inputs of every panel lies within `gradient`.
                unsafe { _mm256_storeu_ps(product.gradient.as_mut_ptr().add(at + input * PANEL), sum) }
            }
        }
    }
}

/// Says which values of rows of 32 are not zero; returns how many.
///
/// # Safety
///
/// AVX2 and POPCNT.
#[target_feature(enable = "avx2,popcnt")]
pub(crate) unsafe fn mask_rows(rows: &[[f32; PANEL]], masks: &mut [u32]) -> u32 {
    let mut kept = 0;
    for (row, mask) in rows.iter().zip(masks) {
        *mask = 0;
        for quarter in 0..ROW {
            // SAFETY: a row is four registers.
            let values = unsafe { _mm256_loadu_ps(row.as_ptr().add(quarter * LANES)) };
            let of_quarter = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(values, _mm256_setzero_ps()));
            *mask |= (of_quarter as u32) << (quarter * LANES);
        }
        kept += mask.count_ones();
    }
    kept
}

/// [`SampleForward::run_if_few`] for rows with these masks.
///
/// # Safety
///
/// AVX2, FMA and BMI1, and operands as long as `run_if_few` checks.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(crate) unsafe fn conv_forward(sample: &mut SampleForward<'_>, masks: &[u32]) {
    let (input, weights, bias) = (sample.input.as_ptr(), sample.weights.as_ptr(), sample.bias.as_ptr());
    let (out, row, half) = (sample.out.data.as_mut_ptr(), sample.out.row, sample.out.half);
    let of_kernel = |kernel: usize| -> [*const f32; ROW] {
        std::array::from_fn(|quarter| weights.wrapping_add(kernel * PANEL * PANEL + quarter * LANES))
    };
    let ([first, second, third], positions) = ([0, 1, 2].map(of_kernel), masks.len() / 2);
    let both: [*const f32; 2 * ROW] =
        std::array::from_fn(|eighth| if eighth < ROW { third[eighth] } else { first[eighth - ROW] });
    let (masks, last) = (masks.chunks_exact(2), masks[2 * positions]);
    // SAFETY: rows of 32 values, kernels of 32 × 32 weights and positions are among those checked.
    unsafe {
        let bias: [__m256; ROW] = std::array::from_fn(|quarter| _mm256_loadu_ps(bias.add(quarter * LANES)));
        let store = |position: usize, sums: [__m256; ROW]| {
            for (quarter, sum) in sums.into_iter().enumerate() {
                let sum = _mm256_max_ps(sum, _mm256_setzero_ps());
                _mm256_storeu_ps(out.add(position * row + within(half, quarter)), sum);
            }
        };
        let of_row = |row: usize| move |k: usize| input.wrapping_add(row * PANEL + k);
        let mut sums = bias;
        for (position, mask) in masks.enumerate() {
            let even: [__m256; 2 * ROW] =
                std::array::from_fn(|eighth| if eighth < ROW { sums[eighth] } else { bias[eighth - ROW] });
            let even = add::<{ 2 * ROW }, PANEL>(even, u64::from(mask[0]), of_row(2 * position), both);
            if position > 0 {
                store(position - 1, std::array::from_fn(|quarter| even[quarter]));
            }
            let own = std::array::from_fn(|quarter| even[ROW + quarter]);
            sums = add::<ROW, PANEL>(own, u64::from(mask[1]), of_row(2 * position + 1), second);
        }
        let sums = add::<ROW, PANEL>(sums, u64::from(last), of_row(2 * positions), third);
        store(positions - 1, sums);
    }
}

/// Registers of a window.
const TWELFTHS: usize = WINDOW / LANES;
/// Registers of a row of channels.
const ROW: usize = PANEL / LANES;

/// [`SampleGradient::input_gradient`].
///
/// # Safety
///
/// AVX2, FMA and BMI1, and operands as long as `input_gradient` checks.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(crate) unsafe fn conv_input_gradient(
    sample: &SampleGradient<'_>,
    transposed: &[f32],
    d_input: &mut [f32],
    rows: usize,
) {
    let (d_out, input, d_input) = (sample.d_out.as_ptr(), sample.input.as_ptr(), d_input.as_mut_ptr());
    let weights = transposed.as_ptr();
    // Kernel indices 0, 1, 2 stand behind one another as 2, 0, 1.
    let partners: [*const f32; TWELFTHS] = std::array::from_fn(|twelfth| {
        weights.wrapping_add((twelfth / ROW + 1) % 3 * PANEL * PANEL + twelfth % ROW * LANES)
    });
    let store = |row: usize, sums: &[__m256]| {
        for (quarter, sum) in sums.iter().enumerate() {
            let at = row * PANEL + quarter * LANES;
            // SAFETY: rows up to `rows` of both are checked.
            unsafe {
                let positive =
                    _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_loadu_ps(input.add(at)), _mm256_setzero_ps());
                _mm256_storeu_ps(d_input.add(at), _mm256_and_ps(positive, *sum));
            }
        }
    };
    let mut waiting = [_mm256_setzero_ps(); ROW];
    for (position, mask) in sample.positions().iter().enumerate() {
        let d_out = d_out.wrapping_add(position * PANEL);
        let mut sums = [_mm256_setzero_ps(); TWELFTHS];
        sums[..ROW].copy_from_slice(&waiting);
        // SAFETY: a position has 32 output gradients, each kernel index 32 × 32 weights.
        let sums =
            unsafe { add::<TWELFTHS, PANEL>(sums, u64::from(*mask), |k| d_out.wrapping_add(k), partners) };
        if position > 0 {
            store(2 * position, &sums[..ROW]);
        }
        store(2 * position + 1, &sums[ROW..2 * ROW]);
        waiting.copy_from_slice(&sums[2 * ROW..]);
    }
    if rows == 2 * sample.positions().len() {
        store(rows, &waiting);
    }
}

/// [`SampleGradient::add_weight_gradient`].
///
/// # Safety
///
/// AVX2, FMA and BMI1, and operands as long as `add_weight_gradient` checks.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(crate) unsafe fn conv_weight_gradient(
    sample: &SampleGradient<'_>,
    sums: &mut [f32],
    gradient: &mut [f32],
) {
    let parts = sample.channels();
    for (part, masks) in parts.iter().enumerate() {
        let first = part * SPAN;
        let input = sample.input.as_ptr().wrapping_add(first * WINDOW_STEP);
        let partners = std::array::from_fn(|twelfth| input.wrapping_add(twelfth * LANES));
        for (channel, mask) in masks.iter().enumerate() {
            // SAFETY: a part has bits for the sample's positions alone; sums and gradient have a window for each channel.
            unsafe {
                let d_out = sample.d_out.as_ptr().add(first * PANEL + channel);
                let own = sums.as_mut_ptr().add(channel * WINDOW);
                let load = |from: *mut f32| -> [__m256; TWELFTHS] {
                    std::array::from_fn(|twelfth| _mm256_loadu_ps(from.add(twelfth * LANES)))
                };
                let before = if part == 0 { [_mm256_setzero_ps(); TWELFTHS] } else { load(own) };
                let value = |k: usize| d_out.wrapping_add(k * PANEL);
                let mut after = add::<TWELFTHS, WINDOW_STEP>(before, *mask, value, partners);
                let mut to = own;
                if part + 1 == parts.len() {
                    to = gradient.as_mut_ptr().add(channel * WINDOW);
                    let before = load(to);
                    after = std::array::from_fn(|twelfth| _mm256_add_ps(before[twelfth], after[twelfth]));
                }
                for (twelfth, sum) in after.into_iter().enumerate() {
                    _mm256_storeu_ps(to.add(twelfth * LANES), sum);
                }
            }
        }
    }
}

/// A compile-time check that quarters and eighths speak of the same span.
const _: () = assert!(EIGHTHS == 2 * QUARTERS && BLOCK == 2 * LANES);
