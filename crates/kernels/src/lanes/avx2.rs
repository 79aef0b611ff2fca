//! Registers of 8 floats (AVX2 and FMA).

use std::arch::asm;
use std::arch::x86_64::{
    __m256, _CMP_GT_OQ, _CMP_NEQ_UQ, _MM_HINT_T0, _MM_HINT_T1, _mm_prefetch, _mm256_add_ps, _mm256_and_ps,
    _mm256_and_si256, _mm256_castsi256_ps, _mm256_cmp_ps, _mm256_cmpeq_epi32, _mm256_fmadd_ps,
    _mm256_loadu_ps, _mm256_max_ps, _mm256_movemask_ps, _mm256_permute2f128_ps, _mm256_set1_epi32,
    _mm256_set1_ps, _mm256_setr_epi32, _mm256_setzero_ps, _mm256_shuffle_ps, _mm256_storeu_ps,
    _mm256_unpackhi_ps, _mm256_unpacklo_ps,
};

/// One register.
pub(crate) type V = __m256;

/// Floats of a register.
pub(crate) const LANES: usize = 8;

/// Zeros.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn zero() -> V {
    _mm256_setzero_ps()
}

/// One value in every lane; from memory this is one load.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn splat(value: f32) -> V {
    _mm256_set1_ps(value)
}

/// One value in every lane, by way of a general register: for loops that are bound by loads of
/// vector registers, of which a processor makes two a cycle, and this load is none. The compiler
/// would make it one.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn broadcast(value: f32) -> V {
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

/// # Safety
///
/// 8 floats may be read.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) unsafe fn load(from: *const f32) -> V {
    // SAFETY: the caller's promise.
    unsafe { _mm256_loadu_ps(from) }
}

/// # Safety
///
/// 8 floats may be written.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) unsafe fn store(to: *mut f32, values: V) {
    // SAFETY: the caller's promise.
    unsafe { _mm256_storeu_ps(to, values) }
}

/// a + b.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn add(a: V, b: V) -> V {
    _mm256_add_ps(a, b)
}

/// a · b + c, rounded once.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn fma(a: V, b: V, c: V) -> V {
    _mm256_fmadd_ps(a, b, c)
}

/// max(x, 0) in every lane.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn relu(values: V) -> V {
    _mm256_max_ps(values, _mm256_setzero_ps())
}

/// Bit i is set where lane i is not zero.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn not_zero(values: V) -> u64 {
    let kept = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(values, _mm256_setzero_ps()));
    u64::from(kept as u32)
}

/// Lane i where bit i is set, else 0; higher bits are ignored.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn keep(bits: u64, values: V) -> V {
    let of_lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    let own = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits as u8)), of_lanes);
    _mm256_and_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(own, of_lanes)), values)
}

/// Lane i where lane i of `activations` is positive, else 0.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn keep_positive(activations: V, values: V) -> V {
    _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(activations, _mm256_setzero_ps()), values)
}

/// Asks for the line of an address in the first-level cache. It has no other effect, wherever the
/// address points.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn prefetch_near(address: *const f32) {
    _mm_prefetch::<_MM_HINT_T0>(address.cast());
}

/// Asks for the line of an address in the second-level cache. It has no other effect, wherever the
/// address points.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn prefetch_far(address: *const f32) {
    _mm_prefetch::<_MM_HINT_T1>(address.cast());
}

/// The columns of 8 rows of 8 values: pairs of rows are interleaved within each half of a register,
/// then pairs of pairs, then halves are exchanged.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn transpose(rows: &[V; LANES]) -> [V; LANES] {
    let mut quads = *rows;
    for (quads, rows) in quads.chunks_exact_mut(4).zip(rows.chunks_exact(4)) {
        let low = [_mm256_unpacklo_ps(rows[0], rows[1]), _mm256_unpacklo_ps(rows[2], rows[3])];
        let high = [_mm256_unpackhi_ps(rows[0], rows[1]), _mm256_unpackhi_ps(rows[2], rows[3])];
        quads[0] = _mm256_shuffle_ps::<0x44>(low[0], low[1]);
        quads[1] = _mm256_shuffle_ps::<0xEE>(low[0], low[1]);
        quads[2] = _mm256_shuffle_ps::<0x44>(high[0], high[1]);
        quads[3] = _mm256_shuffle_ps::<0xEE>(high[0], high[1]);
    }
    let mut columns = quads;
    for c in 0..4 {
        columns[c] = _mm256_permute2f128_ps::<0x20>(quads[c], quads[c + 4]);
        columns[c + 4] = _mm256_permute2f128_ps::<0x31>(quads[c], quads[c + 4]);
    }
    columns
}
