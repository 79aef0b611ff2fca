//! Any candle model behind the [`Network`] interface.

use std::sync::Arc;

use candle_core::{Device, Result, Tensor};

use super::{Model, Weights};
use crate::batch::Batch;
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::network::Network;
use crate::parameters::Parameters;

/// A [`Model`] with its parameters and gradient. The native order is the canonical one.
#[derive(Debug)]
pub struct CandleNetwork<M> {
    model: M,
    device: Device,
    layout: Arc<Layout>,
    parameters: Vec<f32>,
    gradient: Vec<f32>,
    weights: Weights,
    /// The outputs of the last forward pass, with their graph.
    kept: Option<Tensor>,
}

impl<M: Model> CandleNetwork<M> {
    /// A network with these parameters on this device.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Parameters`] if the parameters are not of the model's layout,
    /// [`PolicyError::Candle`] if the device refuses.
    pub fn new(model: M, parameters: &Parameters, device: Device) -> std::result::Result<Self, PolicyError> {
        parameters.check_layout(&model.layout())?;
        let layout = Arc::clone(parameters.layout());
        let parameters = parameters.flat().to_vec();
        let weights = Weights::variables(Arc::clone(&layout), &parameters, &device)?;
        let gradient = vec![0.0; parameters.len()];
        Ok(Self { model, device, layout, parameters, gradient, weights, kept: None })
    }

    /// The model.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// The weights that autograd follows, to differentiate a loss of one's own.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The rows of a batch as tensors: observations `[B, width]` and tokens `[B]`.
    ///
    /// # Panics
    ///
    /// If the batch does not fit the model ([`Batch::check`]).
    pub fn tensors(&self, batch: Batch<'_>) -> Result<(Tensor, Tensor)> {
        let width = self.model.observation_len();
        if let Err(error) = batch.check(width, self.model.n_behaviours()) {
            panic!("{error}");
        }
        let rows: Vec<f32> =
            (0..batch.len()).flat_map(|idx| batch.observation(idx, width)).copied().collect();
        let tokens: Vec<u32> = (0..batch.len()).map(|idx| batch.token(idx)).collect();
        let observations = Tensor::from_vec(rows, (batch.len(), width), &self.device)?;
        Ok((observations, Tensor::from_vec(tokens, batch.len(), &self.device)?))
    }

    fn run(&self, weights: &Weights, batch: Batch<'_>, outputs: &mut [f32]) -> Result<Tensor> {
        let (observations, tokens) = self.tensors(batch)?;
        let tensor = self.model.forward(weights, &observations, &tokens)?;
        outputs.copy_from_slice(&tensor.flatten_all()?.to_vec1::<f32>()?);
        Ok(tensor)
    }

    fn differentiate(&mut self, d_outputs: &[f32]) -> std::result::Result<(), PolicyError> {
        let outputs = self.kept.take().expect("backward needs a forward pass before it");
        let d_outputs = Tensor::from_slice(d_outputs, outputs.dims(), &self.device)?;
        let weighted = (outputs * d_outputs)?.sum_all()?;
        self.weights.gradient(&weighted, &mut self.gradient)
    }
}

/// The one reason for candle to fail here: its device does (memory, driver); shapes were checked.
const DEVICE: &str = "candle's device failed";

impl<M: Model> Network for CandleNetwork<M> {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn n_outputs(&self) -> usize {
        self.model.n_outputs()
    }

    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        assert_eq!(outputs.len(), batch.len() * self.n_outputs(), "length of the outputs");
        if !batch.is_empty() {
            self.run(&self.weights.detached(), batch, outputs).expect(DEVICE);
        }
    }

    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        assert_eq!(outputs.len(), batch.len() * self.n_outputs(), "length of the outputs");
        assert!(!batch.is_empty(), "an empty batch has no gradient");
        self.kept = Some(self.run(&self.weights, batch, outputs).expect(DEVICE));
    }

    fn backward(&mut self, d_outputs: &[f32]) {
        self.differentiate(d_outputs).expect(DEVICE);
    }

    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut self.parameters, &mut self.gradient)
    }

    fn parameters_changed(&mut self) {
        self.kept = None;
        self.weights =
            Weights::variables(Arc::clone(&self.layout), &self.parameters, &self.device).expect(DEVICE);
    }

    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        assert_eq!(native.len(), self.layout.len(), "one value for each parameter");
        native.to_vec()
    }

    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        assert_eq!(canonical.len(), self.layout.len(), "one value for each parameter");
        canonical.to_vec()
    }
}
