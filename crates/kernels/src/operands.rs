//! The operands of the dense products: where their values are in memory.
//!
//! Every product has an output of 32 columns, a *panel*, whose two halves may be apart.

/// Columns of a panel: two registers of 16 floats.
pub const PANEL: usize = 32;
/// Floats in a half of a panel: one register.
pub const HALF: usize = 16;

/// The left operand of [`rows_times_panel`](crate::rows_times_panel): rows whose elements are
/// broadcast.
#[derive(Debug, Clone, Copy)]
pub struct Strips<'a> {
    /// Element (m, block, i) is at `m·ROW + block·block_stride + i`.
    pub data: &'a [f32],
    /// Number of blocks of a row.
    pub blocks: usize,
    /// Elements of a block, side by side.
    pub block_len: usize,
    /// Distance between two blocks of a row.
    pub block_stride: usize,
}

/// The value that a sum starts from.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    /// Zero.
    Zero,
    /// One value for each column.
    Bias(&'a [f32]),
    /// The value in the output.
    Accumulate,
}

/// The function of a finished sum that is stored.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a> {
    /// The sum itself.
    Store,
    /// max(sum, 0).
    Relu,
    /// The backward pass of a ReLU: the sum where the activation is positive, else 0. The
    /// activation is addressed like an output.
    Mask(Grid<&'a [f32]>),
}

/// Rows of 32 values in two halves: element (m, half, i) is at `m·row + half·half_stride + i`.
#[derive(Debug, Clone, Copy)]
pub struct Grid<T> {
    /// The values.
    pub data: T,
    /// Distance between two rows.
    pub row: usize,
    /// Distance between the two halves of a row.
    pub half: usize,
}

impl<T> Grid<T> {
    /// Smallest length that holds `rows` > 0 rows.
    pub(crate) fn needed(&self, rows: usize) -> usize {
        (rows - 1) * self.row + self.half + HALF
    }
}

/// One operand of [`outer_products`](crate::outer_products): the place of each step's values.
#[derive(Debug, Clone, Copy)]
pub struct Steps<'a> {
    /// The values.
    pub data: &'a [f32],
    /// Distance between two steps of a segment.
    pub step: usize,
    /// Distance between two segments.
    pub segment: usize,
    /// Distance between the two halves of a step (right operand only).
    pub half: usize,
}

/// The number of outer products that are summed.
#[derive(Debug, Clone, Copy)]
pub struct Count {
    /// Number of segments.
    pub segments: usize,
    /// Steps of each segment.
    pub steps: usize,
}

/// Offset of register `i` of a row that is stored in blocks of 16 floats, `block_stride` apart, for
/// registers of `lanes` floats.
#[inline]
pub(crate) const fn register_offset(i: usize, lanes: usize, block_stride: usize) -> usize {
    i * lanes / HALF * block_stride + i * lanes % HALF
}
