//! A narrow linear layer: any number of outputs, by padding to a panel of 32.
//!
//! Heads have 1, 2 or M outputs. Their parameters stay in canonical order (one row of weights for
//! each output), and a padded copy is made once per step; it is so small that the zeros cost
//! nothing.

use crate::Isa;
use crate::aligned::AlignedVec;
use crate::blocked::Chunks;
use crate::linear::{Forward, Linear};
use crate::operands::{Finish, Grid, PANEL};

/// A narrow layer and its padded weights.
#[derive(Debug, Clone)]
pub struct Head {
    linear: Linear,
    /// Indices of each output's weights and bias in the network's flat vector.
    offsets: Vec<(usize, usize)>,
    weights: AlignedVec,
    bias: AlignedVec,
    transposed: AlignedVec,
    gradient: AlignedVec,
}

impl Head {
    /// A layer whose output o has its weights at `offsets[o].0` and its bias at `offsets[o].1` of
    /// the flat vector.
    pub fn new(inputs: usize, offsets: Vec<(usize, usize)>) -> Self {
        let linear = Linear::new(inputs, offsets.len().next_multiple_of(PANEL));
        Self {
            linear,
            weights: AlignedVec::zeros(linear.weights()),
            bias: AlignedVec::zeros(linear.outputs()),
            transposed: AlignedVec::zeros(linear.transposed_len()),
            gradient: AlignedVec::zeros(linear.weights()),
            offsets,
        }
    }

    /// Number of outputs.
    pub fn n_outputs(&self) -> usize {
        self.offsets.len()
    }

    /// Number of outputs with the padding: features of the blocked outputs and of their gradient.
    pub fn padded(&self) -> usize {
        self.linear.outputs()
    }

    /// Copies the parameters from the flat vector.
    pub fn load(&mut self, isa: Isa, flat: &[f32]) {
        for (output, (weights, bias)) in self.offsets.iter().enumerate() {
            for (input, weight) in flat[*weights..][..self.linear.inputs()].iter().enumerate() {
                self.weights[self.linear.index(input, output)] = *weight;
            }
            self.bias[output] = flat[*bias];
        }
        self.linear.transpose(isa, &self.weights, &mut self.transposed);
    }

    /// Forward pass of one chunk; the padding of `y` becomes zeros.
    pub fn forward(&self, isa: Isa, chunk: Forward<'_>) {
        self.linear.forward(isa, &self.weights, &self.bias, chunk);
    }

    /// Input gradient of one chunk behind a ReLU with activations `x`.
    pub fn input_gradient(
        &self,
        isa: Isa,
        chunks: &Chunks,
        rows: usize,
        dy: &[f32],
        x: &[f32],
        dx: &mut [f32],
    ) {
        let stride = chunks.block_stride();
        for panel in 0..self.linear.transposed_panels() {
            let mask = Grid { data: &x[panel * 2 * stride..], row: 16, half: stride };
            let dx = Grid { data: &mut dx[panel * 2 * stride..], row: 16, half: stride };
            self.linear.input_gradient(
                isa,
                &self.transposed,
                panel,
                chunks,
                rows,
                dy,
                Finish::Mask(mask),
                dx,
            );
        }
    }

    /// Writes the gradient of weights and biases into the flat vector.
    pub fn weight_gradient(&mut self, isa: Isa, chunks: &Chunks, x: &[f32], dy: &[f32], flat: &mut [f32]) {
        self.linear.weight_gradient(isa, chunks, x, dy, &mut self.gradient);
        let mut bias = vec![0.0; self.padded()];
        chunks.sum_rows(dy, self.padded(), &mut bias);
        for (output, (to_weights, to_bias)) in self.offsets.iter().enumerate() {
            for (input, to) in flat[*to_weights..][..self.linear.inputs()].iter_mut().enumerate() {
                *to = self.gradient[self.linear.index(input, output)];
            }
            flat[*to_bias] = bias[output];
        }
    }
}
