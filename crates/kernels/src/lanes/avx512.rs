//! Registers of 16 floats (AVX-512F).

use std::arch::asm;
use std::arch::x86_64::{
    __m512, __m512d, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T0, _MM_HINT_T1, _mm_prefetch, _mm512_add_ps,
    _mm512_castpd_ps, _mm512_castps_pd, _mm512_cmp_ps_mask, _mm512_fmadd_ps, _mm512_loadu_ps,
    _mm512_maskz_mov_ps, _mm512_max_ps, _mm512_set1_ps, _mm512_setzero_ps, _mm512_shuffle_f32x4,
    _mm512_storeu_ps, _mm512_unpackhi_pd, _mm512_unpackhi_ps, _mm512_unpacklo_pd, _mm512_unpacklo_ps,
};

/// One register.
pub(crate) type V = __m512;

/// Floats of a register.
pub(crate) const LANES: usize = 16;

/// Zeros.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn zero() -> V {
    _mm512_setzero_ps()
}

/// One value in every lane; from memory this is one load.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn splat(value: f32) -> V {
    _mm512_set1_ps(value)
}

/// One value in every lane, by way of a general register: for loops that are bound by loads of
/// vector registers, of which a processor makes one or two a cycle, and this load is none. The
/// compiler would make it one.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn broadcast(value: f32) -> V {
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

/// # Safety
///
/// 16 floats may be read.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn load(from: *const f32) -> V {
    // SAFETY: the caller's promise.
    unsafe { _mm512_loadu_ps(from) }
}

/// # Safety
///
/// 16 floats may be written.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn store(to: *mut f32, values: V) {
    // SAFETY: the caller's promise.
    unsafe { _mm512_storeu_ps(to, values) }
}

/// a + b.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn add(a: V, b: V) -> V {
    _mm512_add_ps(a, b)
}

/// a · b + c, rounded once.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn fma(a: V, b: V, c: V) -> V {
    _mm512_fmadd_ps(a, b, c)
}

/// max(x, 0) in every lane.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn relu(values: V) -> V {
    _mm512_max_ps(values, _mm512_setzero_ps())
}

/// Bit i is set where lane i is not zero.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn not_zero(values: V) -> u64 {
    u64::from(_mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(values, _mm512_setzero_ps()))
}

/// Lane i where bit i is set, else 0; higher bits are ignored.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn keep(bits: u64, values: V) -> V {
    _mm512_maskz_mov_ps(bits as u16, values)
}

/// Lane i where lane i of `activations` is positive, else 0.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn keep_positive(activations: V, values: V) -> V {
    _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(activations, _mm512_setzero_ps()), values)
}

/// Asks for the line of an address in the first-level cache. It has no other effect, wherever the
/// address points.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn prefetch_near(address: *const f32) {
    _mm_prefetch::<_MM_HINT_T0>(address.cast());
}

/// Asks for the line of an address in the second-level cache. It has no other effect, wherever the
/// address points.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn prefetch_far(address: *const f32) {
    _mm_prefetch::<_MM_HINT_T1>(address.cast());
}

/// The columns of 16 rows of 16 values.
///
/// Within each 128-bit lane, pairs of rows are interleaved, then pairs of pairs: lane l of
/// `quads[4·g + c]` holds column 4·l + c of the rows 4·g … 4·g + 3. What is left is a transposition
/// of 4 × 4 lanes.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn transpose(rows: &[V; LANES]) -> [V; LANES] {
    let low = |a: __m512d, b: __m512d| _mm512_castpd_ps(_mm512_unpacklo_pd(a, b));
    let high = |a: __m512d, b: __m512d| _mm512_castpd_ps(_mm512_unpackhi_pd(a, b));
    let mut quads = [_mm512_setzero_ps(); LANES];
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
    let mut columns = [_mm512_setzero_ps(); LANES];
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
