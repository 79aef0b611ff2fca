//! A multi-layer perceptron with two hidden ReLU layers: the shape of both discriminators, and of
//! actor and critic where they read bodies with their velocities ([`crate::encoder::motion`]).

use std::sync::Arc;

use jostle_kernels::{AlignedVec, BLOCK, Chunks, Finish, Forward, Grid, Head, Isa, Linear, for_each_piece};

use super::network::Activation;
use super::permutation::Permutation;
use crate::batch::Batch;
use crate::config::NetworkConfig;
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::network::Network;
use crate::parameters::Parameters;

/// inputs → hidden (ReLU) → hidden (ReLU) → outputs, with tensors `fc1`, `fc2` and the heads
/// (`out`, or those of an actor or a critic).
///
/// A batch's observations are rows of `inputs` values. A discriminator does not read the tokens,
/// but there is one for each row; actor and critic read the token z as the z-th of M further inputs
/// being 1.
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
    /// Values of an observation row; behind them fc1 reads `n_tokens` values, one of which is 1.
    inputs: usize,
    n_tokens: usize,
    fc1: Linear,
    fc2: Linear,
    out: Head,
    activations: Vec<Activation>,
    at: [(usize, usize); 2],
    transposed2: AlignedVec,
    transposed_fresh: bool,
    memory: Memory,
    kept: Option<Chunks>,
}

/// The sizes in which perceptrons differ.
struct Shape {
    inputs: usize,
    n_tokens: usize,
    hidden: [usize; 2],
    /// Indices of each output's weights and bias in the flat vector.
    heads: Vec<(usize, usize)>,
    activations: Vec<Activation>,
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
    /// Outputs `[B, n_outputs]` behind their activations.
    outputs: Vec<f32>,
    /// A bit for each value of `d_h1` that is not zero: a mask for each unit and chunk.
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
        let start = |name: &str| layout.range(name).expect("the tensors of `Mlp::layout`").start;
        let (weight, bias) = (start("out.weight"), start("out.bias"));
        let heads = (0..outputs).map(|o| (weight + o * hidden, bias + o)).collect();
        let activations = vec![Activation::Identity; outputs];
        Self::build(
            Shape { inputs, n_tokens: 0, hidden: [hidden; 2], heads, activations },
            layout,
            parameters,
            isa,
        )
    }

    /// An actor that reads bodies with their velocities.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Config`] if `laser_feature` or `hidden` is no multiple of 32,
    /// [`PolicyError::Parameters`] if the parameters are not an actor's of this shape.
    pub fn actor(config: &NetworkConfig, parameters: &Parameters) -> Result<Self, PolicyError> {
        let heads = [("mean_v", Activation::Sigmoid), ("mean_w", Activation::Tanh)];
        Self::for_policy(config, Layout::actor(config), &heads, parameters, Isa::detect())
    }

    /// A critic that reads bodies with their velocities.
    ///
    /// # Errors
    ///
    /// As [`actor`](Self::actor).
    pub fn critic(config: &NetworkConfig, parameters: &Parameters) -> Result<Self, PolicyError> {
        let heads = [("value", Activation::Identity)];
        Self::for_policy(config, Layout::critic(config), &heads, parameters, Isa::detect())
    }

    pub(super) fn for_policy(
        config: &NetworkConfig,
        layout: Layout,
        heads: &[(&str, Activation)],
        parameters: &Parameters,
        isa: Isa,
    ) -> Result<Self, PolicyError> {
        config.validate()?;
        super::check_width("laser_feature", config.laser_feature)?;
        super::check_width("hidden", config.hidden)?;
        let start = |name: &str| layout.range(name).expect("the layout of a policy").start;
        let shape = Shape {
            inputs: config.input_len(),
            n_tokens: config.n_behaviours,
            hidden: [config.laser_feature, config.hidden],
            heads: heads
                .iter()
                .map(|(name, _)| (start(&format!("{name}.weight")), start(&format!("{name}.bias"))))
                .collect(),
            activations: heads.iter().map(|(_, activation)| *activation).collect(),
        };
        Self::build(shape, layout, parameters, isa)
    }

    fn build(shape: Shape, layout: Layout, parameters: &Parameters, isa: Isa) -> Result<Self, PolicyError> {
        parameters.check_layout(&layout)?;
        let Shape { inputs, n_tokens, hidden: [hidden1, hidden2], heads, activations } = shape;
        let start = |name: &str| layout.range(name).expect("the tensors of a perceptron").start;
        let (fc1, fc2) = (Linear::new(inputs + n_tokens, hidden1), Linear::new(hidden1, hidden2));
        let mut permutation = Permutation::identity(layout.len());
        for (name, linear) in [("fc1.weight", fc1), ("fc2.weight", fc2)] {
            let width = linear.inputs();
            permutation.reorder(start(name), linear.weights(), |idx| linear.index(idx % width, idx / width));
        }
        let mut mlp = Self {
            isa,
            parameters: AlignedVec::zeros(layout.len()),
            gradient: AlignedVec::zeros(layout.len()),
            inputs,
            n_tokens,
            out: Head::new(hidden2, heads),
            activations,
            at: [("fc1.weight", "fc1.bias"), ("fc2.weight", "fc2.bias")]
                .map(|(weight, bias)| (start(weight), start(bias))),
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

    /// Lengths of a chunk's input, both hidden layers and padded output.
    fn chunk_lens(&self, chunks: &Chunks) -> [usize; 4] {
        [self.fc1.inputs(), self.fc1.outputs(), self.fc2.outputs(), self.out.padded()]
            .map(|features| chunks.chunk_len(features))
    }

    /// Refuses a batch that does not fit.
    fn check(&self, batch: Batch<'_>) {
        // A discriminator does not read the tokens, so any token passes.
        let n_tokens = if self.n_tokens == 0 { usize::MAX } else { self.n_tokens };
        if let Err(error) = batch.check(self.inputs, n_tokens) {
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
        let [x, h1, h2, y] = self.chunk_lens(&chunks);
        let memory = &mut self.memory;
        memory.x.reserve_len(chunks.count * x);
        memory.h1.reserve_len(chunks.count * h1);
        memory.h2.reserve_len(chunks.count * h2);
        memory.y.reserve_len(chunks.count * y);
        let (isa, p, [(w1, b1), (w2, b2)]) = (self.isa, &self.parameters[..], self.at);
        let (fc1, fc2, out, activations) = (&self.fc1, &self.fc2, &self.out, &self.activations);
        let (inputs, n_tokens) = (self.inputs, self.n_tokens);
        let slices = [
            (&mut memory.x[..], x),
            (&mut memory.h1[..], h1),
            (&mut memory.h2[..], h2),
            (&mut memory.y[..], y),
            (&mut outputs[..], chunks.size * n_outputs),
        ];
        for_each_piece(chunks.count, slices, &|chunk, [x, h1, h2, y, outputs]| {
            let (rows, first) = (chunks.rows(chunk), chunks.first(chunk));
            for row in 0..rows {
                chunks.write_row(x, row, 0, batch.observation(first + row, inputs));
                for token in 0..n_tokens {
                    let chosen = batch.token(first + row) as usize == token;
                    chunks.write_row(x, row, inputs + token, &[f32::from(chosen)]);
                }
            }
            fc1.forward(isa, &p[w1..], &p[b1..], Forward::new(&chunks, chunk, x, h1, true));
            fc2.forward(isa, &p[w2..], &p[b2..], Forward::new(&chunks, chunk, h1, h2, true));
            out.forward(isa, Forward::new(&chunks, chunk, h2, y, false));
            for (row, outputs) in outputs.chunks_exact_mut(n_outputs).enumerate() {
                for (idx, output) in outputs.iter_mut().enumerate() {
                    let sum = y[idx / BLOCK * chunks.block_stride() + row * BLOCK + idx % BLOCK];
                    *output = activations[idx].value(sum);
                }
            }
        });
        memory.outputs.clear();
        memory.outputs.extend_from_slice(outputs);
        self.kept = Some(chunks);
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        let chunks = self.kept.expect("backward comes after a forward of at least one row");
        let n_outputs = self.n_outputs();
        assert_eq!(d_outputs.len(), chunks.batch * n_outputs, "gradient of {} rows", chunks.batch);
        let [x, len1, len2, y] = self.chunk_lens(&chunks);
        let (isa, [(w1, b1), (w2, b2)]) = (self.isa, self.at);
        if !self.transposed_fresh {
            self.fc2.transpose(isa, &self.parameters[w2..], &mut self.transposed2);
            self.transposed_fresh = true;
        }
        let Memory { x: xs, h1, h2, d_h1, d_h2, d_y, columns, outputs, .. } = &mut self.memory;
        d_h1.reserve_len(chunks.count * len1);
        d_h2.reserve_len(chunks.count * len2);
        d_y.reserve_len(chunks.count * y);
        let (fc2, out, transposed2) = (&self.fc2, &self.out, &self.transposed2);
        let (activations, outputs) = (&self.activations, &outputs[..]);
        let slices = [(&mut d_h1[..], len1), (&mut d_h2[..], len2), (&mut d_y[..], y)];
        for_each_piece(chunks.count, slices, &|chunk, [d_h1, d_h2, d_y]| {
            let (rows, stride) = (chunks.rows(chunk), chunks.block_stride());
            let (h1, h2) = (&h1[chunk * len1..], &h2[chunk * len2..]);
            let range = chunks.first(chunk) * n_outputs..(chunks.first(chunk) + rows) * n_outputs;
            let (d_outputs, outputs) = (&d_outputs[range.clone()], &outputs[range]);
            d_y.fill(0.0);
            for (at, (d_output, output)) in d_outputs.iter().zip(outputs).enumerate() {
                let (row, idx) = (at / n_outputs, at % n_outputs);
                chunks.write_row(d_y, row, idx, &[d_output * activations[idx].slope(*output)]);
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
            (&d_h1[..chunks.count * len1], &d_h2[..chunks.count * len2], &d_y[..chunks.count * y]);
        let xs = &xs[..chunks.count * x];
        self.fc1.weight_gradient_behind_relu(isa, &chunks, xs, d_h1, &mut gradient[w1..], columns);
        chunks.sum_rows(d_h1, self.fc1.outputs(), &mut gradient[b1..][..self.fc1.outputs()]);
        self.fc2.weight_gradient(isa, &chunks, &h1[..chunks.count * len1], d_h2, &mut gradient[w2..]);
        chunks.sum_rows(d_h2, self.fc2.outputs(), &mut gradient[b2..][..self.fc2.outputs()]);
        self.out.weight_gradient(isa, &chunks, &h2[..chunks.count * len2], d_y, gradient);
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
