//! The discriminator on the CPU: three matrix products forward and five backward, over preallocated memory, by faer.
//!
//! Each product runs on one thread: the two discriminators train beside the actor and the critic, and the sums then have
//! one order whatever the number of threads. The input's own gradient is nobody's concern and is not computed.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use jostle_policy::{Batch, Layout, Network, Parameters};

use crate::DiscriminatorShape;

/// A discriminator with its parameters and gradient. The native order is the canonical one.
pub(crate) struct FastMlp {
    shape: DiscriminatorShape,
    layout: Layout,
    parameters: Vec<f32>,
    gradient: Vec<f32>,
    /// Input rows of the last pass, [B, `n_inputs`].
    inputs: Vec<f32>,
    /// Outputs of both hidden layers behind their `ReLU`, [B, hidden] each.
    hidden: [Vec<f32>; 2],
    /// Their gradients.
    d_hidden: [Vec<f32>; 2],
    /// Rows of the last `forward`; 0 after an `infer`.
    n_kept: usize,
}

/// A linear layer's place in the flat vector: weight [outputs, inputs], then bias [outputs].
#[derive(Clone, Copy)]
struct Layer {
    start: usize,
    inputs: usize,
    outputs: usize,
}

impl Layer {
    fn weight(self, flat: &[f32]) -> &[f32] {
        &flat[self.start..self.start + self.inputs * self.outputs]
    }

    fn bias(self, flat: &[f32]) -> &[f32] {
        let start = self.start + self.inputs * self.outputs;
        &flat[start..start + self.outputs]
    }

    /// ys = xs·Wᵀ + b
    fn forward(self, flat: &[f32], xs: &[f32], ys: &mut [f32]) {
        let n = ys.len() / self.outputs;
        ys.chunks_exact_mut(self.outputs).for_each(|row| row.copy_from_slice(self.bias(flat)));
        let weight = MatRef::from_row_major_slice(self.weight(flat), self.outputs, self.inputs);
        let xs = MatRef::from_row_major_slice(xs, n, self.inputs);
        let ys = MatMut::from_row_major_slice_mut(ys, n, self.outputs);
        matmul(ys, Accum::Add, xs, weight.transpose(), 1.0, Par::Seq);
    }

    /// dW = d_ysᵀ·xs and db = Σ d_ys
    fn backward_weights(self, gradient: &mut [f32], xs: &[f32], d_ys: &[f32]) {
        let n = d_ys.len() / self.outputs;
        let place = &mut gradient[self.start..][..(self.inputs + 1) * self.outputs];
        let (d_weight, d_bias) = place.split_at_mut(self.inputs * self.outputs);
        let d_weight = MatMut::from_row_major_slice_mut(d_weight, self.outputs, self.inputs);
        let xs = MatRef::from_row_major_slice(xs, n, self.inputs);
        let d_rows = MatRef::from_row_major_slice(d_ys, n, self.outputs);
        matmul(d_weight, Accum::Replace, d_rows.transpose(), xs, 1.0, Par::Seq);
        d_bias.fill(0.0);
        for row in d_ys.chunks_exact(self.outputs) {
            d_bias.iter_mut().zip(row).for_each(|(d, &g)| *d += g);
        }
    }

    /// d_xs = d_ys·W, let through where xs, the output of a `ReLU`, is positive.
    fn backward_inputs(self, flat: &[f32], xs: &[f32], d_ys: &[f32], d_xs: &mut [f32]) {
        let n = d_ys.len() / self.outputs;
        let weight = MatRef::from_row_major_slice(self.weight(flat), self.outputs, self.inputs);
        let d_rows = MatRef::from_row_major_slice(d_ys, n, self.outputs);
        let d_inputs = MatMut::from_row_major_slice_mut(d_xs, n, self.inputs);
        matmul(d_inputs, Accum::Replace, d_rows, weight, 1.0, Par::Seq);
        d_xs.iter_mut().zip(xs).for_each(|(d, &x)| *d = if x > 0.0 { *d } else { 0.0 });
    }
}

fn relu(xs: &mut [f32]) {
    xs.iter_mut().for_each(|x| *x = x.max(0.0));
}

impl FastMlp {
    pub(crate) fn new(shape: DiscriminatorShape, parameters: &Parameters) -> Self {
        let layout = shape.layout();
        let gradient = vec![0.0; layout.len()];
        let parameters = parameters.flat().to_vec();
        let (inputs, hidden, d_hidden) = (Vec::new(), Default::default(), Default::default());
        Self { shape, layout, parameters, gradient, inputs, hidden, d_hidden, n_kept: 0 }
    }

    fn layers(&self) -> [Layer; 3] {
        let DiscriminatorShape { n_inputs, hidden, n_behaviours } = self.shape;
        let layer = |start, inputs, outputs| Layer { start, inputs, outputs };
        let second = (n_inputs + 1) * hidden;
        let third = second + (hidden + 1) * hidden;
        [layer(0, n_inputs, hidden), layer(second, hidden, hidden), layer(third, hidden, n_behaviours)]
    }

    fn compute(&mut self, batch: Batch<'_>, logits: &mut [f32]) {
        let (n, width) = (batch.len(), self.shape.n_inputs);
        assert_eq!(batch.observations.len(), batch.tokens.len() * width, "rows are [B, n_inputs]");
        assert_eq!(logits.len(), n * self.shape.n_behaviours, "logits are [B, M]");
        self.inputs.clear();
        (0..n).for_each(|row| self.inputs.extend_from_slice(batch.observation(row, width)));
        self.hidden.iter_mut().for_each(|layer| layer.resize(n * self.shape.hidden, 0.0));
        let [fc1, fc2, out] = self.layers();
        let [first, second] = &mut self.hidden;
        fc1.forward(&self.parameters, &self.inputs, first);
        relu(first);
        fc2.forward(&self.parameters, first, second);
        relu(second);
        out.forward(&self.parameters, second, logits);
    }
}

impl Network for FastMlp {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn n_outputs(&self) -> usize {
        self.shape.n_behaviours
    }

    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.compute(batch, outputs);
        self.n_kept = 0;
    }

    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.compute(batch, outputs);
        self.n_kept = batch.len();
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        assert!(self.n_kept > 0, "backward needs a forward pass before it");
        assert_eq!(d_outputs.len(), self.n_kept * self.shape.n_behaviours, "d_outputs is [B, M]");
        let [fc1, fc2, out] = self.layers();
        let [first, second] = &self.hidden;
        let [d_first, d_second] = &mut self.d_hidden;
        d_first.resize(first.len(), 0.0);
        d_second.resize(second.len(), 0.0);
        out.backward_weights(&mut self.gradient, second, d_outputs);
        out.backward_inputs(&self.parameters, second, d_outputs, d_second);
        fc2.backward_weights(&mut self.gradient, first, d_second);
        fc2.backward_inputs(&self.parameters, first, d_second, d_first);
        fc1.backward_weights(&mut self.gradient, &self.inputs, d_first);
    }

    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut self.parameters, &mut self.gradient)
    }

    fn parameters_changed(&mut self) {
        self.n_kept = 0;
    }

    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        native.to_vec()
    }

    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        canonical.to_vec()
    }
}
