//! The two products for AVX-512: tiles of up to 14 rows × 2 registers, 28 sums in registers of 32.
//!
//! A step of k loads two registers of the right operand and broadcasts up to 14 values of the left one: 16 loads for 28
//! multiply-adds, half of what the load ports can do, so that a tile is bound by the multiply-add units. Tiles of
//! 8 × 3 and 6 × 4 have the same ratio but need panels of 48 and 64 columns, which 256 outputs divide badly or which
//! leave weight gradients with 6 rows of 16.

use std::arch::x86_64::{
    __m512, _CMP_GT_OQ, _MM_HINT_T1, _mm_prefetch, _mm512_add_ps, _mm512_cmp_ps_mask, _mm512_fmadd_ps,
    _mm512_loadu_ps, _mm512_maskz_mov_ps, _mm512_max_ps, _mm512_set1_ps, _mm512_setzero_ps, _mm512_storeu_ps,
};

use crate::outer::{Count, Steps};
use crate::rows::{Finish, Grid, HALF, PANEL, Start, Strips};
use crate::tile::Tiles;

/// [`rows_times_panel`](crate::rows_times_panel).
///
/// # Safety
///
/// AVX-512F, and operands as long as `rows_times_panel` checks.
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn rows<const ROW: usize>(
    tiles: Tiles,
    a: &Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    out: &mut Grid<&mut [f32]>,
) {
    let out = Grid { data: out.data.as_mut_ptr(), row: out.row, half: out.half };
    let mut row = 0;
    for tile in 0..tiles.count {
        let size = tiles.small + usize::from(tile < tiles.n_large);
        macro_rules! sizes {
            ($($n:literal)*) => { match size {
                // SAFETY: passed on; the tile's rows are among those checked.
                $($n => unsafe { rows_tile::<$n, ROW>(row, tile, tiles.count, a, panel, start, finish, out) },)*
                _ => unreachable!("tiles have 1 to 14 rows"),
            } };
        }
        sizes!(1 2 3 4 5 6 7 8 9 10 11 12 13 14);
        row += size;
    }
}

/// # Safety
///
/// As [`rows`], for the rows `row..row + MR`, which are tile number `tile` of `n_tiles`.
#[allow(clippy::too_many_arguments)] // The operands of one product, and which tile of how many this is.
#[target_feature(enable = "avx512f")]
unsafe fn rows_tile<const MR: usize, const ROW: usize>(
    row: usize,
    tile: usize,
    n_tiles: usize,
    a: &Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    out: Grid<*mut f32>,
) {
    // SAFETY: all addresses are those of elements (m, k, n) of the module `rows`, which the caller has checked.
    unsafe {
        let c = out.data.add(row * out.row);
        let mut sums = [[_mm512_setzero_ps(); 2]; MR];
        match start {
            Start::Zero => {}
            Start::Bias(bias) => {
                let bias = bias.as_ptr();
                sums = [[_mm512_loadu_ps(bias), _mm512_loadu_ps(bias.add(HALF))]; MR];
            }
            Start::Accumulate => {
                for (m, sum) in sums.iter_mut().enumerate() {
                    let c = c.add(m * out.row);
                    *sum = [_mm512_loadu_ps(c), _mm512_loadu_ps(c.add(out.half))];
                }
            }
        }
        let mut b = panel.as_ptr();
        let mut strip = a.data.as_ptr().add(row * ROW);
        // The next panel lies behind this one. Each tile fetches its share of it, spread over its steps: what hides the
        // time that the third-level cache takes. Behind the last panel nothing is read: a prefetch has no effect but on
        // the cache.
        let next = b.wrapping_add(a.blocks * a.block_len * PANEL);
        for block in 0..a.blocks {
            let mut x = strip;
            let share = ROW == HALF && block % n_tiles == tile;
            let mut ahead = if share { next.wrapping_add(block * a.block_len * PANEL) } else { b };
            let ahead_step = if share { PANEL } else { 0 };
            for _ in 0..a.block_len {
                if ROW == HALF {
                    _mm_prefetch::<_MM_HINT_T1>(ahead.cast());
                    _mm_prefetch::<_MM_HINT_T1>(ahead.wrapping_add(HALF).cast());
                    ahead = ahead.wrapping_add(ahead_step);
                }
                step::<MR, ROW>(&mut sums, x, _mm512_loadu_ps(b), _mm512_loadu_ps(b.add(HALF)));
                x = x.add(1);
                b = b.add(PANEL);
            }
            strip = strip.wrapping_add(a.block_stride);
        }
        match finish {
            Finish::Store => {}
            Finish::Relu => {
                for sum in &mut sums {
                    *sum = sum.map(|sum| _mm512_max_ps(sum, _mm512_setzero_ps()));
                }
            }
            Finish::Mask(mask) => {
                for (m, sum) in sums.iter_mut().enumerate() {
                    for (half, sum) in sum.iter_mut().enumerate() {
                        let activation = mask.data.as_ptr().add((row + m) * mask.row + half * mask.half);
                        let positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(
                            _mm512_loadu_ps(activation),
                            _mm512_setzero_ps(),
                        );
                        *sum = _mm512_maskz_mov_ps(positive, *sum);
                    }
                }
            }
        }
        for (m, sum) in sums.iter().enumerate() {
            let c = c.add(m * out.row);
            _mm512_storeu_ps(c, sum[0]);
            _mm512_storeu_ps(c.add(out.half), sum[1]);
        }
    }
}

/// [`outer_products`](crate::outer_products).
///
/// # Safety
///
/// AVX-512F, and operands as long as `outer_products` checks.
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn outer(
    tiles: Tiles,
    count: Count,
    a: &Steps<'_>,
    b: &Steps<'_>,
    accumulate: bool,
    out: &mut [f32],
) {
    let mut row = 0;
    for tile in 0..tiles.count {
        let size = tiles.small + usize::from(tile < tiles.n_large);
        // SAFETY: the output has `rows` rows of a panel.
        let out = unsafe { out.as_mut_ptr().add(row * PANEL) };
        macro_rules! sizes {
            ($($n:literal)*) => { match size {
                // SAFETY: passed on; the tile's rows are among those checked.
                $($n => unsafe { outer_tile::<$n>(row, count, a, b, accumulate, out) },)*
                _ => unreachable!("tiles have 1 to 14 rows"),
            } };
        }
        sizes!(1 2 3 4 5 6 7 8 9 10 11 12 13 14);
        row += size;
    }
}

/// # Safety
///
/// As [`outer`], for the rows `row..row + MR`; `out` points to the first of them.
#[target_feature(enable = "avx512f")]
unsafe fn outer_tile<const MR: usize>(
    row: usize,
    count: Count,
    a: &Steps<'_>,
    b: &Steps<'_>,
    accumulate: bool,
    out: *mut f32,
) {
    // SAFETY: all addresses are those of elements (m, k, n) of the module `outer`, which the caller has checked.
    unsafe {
        let mut sums = [[_mm512_setzero_ps(); 2]; MR];
        for segment in 0..count.segments {
            let mut x = a.data.as_ptr().add(segment * a.segment + row);
            let mut y = b.data.as_ptr().add(segment * b.segment);
            for _ in 0..count.steps {
                step::<MR, 1>(&mut sums, x, _mm512_loadu_ps(y), _mm512_loadu_ps(y.wrapping_add(b.half)));
                x = x.wrapping_add(a.step);
                y = y.wrapping_add(b.step);
            }
        }
        for (m, sum) in sums.iter().enumerate() {
            for (half, sum) in sum.iter().enumerate() {
                let out = out.add(m * PANEL + half * HALF);
                let before = if accumulate { _mm512_loadu_ps(out) } else { _mm512_setzero_ps() };
                _mm512_storeu_ps(out, _mm512_add_ps(before, *sum));
            }
        }
    }
}

/// One step of k: `sums[m] += x[m·ROW] · (b0, b1)`.
///
/// # Safety
///
/// AVX-512F; `x` may be read at `m·ROW` for every m.
#[inline]
#[target_feature(enable = "avx512f")]
unsafe fn step<const MR: usize, const ROW: usize>(
    sums: &mut [[__m512; 2]; MR],
    x: *const f32,
    b0: __m512,
    b1: __m512,
) {
    for (m, sum) in sums.iter_mut().enumerate() {
        // SAFETY: the caller's promise.
        let x = _mm512_set1_ps(unsafe { *x.add(m * ROW) });
        sum[0] = _mm512_fmadd_ps(x, b0, sum[0]);
        sum[1] = _mm512_fmadd_ps(x, b1, sum[1]);
    }
}
