//! Plain Rust: one row at a time, 32 sums.

use super::body::{Block, dense_products};
use crate::lanes::plain as lanes;

/// Steps of k that all rows take before any takes the next: all.
const DEPTH: usize = usize::MAX;

/// Nothing is fetched ahead.
struct Ahead;

impl Ahead {
    #[inline]
    fn new<const ROW: usize>(_: Block) -> Self {
        Self
    }

    /// Does nothing.
    #[inline]
    #[allow(clippy::unused_self)] // One body for all sets calls it; that of AVX-512 remembers a place.
    fn fetch<const ROW: usize>(&mut self, _: *const f32) {}
}

dense_products!(1);
