//! Linear layers on blocked activations: forward, input gradient, weight gradient.
//!
//! # Shapes
//!
//! y [B, outputs] = x [B, inputs] · W + b. The weights are kept `[inputs, outputs]`, in groups of 256 inputs and panels
//! of 32 outputs:
//!
//! ```text
//! [inputs / 256][outputs / 32][256 inputs of the group][32 outputs of the panel]
//! ```
//!
//! so that the forward product reads them as one stream, a part of 32 KB (one group, one panel) stays in the first-level
//! cache for all rows of a chunk, and a weight gradient is computed group by group into memory that lies together.
//! Because the optimiser works element by element it does not care; nothing is packed for the forward pass. The input
//! gradient wants the transpose, which [`Linear::transpose`] makes once per step of the optimiser.

use super::blocked::{BLOCK, Chunks};
use super::outer::{Count, Steps, outer_products};
use super::rows::{Finish, Grid, HALF, PANEL, Start, Strips, rows_times_panel};
use super::sparse::{self, Nonzeros, Panels, QUARTERS, Rows, SPAN, rows_times_span, span_gradient};
use super::{Isa, for_each_piece};

/// Inputs of a group.
const GROUP: usize = 256;
/// Chunks summed in registers by one weight-gradient tile: 192 rows, 12 KB of inputs and 24 KB of output gradients.
const CHUNKS_AT_ONCE: usize = 3;

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
    /// If a size is 0 or `outputs` is not a multiple of 32 (pad it: see [`Head`](super::Head)).
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

    /// Where the weight from an input to an output stands.
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

    /// [`forward`](Self::forward) for inputs that come out of a ReLU: zeros are left out where that is faster. The bits are
    /// the same.
    pub fn forward_behind_relu(
        &self,
        isa: Isa,
        weights: &[f32],
        bias: &[f32],
        chunk: Forward<'_>,
        nonzeros: &mut Nonzeros,
    ) {
        let (n_spans, n_pairs) = (self.inputs / SPAN, self.outputs / SPAN);
        let stride = chunk.chunks.block_stride();
        if !self.divides_into_spans()
            || !sparse::is_worth_a_look(isa, chunk.rows)
            || !sparse::are_few_in(chunk.rows, n_spans, chunk.x, stride)
        {
            return self.forward(isa, weights, bias, chunk);
        }
        let Forward { rows, x, y, relu, .. } = chunk;
        let panel =
            |span: usize, panel: usize| &weights[self.index(span * SPAN, panel * PANEL)..][..SPAN * PANEL];
        for span in 0..n_spans {
            let x = &x[span * QUARTERS * stride..];
            nonzeros.of_rows(isa, rows, 1, x, stride);
            let finish = if relu && span + 1 == n_spans { Finish::Relu } else { Finish::Store };
            let start = |at: usize| if span == 0 { Start::Bias(&bias[at..]) } else { Start::Accumulate };
            for pair in 0..n_pairs {
                let panels = |span, pair| [panel(span, 2 * pair), panel(span, 2 * pair + 1)];
                let behind = (span * n_pairs + pair + 1).min(n_spans * n_pairs - 1);
                let next = panels(behind / n_pairs, behind % n_pairs);
                let out = Grid { data: &mut y[pair * QUARTERS * stride..], row: BLOCK, half: stride };
                let start = start(pair * SPAN);
                rows_times_span(isa, rows, nonzeros, 0, panels(span, pair), next, start, finish, out);
            }
        }
    }

    /// Whether both sides are made of whole spans, no group of inputs cutting one.
    fn divides_into_spans(&self) -> bool {
        self.inputs.is_multiple_of(SPAN) && self.outputs.is_multiple_of(SPAN)
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
                    super::transpose::square(isa, from, to);
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

    /// Input gradient of one chunk where both sides of the layer are behind a ReLU: `dx = dy · Wᵀ` where `x` is positive,
    /// else 0, as rows `dx_row` apart. Zeros of `dy` are left out where that is faster; the bits are the same.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    pub fn input_gradient_between_relus(
        &self,
        isa: Isa,
        transposed: &[f32],
        chunks: &Chunks,
        rows: usize,
        dy: &[f32],
        x: &[f32],
        dx: &mut [f32],
        dx_row: usize,
        nonzeros: &mut Nonzeros,
    ) {
        let stride = chunks.block_stride();
        let spans = self.outputs / SPAN;
        let can_leave_out = self.divides_into_spans() && sparse::is_worth_a_look(isa, rows);
        if can_leave_out {
            nonzeros.of_rows(isa, rows, spans, dy, stride);
        }
        if !can_leave_out || !nonzeros.are_few() {
            for panel in 0..self.transposed_panels() {
                let mask = Grid { data: &x[panel * 2 * stride..], row: BLOCK, half: stride };
                let dx = Grid { data: &mut dx[panel * PANEL..], row: dx_row, half: HALF };
                self.input_gradient(isa, transposed, panel, chunks, rows, dy, Finish::Mask(mask), dx);
            }
            return;
        }
        let n_pairs = self.inputs / SPAN;
        let panels = |pair: usize, span: usize| {
            [2 * pair, 2 * pair + 1]
                .map(|panel| &transposed[(panel * self.outputs + span * SPAN) * PANEL..][..SPAN * PANEL])
        };
        for pair in 0..n_pairs {
            let mask = Grid { data: &x[pair * QUARTERS * stride..], row: BLOCK, half: stride };
            for span in 0..spans {
                let behind = (pair * spans + span + 1).min(n_pairs * spans - 1);
                let next = panels(behind / spans, behind % spans);
                let start = if span == 0 { Start::Zero } else { Start::Accumulate };
                let finish = if span + 1 == spans { Finish::Mask(mask) } else { Finish::Store };
                let out = Grid { data: &mut dx[pair * SPAN..], row: dx_row, half: HALF };
                let first_list = span * rows;
                rows_times_span(
                    isa,
                    rows,
                    nonzeros,
                    first_list,
                    panels(pair, span),
                    next,
                    start,
                    finish,
                    out,
                );
            }
        }
    }

    /// [`weight_gradient`](Self::weight_gradient) for output gradients behind a ReLU: zeros of `dy` are left out where
    /// that is faster; the bits are the same.
    #[allow(clippy::too_many_arguments)] // The operands of one product.
    pub fn weight_gradient_behind_relu(
        &self,
        isa: Isa,
        chunks: &Chunks,
        x: &[f32],
        dy: &[f32],
        gradient: &mut [f32],
        columns: &mut Vec<Nonzeros>,
    ) {
        if !self.divides_into_spans() || !sparse::is_worth_a_look(isa, chunks.batch) {
            return self.weight_gradient(isa, chunks, x, dy, gradient);
        }
        let stride = chunks.block_stride();
        let (x_chunk, dy_chunk) = (chunks.chunk_len(self.inputs), chunks.chunk_len(self.outputs));
        let n_runs = chunk_runs(chunks).count();
        if columns.len() < n_runs {
            columns.resize_with(n_runs, Nonzeros::default);
        }
        let columns = &mut columns[..n_runs];
        let rows = |count: Count| Rows { chunks: count.segments, of_each: count.steps, dy_chunk, x_chunk };
        for (columns, (first, count)) in columns.iter_mut().zip(chunk_runs(chunks)) {
            columns.of_columns(isa, self.outputs, &dy[first * dy_chunk..], rows(count), stride);
        }
        if !columns.iter().all(Nonzeros::are_few) {
            return self.weight_gradient(isa, chunks, x, dy, gradient);
        }
        let columns = &*columns;
        let gradient = &mut gradient[..self.weights()];
        for_each_piece(self.groups(), [(gradient, GROUP * self.outputs)], &|group, [gradient]| {
            let inputs = gradient.len() / self.outputs;
            for span in 0..inputs / SPAN {
                let x = &x[(group * (GROUP / BLOCK) + span * QUARTERS) * stride..];
                let gradient = &mut gradient[span * SPAN * PANEL..];
                for (columns, (first, count)) in columns.iter().zip(chunk_runs(chunks)) {
                    let x = &x[first * x_chunk..];
                    let gradient = Panels { data: &mut *gradient, stride: inputs * PANEL };
                    span_gradient(isa, columns, rows(count), x, stride, first > 0, gradient);
                }
            }
        });
    }

    /// Weight gradient of the whole batch: `dW = xᵀ · dy`, in the order of the weights, overwritten.
    ///
    /// Work is divided by groups of inputs; the sum over the batch is in one order for each weight.
    pub fn weight_gradient(&self, isa: Isa, chunks: &Chunks, x: &[f32], dy: &[f32], gradient: &mut [f32]) {
        let gradient = &mut gradient[..self.weights()];
        for_each_piece(self.groups(), [(gradient, GROUP * self.outputs)], &|group, [gradient]| {
            let x = &x[group * (GROUP / BLOCK) * chunks.block_stride()..];
            self.group_gradient(isa, chunks, x, dy, gradient);
        });
    }

    /// The weight gradient of one group; `x` starts at its first block.
    fn group_gradient(&self, isa: Isa, chunks: &Chunks, x: &[f32], dy: &[f32], gradient: &mut [f32]) {
        let inputs = gradient.len() / self.outputs;
        let stride = chunks.block_stride();
        let (x_chunk, dy_chunk) = (chunks.chunk_len(self.inputs), chunks.chunk_len(self.outputs));
        for block in 0..inputs.div_ceil(BLOCK) {
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
    /// How the batch is cut.
    pub chunks: &'a Chunks,
    /// Rows of this chunk.
    pub rows: usize,
    /// The chunk's inputs, blocked.
    pub x: &'a [f32],
    /// The chunk's outputs, blocked, overwritten.
    pub y: &'a mut [f32],
    /// Whether a ReLU follows.
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
    let n_full = chunks.batch / chunks.size;
    let full = (0..n_full).step_by(CHUNKS_AT_ONCE).map(move |first| {
        let segments = CHUNKS_AT_ONCE.min(n_full - first);
        (first, segments)
    });
    let (size, rest) = (chunks.size, chunks.batch % chunks.size);
    full.map(move |(first, segments)| (first, Count { segments, steps: size }))
        .chain((rest > 0).then_some((n_full, Count { segments: 1, steps: rest })))
}
