//! The three products of fc1 (4096 → 256), two thirds of a trunk's arithmetic, at the batch of work
//! U, on one thread.
//!
//! A ReLU stands before the layer and one behind it, so half of its inputs and of its output
//! gradients are zero here, as in a fresh network. Operations are counted as if they were not.

use jostle_kernels::{AlignedVec, Chunks, Forward, Isa, Linear};
use rand::Rng;

use crate::clock::Stopwatch;
use crate::learners::TRANSITIONS;
use crate::scenes::stream;

/// Room between two rows of an input gradient, so that rows do not share a set of the cache.
const ROW_GAP: usize = 48;

/// Operands of the layer; every product writes memory of its own.
pub struct Fc1 {
    layer: Linear,
    isa: Isa,
    chunks: Chunks,
    weights: AlignedVec,
    transposed: AlignedVec,
    bias: Vec<f32>,
    x: AlignedVec,
    y: AlignedVec,
    dy: AlignedVec,
    dx: AlignedVec,
    gradient: AlignedVec,
    masks: Vec<u64>,
    dy_masks: Vec<u64>,
    columns: Vec<u64>,
}

impl Fc1 {
    /// The layer with arbitrary weights, inputs and gradients.
    pub fn new() -> Self {
        let (layer, isa) = (Linear::new(4096, 256), Isa::detect());
        let chunks = Chunks::new(TRANSITIONS);
        let mut rng = stream("fc1");
        let mut fill = |len: usize, least: f32| {
            let mut values = AlignedVec::zeros(len);
            let mut draw = || rng.next_u32() as f32 / u32::MAX as f32 - 0.5;
            values.iter_mut().for_each(|value| *value = draw().max(least));
            values
        };
        let weights = fill(layer.weights(), -0.5);
        let mut transposed = AlignedVec::zeros(layer.transposed_len());
        layer.transpose(isa, &weights, &mut transposed);
        Self {
            x: fill(chunks.len(layer.inputs()), 0.0),
            dy: fill(chunks.len(layer.outputs()), 0.0),
            y: AlignedVec::zeros(chunks.len(layer.outputs())),
            dx: AlignedVec::zeros(chunks.size * (layer.inputs() + ROW_GAP)),
            gradient: AlignedVec::zeros(layer.weights()),
            masks: vec![0; chunks.count * chunks.size * layer.spans()],
            dy_masks: Vec::new(),
            columns: Vec::new(),
            bias: vec![0.1; layer.outputs()],
            layer,
            isa,
            chunks,
            weights,
            transposed,
        }
    }

    /// Operations of each of the products.
    pub fn flop(&self) -> f64 {
        2.0 * (self.layer.weights() * TRANSITIONS) as f64
    }

    /// Seconds of y = x·W + b for all rows.
    pub fn forward(&mut self) -> f64 {
        let watch = Stopwatch::start(1);
        let (x_len, y_len) =
            (self.chunks.chunk_len(self.layer.inputs()), self.chunks.chunk_len(self.layer.outputs()));
        let (chunks, isa) = (&self.chunks, self.isa);
        let masks = self.masks.chunks_mut(chunks.size * self.layer.spans());
        for (chunk, ((x, y), masks)) in
            self.x.chunks(x_len).zip(self.y.chunks_mut(y_len)).zip(masks).enumerate()
        {
            self.layer.mask_chunk(isa, chunks, chunks.rows(chunk), x, masks);
            let operands = Forward::new(chunks, chunk, x, y, true);
            self.layer.forward_behind_relu(isa, &self.weights, &self.bias, operands, masks);
        }
        watch.seconds()
    }

    /// Seconds of dx = dy·Wᵀ, masked by the ReLU before; comes after the forward product.
    pub fn input_gradient(&mut self) -> f64 {
        let watch = Stopwatch::start(1);
        let row = self.layer.inputs() + ROW_GAP;
        let (x_len, y_len) =
            (self.chunks.chunk_len(self.layer.inputs()), self.chunks.chunk_len(self.layer.outputs()));
        for (chunk, (x, dy)) in self.x.chunks(x_len).zip(self.dy.chunks(y_len)).enumerate() {
            let (rows, dx, dy_masks) = (self.chunks.rows(chunk), &mut self.dx[..], &mut self.dy_masks);
            let masks = &self.masks[chunk * self.chunks.size * self.layer.spans()..];
            let (layer, transposed) = (&self.layer, &self.transposed);
            layer.input_gradient_between_relus(
                self.isa,
                transposed,
                &self.chunks,
                rows,
                dy,
                x,
                masks,
                dx,
                row,
                dy_masks,
            );
        }
        watch.seconds()
    }

    /// Seconds of dW = xᵀ·dy. To be called on a pool of one thread, which the clock then reads.
    pub fn weight_gradient(&mut self) -> f64 {
        let watch = Stopwatch::start(1);
        let (gradient, columns) = (&mut self.gradient[..], &mut self.columns);
        self.layer.weight_gradient_behind_relu(self.isa, &self.chunks, &self.x, &self.dy, gradient, columns);
        watch.seconds()
    }
}

impl Default for Fc1 {
    fn default() -> Self {
        Self::new()
    }
}
