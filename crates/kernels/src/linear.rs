//! Linear layers on blocked activations: forward, input gradient, weight gradient.
//!
//! # Shapes
//!
//! y [B, outputs] = x [B, inputs] · W + b. The weights are kept `[inputs, outputs]`, in groups of
//! 256 inputs and panels of 32 outputs:
//!
//! ```text
//! [inputs / 256][outputs / 32][256 inputs of the group][32 outputs of the panel]
//! ```
//!
//! so that the forward product reads them as one stream, a part of 32 KB (one group, one panel)
//! stays in the first-level cache for all rows of a chunk, and a weight gradient is computed group
//! by group into memory that lies together. Because the optimiser works element by element it does
//! not care; nothing is packed for the forward pass. The input gradient wants the transpose, which
//! [`Linear::transpose`] makes once per step of the optimiser.

use crate::blocked::{BLOCK, Chunks};
use crate::dense::{outer_products, rows_times_panel};
use crate::dispatch::Isa;
use crate::operands::{Count, Finish, Grid, HALF, PANEL, Start, Steps, Strips};
use crate::pieces::for_each_piece;
use crate::sparse::{self, After, QUARTERS, SPAN, SpanGradient, SpanProduct, rows_times_span, span_gradient};

/// Inputs of a group.
const GROUP: usize = 256;

/// The shape of a linear layer whose number of outputs is a multiple of 32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear {
    inputs: usize,
    outputs: usize,
}

impl Linear {
    /// A layer of this shape.
    ///
    /// # Panics
    ///
    /// If a size is 0 or `outputs` is not a multiple of 32 (pad it: see [`Head`](crate::Head)).
    pub fn new(inputs: usize, outputs: usize) -> Self {
        assert!(inputs > 0 && outputs > 0, "a layer of {inputs} inputs and {outputs} outputs");
        assert!(outputs.is_multiple_of(PANEL), "{outputs} outputs are no multiple of {PANEL}");
        Self { inputs, outputs }
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Number of weights.
    pub fn weights(&self) -> usize {
        self.inputs * self.outputs
    }

    /// Number of groups of inputs.
    fn groups(&self) -> usize {
        self.inputs.div_ceil(GROUP)
    }

    /// Index of the weight from an input to an output.
    pub fn index(&self, input: usize, output: usize) -> usize {
        let group = input / GROUP;
        let group_len = GROUP.min(self.inputs - group * GROUP);
        let panel = output / PANEL;
        group * GROUP * self.outputs
            + panel * group_len * PANEL
            + (input - group * GROUP) * PANEL
            + output % PANEL
    }

    /// Forward pass of one chunk: `y = x·W + b`, then a ReLU if asked for.
    pub fn forward(&self, isa: Isa, weights: &[f32], bias: &[f32], chunk: Forward<'_>) {
        let Forward { chunks, rows, x, y, relu } = chunk;
        let stride = chunks.block_stride();
        for (group, weights) in weights[..self.weights()].chunks(GROUP * self.outputs).enumerate() {
            let inputs = weights.len() / self.outputs;
            let x = &x[group * (GROUP / BLOCK) * stride..];
            let last_group = (group + 1) * GROUP >= self.inputs;
            for (panel, weights) in weights.chunks_exact(inputs * PANEL).enumerate() {
                let start = if group == 0 { Start::Bias(&bias[panel * PANEL..]) } else { Start::Accumulate };
                let finish = if relu && last_group { Finish::Relu } else { Finish::Store };
                let y = &mut y[panel * 2 * stride..];
                Self::forward_panel(isa, rows, stride, x, weights, start, finish, y);
            }
        }
    }

    /// `true` if the products behind a ReLU may leave out zeros and need masks for it: both sides
    /// are made of whole spans of 64, and a chunk has enough rows, of which there are `rows`.
    pub fn may_leave_out_zeros(&self, rows: usize) -> bool {
        self.inputs.is_multiple_of(SPAN) && self.outputs.is_multiple_of(SPAN) && sparse::is_worth_a_look(rows)
    }

    /// Masks of a row of inputs: one for each 64.
    pub fn spans(&self) -> usize {
        self.inputs / SPAN
    }

    /// Sets a bit for each input of one row of a chunk that is not zero: bit i of mask
    /// `span · step` is input i of the span.
    ///
    /// `x` and `masks` start at the row; masks of a chunk are `[span][row]` with room for as many
    /// rows as a chunk has.
    ///
    /// # Panics
    ///
    /// If an operand is too short.
    pub fn mask_row(&self, isa: Isa, x: &[f32], block_stride: usize, masks: &mut [u64], step: usize) {
        sparse::mask_row(isa, self.spans(), x, block_stride, masks, step);
    }

    /// [`mask_row`](Self::mask_row) for all rows of a chunk, if zeros may be left out.
    ///
    /// # Panics
    ///
    /// If an operand is too short.
    pub fn mask_chunk(&self, isa: Isa, chunks: &Chunks, rows: usize, x: &[f32], masks: &mut [u64]) {
        if !self.may_leave_out_zeros(rows) {
            return;
        }
        for row in 0..rows {
            let (x, masks) = (&x[row * BLOCK..], &mut masks[row..]);
            self.mask_row(isa, x, chunks.block_stride(), masks, chunks.size);
        }
    }

    /// `true` if so few inputs of a chunk are not zero that leaving out the others pays; `masks`
    /// are by [`mask_row`](Self::mask_row), where zeros may be left out.
    pub fn inputs_are_few(&self, chunks: &Chunks, rows: usize, masks: &[u64]) -> bool {
        let of_span = |span: usize| &masks[span * chunks.size..][..rows];
        self.may_leave_out_zeros(rows) && sparse::are_few((0..self.spans()).map(of_span), rows * self.inputs)
    }

    /// [`forward`](Self::forward) for inputs that come out of a ReLU: zeros are left out where that
    /// is faster. The bits are the same.
    ///
    /// `masks` are the chunk's by [`mask_row`](Self::mask_row), where zeros may be left out.
    pub fn forward_behind_relu(
        &self,
        isa: Isa,
        weights: &[f32],
        bias: &[f32],
        chunk: Forward<'_>,
        masks: &[u64],
    ) {
        if !self.inputs_are_few(chunk.chunks, chunk.rows, masks) {
            return self.forward(isa, weights, bias, chunk);
        }
        let (n_spans, n_pairs) = (self.spans(), self.outputs / SPAN);
        let Forward { chunks, rows, x, y, relu } = chunk;
        let stride = chunks.block_stride();
        let panel =
            |span: usize, panel: usize| &weights[self.index(span * SPAN, panel * PANEL)..][..SPAN * PANEL];
        let panels = |product: usize| {
            let (span, pair) = (product / n_pairs, product % n_pairs);
            [panel(span, 2 * pair), panel(span, 2 * pair + 1)]
        };
        for product in 0..n_spans * n_pairs {
            let (span, pair) = (product / n_pairs, product % n_pairs);
            let product = SpanProduct {
                x: &x[span * QUARTERS * stride..],
                block_stride: stride,
                masks: &masks[span * chunks.size..][..rows],
                panels: panels(product),
                next: panels((product + 1).min(n_spans * n_pairs - 1)),
                start: if span == 0 { Start::Bias(&bias[pair * SPAN..]) } else { Start::Accumulate },
                after: if relu && span + 1 == n_spans { After::Relu } else { After::Store },
                out: Grid { data: &mut y[pair * QUARTERS * stride..], row: BLOCK, half: stride },
            };
            rows_times_span(isa, product);
        }
    }

    /// One panel of one group: the whole blocks, then what is left of the inputs.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    fn forward_panel(
        isa: Isa,
        rows: usize,
        stride: usize,
        x: &[f32],
        weights: &[f32],
        start: Start<'_>,
        finish: Finish<'_>,
        y: &mut [f32],
    ) {
        let inputs = weights.len() / PANEL;
        let (blocks, rest) = (inputs / BLOCK, inputs % BLOCK);
        let mut product = |from: usize, blocks, block_len, start, finish| {
            let a = Strips { data: &x[from / BLOCK * stride..], blocks, block_len, block_stride: stride };
            let out = Grid { data: &mut *y, row: BLOCK, half: stride };
            rows_times_panel::<BLOCK>(isa, rows, a, &weights[from * PANEL..], start, finish, out);
        };
        match (blocks, rest) {
            (_, 0) => product(0, blocks, BLOCK, start, finish),
            (0, _) => product(0, 1, rest, start, finish),
            _ => {
                product(0, blocks, BLOCK, start, Finish::Store);
                product(blocks * BLOCK, 1, rest, Start::Accumulate, finish);
            }
        }
    }

    /// Panels of the transpose: the inputs in panels of 32, the last padded with zeros.
    pub fn transposed_panels(&self) -> usize {
        self.inputs.div_ceil(PANEL)
    }

    /// Length of the transpose.
    pub fn transposed_len(&self) -> usize {
        self.transposed_panels() * PANEL * self.outputs
    }

    /// Writes the transpose, `[inputs / 32][outputs][32 inputs of the panel]`.
    pub fn transpose(&self, isa: Isa, weights: &[f32], transposed: &mut [f32]) {
        let transposed = &mut transposed[..self.transposed_len()];
        let (weights, group_len) = (&weights[..self.weights()], GROUP * self.outputs);
        for_each_piece(self.groups(), [(transposed, group_len)], &|group, [transposed]| {
            let weights = &weights[group * group_len..];
            let weights = &weights[..group_len.min(weights.len())];
            let inputs = weights.len() / self.outputs;
            for (q, transposed) in transposed.chunks_exact_mut(PANEL * self.outputs).enumerate() {
                let rows = PANEL.min(inputs - q * PANEL);
                for (p, to) in transposed.chunks_exact_mut(PANEL * PANEL).enumerate() {
                    let from = &weights[(p * inputs + q * PANEL) * PANEL..][..rows * PANEL];
                    crate::transpose::square(isa, from, to);
                }
            }
        });
    }

    /// Input gradient of one chunk and one panel of 32 inputs: `dx = dy · Wᵀ`, masked if asked for.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    pub fn input_gradient(
        &self,
        isa: Isa,
        transposed: &[f32],
        panel: usize,
        chunks: &Chunks,
        rows: usize,
        dy: &[f32],
        finish: Finish<'_>,
        dx: Grid<&mut [f32]>,
    ) {
        let a = Strips {
            data: dy,
            blocks: self.outputs / BLOCK,
            block_len: BLOCK,
            block_stride: chunks.block_stride(),
        };
        let weights = &transposed[panel * PANEL * self.outputs..][..PANEL * self.outputs];
        rows_times_panel::<BLOCK>(isa, rows, a, weights, Start::Zero, finish, dx);
    }

    /// Input gradient of one chunk where both sides of the layer are behind a ReLU: `dx = dy · Wᵀ`
    /// where `x` is positive, else 0, as rows `dx_row` apart. Zeros of `dy` are left out where that
    /// is faster; the bits are the same.
    ///
    /// `masks` are those of `x`, as in the forward pass: what comes out of a ReLU is positive where
    /// it is not zero. Those of `dy` are made in `dy_masks`.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    pub fn input_gradient_between_relus(
        &self,
        isa: Isa,
        transposed: &[f32],
        chunks: &Chunks,
        rows: usize,
        dy: &[f32],
        x: &[f32],
        masks: &[u64],
        dx: &mut [f32],
        dx_row: usize,
        dy_masks: &mut Vec<u64>,
    ) {
        let stride = chunks.block_stride();
        let spans = self.outputs / SPAN;
        let mut leave_out = self.may_leave_out_zeros(rows);
        if leave_out {
            dy_masks.clear();
            dy_masks.resize(spans * rows, 0);
            for row in 0..rows {
                sparse::mask_row(isa, spans, &dy[row * BLOCK..], stride, &mut dy_masks[row..], rows);
            }
            leave_out = sparse::are_few([&dy_masks[..]].into_iter(), rows * self.outputs);
        }
        if !leave_out {
            for panel in 0..self.transposed_panels() {
                let mask = Grid { data: &x[panel * 2 * stride..], row: BLOCK, half: stride };
                let dx = Grid { data: &mut dx[panel * PANEL..], row: dx_row, half: HALF };
                self.input_gradient(isa, transposed, panel, chunks, rows, dy, Finish::Mask(mask), dx);
            }
            return;
        }
        let n_products = self.spans() * spans;
        let panels = |product: usize| {
            let (pair, span) = (product / spans, product % spans);
            [2 * pair, 2 * pair + 1]
                .map(|panel| &transposed[(panel * self.outputs + span * SPAN) * PANEL..][..SPAN * PANEL])
        };
        for product in 0..n_products {
            let (pair, span) = (product / spans, product % spans);
            let kept = &masks[pair * chunks.size..][..rows];
            let product = SpanProduct {
                x: &dy[span * QUARTERS * stride..],
                block_stride: stride,
                masks: &dy_masks[span * rows..][..rows],
                panels: panels(product),
                next: panels((product + 1).min(n_products - 1)),
                start: if span == 0 { Start::Zero } else { Start::Accumulate },
                after: if span + 1 == spans { After::Keep(kept) } else { After::Store },
                out: Grid { data: &mut dx[pair * SPAN..], row: dx_row, half: HALF },
            };
            rows_times_span(isa, product);
        }
    }

    /// [`weight_gradient`](Self::weight_gradient) for output gradients behind a ReLU: zeros of `dy`
    /// are left out where that is faster; the bits are the same. `columns` is memory for masks.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    pub fn weight_gradient_behind_relu(
        &self,
        isa: Isa,
        chunks: &Chunks,
        x: &[f32],
        dy: &[f32],
        gradient: &mut [f32],
        columns: &mut Vec<u64>,
    ) {
        if !self.outputs.is_multiple_of(SPAN) || !sparse::is_worth_a_look(chunks.batch) {
            return self.weight_gradient(isa, chunks, x, dy, gradient);
        }
        sparse::mask_columns(isa, chunks, self.outputs, dy, columns);
        if !sparse::are_few([&columns[..]].into_iter(), chunks.batch * self.outputs) {
            return self.weight_gradient(isa, chunks, x, dy, gradient);
        }
        let (columns, gradient) = (&columns[..], &mut gradient[..self.weights()]);
        for_each_piece(self.groups(), [(gradient, GROUP * self.outputs)], &|group, [gradient]| {
            let inputs = gradient.len() / self.outputs;
            let x = &x[group * (GROUP / BLOCK) * chunks.block_stride()..];
            for span in 0..inputs / SPAN {
                let product = SpanGradient {
                    chunks,
                    outputs: self.outputs,
                    dy,
                    columns,
                    x: &x[span * QUARTERS * chunks.block_stride()..],
                    x_chunk: chunks.chunk_len(self.inputs),
                    gradient: &mut gradient[span * SPAN * PANEL..],
                    panel_stride: inputs * PANEL,
                };
                span_gradient(isa, product);
            }
            self.group_gradient(isa, chunks, x, dy, inputs / SPAN * QUARTERS, gradient);
        });
    }

    /// Weight gradient of the whole batch: `dW = xᵀ · dy`, in the order of the weights,
    /// overwritten.
    ///
    /// Work is divided by groups of inputs; the sum over the batch is in one order for each weight.
    pub fn weight_gradient(&self, isa: Isa, chunks: &Chunks, x: &[f32], dy: &[f32], gradient: &mut [f32]) {
        let gradient = &mut gradient[..self.weights()];
        for_each_piece(self.groups(), [(gradient, GROUP * self.outputs)], &|group, [gradient]| {
            let x = &x[group * (GROUP / BLOCK) * chunks.block_stride()..];
            self.group_gradient(isa, chunks, x, dy, 0, gradient);
        });
    }

    /// The weight gradient of one group from the block `first_block` on; `x` starts at the group's
    /// first block.
    fn group_gradient(
        &self,
        isa: Isa,
        chunks: &Chunks,
        x: &[f32],
        dy: &[f32],
        first_block: usize,
        gradient: &mut [f32],
    ) {
        let inputs = gradient.len() / self.outputs;
        let stride = chunks.block_stride();
        let (x_chunk, dy_chunk) = (chunks.chunk_len(self.inputs), chunks.chunk_len(self.outputs));
        for block in first_block..inputs.div_ceil(BLOCK) {
            let rows = BLOCK.min(inputs - block * BLOCK);
            for (first, count) in chunk_runs(chunks) {
                let a = Steps {
                    data: &x[first * x_chunk + block * stride..],
                    step: BLOCK,
                    segment: x_chunk,
                    half: 0,
                };
                for panel in 0..self.outputs / PANEL {
                    let b = Steps {
                        data: &dy[first * dy_chunk + panel * 2 * stride..],
                        step: BLOCK,
                        segment: dy_chunk,
                        half: stride,
                    };
                    let out = &mut gradient[(panel * inputs + block * BLOCK) * PANEL..][..rows * PANEL];
                    outer_products(isa, rows, count, a, b, first > 0, out);
                }
            }
        }
    }
}

/// One chunk of a forward pass.
#[derive(Debug)]
pub struct Forward<'a> {
    /// The division of the batch.
    pub chunks: &'a Chunks,
    /// Rows of this chunk.
    pub rows: usize,
    /// The chunk's inputs, blocked.
    pub x: &'a [f32],
    /// The chunk's outputs, blocked, overwritten.
    pub y: &'a mut [f32],
    /// `true` if a ReLU follows.
    pub relu: bool,
}

impl<'a> Forward<'a> {
    /// The operands of the chunk number `chunk`.
    pub fn new(chunks: &'a Chunks, chunk: usize, x: &'a [f32], y: &'a mut [f32], relu: bool) -> Self {
        Self { chunks, rows: chunks.rows(chunk), x, y, relu }
    }
}

/// The chunks in runs of equal rows, at most three in one: (first chunk, segments and steps).
fn chunk_runs(chunks: &Chunks) -> impl Iterator<Item = (usize, Count)> {
    (0..chunks.count).filter(|chunk| chunks.begins_run(*chunk)).map(|first| {
        let others = (first + 1..chunks.count).take_while(|chunk| !chunks.begins_run(*chunk));
        (first, Count { segments: 1 + others.count(), steps: chunks.rows(first) })
    })
}
