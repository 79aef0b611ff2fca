//! The products of [`sparse`](super::sparse) for AVX2 and FMA: one list at a time, its 64 sums in eight registers.
//!
//! Each value costs eight multiply-adds that read their partner from the first-level cache, two a cycle, as many as a core can
//! do anyway.

use std::arch::x86_64::{
    __m256, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T1, _mm_prefetch, _mm256_add_epi32, _mm256_add_ps,
    _mm256_and_ps, _mm256_castsi256_ps, _mm256_cmp_ps, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_loadu_si256,
    _mm256_max_ps, _mm256_movemask_ps, _mm256_mullo_epi32, _mm256_permutevar8x32_ps, _mm256_set1_epi32,
    _mm256_set1_ps, _mm256_setr_epi32, _mm256_setzero_ps, _mm256_storeu_ps,
};

use super::blocked::BLOCK;
use super::rows::{Finish, Grid, PANEL, Start};
use super::sparse::{List, Nonzeros, Panels, QUARTERS, Rows, SPAN};
use super::transpose::eight_by_eight;

/// Floats of a register.
const LANES: usize = 8;
/// Registers of a span.
const EIGHTHS: usize = SPAN / LANES;

/// The sums of a span.
type Sums = [__m256; EIGHTHS];

/// For each set of lanes, their numbers in order: what moves the lanes that are kept to the front.
static TO_THE_FRONT: [[u32; LANES]; 1 << LANES] = {
    let mut table = [[0; LANES]; 1 << LANES];
    let mut kept = 0;
    while kept < table.len() {
        let (mut lane, mut at) = (0, 0);
        while lane < LANES {
            if kept >> lane & 1 == 1 {
                table[kept][at] = lane as u32;
                at += 1;
            }
            lane += 1;
        }
        kept += 1;
    }
    table
};

/// Lists the values of a row's span that are not zero; returns how many. `offsets` are places of rows in a panel.
///
/// # Safety
///
/// AVX2. `x` has four blocks of 16 values, `block_stride` apart; both lists have room for 64 values.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn list(x: &[f32], block_stride: usize, offsets: &mut [u32], values: &mut [f32]) -> u32 {
    let mut places =
        _mm256_mullo_epi32(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), _mm256_set1_epi32(PANEL as i32));
    let mut len = 0_usize;
    for eighth in 0..EIGHTHS {
        // SAFETY: the caller's promise; before eighth e at most 8 · e values are listed, and 8 are written.
        unsafe {
            let x = _mm256_loadu_ps(x.as_ptr().add(eighth / 2 * block_stride + eighth % 2 * LANES));
            let kept = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(x, _mm256_setzero_ps()));
            let order = _mm256_loadu_si256(TO_THE_FRONT[kept as usize].as_ptr().cast());
            _mm256_storeu_ps(values.as_mut_ptr().add(len), _mm256_permutevar8x32_ps(x, order));
            let kept_places = _mm256_permutevar8x32_ps(_mm256_castsi256_ps(places), order);
            _mm256_storeu_ps(offsets.as_mut_ptr().add(len).cast(), kept_places);
            len += kept.count_ones() as usize;
        }
        places = _mm256_add_epi32(places, _mm256_set1_epi32((LANES * PANEL) as i32));
    }
    len as u32
}

/// Adds `value · partner[offset + eighth]` for all of a list.
///
/// # Safety
///
/// AVX2 and FMA; 8 values can be read at each of the eight partners from each offset on.
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn add_list(sums: &mut Sums, list: List<'_>, partners: [*const f32; EIGHTHS]) {
    let mut own = *sums;
    for (at, value) in list.offsets.iter().zip(list.values) {
        let value = _mm256_set1_ps(*value);
        for (sum, partner) in own.iter_mut().zip(partners) {
            // SAFETY: the caller's promise.
            *sum = unsafe { _mm256_fmadd_ps(value, _mm256_loadu_ps(partner.add(*at as usize)), *sum) };
        }
    }
    *sums = own;
}

/// [`rows_times_span`](super::sparse::rows_times_span).
///
/// # Safety
///
/// AVX2 and FMA, and operands as long as `rows_times_span` checks.
#[allow(clippy::too_many_arguments)] // The operands of one product.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn rows(
    rows: usize,
    nonzeros: &Nonzeros,
    first_list: usize,
    panels: [&[f32]; 2],
    next: [&[f32]; 2],
    start: Start<'_>,
    finish: Finish<'_>,
    out: &mut Grid<&mut [f32]>,
) {
    let base = out.data.as_mut_ptr();
    let partners = std::array::from_fn(|eighth| panels[eighth / 4].as_ptr().wrapping_add(eighth % 4 * LANES));
    // Lines of the next two panels that each row fetches: what hides the time that the third-level cache takes.
    let ahead = (SPAN * PANEL / BLOCK).div_ceil(rows);
    let within =
        |row_start: usize, half: usize, eighth: usize| row_start + eighth / 2 * half + eighth % 2 * LANES;
    for row in 0..rows {
        for line in row * ahead..(row + 1) * ahead {
            for next in next {
                // A prefetch has no effect but on the cache, wherever it points.
                _mm_prefetch::<_MM_HINT_T1>(next.as_ptr().wrapping_add(line * BLOCK).cast());
            }
        }
        // SAFETY: the caller has checked the grids, the bias and the mask.
        unsafe {
            let at = |eighth| base.add(within(row * out.row, out.half, eighth));
            let mut sums: Sums = std::array::from_fn(|eighth| match start {
                Start::Zero => _mm256_setzero_ps(),
                Start::Bias(bias) => _mm256_loadu_ps(bias.as_ptr().add(eighth * LANES)),
                Start::Accumulate => _mm256_loadu_ps(at(eighth)),
            });
            add_list(&mut sums, nonzeros.list(first_list + row), partners);
            for (eighth, mut sum) in sums.into_iter().enumerate() {
                match finish {
                    Finish::Store => {}
                    Finish::Relu => sum = _mm256_max_ps(sum, _mm256_setzero_ps()),
                    Finish::Mask(mask) => {
                        let activation = mask.data.as_ptr().add(within(row * mask.row, mask.half, eighth));
                        let activation = _mm256_loadu_ps(activation);
                        let positive = _mm256_cmp_ps::<_CMP_GT_OQ>(activation, _mm256_setzero_ps());
                        sum = _mm256_and_ps(positive, sum);
                    }
                }
                _mm256_storeu_ps(at(eighth), sum);
            }
        }
    }
}

/// Sums of 64 outputs for 64 inputs.
#[repr(align(64))]
struct Square([[f32; SPAN]; SPAN]);

/// [`span_gradient`](super::sparse::span_gradient): 64 outputs at a time, chunk by chunk, so that a chunk's inputs (16 KB)
/// stay in the first-level cache for 64 lists; then rows of inputs are turned into rows of outputs.
///
/// # Safety
///
/// AVX2 and FMA, and operands as long as `span_gradient` checks.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn gradient(
    columns: &Nonzeros,
    rows: Rows,
    outputs: usize,
    x: &[f32],
    block_stride: usize,
    accumulate: bool,
    gradient: &mut Panels<'_>,
) {
    let mut square = Square([[0.0; SPAN]; SPAN]);
    for first in (0..outputs).step_by(SPAN) {
        for chunk in 0..rows.chunks {
            let partners = std::array::from_fn(|eighth| {
                let block = chunk * rows.x_chunk + eighth / 2 * block_stride;
                x.as_ptr().wrapping_add(block + eighth % 2 * LANES)
            });
            for (output, out) in square.0.iter_mut().enumerate() {
                // SAFETY: the list's offsets and four blocks behind them lie within the chunk; a row is eight registers.
                unsafe {
                    let mut sums: Sums = std::array::from_fn(|eighth| match chunk {
                        0 => _mm256_setzero_ps(),
                        _ => _mm256_loadu_ps(out.as_ptr().add(eighth * LANES)),
                    });
                    add_list(&mut sums, columns.list(chunk * outputs + first + output), partners);
                    for (eighth, sum) in sums.into_iter().enumerate() {
                        _mm256_storeu_ps(out.as_mut_ptr().add(eighth * LANES), sum);
                    }
                }
            }
        }
        for (of_outputs, inputs) in
            (0..EIGHTHS).flat_map(|outputs| (0..EIGHTHS).map(move |inputs| (outputs, inputs)))
        {
            let output = first + of_outputs * LANES;
            let at = output / PANEL * gradient.stride + inputs * LANES * PANEL + output % PANEL;
            let sums: [__m256; LANES] = std::array::from_fn(|output| {
                let row = &square.0[of_outputs * LANES + output];
                // SAFETY: a row is eight registers.
                unsafe { _mm256_loadu_ps(row.as_ptr().add(inputs * LANES)) }
            });
            for (input, sum) in eight_by_eight(sums).into_iter().enumerate() {
                // SAFETY: a span of inputs of every panel lies within `gradient`.
                unsafe {
                    let out = gradient.data.as_mut_ptr().add(at + input * PANEL);
                    let before = if accumulate { _mm256_loadu_ps(out) } else { _mm256_setzero_ps() };
                    _mm256_storeu_ps(out, _mm256_add_ps(before, sum));
                }
            }
        }
    }
}

/// A compile-time check that quarters and eighths speak of the same span.
const _: () = assert!(EIGHTHS == 2 * QUARTERS && BLOCK == 2 * LANES);
