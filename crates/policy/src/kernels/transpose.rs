//! Transposing a square of weights.

use super::Isa;
use super::isa::Level;
use super::rows::PANEL;

/// `to[j·32 + i] = from[i·32 + j]`; rows that `from` does not have become zeros.
///
/// # Panics
///
/// If `to` does not have 32 × 32 values, or `from` has more.
pub(super) fn square(isa: Isa, from: &[f32], to: &mut [f32]) {
    let (from, _) = from.as_chunks::<PANEL>();
    let (to, _) = to.as_chunks_mut::<PANEL>();
    assert!(from.len() <= PANEL && to.len() == PANEL, "{} rows to {}", from.len(), to.len());
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe { square_avx512(from, to) },
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

/// The plain loop, compiled for wider registers: the compiler turns the inner loop into gathers and stores of a row.
///
/// # Safety
///
/// AVX-512F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn square_avx512(from: &[[f32; PANEL]], to: &mut [[f32; PANEL]]) {
    plain(from, to);
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
