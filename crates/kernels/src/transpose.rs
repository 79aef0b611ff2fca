//! Transposing a square of weights.

use crate::dispatch::{Isa, on_set};
use crate::operands::PANEL;

/// `to[j·32 + i] = from[i·32 + j]`; rows that `from` does not have become zeros.
///
/// # Panics
///
/// If `to` does not have 32 × 32 values, or `from` has more.
pub(crate) fn square(isa: Isa, from: &[f32], to: &mut [f32]) {
    let (from, _) = from.as_chunks::<PANEL>();
    let (to, _) = to.as_chunks_mut::<PANEL>();
    assert!(from.len() <= PANEL && to.len() == PANEL, "{} rows to {}", from.len(), to.len());
    if from.len() == PANEL {
        // SAFETY: both sides have 32 rows.
        return unsafe { on_set!(isa, whole(from, to)) };
    }
    for (j, to) in to.iter_mut().enumerate() {
        for (i, to) in to.iter_mut().enumerate() {
            *to = from.get(i).map_or(0.0, |row| row[j]);
        }
    }
}

/// `whole` for one set: squares in its registers.
macro_rules! whole {
    ($set:ident $(#[$feature:meta])?) => {
        mod $set {
            use crate::lanes::$set as lanes;
            use crate::operands::PANEL;
            use lanes::LANES;

            /// # Safety
            ///
            /// The instruction set; both sides have 32 rows.
            $(#[$feature])?
            pub(super) unsafe fn whole(from: &[[f32; PANEL]], to: &mut [[f32; PANEL]]) {
                for i in (0..PANEL).step_by(LANES) {
                    for j in (0..PANEL).step_by(LANES) {
                        // SAFETY: a register from column j on is within a row of 32.
                        let rows = std::array::from_fn(|row| unsafe { lanes::load(from[i + row][j..].as_ptr()) });
                        for (column, values) in lanes::transpose(&rows).into_iter().enumerate() {
                            // SAFETY: as for the loads.
                            unsafe { lanes::store(to[j + column][i..].as_mut_ptr(), values) };
                        }
                    }
                }
            }
        }
    };
}
#[cfg(target_arch = "x86_64")]
whole!(avx512 #[target_feature(enable = "avx512f")]);
#[cfg(target_arch = "x86_64")]
whole!(avx2 #[target_feature(enable = "avx2,fma")]);
whole!(plain);

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
