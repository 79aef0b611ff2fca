//! Both dense products for registers of any width, compiled once for each instruction set.
//!
//! A tile has up to `TILE` rows and two registers of columns: the whole panel where a register has
//! 16 floats, half of it where a register has 8.

/// One block of k, as a tile comes to it.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// Number of the block.
    pub(super) index: usize,
    /// Number of blocks.
    pub(super) count: usize,
    /// Steps of k in each block.
    pub(super) len: usize,
    /// The panel, whose rows belong to one step of k each.
    pub(super) panel: *const f32,
    /// Number of the tile.
    pub(super) tile: usize,
    /// Number of tiles.
    pub(super) n_tiles: usize,
}

/// The functions `rows` and `outer` for one set: its feature, then the sizes that a tile may have.
///
/// In scope at the call are `lanes`, the set's registers; `DEPTH`, the number of steps of k that
/// all tiles of a panel take before any takes the next; and `Ahead`, which fetches memory ahead.
macro_rules! dense_products {
    ($(#[$feature:meta])? $($size:literal)*) => {
        use crate::operands::{Count, Finish, Grid, Start, Steps, Strips};
        use crate::tile::Tiles;
        use lanes::{LANES, V};

        /// Most rows of a tile.
        const TILE: usize = [$($size),*].len();
        /// Columns of a tile.
        const COLUMNS: usize = 2 * LANES;

        /// [`rows_times_panel`](crate::rows_times_panel). Sums that wait for their next steps wait
        /// in the output: the bits are those of one sum over all k.
        ///
        /// # Safety
        ///
        /// The instruction set, `rows` > 0, and operands as long as `rows_times_panel` checks.
        $(#[$feature])?
        pub(super) unsafe fn rows<const ROW: usize>(
            rows: usize,
            a: &Strips<'_>,
            panel: &[f32],
            start: Start<'_>,
            finish: Finish<'_>,
            out: &mut Grid<&mut [f32]>,
        ) {
            let out = Grid { data: out.data.as_mut_ptr(), row: out.row, half: out.half };
            let tiles = Tiles::new(rows, TILE);
            let blocks_at_once =
                if DEPTH == usize::MAX { a.blocks } else { (DEPTH / a.block_len).clamp(1, a.blocks) };
            for first in (0..a.blocks).step_by(blocks_at_once) {
                let blocks = blocks_at_once.min(a.blocks - first);
                let a_part = Strips { data: &a.data[first * a.block_stride..], blocks, ..*a };
                let panel = &panel[first * a.block_len * crate::operands::PANEL..];
                let start = if first == 0 { start } else { Start::Accumulate };
                let finish = if first + blocks == a.blocks { finish } else { Finish::Store };
                let mut row = 0;
                for tile in 0..tiles.count {
                    let size = tiles.small + usize::from(tile < tiles.n_large);
                    for column in (0..crate::operands::PANEL).step_by(COLUMNS) {
                        match size {
                            // SAFETY: passed on; the tile's rows are among those checked.
                            $($size => unsafe {
                                rows_tile::<$size, ROW>(
                                    row, column, tile, tiles.count, &a_part, panel, start, finish, out,
                                );
                            },)*
                            _ => unreachable!("tiles have 1 to {TILE} rows"),
                        }
                    }
                    row += size;
                }
            }
        }

        /// # Safety
        ///
        /// As [`rows`], for the rows `row..row + MR` and the columns from `column` on, which are
        /// tile number `tile` of `n_tiles`.
        #[allow(clippy::too_many_arguments)] // The operands of one product, and the place of a tile in it.
        $(#[$feature])?
        unsafe fn rows_tile<const MR: usize, const ROW: usize>(
            row: usize,
            column: usize,
            tile: usize,
            n_tiles: usize,
            a: &Strips<'_>,
            panel: &[f32],
            start: Start<'_>,
            finish: Finish<'_>,
            out: Grid<*mut f32>,
        ) {
            use crate::operands::{HALF, PANEL};
            let half = column / HALF;
            // SAFETY: all addresses are those of elements (m, k, n) of the module `dense`, which
            // the caller has checked.
            unsafe {
                let c = out.data.add(row * out.row + half * out.half);
                let mut sums = [[lanes::zero(); 2]; MR];
                match start {
                    Start::Zero => {}
                    Start::Bias(bias) => sums = [load(bias.as_ptr().add(column), HALF); MR],
                    Start::Accumulate => {
                        for (m, sum) in sums.iter_mut().enumerate() {
                            *sum = load(c.add(m * out.row), out.half);
                        }
                    }
                }
                let mut b = panel.as_ptr().wrapping_add(column);
                let mut strip = a.data.as_ptr().add(row * ROW);
                for index in 0..a.blocks {
                    let mut x = strip;
                    let mut ahead = Ahead::new::<ROW>(Block {
                        index,
                        count: a.blocks,
                        len: a.block_len,
                        panel: panel.as_ptr(),
                        tile,
                        n_tiles,
                    });
                    for _ in 0..a.block_len {
                        ahead.fetch::<ROW>(b);
                        step::<MR, ROW>(&mut sums, x, load(b, HALF));
                        x = x.add(1);
                        b = b.wrapping_add(PANEL);
                    }
                    strip = strip.wrapping_add(a.block_stride);
                }
                match finish {
                    Finish::Store => {}
                    Finish::Relu => {
                        for sum in &mut sums {
                            *sum = [lanes::relu(sum[0]), lanes::relu(sum[1])];
                        }
                    }
                    Finish::Mask(mask) => {
                        for (m, sum) in sums.iter_mut().enumerate() {
                            let activations = mask.data.as_ptr().add((row + m) * mask.row + half * mask.half);
                            let activations = load(activations, mask.half);
                            for (sum, activations) in sum.iter_mut().zip(activations) {
                                *sum = lanes::keep_positive(activations, *sum);
                            }
                        }
                    }
                }
                for (m, sum) in sums.iter().enumerate() {
                    store(c.add(m * out.row), out.half, *sum);
                }
            }
        }

        /// [`outer_products`](crate::outer_products).
        ///
        /// # Safety
        ///
        /// The instruction set, `rows` > 0, and operands as long as `outer_products` checks.
        $(#[$feature])?
        pub(super) unsafe fn outer(
            rows: usize,
            count: Count,
            a: &Steps<'_>,
            b: &Steps<'_>,
            accumulate: bool,
            out: &mut [f32],
        ) {
            use crate::operands::PANEL;
            let tiles = Tiles::new(rows, TILE);
            for column in (0..PANEL).step_by(COLUMNS) {
                let mut row = 0;
                for tile in 0..tiles.count {
                    let size = tiles.small + usize::from(tile < tiles.n_large);
                    // SAFETY: the output has `rows` rows of a panel.
                    let out = unsafe { out.as_mut_ptr().add(row * PANEL + column) };
                    match size {
                        // SAFETY: passed on; the tile's rows are among those checked.
                        $($size => unsafe { outer_tile::<$size>(row, column, count, a, b, accumulate, out) },)*
                        _ => unreachable!("tiles have 1 to {TILE} rows"),
                    }
                    row += size;
                }
            }
        }

        /// # Safety
        ///
        /// As [`outer`], for the rows `row..row + MR` and the columns from `column` on; `out`
        /// points to the first of them.
        $(#[$feature])?
        unsafe fn outer_tile<const MR: usize>(
            row: usize,
            column: usize,
            count: Count,
            a: &Steps<'_>,
            b: &Steps<'_>,
            accumulate: bool,
            out: *mut f32,
        ) {
            use crate::operands::{HALF, PANEL};
            // SAFETY: all addresses are those of elements (m, k, n) of the module `dense`, which
            // the caller has checked.
            unsafe {
                let mut sums = [[lanes::zero(); 2]; MR];
                for segment in 0..count.segments {
                    let mut x = a.data.as_ptr().add(segment * a.segment + row);
                    let mut y = b.data.as_ptr().add(segment * b.segment + column / HALF * b.half);
                    for _ in 0..count.steps {
                        step::<MR, 1>(&mut sums, x, load(y, b.half));
                        x = x.wrapping_add(a.step);
                        y = y.wrapping_add(b.step);
                    }
                }
                for (m, sum) in sums.iter().enumerate() {
                    let out = out.add(m * PANEL);
                    let before = if accumulate { load(out, HALF) } else { [lanes::zero(); 2] };
                    store(out, HALF, [lanes::add(before[0], sum[0]), lanes::add(before[1], sum[1])]);
                }
            }
        }

        /// One step of k: `sums[m] += x[m·ROW] · b`.
        ///
        /// # Safety
        ///
        /// The instruction set; `x` may be read at `m·ROW` for every m.
        #[inline]
        $(#[$feature])?
        unsafe fn step<const MR: usize, const ROW: usize>(sums: &mut [[V; 2]; MR], x: *const f32, b: [V; 2]) {
            for (m, sum) in sums.iter_mut().enumerate() {
                // SAFETY: the caller's promise.
                let x = lanes::splat(unsafe { *x.add(m * ROW) });
                sum[0] = lanes::fma(x, b[0], sum[0]);
                sum[1] = lanes::fma(x, b[1], sum[1]);
            }
        }

        /// The two registers of a tile's row, whose half panels are `half` apart.
        ///
        /// # Safety
        ///
        /// The instruction set; both registers may be read.
        #[inline]
        $(#[$feature])?
        unsafe fn load(from: *const f32, half: usize) -> [V; 2] {
            let second = crate::operands::register_offset(1, LANES, half);
            // SAFETY: the caller's promise.
            unsafe { [lanes::load(from), lanes::load(from.wrapping_add(second))] }
        }

        /// Stores the two registers of a tile's row, whose half panels are `half` apart.
        ///
        /// # Safety
        ///
        /// The instruction set; both registers may be written.
        #[inline]
        $(#[$feature])?
        unsafe fn store(to: *mut f32, half: usize, values: [V; 2]) {
            let second = crate::operands::register_offset(1, LANES, half);
            // SAFETY: the caller's promise.
            unsafe {
                lanes::store(to, values[0]);
                lanes::store(to.wrapping_add(second), values[1]);
            }
        }
    };
}
pub(super) use dense_products;
