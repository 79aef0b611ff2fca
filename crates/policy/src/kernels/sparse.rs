//! Products that leave out what a ReLU made zero.
//!
//! Behind a ReLU about half of the activations are zero, and of the gradients that come back through it two thirds. A
//! dense product multiplies them all the same. Here the values of a row that are not zero are first listed with their
//! places; then each of them is broadcast and multiplied by 64 values of the other operand, which stay in the first-level
//! cache. That reads an operand of the multiply-add from memory each time, where the dense tiles of
//! [`rows`](super::rows) keep it in a register for 14 rows, so it pays where the share of values that are not zero is below
//! `DENSE`; above it the dense product is used.
//!
//! # The same bits
//!
//! Sums are made in the order of the dense products, and a term that is left out would have added a zero to a sum that is
//! no negative zero. So which of the two is used changes no bit of a finite result (test
//! `products_that_leave_out_zeros_have_the_bits_of_those_that_do_not`). Plain Rust has no such product and uses the dense one
//! always.
//!
//! # Shapes
//!
//! A *span* is 64 features, or outputs: four blocks of 16.

use super::Isa;
use super::blocked::BLOCK;
use super::isa::Level;
use super::rows::{Finish, Grid, PANEL, Start};

/// Features that a listed value is multiplied by, and features of a list: four registers of AVX-512, eight of AVX2.
pub(super) const SPAN: usize = 64;
/// Blocks of a span.
pub(super) const QUARTERS: usize = SPAN / BLOCK;
/// Above this share of values that are not zero the dense product is faster. Measured at 4096 × 256 on a processor with one
/// 512-bit multiply-add a cycle: 1.4 to 2 times faster at a share of 0.3, 1.1 to 1.3 at 0.5, even at 0.6 to 0.7.
const DENSE: f64 = 0.6;
/// Which part of the spans is counted to know the share.
const SAMPLED: usize = 8;
/// Fewer rows than this are bound by reading the weights, not by arithmetic.
const ROWS_MIN: usize = 16;

/// Whether products may leave out zeros: the processor has the instructions, and there are enough rows.
pub(super) fn is_worth_a_look(isa: Isa, rows: usize) -> bool {
    is_available(isa) && rows >= ROWS_MIN
}

/// Whether so few values of a chunk in blocks are not zero that leaving out the others pays, going by one span in
/// `SAMPLED` of all.
pub(super) fn are_few_in(rows: usize, spans: usize, x: &[f32], block_stride: usize) -> bool {
    let (mut kept, mut seen) = (0, 0);
    for block in (0..spans).step_by(SAMPLED).flat_map(|span| span * QUARTERS..(span + 1) * QUARTERS) {
        let values = &x[block * block_stride..][..rows * BLOCK];
        kept += values.iter().filter(|value| **value != 0.0).count();
        seen += values.len();
    }
    pays(kept, seen)
}

/// Whether leaving out zeros is faster where so many of the values seen are kept.
fn pays(kept: usize, seen: usize) -> bool {
    (kept as f64) < DENSE * seen as f64
}

#[cfg(target_arch = "x86_64")]
fn is_available(isa: Isa) -> bool {
    matches!(isa.0, Level::Avx512 | Level::Avx2)
}

#[cfg(not(target_arch = "x86_64"))]
fn is_available(_: Isa) -> bool {
    false
}

/// Whether lists are worked off two at a time.
fn works_in_pairs(isa: Isa) -> bool {
    isa.0 == Level::Avx512
}

/// Lists of the values that are not zero, each with where its partner starts in the other operand.
///
/// For AVX-512, lists 2·i and 2·i + 1 are a pair, worked off together: the shorter one is filled up with zeros. The memory
/// grows to the largest use and stays.
#[derive(Debug, Clone, Default)]
pub struct Nonzeros {
    offsets: Vec<u32>,
    values: Vec<f32>,
    lengths: Vec<u32>,
    /// Which column of its block a list is of.
    columns: Vec<u8>,
    /// Room of one list: for all values of its row or column.
    room: usize,
    /// The largest offset that a list may hold.
    farthest: usize,
}

/// One list.
#[derive(Debug, Clone, Copy)]
pub(super) struct List<'a> {
    pub(super) offsets: &'a [u32],
    pub(super) values: &'a [f32],
}

impl Nonzeros {
    fn clear(&mut self, lists: usize, longest: usize) {
        // Registers are stored whole, but what was listed before leaves room for all that may still come.
        self.room = longest;
        let len = lists * self.room;
        if self.values.len() < len {
            self.values.resize(len, 0.0);
            self.offsets.resize(len, 0);
        }
        self.lengths.clear();
        self.lengths.resize(lists, 0);
    }

    pub(super) fn list(&self, list: usize) -> List<'_> {
        let range = list * self.room..list * self.room + self.lengths[list] as usize;
        List { offsets: &self.offsets[range.clone()], values: &self.values[range] }
    }

    /// Whether so few values are not zero that leaving out the others pays.
    pub(super) fn are_few(&self) -> bool {
        let kept = self.lengths.iter().map(|len| *len as usize).sum();
        pays(kept, self.lengths.len() * self.room)
    }

    /// Fills the shorter of two lists up.
    fn even_out(&mut self, list: usize, other: usize) {
        let len = self.lengths[list].max(self.lengths[other]);
        for list in [list, other] {
            let range = list * self.room + self.lengths[list] as usize..list * self.room + len as usize;
            self.values[range.clone()].fill(0.0);
            self.offsets[range].fill(0);
            self.lengths[list] = len;
        }
    }

    /// One list for each span and row of a chunk in blocks: list `span · rows + row`. A value's partner is the row of a
    /// panel (32 values) with its number in the span.
    pub(super) fn of_rows(&mut self, isa: Isa, rows: usize, spans: usize, x: &[f32], block_stride: usize) {
        self.clear(spans * rows, SPAN);
        self.farthest = (SPAN - 1) * PANEL;
        let needed = (spans * QUARTERS - 1) * block_stride + rows * BLOCK;
        assert!(x.len() >= needed, "activations: {} < {needed}", x.len());
        for list in 0..spans * rows {
            let (span, row) = (list / rows, list % rows);
            let x = &x[span * QUARTERS * block_stride + row * BLOCK..];
            let range = list * self.room..(list + 1) * self.room;
            let (offsets, values) = (&mut self.offsets[range.clone()], &mut self.values[range]);
            self.lengths[list] = match isa.0 {
                // SAFETY: an `Isa` exists only where the processor has it; a list has room for a span,
                // and the length of `x` is checked above.
                #[cfg(target_arch = "x86_64")]
                Level::Avx512 => unsafe { super::avx512_sparse::list(x, block_stride, offsets, values) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Level::Avx2 => unsafe { super::avx2_sparse::list(x, block_stride, offsets, values) },
                _ => unreachable!("callers ask whether this is available"),
            };
            if row % 2 == 1 && works_in_pairs(isa) {
                self.even_out(list - 1, list);
            }
        }
    }

    /// One list for each output and chunk of output gradients in blocks. A value's partner is its row of the chunk.
    ///
    /// Lists `chunk · outputs + block · 16 ..` are those of a block. Where lists are worked off in pairs they are in the order
    /// of their lengths, shorter ones first: some outputs pass a gradient for every row and some for none, and in trained
    /// networks pairs of neighbours would be filled up by more than half. [`Self::column`] says which output it is.
    pub(super) fn of_columns(
        &mut self,
        isa: Isa,
        outputs: usize,
        dy: &[f32],
        rows: Rows,
        block_stride: usize,
    ) {
        self.clear(rows.chunks * outputs, rows.of_each);
        self.columns.resize(rows.chunks * outputs, 0);
        self.farthest = (rows.of_each - 1) * BLOCK;
        for first in (0..rows.chunks * outputs).step_by(BLOCK) {
            let (chunk, output) = (first / outputs, first % outputs);
            let dy = &dy[chunk * rows.dy_chunk + output / BLOCK * block_stride..][..rows.of_each * BLOCK];
            let (dy, _) = dy.as_chunks::<BLOCK>();
            let mut lengths = [0; BLOCK];
            for dy in dy {
                lengths.iter_mut().zip(dy).for_each(|(len, value)| *len += u32::from(*value != 0.0));
            }
            let mut order: [usize; BLOCK] = std::array::from_fn(|column| column);
            if works_in_pairs(isa) {
                order.sort_unstable_by_key(|column| (lengths[*column], *column));
            }
            let mut at = [0; BLOCK];
            for (list, column) in (first..).zip(order) {
                at[column] = list * self.room;
                (self.lengths[list], self.columns[list]) = (lengths[column], column as u8);
            }
            for (row, dy) in dy.iter().enumerate() {
                for (at, value) in at.iter_mut().zip(dy) {
                    // Written in any case and kept if it counts: a branch on random values would cost more.
                    self.values[*at] = *value;
                    self.offsets[*at] = (row * BLOCK) as u32;
                    *at += usize::from(*value != 0.0);
                }
            }
            if works_in_pairs(isa) {
                (first..first + BLOCK).step_by(2).for_each(|list| self.even_out(list, list + 1));
            }
        }
    }

    /// Which output a list of columns is of, within its block of 16.
    pub(super) fn column(&self, list: usize) -> usize {
        usize::from(self.columns[list])
    }
}

/// Rows of several chunks of one size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows {
    pub(super) chunks: usize,
    pub(super) of_each: usize,
    /// Distance between two chunks of output gradients.
    pub(super) dy_chunk: usize,
    /// Distance between two chunks of inputs.
    pub(super) x_chunk: usize,
}

/// `out[row, 0..64] = finish(start + Σ value · panels[offset, 0..64])` for the lists `first_list ..` of the rows.
///
/// `panels` are two panels of 32 columns with a row for each feature of the span. Four blocks of `out` (and of a mask)
/// lie `half` apart.
///
/// # Panics
///
/// If an operand is too short for its shape.
#[allow(clippy::too_many_arguments)] // The operands of one product.
pub(super) fn rows_times_span(
    isa: Isa,
    rows: usize,
    nonzeros: &Nonzeros,
    first_list: usize,
    panels: [&[f32]; 2],
    next: [&[f32]; 2],
    start: Start<'_>,
    finish: Finish<'_>,
    mut out: Grid<&mut [f32]>,
) {
    let needed = nonzeros.farthest + PANEL;
    assert!(panels.iter().all(|panel| panel.len() >= needed), "a panel is shorter than {needed}");
    let needed = |row: usize, quarter: usize| (rows - 1) * row + (QUARTERS - 1) * quarter + BLOCK;
    assert!(rows > 0 && out.data.len() >= needed(out.row, out.half), "output too short: {}", out.data.len());
    if let Start::Bias(bias) = start {
        assert!(bias.len() >= SPAN, "bias too short: {}", bias.len());
    }
    if let Finish::Mask(mask) = finish {
        assert!(mask.data.len() >= needed(mask.row, mask.half), "mask too short: {}", mask.data.len());
    }
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it; lengths are checked above, and no offset is beyond
        // `farthest`.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe {
            super::avx512_sparse::rows(rows, nonzeros, first_list, panels, next, start, finish, &mut out);
        },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe {
            super::avx2_sparse::rows(rows, nonzeros, first_list, panels, next, start, finish, &mut out);
        },
        _ => {
            let _ = (nonzeros, first_list, next, out);
            unreachable!("callers ask whether this is available")
        }
    }
}

/// A span of inputs of a weight gradient: `gradient[output panel][input][32] (+)= Σ_row x[row, input] · dy[row, output]`,
/// where `columns` are of these rows and outputs.
///
/// `x` starts at the span's first block; `gradient` at the span's first input, panels lying `panel_stride` apart.
///
/// # Panics
///
/// If an operand is too short for its shape.
pub(super) fn span_gradient(
    isa: Isa,
    columns: &Nonzeros,
    rows: Rows,
    x: &[f32],
    block_stride: usize,
    accumulate: bool,
    mut gradient: Panels<'_>,
) {
    let outputs = columns.lengths.len() / rows.chunks;
    let needed = (rows.chunks - 1) * rows.x_chunk + columns.farthest + (QUARTERS - 1) * block_stride + BLOCK;
    assert!(x.len() >= needed, "inputs: {} < {needed}", x.len());
    assert!(outputs.is_multiple_of(SPAN), "{outputs} outputs");
    let needed = (outputs / PANEL - 1) * gradient.stride + SPAN * PANEL;
    assert!(gradient.data.len() >= needed, "gradient: {} < {needed}", gradient.data.len());
    match isa.0 {
        // SAFETY: an `Isa` exists only where the processor has it; lengths are checked above, and no offset is beyond
        // `farthest`.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe {
            super::avx512_sparse::gradient(
                columns,
                rows,
                outputs,
                x,
                block_stride,
                accumulate,
                &mut gradient,
            );
        },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe {
            super::avx2_sparse::gradient(columns, rows, outputs, x, block_stride, accumulate, &mut gradient);
        },
        _ => {
            let _ = accumulate;
            unreachable!("callers ask whether this is available")
        }
    }
}

/// Panels of 32 outputs.
#[derive(Debug)]
pub(super) struct Panels<'a> {
    pub(super) data: &'a mut [f32],
    /// Distance between two panels.
    pub(super) stride: usize,
}

#[cfg(test)]
mod tests {
    use super::super::tests::values;
    use super::super::{Chunks, Forward, HALF, Linear};
    use super::*;

    /// Irregular values of which about `share` are positive and the others zero, as behind a ReLU.
    fn behind_relu(len: usize, share: f32, seed: u32) -> Vec<f32> {
        let keep = values(len, seed + 100);
        values(len, seed)
            .iter()
            .zip(keep)
            .map(|(x, k)| if k < 2.0 * share - 1.0 { x.abs() } else { 0.0 })
            .collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    fn check(isa: Isa, layer: Linear, batch: usize, share: f32) {
        let chunks = Chunks::new(batch);
        let weights = values(layer.weights(), 1);
        let bias = values(layer.outputs(), 2);
        let x = behind_relu(chunks.len(layer.inputs()), share, 3);
        let dy = behind_relu(chunks.len(layer.outputs()), share, 4);
        let name = format!("{layer:?}, {batch} rows, {share}");

        let mut transposed = vec![0.0; layer.transposed_len()];
        layer.transpose(isa, &weights, &mut transposed);
        let (mut nonzeros, mut columns) = (Nonzeros::default(), Vec::new());
        for chunk in 0..chunks.count {
            let rows = chunks.rows(chunk);
            let part = |data, features| -> &[f32] {
                let (data, len): (&[f32], _) = (data, chunks.chunk_len(features));
                &data[chunk * len..(chunk + 1) * len]
            };
            let (x, dy) = (part(&x, layer.inputs()), part(&dy, layer.outputs()));
            let mut expected = vec![0.0; chunks.chunk_len(layer.outputs())];
            let mut found = expected.clone();
            layer.forward(isa, &weights, &bias, Forward::new(&chunks, chunk, x, &mut expected, true));
            let forward = Forward::new(&chunks, chunk, x, &mut found, true);
            layer.forward_behind_relu(isa, &weights, &bias, forward, &mut nonzeros);
            assert_eq!(bits(&found), bits(&expected), "{name}: forward");

            let row = layer.inputs() + 32;
            let mut expected = vec![0.5; rows * row];
            let mut found = expected.clone();
            let stride = chunks.block_stride();
            for panel in 0..layer.transposed_panels() {
                let mask = Grid { data: &x[panel * 2 * stride..], row: BLOCK, half: stride };
                let dx = Grid { data: &mut expected[panel * PANEL..], row, half: HALF };
                layer.input_gradient(isa, &transposed, panel, &chunks, rows, dy, Finish::Mask(mask), dx);
            }
            let dx = &mut found[..];
            layer.input_gradient_between_relus(
                isa,
                &transposed,
                &chunks,
                rows,
                dy,
                x,
                dx,
                row,
                &mut nonzeros,
            );
            assert_eq!(bits(&found), bits(&expected), "{name}: input gradient");
        }
        let mut expected = vec![0.0; layer.weights()];
        let mut found = values(layer.weights(), 5);
        layer.weight_gradient(isa, &chunks, &x, &dy, &mut expected);
        layer.weight_gradient_behind_relu(isa, &chunks, &x, &dy, &mut found, &mut columns);
        assert_eq!(bits(&found), bits(&expected), "{name}: weight gradient");
    }

    #[test]
    fn products_that_leave_out_zeros_have_the_bits_of_those_that_do_not() {
        for isa in Isa::available() {
            for layer in
                [Linear::new(64, 64), Linear::new(320, 128), Linear::new(576, 64), Linear::new(96, 64)]
            {
                for batch in [1, 15, 16, 29, 67, 200, 640] {
                    for share in [0.0, 0.1, 0.6, 1.0] {
                        check(isa, layer, batch, share);
                    }
                }
            }
        }
    }

    #[test]
    fn lists_hold_what_is_not_zero_in_its_order() {
        Isa::available().into_iter().filter(|isa| is_available(*isa)).for_each(check_lists);
    }

    fn check_lists(isa: Isa) {
        let chunks = Chunks::new(20);
        let stride = chunks.block_stride();
        let x = behind_relu(chunks.len(2 * SPAN), 0.4, 6);
        let mut nonzeros = Nonzeros::default();
        nonzeros.of_rows(isa, 20, 2, &x, stride);
        for (span, row) in (0..2).flat_map(|span| (0..20).map(move |row| (span, row))) {
            let at = |feature: usize| {
                x[(span * QUARTERS + feature / BLOCK) * stride + row * BLOCK + feature % BLOCK]
            };
            let expected: Vec<(u32, f32)> = (0..SPAN)
                .filter(|feature| at(*feature) != 0.0)
                .map(|feature| ((feature * PANEL) as u32, at(feature)))
                .collect();
            let list = nonzeros.list(span * 20 + row);
            let found: Vec<(u32, f32)> =
                list.offsets.iter().copied().zip(list.values.iter().copied()).collect();
            let (kept, filled) = found.split_at(expected.len());
            assert_eq!(kept, expected, "span {span}, row {row}");
            assert!(filled.iter().all(|(_, value)| *value == 0.0), "span {span}, row {row}: {filled:?}");
        }
        assert!(nonzeros.are_few());
    }

    #[test]
    fn columns_are_listed_once_each_and_paired_by_length() {
        Isa::available().into_iter().filter(|isa| is_available(*isa)).for_each(check_columns);
    }

    fn check_columns(isa: Isa) {
        let chunks = Chunks::new(80);
        let (stride, outputs) = (chunks.block_stride(), 2 * SPAN);
        let dy_chunk = chunks.chunk_len(outputs);
        let mut dy = vec![0.0; chunks.len(outputs)];
        let at = |chunk: usize, row: usize, output: usize| {
            chunk * dy_chunk + output / BLOCK * stride + row * BLOCK + output % BLOCK
        };
        // Some outputs are active for every row, some for none, neighbours at odds.
        for (chunk, row, output) in (0..2)
            .flat_map(|chunk| (0..chunks.size).map(move |row| (chunk, row)))
            .flat_map(|(chunk, row)| (0..outputs).map(move |output| (chunk, row, output)))
        {
            let active = (row * 7 + output) % 11 < output * 5 % 12;
            dy[at(chunk, row, output)] = if active { (row + 1) as f32 } else { 0.0 };
        }
        let rows = Rows { chunks: 2, of_each: chunks.size, dy_chunk, x_chunk: 0 };
        let mut nonzeros = Nonzeros::default();
        nonzeros.of_columns(isa, outputs, &dy, rows, stride);
        let kept = |list: usize| nonzeros.list(list).values.iter().filter(|value| **value != 0.0).count();
        let mut listed = vec![0; 2 * outputs];
        for list in 0..2 * outputs {
            let (chunk, output) = (list / outputs, list % outputs / BLOCK * BLOCK + nonzeros.column(list));
            listed[chunk * outputs + output] += 1;
            let expected: Vec<(u32, f32)> = (0..chunks.size)
                .map(|row| ((row * BLOCK) as u32, dy[at(chunk, row, output)]))
                .filter(|(_, value)| *value != 0.0)
                .collect();
            let List { offsets, values } = nonzeros.list(list);
            let found: Vec<(u32, f32)> = offsets.iter().copied().zip(values.iter().copied()).collect();
            let (listed, filled) = found.split_at(expected.len());
            assert_eq!(listed, expected, "chunk {chunk}, output {output}");
            assert!(filled.iter().all(|(_, value)| *value == 0.0), "chunk {chunk}, output {output}");
            if works_in_pairs(isa) {
                assert_eq!(nonzeros.list(list ^ 1).values.len(), values.len(), "pair of list {list}");
                assert!(list % BLOCK == 0 || kept(list - 1) <= kept(list), "list {list} is shorter");
            }
        }
        assert!(listed.iter().all(|count| *count == 1), "{listed:?}");
        assert!(nonzeros.are_few());
    }
}
