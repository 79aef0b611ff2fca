//! The products of [`sparse`](super::sparse) for AVX-512.

use std::arch::x86_64::{
    __m512, __m512d, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T1, _mm_prefetch, _mm512_add_epi32, _mm512_add_ps,
    _mm512_castpd_ps, _mm512_castps_pd, _mm512_cmp_ps_mask, _mm512_fmadd_ps, _mm512_loadu_ps,
    _mm512_maskz_compress_epi32, _mm512_maskz_compress_ps, _mm512_maskz_mov_ps, _mm512_max_ps,
    _mm512_mullo_epi32, _mm512_set1_epi32, _mm512_set1_ps, _mm512_setr_epi32, _mm512_setzero_ps,
    _mm512_shuffle_f32x4, _mm512_storeu_ps, _mm512_storeu_si512, _mm512_unpackhi_pd, _mm512_unpackhi_ps,
    _mm512_unpacklo_pd, _mm512_unpacklo_ps,
};

use super::blocked::BLOCK;
use super::rows::{Finish, Grid, PANEL, Start};
use super::sparse::{List, Nonzeros, Panels, QUARTERS, Rows, SPAN};

/// The sums of a span.
type Sums = [__m512; QUARTERS];

/// Lists the values of a row's span that are not zero; returns how many. `offsets` are places of rows in a panel.
///
/// # Safety
///
/// AVX-512F. `x` has four blocks of 16 values, `block_stride` apart; both lists have room for 64 values.
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn list(x: &[f32], block_stride: usize, offsets: &mut [u32], values: &mut [f32]) -> u32 {
    let iota = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let mut places = _mm512_mullo_epi32(iota, _mm512_set1_epi32(PANEL as i32));
    let mut len = 0_usize;
    for block in 0..QUARTERS {
        // SAFETY: the caller's promise; before block b at most 16 · b values are listed, and 16 are written.
        unsafe {
            let x = _mm512_loadu_ps(x.as_ptr().add(block * block_stride));
            let kept = _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(x, _mm512_setzero_ps());
            _mm512_storeu_ps(values.as_mut_ptr().add(len), _mm512_maskz_compress_ps(kept, x));
            let places = _mm512_maskz_compress_epi32(kept, places);
            _mm512_storeu_si512(offsets.as_mut_ptr().add(len).cast(), places);
            len += kept.count_ones() as usize;
        }
        places = _mm512_add_epi32(places, _mm512_set1_epi32((BLOCK * PANEL) as i32));
    }
    len as u32
}

/// Adds `value · partner[offset + quarter]` for all of a pair of lists of one length: eight sums, so that the wait for one
/// is filled by the others.
///
/// # Safety
///
/// AVX-512F; 16 values can be read at each of the four partners from each offset on.
#[inline]
#[target_feature(enable = "avx512f")]
unsafe fn add_pair(sums: &mut [Sums; 2], [first, second]: [List<'_>; 2], partners: [*const f32; QUARTERS]) {
    let [mut a, mut b] = *sums;
    let first = first.offsets.iter().zip(first.values);
    for ((at_a, of_a), (at_b, of_b)) in first.zip(second.offsets.iter().zip(second.values)) {
        let (of_a, of_b) = (_mm512_set1_ps(*of_a), _mm512_set1_ps(*of_b));
        for ((a, b), partner) in a.iter_mut().zip(&mut b).zip(partners) {
            // SAFETY: the caller's promise.
            unsafe {
                *a = _mm512_fmadd_ps(of_a, _mm512_loadu_ps(partner.add(*at_a as usize)), *a);
                *b = _mm512_fmadd_ps(of_b, _mm512_loadu_ps(partner.add(*at_b as usize)), *b);
            }
        }
    }
    *sums = [a, b];
}

/// [`rows_times_span`](super::sparse::rows_times_span).
///
/// # Safety
///
/// AVX-512F, and operands as long as `rows_times_span` checks.
#[allow(clippy::too_many_arguments)] // The operands of one product.
#[target_feature(enable = "avx512f")]
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
    let [p, q] = panels.map(<[f32]>::as_ptr);
    let partners = [p, p.wrapping_add(BLOCK), q, q.wrapping_add(BLOCK)];
    // Lines of the next two panels that each row fetches: what hides the time that the third-level cache takes.
    let ahead = (SPAN * PANEL / BLOCK).div_ceil(rows);
    for row in (0..rows).step_by(2) {
        for line in row * ahead..(row + 2) * ahead {
            for next in next {
                // A prefetch has no effect but on the cache, wherever it points.
                _mm_prefetch::<_MM_HINT_T1>(next.as_ptr().wrapping_add(line * BLOCK).cast());
            }
        }
        // The last of an odd number of rows is computed twice and stored twice, which changes nothing.
        let pair = [row, (row + 1).min(rows - 1)];
        // SAFETY: the caller has checked the grids, the bias and the mask.
        unsafe {
            let c = pair.map(|row| base.add(row * out.row));
            let mut sums: [Sums; 2] = [[_mm512_setzero_ps(); QUARTERS]; 2];
            for (sums, c) in sums.iter_mut().zip(c) {
                for (quarter, sum) in sums.iter_mut().enumerate() {
                    match start {
                        Start::Zero => {}
                        Start::Bias(bias) => *sum = _mm512_loadu_ps(bias.as_ptr().add(quarter * BLOCK)),
                        Start::Accumulate => *sum = _mm512_loadu_ps(c.add(quarter * out.half)),
                    }
                }
            }
            add_pair(&mut sums, pair.map(|row| nonzeros.list(first_list + row)), partners);
            for ((sums, c), row) in sums.into_iter().zip(c).zip(pair) {
                for (quarter, mut sum) in sums.into_iter().enumerate() {
                    match finish {
                        Finish::Store => {}
                        Finish::Relu => sum = _mm512_max_ps(sum, _mm512_setzero_ps()),
                        Finish::Mask(mask) => {
                            let activation =
                                _mm512_loadu_ps(mask.data.as_ptr().add(row * mask.row + quarter * mask.half));
                            let positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(activation, _mm512_setzero_ps());
                            sum = _mm512_maskz_mov_ps(positive, sum);
                        }
                    }
                    _mm512_storeu_ps(c.add(quarter * out.half), sum);
                }
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
/// AVX-512F, and operands as long as `span_gradient` checks.
#[target_feature(enable = "avx512f")]
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
    let load = |row: &[f32; SPAN]| -> Sums {
        // SAFETY: a row is four registers.
        std::array::from_fn(|quarter| unsafe { _mm512_loadu_ps(row.as_ptr().add(quarter * BLOCK)) })
    };
    for first in (0..outputs).step_by(SPAN) {
        for chunk in 0..rows.chunks {
            let partners: [*const f32; QUARTERS] = std::array::from_fn(|quarter| {
                x.as_ptr().wrapping_add(chunk * rows.x_chunk + quarter * block_stride)
            });
            for output in (0..SPAN).step_by(2) {
                let list = chunk * outputs + first + output;
                let lists = [list, list + 1];
                let of_lists = lists.map(|list| output / BLOCK * BLOCK + columns.column(list));
                let mut sums = match chunk {
                    0 => [[_mm512_setzero_ps(); QUARTERS]; 2],
                    _ => of_lists.map(|output| load(&square.0[output])),
                };
                // SAFETY: the lists' offsets and four blocks behind them lie within the chunk; a row is four registers.
                unsafe {
                    add_pair(&mut sums, lists.map(|list| columns.list(list)), partners);
                    for (sums, output) in sums.into_iter().zip(of_lists) {
                        for (quarter, sum) in sums.into_iter().enumerate() {
                            _mm512_storeu_ps(square.0[output].as_mut_ptr().add(quarter * BLOCK), sum);
                        }
                    }
                }
            }
        }
        for (block, quarter) in
            (0..QUARTERS).flat_map(|block| (0..QUARTERS).map(move |quarter| (block, quarter)))
        {
            let output = first + block * BLOCK;
            let at = output / PANEL * gradient.stride + quarter * BLOCK * PANEL + output % PANEL;
            let of_outputs: [__m512; BLOCK] = std::array::from_fn(|output| {
                let row = &square.0[block * BLOCK + output];
                // SAFETY: a row is four registers.
                unsafe { _mm512_loadu_ps(row.as_ptr().add(quarter * BLOCK)) }
            });
            for (input, sum) in transposed(&of_outputs).into_iter().enumerate() {
                // SAFETY: a span of inputs of every panel lies within `gradient`.
                unsafe {
                    let out = gradient.data.as_mut_ptr().add(at + input * PANEL);
                    let before = if accumulate { _mm512_loadu_ps(out) } else { _mm512_setzero_ps() };
                    _mm512_storeu_ps(out, _mm512_add_ps(before, sum));
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
