//! The products of [`sparse`](crate::sparse) for AVX-512: one row or column at a time, its 64 sums in four registers. While
//! the sums of one wait for each other, the processor is already at the next, for no branch depends on a sum.

use std::arch::asm;
use std::arch::x86_64::{
    __m512, __m512d, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T0, _MM_HINT_T1, _mm_prefetch, _mm512_add_ps,
    _mm512_castpd_ps, _mm512_castps_pd, _mm512_cmp_ps_mask, _mm512_fmadd_ps, _mm512_loadu_ps,
    _mm512_maskz_mov_ps, _mm512_max_ps, _mm512_setzero_ps, _mm512_shuffle_f32x4, _mm512_storeu_ps,
    _mm512_unpackhi_pd, _mm512_unpackhi_ps, _mm512_unpacklo_pd, _mm512_unpacklo_ps,
};

use crate::blocked::BLOCK;
use crate::linear::begins_run;
use crate::rows::{PANEL, Start};
use crate::sparse::{After, QUARTERS, SPAN, SpanGradient, SpanProduct};
use crate::sparse_conv::{SampleForward, SampleGradient, WINDOW, WINDOW_STEP};

/// The sums of a span.
type Sums = [__m512; QUARTERS];

/// [`mask_row`](crate::sparse::mask_row).
///
/// # Safety
///
/// AVX-512F. For each mask, `x` has four blocks of 16 values, `block_stride` apart.
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn mask_row<'a>(x: &[f32], block_stride: usize, masks: impl Iterator<Item = &'a mut u64>) {
    let mut x = x.as_ptr();
    for mask in masks {
        *mask = 0;
        for block in 0..QUARTERS {
            // SAFETY: the caller's promise.
            let values = unsafe { _mm512_loadu_ps(x) };
            let kept = _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(values, _mm512_setzero_ps());
            *mask |= u64::from(kept) << (block * BLOCK);
            x = x.wrapping_add(block_stride);
        }
    }
}

/// [`mask_block`](crate::sparse::mask_block).
///
/// # Safety
///
/// AVX-512F.
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn mask_block(rows: &[[f32; BLOCK]], masks: &mut [u64; BLOCK]) {
    crate::sparse::mask_block(rows, masks);
}

/// A value in all lanes, by way of a general register: the loops here are bound by loads of vector registers, of which a
/// processor makes one or two a cycle, and this load is none. The compiler would make it one.
#[inline]
#[target_feature(enable = "avx512f")]
fn in_all_lanes(value: f32) -> __m512 {
    let all;
    // SAFETY: from one register into another.
    unsafe {
        asm!(
            "vpbroadcastd {all}, {bits:e}",
            all = out(zmm_reg) all,
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
/// AVX-512F and BMI1; for each bit, `value(k)` can be read, and 16 values at each partner.
#[inline]
#[target_feature(enable = "avx512f,bmi1")]
unsafe fn add<const N: usize, const STEP: usize>(
    mut sums: [__m512; N],
    mut mask: u64,
    value: impl Fn(usize) -> *const f32,
    partners: [*const f32; N],
) -> [__m512; N] {
    while mask != 0 {
        let k = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        // SAFETY: the caller's promise.
        unsafe {
            let value = in_all_lanes(*value(k));
            for (sum, partner) in sums.iter_mut().zip(partners) {
                *sum = _mm512_fmadd_ps(value, _mm512_loadu_ps(partner.add(k * STEP)), *sum);
            }
        }
    }
    sums
}

/// [`rows_times_span`](crate::sparse::rows_times_span).
///
/// # Safety
///
/// AVX-512F and BMI1, and operands as long as `rows_times_span` checks.
#[target_feature(enable = "avx512f,bmi1")]
pub(crate) unsafe fn rows(product: &mut SpanProduct<'_>) {
    let SpanProduct { x, block_stride, masks, panels, next, start, after, out } = product;
    let (x, start, after) = (x.as_ptr(), *start, *after);
    let base = out.data.as_mut_ptr();
    let [p, q] = panels.map(<[f32]>::as_ptr);
    let partners = [p, p.wrapping_add(BLOCK), q, q.wrapping_add(BLOCK)];
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
            let sums: Sums = match start {
                Start::Zero => [_mm512_setzero_ps(); QUARTERS],
                Start::Bias(bias) => {
                    std::array::from_fn(|quarter| _mm512_loadu_ps(bias.as_ptr().add(quarter * BLOCK)))
                }
                Start::Accumulate => {
                    std::array::from_fn(|quarter| _mm512_loadu_ps(c.add(quarter * out.half)))
                }
            };
            let x = x.add(row * BLOCK);
            let value = |k: usize| x.wrapping_add(k.wrapping_add((k / BLOCK).wrapping_mul(gap)));
            let sums = add::<QUARTERS, PANEL>(sums, *mask, value, partners);
            for (quarter, mut sum) in sums.into_iter().enumerate() {
                match after {
                    After::Store => {}
                    After::Relu => sum = _mm512_max_ps(sum, _mm512_setzero_ps()),
                    After::Keep(kept) => {
                        let kept = (kept.get_unchecked(row) >> (quarter * BLOCK)) as u16;
                        sum = _mm512_maskz_mov_ps(kept, sum);
                    }
                }
                _mm512_storeu_ps(c.add(quarter * out.half), sum);
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
/// AVX-512F and BMI1, and operands as `span_gradient` checks.
#[target_feature(enable = "avx512f,bmi1")]
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
            let partners = std::array::from_fn(|quarter| x.wrapping_add(quarter * stride));
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
                // SAFETY: the rows that a mask has bits of lie within the chunk; a row of a square is four registers.
                unsafe {
                    let load = |row: *mut f32| -> Sums {
                        std::array::from_fn(|quarter| _mm512_loadu_ps(row.add(quarter * BLOCK)))
                    };
                    let (run, total) = (row(&mut run, output), row(&mut total, output));
                    let sums = if begins { [_mm512_setzero_ps(); QUARTERS] } else { load(run) };
                    let dy = dy.as_ptr().add(at);
                    let mut sums =
                        add::<QUARTERS, BLOCK>(sums, mask, |k| dy.wrapping_add(k * BLOCK), partners);
                    if ends && has_total {
                        let before = load(total);
                        sums = std::array::from_fn(|quarter| _mm512_add_ps(before[quarter], sums[quarter]));
                    }
                    let to = if ends { total } else { run };
                    for (quarter, sum) in sums.into_iter().enumerate() {
                        _mm512_storeu_ps(to.add(quarter * BLOCK), sum);
                    }
                }
            }
            has_total |= ends;
        }
        for (block, quarter) in
            (0..QUARTERS).flat_map(|block| (0..QUARTERS).map(move |quarter| (block, quarter)))
        {
            let output = first + block * BLOCK;
            let at = output / PANEL * panel_stride + quarter * BLOCK * PANEL + output % PANEL;
            let of_outputs: [__m512; BLOCK] = std::array::from_fn(|output| {
                let row = &total.0[block * BLOCK + output];
                // SAFETY: a row is four registers.
                unsafe { _mm512_loadu_ps(row.as_ptr().add(quarter * BLOCK)) }
            });
            for (input, sum) in transposed(&of_outputs).into_iter().enumerate() {
                // SAFETY: a span of inputs of every panel lies within `gradient`.
                unsafe { _mm512_storeu_ps(product.gradient.as_mut_ptr().add(at + input * PANEL), sum) }
            }
        }
    }
}

/// Says which values of rows of 32 are not zero; returns how many.
///
/// # Safety
///
/// AVX-512F and POPCNT.
#[target_feature(enable = "avx512f,popcnt")]
pub(crate) unsafe fn mask_rows(rows: &[[f32; PANEL]], masks: &mut [u32]) -> u32 {
    let mut kept = 0;
    for (row, mask) in rows.iter().zip(masks) {
        // SAFETY: a row is two registers.
        let [low, high] = [0, BLOCK].map(|half| unsafe {
            let values = _mm512_loadu_ps(row.as_ptr().add(half));
            _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(values, _mm512_setzero_ps())
        });
        *mask = u32::from(low) | u32::from(high) << BLOCK;
        kept += mask.count_ones();
    }
    kept
}

/// [`SampleForward::run_if_few`] for rows with these masks.
///
/// # Safety
///
/// AVX-512F and BMI1, and operands as long as `run_if_few` checks.
#[target_feature(enable = "avx512f,bmi1")]
pub(crate) unsafe fn conv_forward(sample: &mut SampleForward<'_>, masks: &[u32]) {
    let (input, weights, bias) = (sample.input.as_ptr(), sample.weights.as_ptr(), sample.bias.as_ptr());
    let (out, row, half) = (sample.out.data.as_mut_ptr(), sample.out.row, sample.out.half);
    let of_kernel = |kernel: usize| {
        let weights = weights.wrapping_add(kernel * PANEL * PANEL);
        [weights, weights.wrapping_add(BLOCK)]
    };
    let ([first, second, third], positions) = ([0, 1, 2].map(of_kernel), masks.len() / 2);
    let (masks, last) = (masks.chunks_exact(2), masks[2 * positions]);
    // SAFETY: rows of 32 values, kernels of 32 × 32 weights and positions are among those checked.
    unsafe {
        let bias = [_mm512_loadu_ps(bias), _mm512_loadu_ps(bias.add(BLOCK))];
        let store = |position: usize, sums: [__m512; 2]| {
            for (at, sum) in sums.into_iter().enumerate() {
                let sum = _mm512_max_ps(sum, _mm512_setzero_ps());
                _mm512_storeu_ps(out.add(position * row + at * half), sum);
            }
        };
        let of_row = |row: usize| move |k: usize| input.wrapping_add(row * PANEL + k);
        let mut sums = bias;
        for (position, mask) in masks.enumerate() {
            let even = [sums[0], sums[1], bias[0], bias[1]];
            let partners = [third[0], third[1], first[0], first[1]];
            let even = add::<4, PANEL>(even, u64::from(mask[0]), of_row(2 * position), partners);
            if position > 0 {
                store(position - 1, [even[0], even[1]]);
            }
            sums = add::<2, PANEL>([even[2], even[3]], u64::from(mask[1]), of_row(2 * position + 1), second);
        }
        let sums = add::<2, PANEL>(sums, u64::from(last), of_row(2 * positions), third);
        store(positions - 1, sums);
    }
}

/// Registers of a window.
const SIXTHS: usize = WINDOW / BLOCK;

/// [`SampleGradient::input_gradient`].
///
/// # Safety
///
/// AVX-512F and BMI1, and operands as long as `input_gradient` checks.
#[target_feature(enable = "avx512f,bmi1")]
pub(crate) unsafe fn conv_input_gradient(
    sample: &SampleGradient<'_>,
    transposed: &[f32],
    d_input: &mut [f32],
    rows: usize,
) {
    let (d_out, input, d_input) = (sample.d_out.as_ptr(), sample.input.as_ptr(), d_input.as_mut_ptr());
    let weights = transposed.as_ptr();
    // Kernel indices 0, 1, 2 stand behind one another as 2, 0, 1.
    let partners: [*const f32; SIXTHS] = std::array::from_fn(|sixth| {
        weights.wrapping_add((sixth / 2 + 1) % 3 * PANEL * PANEL + sixth % 2 * BLOCK)
    });
    let store = |row: usize, sums: [__m512; 2]| {
        for (half, sum) in sums.into_iter().enumerate() {
            let at = row * PANEL + half * BLOCK;
            // SAFETY: rows up to `rows` of both are checked.
            unsafe {
                let positive =
                    _mm512_cmp_ps_mask::<_CMP_GT_OQ>(_mm512_loadu_ps(input.add(at)), _mm512_setzero_ps());
                _mm512_storeu_ps(d_input.add(at), _mm512_maskz_mov_ps(positive, sum));
            }
        }
    };
    let zero = _mm512_setzero_ps();
    let mut waiting = [zero; 2];
    for (position, mask) in sample.positions().iter().enumerate() {
        let d_out = d_out.wrapping_add(position * PANEL);
        let sums = [waiting[0], waiting[1], zero, zero, zero, zero];
        // SAFETY: a position has 32 output gradients, each kernel index 32 × 32 weights.
        let sums =
            unsafe { add::<SIXTHS, PANEL>(sums, u64::from(*mask), |k| d_out.wrapping_add(k), partners) };
        if position > 0 {
            store(2 * position, [sums[0], sums[1]]);
        }
        store(2 * position + 1, [sums[2], sums[3]]);
        waiting = [sums[4], sums[5]];
    }
    if rows == 2 * sample.positions().len() {
        store(rows, waiting);
    }
}

/// [`SampleGradient::add_weight_gradient`].
///
/// # Safety
///
/// AVX-512F and BMI1, and operands as long as `add_weight_gradient` checks.
#[target_feature(enable = "avx512f,bmi1")]
pub(crate) unsafe fn conv_weight_gradient(
    sample: &SampleGradient<'_>,
    sums: &mut [f32],
    gradient: &mut [f32],
) {
    let parts = sample.channels();
    for (part, masks) in parts.iter().enumerate() {
        let first = part * SPAN;
        let input = sample.input.as_ptr().wrapping_add(first * WINDOW_STEP);
        let partners = std::array::from_fn(|sixth| input.wrapping_add(sixth * BLOCK));
        for (channel, mask) in masks.iter().enumerate() {
            // SAFETY: a part has bits for the sample's positions alone; sums and gradient have a window for each channel.
            unsafe {
                let d_out = sample.d_out.as_ptr().add(first * PANEL + channel);
                let own = sums.as_mut_ptr().add(channel * WINDOW);
                let load = |from: *mut f32| -> [__m512; SIXTHS] {
                    std::array::from_fn(|sixth| _mm512_loadu_ps(from.add(sixth * BLOCK)))
                };
                let before = if part == 0 { [_mm512_setzero_ps(); SIXTHS] } else { load(own) };
                let value = |k: usize| d_out.wrapping_add(k * PANEL);
                let mut after = add::<SIXTHS, WINDOW_STEP>(before, *mask, value, partners);
                let mut to = own;
                if part + 1 == parts.len() {
                    to = gradient.as_mut_ptr().add(channel * WINDOW);
                    let before = load(to);
                    after = std::array::from_fn(|sixth| _mm512_add_ps(before[sixth], after[sixth]));
                }
                for (sixth, sum) in after.into_iter().enumerate() {
                    _mm512_storeu_ps(to.add(sixth * BLOCK), sum);
                }
            }
        }
    }
}

/// The columns of 16 rows of 16 values.
///
/// Within each 128-bit lane, pairs of rows are interleaved, then pairs of pairs: lane l of `quads[4·g + c]` holds column
/// 4·l + c of the rows 4·g … 4·g + 3. What is left is a transposition of 4 × 4 lanes.
#[target_feature(enable = "avx512f")]
fn transposed(rows: &[__m512; BLOCK]) -> [__m512; BLOCK] {
    let low = |a: __m512d, b: __m512d| _mm512_castpd_ps(_mm512_unpacklo_pd(a, b));
    let high = |a: __m512d, b: __m512d| _mm512_castpd_ps(_mm512_unpackhi_pd(a, b));
    let mut quads = [_mm512_setzero_ps(); BLOCK];
    for (quads, rows) in quads.chunks_exact_mut(4).zip(rows.chunks_exact(4)) {
        let pairs = [
            _mm512_unpacklo_ps(rows[0], rows[1]),
            _mm512_unpackhi_ps(rows[0], rows[1]),
            _mm512_unpacklo_ps(rows[2], rows[3]),
            _mm512_unpackhi_ps(rows[2], rows[3]),
        ]
        .map(|pair| _mm512_castps_pd(pair));
        quads[0] = low(pairs[0], pairs[2]);
        quads[1] = high(pairs[0], pairs[2]);
        quads[2] = low(pairs[1], pairs[3]);
        quads[3] = high(pairs[1], pairs[3]);
    }
    let mut columns = [_mm512_setzero_ps(); BLOCK];
    for c in 0..4 {
        let lanes = [quads[c], quads[4 + c], quads[8 + c], quads[12 + c]];
        let even = |a, b| _mm512_shuffle_f32x4::<0x88>(a, b);
        let odd = |a, b| _mm512_shuffle_f32x4::<0xdd>(a, b);
        let (front_even, back_even) = (even(lanes[0], lanes[1]), even(lanes[2], lanes[3]));
        let (front_odd, back_odd) = (odd(lanes[0], lanes[1]), odd(lanes[2], lanes[3]));
        columns[c] = even(front_even, back_even);
        columns[4 + c] = even(front_odd, back_odd);
        columns[8 + c] = odd(front_even, back_even);
        columns[12 + c] = odd(front_odd, back_odd);
    }
    columns
}
