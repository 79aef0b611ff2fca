//! Actor and critic: forward pass and the [`Network`] interface.
//!
//! The actor has two outputs (sigmoid, tanh), the critic one; all else is the same. A batch is cut
//! into chunks, and one task takes a chunk from the observation to the output while its activations
//! are in the second-level cache. The backward pass is in `backward.rs`.

use std::sync::{Arc, Mutex};

use jostle_kernels::{
    AlignedVec, BLOCK, Chunks, Forward, Head, Isa, Linear, PANEL, for_each_piece, prefetch,
};

use super::conv::{ConvParts, ConvScratch, Convolutions, TRANSPOSED2_LEN};
use super::permutation::Permutation;
use crate::batch::Batch;
use crate::config::{CONV1_KERNEL, CONV2_KERNEL, NetworkConfig};
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::network::Network;
use crate::observation::TAIL_LEN;
use crate::parameters::Parameters;

/// The function of a head's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Activation {
    Identity,
    Sigmoid,
    Tanh,
}

impl Activation {
    pub(super) fn value(self, x: f32) -> f32 {
        match self {
            Self::Identity => x,
            Self::Sigmoid => 1.0 / (1.0 + (-x).exp()),
            Self::Tanh => x.tanh(),
        }
    }

    /// The derivative, from the value.
    pub(super) fn slope(self, value: f32) -> f32 {
        match self {
            Self::Identity => 1.0,
            Self::Sigmoid => value * (1.0 - value),
            Self::Tanh => 1.0 - value * value,
        }
    }
}

/// An actor or a critic on the fast back end.
///
/// # Shapes
///
/// Native order keeps the offsets of the tensors and reorders the weights inside: convolutions
/// `[kernel, input, channel]`, linear layers as [`Linear`] says, fc1's inputs channels last.
#[derive(Debug)]
pub struct FastNetwork {
    pub(super) isa: Isa,
    pub(super) config: NetworkConfig,
    pub(super) layout: Arc<Layout>,
    permutation: Permutation,
    pub(super) parameters: AlignedVec,
    pub(super) gradient: AlignedVec,
    pub(super) conv: Convolutions,
    pub(super) fc1: Linear,
    pub(super) fc2: Linear,
    pub(super) head: Head,
    pub(super) activations: Vec<Activation>,
    pub(super) at: Offsets,
    pub(super) transposed: Transposed,
    pub(super) memory: Memory,
    pub(super) pool: Pool,
    /// The division of the batch of the last `forward`; `None` when nothing is kept.
    pub(super) kept: Option<Chunks>,
}

/// Index of the first value of each tensor of the trunk in the flat vector.
#[derive(Debug, Clone, Copy)]
pub(super) struct Offsets {
    pub(super) fc1_weight: usize,
    pub(super) fc1_bias: usize,
    pub(super) embedding: usize,
    pub(super) fc2_weight: usize,
    pub(super) fc2_bias: usize,
}

/// Transposed weights for the input gradients, made when first needed after a step.
#[derive(Debug)]
pub(super) struct Transposed {
    pub(super) fresh: bool,
    pub(super) conv2: AlignedVec,
    pub(super) fc1: AlignedVec,
    pub(super) fc2: AlignedVec,
}

/// Activations and their gradients, chunk by chunk; it grows to the largest batch and stays.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// Padded scans, row by row.
    pub(super) scans: AlignedVec,
    /// Output of the convolutions.
    pub(super) x: AlignedVec,
    /// Input of fc2: laser feature, goal, velocity, embedding.
    pub(super) concat: AlignedVec,
    /// Output of fc2.
    pub(super) hidden: AlignedVec,
    /// Output of the head, before its activation.
    pub(super) y: AlignedVec,
    /// Outputs `[B, n_outputs]`.
    pub(super) outputs: Vec<f32>,
    pub(super) tokens: Vec<u32>,
    pub(super) d_y: AlignedVec,
    pub(super) d_hidden: AlignedVec,
    pub(super) d_feature: AlignedVec,
    /// Each chunk's gradient of the convolutions and of the embedding.
    pub(super) partial: AlignedVec,
    /// A bit for each value of `x` that is not zero: a mask for each span and row of a chunk. Empty
    /// where nothing is left out.
    pub(super) masks: Vec<u64>,
    /// A bit for each value of the laser feature's gradient that is not zero: a mask for each
    /// output.
    pub(super) columns: Vec<u64>,
}

/// Memory of one task.
#[derive(Debug)]
pub(super) struct Scratch {
    pub(super) conv: ConvScratch,
    /// Padded scans and outputs of the convolutions where no backward pass follows.
    scans: AlignedVec,
    x: AlignedVec,
    /// Gradient of a chunk's convolution outputs.
    pub(super) d_x: AlignedVec,
    /// Gradient of fc2's inputs behind the laser feature.
    pub(super) d_tail: AlignedVec,
    /// A bit for each value of a chunk's gradient of the laser feature that is not zero.
    pub(super) masks: Vec<u64>,
}

/// Scratch memory that tasks borrow; every task overwrites what it reads, so that it does not
/// matter which it gets.
#[derive(Debug, Default)]
pub(super) struct Pool(Mutex<Vec<Scratch>>);

impl Pool {
    /// Runs `work` with a piece of scratch memory.
    pub(super) fn with(&self, conv: &Convolutions, work: impl FnOnce(&mut Scratch)) {
        let lock = || self.0.lock().expect("no task panics while it holds the lock");
        let free = lock().pop();
        let mut scratch = free.unwrap_or_else(|| Scratch {
            conv: conv.scratch(),
            scans: AlignedVec::default(),
            x: AlignedVec::default(),
            d_x: AlignedVec::default(),
            d_tail: AlignedVec::default(),
            masks: Vec::new(),
        });
        work(&mut scratch);
        lock().push(scratch);
    }
}

impl FastNetwork {
    /// An actor.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Config`] if `laser_feature` or `hidden` is no multiple of 32,
    /// [`PolicyError::Parameters`] if the parameters are not an actor's of this shape.
    pub fn actor(config: &NetworkConfig, parameters: &Parameters) -> Result<Self, PolicyError> {
        let heads = [("mean_v", Activation::Sigmoid), ("mean_w", Activation::Tanh)];
        Self::new(config, Layout::actor(config), &heads, parameters, Isa::detect())
    }

    /// A critic.
    ///
    /// # Errors
    ///
    /// As [`actor`](Self::actor).
    pub fn critic(config: &NetworkConfig, parameters: &Parameters) -> Result<Self, PolicyError> {
        let heads = [("value", Activation::Identity)];
        Self::new(config, Layout::critic(config), &heads, parameters, Isa::detect())
    }

    pub(super) fn new(
        config: &NetworkConfig,
        layout: Layout,
        heads: &[(&str, Activation)],
        parameters: &Parameters,
        isa: Isa,
    ) -> Result<Self, PolicyError> {
        config.validate()?;
        super::check_width("laser_feature", config.laser_feature)?;
        super::check_width("hidden", config.hidden)?;
        parameters.check_layout(&layout)?;
        let start = |name: &str| layout.range(name).expect("the layout of a trunk").start;
        let conv = Convolutions::new(config);
        let fc1 = Linear::new(conv.features(), config.laser_feature);
        let fc2 = Linear::new(config.concat_len(), config.hidden);
        let head_offsets =
            heads.iter().map(|(name, _)| (start(&format!("{name}.weight")), start(&format!("{name}.bias"))));
        let at = Offsets {
            fc1_weight: start("fc1.weight"),
            fc1_bias: start("fc1.bias"),
            embedding: start("embedding.weight"),
            fc2_weight: start("fc2.weight"),
            fc2_bias: start("fc2.bias"),
        };
        let mut network = Self {
            isa,
            config: config.clone(),
            permutation: permutation(config, &layout, &fc1, &fc2),
            parameters: AlignedVec::zeros(layout.len()),
            gradient: AlignedVec::zeros(layout.len()),
            conv,
            fc1,
            fc2,
            head: Head::new(config.hidden, head_offsets.collect()),
            activations: heads.iter().map(|(_, activation)| *activation).collect(),
            at,
            transposed: Transposed {
                fresh: false,
                conv2: AlignedVec::zeros(TRANSPOSED2_LEN),
                fc1: AlignedVec::zeros(fc1.transposed_len()),
                fc2: AlignedVec::zeros(fc2.transposed_len()),
            },
            memory: Memory::default(),
            pool: Pool::default(),
            kept: None,
            layout: Arc::new(layout),
        };
        network.parameters.copy_from_slice(&network.permutation.to_native(parameters.flat()));
        network.parameters_changed();
        Ok(network)
    }

    /// Masks of a chunk's `x`; 0 where nothing is left out.
    pub(super) fn masks_len(&self, chunks: &Chunks) -> usize {
        if self.fc1.may_leave_out_zeros(chunks.size) { self.fc1.spans() * chunks.size } else { 0 }
    }

    /// The outputs, and how the batch was cut unless it is empty; `keep` says whether a backward
    /// pass may follow.
    fn outputs_of(&mut self, batch: Batch<'_>, keep: bool, outputs: &mut [f32]) -> Option<Chunks> {
        assert_eq!(outputs.len(), batch.len() * self.n_outputs(), "outputs of {} rows", batch.len());
        self.kept = None;
        if batch.is_empty() {
            return None;
        }
        let chunks = self.run(batch, keep);
        outputs.copy_from_slice(&self.memory.outputs);
        Some(chunks)
    }

    /// Computes the outputs into `memory`. Without a backward pass to `keep` them for, padded scans
    /// and convolutions' outputs are in a task's scratch memory, where the second-level cache holds
    /// them for the next chunk.
    fn run(&mut self, batch: Batch<'_>, keep: bool) -> Chunks {
        let width = self.config.input_len();
        if let Err(error) = batch.check(width, self.config.n_behaviours) {
            panic!("{error}");
        }
        let chunks = Chunks::new(batch.len());
        let (n_outputs, masks_len) = (self.head.n_outputs(), self.masks_len(&chunks));
        let memory = &mut self.memory;
        let (scans_len, x_len) = (chunks.size * self.conv.scans_len(), chunks.chunk_len(self.fc1.inputs()));
        let [kept_scans, kept_x] = [scans_len, x_len].map(|len| if keep { len } else { 0 });
        memory.scans.reserve_len(chunks.count * kept_scans);
        memory.x.reserve_len(chunks.count * kept_x);
        memory.concat.reserve_len(chunks.len(self.fc2.inputs()));
        memory.hidden.reserve_len(chunks.len(self.fc2.outputs()));
        memory.y.reserve_len(chunks.len(self.head.padded()));
        memory.outputs.resize(batch.len() * n_outputs, 0.0);
        memory.tokens.clear();
        memory.tokens.extend((0..batch.len()).map(|row| batch.token(row)));

        let model = Model {
            isa: self.isa,
            config: &self.config,
            parameters: &self.parameters,
            conv: &self.conv,
            fc1: &self.fc1,
            fc2: &self.fc2,
            head: &self.head,
            activations: &self.activations,
            at: &self.at,
        };
        let pool = &self.pool;
        let [concat_len, hidden_len, y_len] = [self.fc2.inputs(), self.fc2.outputs(), self.head.padded()]
            .map(|features| chunks.chunk_len(features));
        memory.masks.resize(chunks.count * masks_len, 0);
        let Memory { scans, x, masks, concat, hidden, y, outputs, .. } = memory;
        let slices = [
            (&mut scans[..], kept_scans),
            (&mut x[..], kept_x),
            (&mut concat[..], concat_len),
            (&mut hidden[..], hidden_len),
            (&mut y[..], y_len),
            (&mut outputs[..], chunks.size * n_outputs),
        ];
        let slices = (slices, (&mut masks[..], masks_len));
        for_each_piece(chunks.count, slices, &|chunk, ([scans, x, concat, hidden, y, outputs], masks)| {
            pool.with(model.conv, |scratch| {
                let Scratch { conv, scans: own_scans, x: own_x, .. } = scratch;
                let (mut scans, mut x) = (scans, x);
                if !keep {
                    own_scans.reserve_len(scans_len);
                    own_x.reserve_len(x_len);
                    (scans, x) = (&mut own_scans[..scans_len], &mut own_x[..x_len]);
                }
                let part = ForwardPart { chunk, scans, x, masks, concat, hidden, y, outputs };
                model.forward(batch, &chunks, part, conv);
            });
        });
        chunks
    }
}

/// One chunk's memory in a forward pass.
struct ForwardPart<'a> {
    chunk: usize,
    scans: &'a mut [f32],
    x: &'a mut [f32],
    masks: &'a mut [u64],
    concat: &'a mut [f32],
    hidden: &'a mut [f32],
    y: &'a mut [f32],
    outputs: &'a mut [f32],
}

/// The data that all tasks of a forward pass read.
struct Model<'a> {
    isa: Isa,
    config: &'a NetworkConfig,
    parameters: &'a [f32],
    conv: &'a Convolutions,
    fc1: &'a Linear,
    fc2: &'a Linear,
    head: &'a Head,
    activations: &'a [Activation],
    at: &'a Offsets,
}

impl Model<'_> {
    /// One chunk, from observations to outputs.
    fn forward(&self, batch: Batch<'_>, chunks: &Chunks, part: ForwardPart<'_>, scratch: &mut ConvScratch) {
        let ForwardPart { chunk, scans, x, masks, concat, hidden, y, outputs } = part;
        let (rows, first) = (chunks.rows(chunk), chunks.first(chunk));
        let (isa, p) = (self.isa, self.parameters);
        let width = self.config.input_len();
        let conv = conv_parts(self.conv, p);
        for (row, scans) in scans.chunks_exact_mut(self.conv.scans_len()).take(rows).enumerate() {
            let observation = batch.observation(first + row, width);
            if row + 1 < rows {
                prefetch(batch.observation(first + row + 1, width));
            }
            self.conv.pad(observation, scans);
            self.conv.forward(isa, conv, scans, scratch, &mut x[row * BLOCK..], chunks.block_stride());
            if !masks.is_empty() {
                let (x, masks) = (&x[row * BLOCK..], &mut masks[row..]);
                self.fc1.mask_row(isa, x, chunks.block_stride(), masks, chunks.size);
            }
            let feature = self.fc1.outputs();
            chunks.write_row(concat, row, feature, &observation[width - TAIL_LEN..]);
            let token = batch.token(first + row) as usize;
            let embedding = &p[self.at.embedding + token * self.config.embedding..][..self.config.embedding];
            chunks.write_row(concat, row, feature + TAIL_LEN, embedding);
        }
        let at = self.at;
        self.fc1.forward_behind_relu(
            isa,
            &p[at.fc1_weight..],
            &p[at.fc1_bias..],
            Forward::new(chunks, chunk, x, concat, true),
            masks,
        );
        self.fc2.forward(
            isa,
            &p[at.fc2_weight..],
            &p[at.fc2_bias..],
            Forward::new(chunks, chunk, concat, hidden, true),
        );
        self.head.forward(isa, Forward::new(chunks, chunk, hidden, y, false));
        let n_outputs = self.activations.len();
        for (row, outputs) in outputs.chunks_exact_mut(n_outputs).enumerate() {
            for ((idx, output), activation) in outputs.iter_mut().enumerate().zip(self.activations) {
                *output = activation.value(y[row * BLOCK + idx]);
            }
        }
    }
}

/// The convolutions' part of a flat vector in native order: the first four tensors of a trunk.
pub(super) fn conv_parts<'a>(conv: &Convolutions, flat: &'a [f32]) -> ConvParts<&'a [f32]> {
    let (weight1, rest) = flat.split_at(conv.weights1());
    let (bias1, rest) = rest.split_at(PANEL);
    let (weight2, rest) = rest.split_at(CONV2_KERNEL * PANEL * PANEL);
    ConvParts { weight1, bias1, weight2, bias2: &rest[..PANEL] }
}

/// Canonical to native order of a trunk.
fn permutation(config: &NetworkConfig, layout: &Layout, fc1: &Linear, fc2: &Linear) -> Permutation {
    let mut permutation = Permutation::identity(layout.len());
    let mut reorder = |name: &str, native_index: &dyn Fn(usize) -> usize| {
        let range = layout.range(name).expect("the layout of a trunk");
        permutation.reorder(range.start, range.len(), native_index);
    };
    // [channel, frame, kernel] → [frame, kernel, channel].
    let window = config.frames * CONV1_KERNEL;
    reorder("conv1.weight", &|idx| idx % window * PANEL + idx / window);
    // [channel, input, kernel] → [kernel, input, channel].
    reorder("conv2.weight", &|idx| {
        let (channel, input, kernel) =
            (idx / (PANEL * CONV2_KERNEL), idx / CONV2_KERNEL % PANEL, idx % CONV2_KERNEL);
        (kernel * PANEL + input) * PANEL + channel
    });
    // [output, channel · positions + position] → inputs as position · 32 + channel.
    let (flat, positions) = (config.flat_len(), config.conv2_len());
    reorder("fc1.weight", &|idx| {
        let (output, input) = (idx / flat, idx % flat);
        fc1.index(input % positions * PANEL + input / positions, output)
    });
    let concat = config.concat_len();
    reorder("fc2.weight", &|idx| fc2.index(idx % concat, idx / concat));
    permutation
}

impl Network for FastNetwork {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn n_outputs(&self) -> usize {
        self.head.n_outputs()
    }

    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.outputs_of(batch, false, outputs);
    }

    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.kept = self.outputs_of(batch, true, outputs);
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        let chunks = self.kept.expect("backward comes after a forward of at least one row");
        assert_eq!(d_outputs.len(), chunks.batch * self.n_outputs(), "gradient of {} rows", chunks.batch);
        self.run_backward(&chunks, d_outputs);
    }

    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut self.parameters, &mut self.gradient)
    }

    fn parameters_changed(&mut self) {
        self.head.load(self.isa, &self.parameters);
        self.transposed.fresh = false;
        self.kept = None;
    }

    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        self.permutation.to_canonical(native)
    }

    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        self.permutation.to_native(canonical)
    }
}
