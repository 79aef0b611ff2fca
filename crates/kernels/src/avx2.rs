//! The two products for AVX2 and FMA: tiles of up to 6 rows × 16 columns (2 registers), 12 sums in registers of 16.
//!
//! A tile does the two halves of a panel one after the other, [`DEPTH`] steps of k at a time, so that the part of a panel that
//! all tiles read again (16 KB) leaves room for their own rows in a first-level cache of 32 KB.

use std::arch::x86_64::{
    __m256, _CMP_GT_OQ, _MM_HINT_T0, _mm_prefetch, _mm256_add_ps, _mm256_and_ps, _mm256_cmp_ps,
    _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_max_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps,
};

use crate::outer::{Count, Steps};
use crate::rows::{Finish, Grid, HALF, PANEL, Start, Strips};
use crate::tile::Tiles;

/// Floats of a register.
const LANES: usize = 8;

/// Steps of k that all tiles of a panel take before any takes the next.
const DEPTH: usize = 128;
/// Steps of k by which a panel is asked for before it is read.
const AHEAD: usize = 24;

/// [`rows_times_panel`](crate::rows_times_panel). Sums that wait for their next steps wait in the output: the bits are those of
/// one sum over all k.
///
/// # Safety
///
/// AVX2 and FMA, and operands as long as `rows_times_panel` checks.
#[target_feature(enable = "avx2,fma")]
pub(crate) unsafe fn rows<const ROW: usize>(
    tiles: Tiles,
    a: &Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    out: &mut Grid<&mut [f32]>,
) {
    let out = Grid { data: out.data.as_mut_ptr(), row: out.row, half: out.half };
    let blocks_at_once = (DEPTH / a.block_len).max(1);
    for first in (0..a.blocks).step_by(blocks_at_once) {
        let blocks = blocks_at_once.min(a.blocks - first);
        let a_part = Strips { data: &a.data[first * a.block_stride..], blocks, ..*a };
        let panel = &panel[first * a.block_len * PANEL..];
        let start = if first == 0 { start } else { Start::Accumulate };
        let finish = if first + blocks == a.blocks { finish } else { Finish::Store };
        let mut row = 0;
        for tile in 0..tiles.count {
            let size = tiles.small + usize::from(tile < tiles.n_large);
            for half in 0..2 {
                macro_rules! sizes {
                    ($($n:literal)*) => { match size {
                        // SAFETY: passed on; the tile's rows are among those checked.
                        $($n => unsafe { rows_tile::<$n, ROW>(row, half, &a_part, panel, start, finish, out) },)*
                        _ => unreachable!("tiles have 1 to 6 rows"),
                    } };
                }
                sizes!(1 2 3 4 5 6);
            }
            row += size;
        }
    }
}

/// # Safety
///
/// As [`rows`], for the rows `row..row + MR` and one half.
#[target_feature(enable = "avx2,fma")]
unsafe fn rows_tile<const MR: usize, const ROW: usize>(
    row: usize,
    half: usize,
    a: &Strips<'_>,
    panel: &[f32],
    start: Start<'_>,
    finish: Finish<'_>,
    out: Grid<*mut f32>,
) {
    // SAFETY: all addresses are those of elements (m, k, n) of the module `rows`, which the caller has checked.
    unsafe {
        let c = out.data.add(row * out.row + half * out.half);
        let mut sums = [[_mm256_setzero_ps(); 2]; MR];
        match start {
            Start::Zero => {}
            Start::Bias(bias) => sums = [load(bias.as_ptr().add(half * HALF)); MR],
            Start::Accumulate => {
                for (m, sum) in sums.iter_mut().enumerate() {
                    *sum = load(c.add(m * out.row));
                }
            }
        }
        let mut b = panel.as_ptr().wrapping_add(half * HALF);
        let mut strip = a.data.as_ptr().add(row * ROW);
        for _ in 0..a.blocks {
            let mut x = strip;
            for _ in 0..a.block_len {
                _mm_prefetch::<_MM_HINT_T0>(b.wrapping_add(AHEAD * PANEL).cast());
                step::<MR, ROW>(&mut sums, x, load(b));
                x = x.add(1);
                b = b.wrapping_add(PANEL);
            }
            strip = strip.wrapping_add(a.block_stride);
        }
        match finish {
            Finish::Store => {}
            Finish::Relu => {
                for sum in &mut sums {
                    *sum = sum.map(|sum| _mm256_max_ps(sum, _mm256_setzero_ps()));
                }
            }
            Finish::Mask(mask) => {
                for (m, sum) in sums.iter_mut().enumerate() {
                    let activations = load(mask.data.as_ptr().add((row + m) * mask.row + half * mask.half));
                    for (sum, activation) in sum.iter_mut().zip(activations) {
                        let positive = _mm256_cmp_ps::<_CMP_GT_OQ>(activation, _mm256_setzero_ps());
                        *sum = _mm256_and_ps(positive, *sum);
                    }
                }
            }
        }
        for (m, sum) in sums.iter().enumerate() {
            store(c.add(m * out.row), *sum);
        }
    }
}

/// [`outer_products`](crate::outer_products).
///
/// # Safety
///
/// AVX2 and FMA, and operands as long as `outer_products` checks.
#[target_feature(enable = "avx2,fma")]
pub(crate) unsafe fn outer(
    tiles: Tiles,
    count: Count,
    a: &Steps<'_>,
    b: &Steps<'_>,
    accumulate: bool,
    out: &mut [f32],
) {
    for half in 0..2 {
        let mut row = 0;
        for tile in 0..tiles.count {
            let size = tiles.small + usize::from(tile < tiles.n_large);
            // SAFETY: the output has `rows` rows of a panel.
            let out = unsafe { out.as_mut_ptr().add(row * PANEL + half * HALF) };
            macro_rules! sizes {
                ($($n:literal)*) => { match size {
                    // SAFETY: passed on; the tile's rows are among those checked.
                    $($n => unsafe { outer_tile::<$n>(row, half, count, a, b, accumulate, out) },)*
                    _ => unreachable!("tiles have 1 to 6 rows"),
                } };
            }
            sizes!(1 2 3 4 5 6);
            row += size;
        }
    }
}

/// # Safety
///
/// As [`outer`], for the rows `row..row + MR` and one half; `out` points to the first of them.
#[target_feature(enable = "avx2,fma")]
unsafe fn outer_tile<const MR: usize>(
    row: usize,
    half: usize,
    count: Count,
    a: &Steps<'_>,
    b: &Steps<'_>,
    accumulate: bool,
    out: *mut f32,
) {
    // SAFETY: all addresses are those of elements (m, k, n) of the module `outer`, which the caller has checked.
    unsafe {
        let mut sums = [[_mm256_setzero_ps(); 2]; MR];
        for segment in 0..count.segments {
            let mut x = a.data.as_ptr().add(segment * a.segment + row);
            let mut y = b.data.as_ptr().add(segment * b.segment + half * b.half);
            for _ in 0..count.steps {
                step::<MR, 1>(&mut sums, x, load(y));
                x = x.wrapping_add(a.step);
                y = y.wrapping_add(b.step);
            }
        }
        for (m, sum) in sums.iter().enumerate() {
            let out = out.add(m * PANEL);
            let before = if accumulate { load(out) } else { [_mm256_setzero_ps(); 2] };
            store(out, [_mm256_add_ps(before[0], sum[0]), _mm256_add_ps(before[1], sum[1])]);
        }
    }
}

/// One step of k: `sums[m] += x[m·ROW] · b`.
///
/// # Safety
///
/// AVX2 and FMA; `x` may be read at `m·ROW` for every m.
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn step<const MR: usize, const ROW: usize>(
    sums: &mut [[__m256; 2]; MR],
    x: *const f32,
    b: [__m256; 2],
) {
    for (m, sum) in sums.iter_mut().enumerate() {
        // SAFETY: the caller's promise.
        let x = _mm256_set1_ps(unsafe { *x.add(m * ROW) });
        sum[0] = _mm256_fmadd_ps(x, b[0], sum[0]);
        sum[1] = _mm256_fmadd_ps(x, b[1], sum[1]);
    }
}

/// # Safety
///
/// AVX; 16 floats may be read.
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn load(from: *const f32) -> [__m256; 2] {
    // SAFETY: the caller's promise.
    unsafe { [_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(LANES))] }
}

/// # Safety
///
/// AVX; 16 floats may be written.
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn store(to: *mut f32, values: [__m256; 2]) {
    // SAFETY: the caller's promise.
    unsafe {
        _mm256_storeu_ps(to, values[0]);
        _mm256_storeu_ps(to.add(LANES), values[1]);
    }
}
