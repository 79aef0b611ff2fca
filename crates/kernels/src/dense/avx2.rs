//! AVX2 and FMA: tiles of up to 6 rows × 16 columns (2 registers), 12 sums in registers of 16.
//!
//! A tile does the two halves of a panel one after the other, [`DEPTH`] steps of k at a time, so
//! that the part of a panel that all tiles read again (16 KB) leaves room for their own rows in a
//! first-level cache of 32 KB.

use super::body::{Block, dense_products};
use crate::lanes::avx2 as lanes;
use crate::operands::PANEL;

/// Steps of k that all tiles of a panel take before any takes the next.
const DEPTH: usize = 128;
/// Steps of k by which a panel is asked for before it is read.
const AHEAD: usize = 24;

/// A panel is fetched some steps before it is read, without more to remember.
struct Ahead;

impl Ahead {
    #[inline]
    fn new<const ROW: usize>(_: Block) -> Self {
        Self
    }

    /// Fetches one step of k of the panel, [`AHEAD`] steps behind `b`.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    #[allow(clippy::unused_self)] // One body for all sets calls it; that of AVX-512 remembers a place.
    fn fetch<const ROW: usize>(&mut self, b: *const f32) {
        lanes::prefetch_near(b.wrapping_add(AHEAD * PANEL));
    }
}

dense_products!(#[target_feature(enable = "avx2,fma")] 1 2 3 4 5 6);
