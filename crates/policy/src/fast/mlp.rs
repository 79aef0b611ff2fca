//! A multi-layer perceptron with two hidden ReLU layers of one width: the shape of both discriminators.

use std::sync::Arc;

use super::permutation::Permutation;
use crate::kernels::{AlignedVec, BLOCK, Chunks, Finish, Forward, Grid, Head, Isa, Linear, for_each_piece};
use crate::{Batch, Layout, Network, Parameters, PolicyError};

/// inputs → hidden (ReLU) → hidden (ReLU) → outputs, with tensors `fc1`, `fc2` and `out`.
///
/// A batch's observations are rows of `inputs` values; its tokens are not read, but there is one for each row.
///
/// # Examples
///
/// ```
/// use jostle_policy::{Batch, Network, Parameters, fast::Mlp};
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let parameters = Parameters::init(Mlp::layout(1540, 128, 5), &mut ChaCha8Rng::seed_from_u64(1));
/// let mut mlp = Mlp::new(1540, 128, 5, &parameters)?;
/// let mut logits = [0.0; 10];
/// mlp.infer(Batch::new(&[0.1; 2 * 1540], &[0, 0]), &mut logits);
/// assert_eq!(logits[..5], logits[5..]);
/// # Ok::<(), jostle_policy::PolicyError>(())
/// ```
#[derive(Debug)]
pub struct Mlp {
    isa: Isa,
    layout: Arc<Layout>,
    permutation: Permutation,
    parameters: AlignedVec,
    gradient: AlignedVec,
    fc1: Linear,
    fc2: Linear,
    out: Head,
    at: [(usize, usize); 2],
    transposed2: AlignedVec,
    transposed_fresh: bool,
    memory: Memory,
    kept: Option<Chunks>,
}

/// Activations and their gradients, blocked; it grows to the largest batch and stays.
#[derive(Debug, Default)]
struct Memory {
    x: AlignedVec,
    h1: AlignedVec,
    h2: AlignedVec,
    y: AlignedVec,
    d_h1: AlignedVec,
    d_h2: AlignedVec,
    d_y: AlignedVec,
    /// Which of `d_h1` are not zero: a mask for each unit and chunk.
    columns: Vec<u64>,
}

impl Mlp {
    /// Names and shapes of such a network.
    pub fn layout(inputs: usize, hidden: usize, outputs: usize) -> Layout {
        let mut layout = Layout::new();
        layout.push_linear("fc1", inputs, hidden);
        layout.push_linear("fc2", hidden, hidden);
        layout.push_linear("out", hidden, outputs);
        layout
    }

    /// A network of this shape.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Config`] if `inputs` or `outputs` is 0 or `hidden` is no multiple of 32,
    /// [`PolicyError::Parameters`] if the parameters are of another shape.
    pub fn new(
        inputs: usize,
        hidden: usize,
        outputs: usize,
        parameters: &Parameters,
    ) -> Result<Self, PolicyError> {
        Self::with_isa(inputs, hidden, outputs, parameters, Isa::detect())
    }

    pub(super) fn with_isa(
        inputs: usize,
        hidden: usize,
        outputs: usize,
        parameters: &Parameters,
        isa: Isa,
    ) -> Result<Self, PolicyError> {
        super::check_width("hidden", hidden)?;
        for (field, found) in [("inputs", inputs), ("outputs", outputs)] {
            if found == 0 {
                return Err(PolicyError::Config {
                    field,
                    found: "0".to_owned(),
                    expected: "1 or more".to_owned(),
                });
            }
        }
        let layout = Self::layout(inputs, hidden, outputs);
        parameters.check_layout(&layout)?;
        let range = |name: &str| layout.range(name).expect("the tensors of `Mlp::layout`");
        let (fc1, fc2) = (Linear::new(inputs, hidden), Linear::new(hidden, hidden));
        let mut permutation = Permutation::identity(layout.len());
        for (name, linear) in [("fc1.weight", fc1), ("fc2.weight", fc2)] {
            let width = linear.inputs();
            permutation
                .reorder(range(name).start, linear.weights(), |idx| linear.index(idx % width, idx / width));
        }
        let head =
            (0..outputs).map(|o| (range("out.weight").start + o * hidden, range("out.bias").start + o));
        let mut mlp = Self {
            isa,
            parameters: AlignedVec::zeros(layout.len()),
            gradient: AlignedVec::zeros(layout.len()),
            out: Head::new(hidden, head.collect()),
            at: [("fc1.weight", "fc1.bias"), ("fc2.weight", "fc2.bias")]
                .map(|(weight, bias)| (range(weight).start, range(bias).start)),
            transposed2: AlignedVec::zeros(fc2.transposed_len()),
            transposed_fresh: false,
            memory: Memory::default(),
            kept: None,
            layout: Arc::new(layout),
            permutation,
            fc1,
            fc2,
        };
        mlp.parameters.copy_from_slice(&mlp.permutation.to_native(parameters.flat()));
        mlp.parameters_changed();
        Ok(mlp)
    }

    /// Refuses a batch that does not fit.
    fn check(&self, batch: Batch<'_>) {
        // The tokens are not read, so any token passes.
        if let Err(error) = batch.check(self.fc1.inputs(), usize::MAX) {
            panic!("{error}");
        }
    }
}

impl Network for Mlp {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn n_outputs(&self) -> usize {
        self.out.n_outputs()
    }

    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.forward(batch, outputs);
        self.kept = None;
    }

    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.check(batch);
        let n_outputs = self.n_outputs();
        assert_eq!(outputs.len(), batch.len() * n_outputs, "outputs of {} rows", batch.len());
        self.kept = None;
        if batch.is_empty() {
            return;
        }
        let chunks = Chunks::new(batch.len());
        let [x, h, y] =
            [self.fc1.inputs(), self.fc1.outputs(), self.out.padded()].map(|n| chunks.chunk_len(n));
        let memory = &mut self.memory;
        memory.x.reserve_len(chunks.count * x);
        memory.h1.reserve_len(chunks.count * h);
        memory.h2.reserve_len(chunks.count * h);
        memory.y.reserve_len(chunks.count * y);
        let (isa, p, [(w1, b1), (w2, b2)]) = (self.isa, &self.parameters[..], self.at);
        let (fc1, fc2, out) = (&self.fc1, &self.fc2, &self.out);
        let slices = [
            (&mut memory.x[..], x),
            (&mut memory.h1[..], h),
            (&mut memory.h2[..], h),
            (&mut memory.y[..], y),
            (outputs, chunks.size * n_outputs),
        ];
        for_each_piece(chunks.count, slices, &|chunk, [x, h1, h2, y, outputs]| {
            let (rows, first) = (chunks.rows(chunk), chunks.first(chunk));
            for row in 0..rows {
                chunks.write_row(x, row, 0, batch.observation(first + row, fc1.inputs()));
            }
            fc1.forward(isa, &p[w1..], &p[b1..], Forward::new(&chunks, chunk, x, h1, true));
            fc2.forward(isa, &p[w2..], &p[b2..], Forward::new(&chunks, chunk, h1, h2, true));
            out.forward(isa, Forward::new(&chunks, chunk, h2, y, false));
            for (row, outputs) in outputs.chunks_exact_mut(n_outputs).enumerate() {
                for (idx, output) in outputs.iter_mut().enumerate() {
                    *output = y[idx / BLOCK * chunks.block_stride() + row * BLOCK + idx % BLOCK];
                }
            }
        });
        self.kept = Some(chunks);
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        let chunks = self.kept.expect("backward comes after a forward of at least one row");
        let n_outputs = self.n_outputs();
        assert_eq!(d_outputs.len(), chunks.batch * n_outputs, "gradient of {} rows", chunks.batch);
        let [x, h, y] =
            [self.fc1.inputs(), self.fc1.outputs(), self.out.padded()].map(|n| chunks.chunk_len(n));
        let (isa, [(w1, b1), (w2, b2)]) = (self.isa, self.at);
        if !self.transposed_fresh {
            self.fc2.transpose(isa, &self.parameters[w2..], &mut self.transposed2);
            self.transposed_fresh = true;
        }
        let Memory { x: xs, h1, h2, d_h1, d_h2, d_y, columns, .. } = &mut self.memory;
        d_h1.reserve_len(chunks.count * h);
        d_h2.reserve_len(chunks.count * h);
        d_y.reserve_len(chunks.count * y);
        let (fc2, out, transposed2) = (&self.fc2, &self.out, &self.transposed2);
        let slices = [(&mut d_h1[..], h), (&mut d_h2[..], h), (&mut d_y[..], y)];
        for_each_piece(chunks.count, slices, &|chunk, [d_h1, d_h2, d_y]| {
            let (rows, stride) = (chunks.rows(chunk), chunks.block_stride());
            let (h1, h2) = (&h1[chunk * h..], &h2[chunk * h..]);
            let d_outputs = &d_outputs[chunks.first(chunk) * n_outputs..][..rows * n_outputs];
            d_y.fill(0.0);
            for (row, d_outputs) in d_outputs.chunks_exact(n_outputs).enumerate() {
                chunks.write_row(d_y, row, 0, d_outputs);
            }
            out.input_gradient(isa, &chunks, rows, d_y, h2, d_h2);
            for panel in 0..fc2.transposed_panels() {
                let at = panel * 2 * stride;
                let finish = Finish::Mask(Grid { data: &h1[at..], row: BLOCK, half: stride });
                let d_h1 = Grid { data: &mut d_h1[at..], row: BLOCK, half: stride };
                fc2.input_gradient(isa, transposed2, panel, &chunks, rows, d_h2, finish, d_h1);
            }
        });
        let gradient = &mut self.gradient;
        let (d_h1, d_h2, d_y) =
            (&d_h1[..chunks.count * h], &d_h2[..chunks.count * h], &d_y[..chunks.count * y]);
        let xs = &xs[..chunks.count * x];
        self.fc1.weight_gradient_behind_relu(isa, &chunks, xs, d_h1, &mut gradient[w1..], columns);
        chunks.sum_rows(d_h1, self.fc1.outputs(), &mut gradient[b1..][..self.fc1.outputs()]);
        self.fc2.weight_gradient(isa, &chunks, &h1[..chunks.count * h], d_h2, &mut gradient[w2..]);
        chunks.sum_rows(d_h2, self.fc2.outputs(), &mut gradient[b2..][..self.fc2.outputs()]);
        self.out.weight_gradient(isa, &chunks, &h2[..chunks.count * h], d_y, gradient);
    }

    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut self.parameters, &mut self.gradient)
    }

    fn parameters_changed(&mut self) {
        self.out.load(self.isa, &self.parameters);
        self.transposed_fresh = false;
        self.kept = None;
    }

    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        self.permutation.to_canonical(native)
    }

    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        self.permutation.to_native(canonical)
    }
}
