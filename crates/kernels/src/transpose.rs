//! Transposing a square of weights.

use crate::Isa;
use crate::isa::Level;
use crate::rows::PANEL;

/// `to[j·32 + i] = from[i·32 + j]`; rows that `from` does not have become zeros.
///
/// # Panics
///
/// If `to` does not have 32 × 32 values, or `from` has more.
pub(crate) fn square(isa: Isa, from: &[f32], to: &mut [f32]) {
    let (from, _) = from.as_chunks::<PANEL>();
    let (to, _) = to.as_chunks_mut::<PANEL>();
    assert!(from.len() <= PANEL && to.len() == PANEL, "{} rows to {}", from.len(), to.len());
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it; AVX-512 is taken only beside AVX2.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 | Level::Avx2 if from.len() == PANEL => unsafe { square_avx2(from, to) },
        _ => plain(from, to),
    }
}

fn plain(from: &[[f32; PANEL]], to: &mut [[f32; PANEL]]) {
    for (j, to) in to.iter_mut().enumerate() {
        for (i, to) in to.iter_mut().enumerate() {
            *to = from.get(i).map_or(0.0, |row| row[j]);
        }
    }
}

/// Squares of 8 × 8 in registers.
///
/// # Safety
///
/// AVX2; both sides have 32 rows.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn square_avx2(from: &[[f32; PANEL]], to: &mut [[f32; PANEL]]) {
    use std::arch::x86_64::{_mm256_loadu_ps, _mm256_storeu_ps};
    const LANES: usize = 8;
    for i in (0..PANEL).step_by(LANES) {
        for j in (0..PANEL).step_by(LANES) {
            // SAFETY: 8 values from column j on are within a row of 32.
            let rows = std::array::from_fn(|row| unsafe { _mm256_loadu_ps(from[i + row][j..].as_ptr()) });
            for (column, values) in eight_by_eight(rows).into_iter().enumerate() {
                // SAFETY: as for the loads.
                unsafe { _mm256_storeu_ps(to[j + column][i..].as_mut_ptr(), values) };
            }
        }
    }
}

/// The columns of 8 rows of 8 values: pairs of rows are interleaved within each half of a register, then pairs of pairs, then
/// halves are exchanged.
#[cfg(target_arch = "x86_64")]
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn eight_by_eight(rows: [std::arch::x86_64::__m256; 8]) -> [std::arch::x86_64::__m256; 8] {
    use std::arch::x86_64::{
        _mm256_permute2f128_ps, _mm256_shuffle_ps, _mm256_unpackhi_ps, _mm256_unpacklo_ps,
    };
    let mut quads = rows;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_and_parts_are_transposed() {
        for isa in Isa::available() {
            for rows in [1, 4, 31, 32] {
                let from: Vec<f32> = (0..rows * PANEL).map(|value| value as f32 + 1.0).collect();
                let mut to = vec![f32::NAN; PANEL * PANEL];
                square(isa, &from, &mut to);
                for i in 0..PANEL {
                    for j in 0..PANEL {
                        let expected = if i < rows { from[i * PANEL + j] } else { 0.0 };
                        assert_eq!(to[j * PANEL + i], expected);
                    }
                }
            }
        }
    }
}
