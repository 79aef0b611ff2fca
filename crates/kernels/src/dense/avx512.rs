//! AVX-512: tiles of up to 14 rows × 2 registers, 28 sums in registers of 32.
//!
//! A step of k loads two registers of the right operand and broadcasts up to 14 values of the left
//! one: 16 loads for 28 multiply-adds, half of what the load ports can do, so that a tile is bound
//! by the multiply-add units. Tiles of 8 × 3 and 6 × 4 have the same ratio but need panels of 48
//! and 64 columns, which 256 outputs divide badly or which leave weight gradients with 6 rows of
//! 16.

use super::body::{Block, dense_products};
use crate::lanes::avx512 as lanes;
use crate::operands::{HALF, PANEL};

/// Steps of k that all tiles of a panel take before any takes the next: all.
const DEPTH: usize = usize::MAX;

/// The place from which the next lines are fetched, and the distance to the next step's.
///
/// The next panel lies behind this one. Each tile fetches its share of it, one block in `n_tiles`,
/// spread over its steps: that hides the time that the third-level cache takes. In the other blocks
/// it asks for the first line of its own panel.
struct Ahead {
    at: *const f32,
    step: usize,
}

impl Ahead {
    #[inline]
    fn new<const ROW: usize>(block: Block) -> Self {
        if ROW == HALF && block.index % block.n_tiles == block.tile {
            let first = block.index * block.len * PANEL;
            Self { at: block.panel.wrapping_add(block.count * block.len * PANEL + first), step: PANEL }
        } else {
            Self { at: block.panel, step: 0 }
        }
    }

    /// Fetches one step of k.
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn fetch<const ROW: usize>(&mut self, _: *const f32) {
        if ROW == HALF {
            lanes::prefetch_far(self.at);
            lanes::prefetch_far(self.at.wrapping_add(HALF));
            self.at = self.at.wrapping_add(self.step);
        }
    }
}

dense_products!(#[target_feature(enable = "avx512f")] 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
