//! A network behind its encoder: it takes observation rows, as everyone outside training has them.

use super::{Encoder, EncoderScratch};
use crate::batch::Batch;
use crate::layout::Layout;
use crate::network::Network;

/// A network that encodes the rows of a batch before it reads them.
pub struct EncodedNetwork {
    encoder: Encoder,
    network: Box<dyn Network>,
    scratch: EncoderScratch,
    inputs: Vec<f32>,
    tokens: Vec<u32>,
}

impl EncodedNetwork {
    /// Puts an encoder before a network.
    pub fn new(encoder: Encoder, network: Box<dyn Network>) -> Self {
        let scratch = EncoderScratch::default();
        Self { encoder, network, scratch, inputs: Vec::new(), tokens: Vec::new() }
    }

    /// The batch's rows, encoded.
    fn encode(&mut self, batch: Batch<'_>) {
        let width = self.encoder.observation_len();
        // The tokens are the network's to judge.
        if let Err(error) = batch.check(width, usize::MAX) {
            panic!("{error}");
        }
        self.inputs.clear();
        self.tokens.clear();
        for row in 0..batch.len() {
            self.encoder.append(batch.observation(row, width), &mut self.scratch, &mut self.inputs);
            self.tokens.push(batch.token(row));
        }
    }
}

impl Network for EncodedNetwork {
    fn layout(&self) -> &Layout {
        self.network.layout()
    }

    fn n_outputs(&self) -> usize {
        self.network.n_outputs()
    }

    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.encode(batch);
        self.network.infer(Batch::new(&self.inputs, &self.tokens), outputs);
    }

    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        self.encode(batch);
        self.network.forward(Batch::new(&self.inputs, &self.tokens), outputs);
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        self.network.backward(d_outputs);
    }

    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        self.network.parameters_and_gradient()
    }

    fn parameters_changed(&mut self) {
        self.network.parameters_changed();
    }

    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        self.network.to_canonical(native)
    }

    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        self.network.to_native(canonical)
    }
}
