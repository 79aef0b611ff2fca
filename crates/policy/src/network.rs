//! The interface of every network, on any back end.

use serde::{Deserialize, Serialize};

use crate::batch::Batch;
use crate::layout::Layout;

/// The software that computes the networks.
///
/// Both give the same numbers up to rounding, and a test holds them together; within one back end
/// the bits are the same at any number of threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// Hand-shaped kernels on the CPU: the default.
    #[default]
    Fast,
    /// The candle model: the definition to study and to compare with; on a GPU with the features
    /// `cuda` and `metal` ([`Device`](crate::Device)).
    Reference,
}

/// A network with a flat vector of parameters and a gradient of the same shape.
///
/// An optimiser steps the flat vector in place and then calls
/// [`parameters_changed`](Self::parameters_changed):
///
/// ```text
/// network.forward(batch, &mut outputs);           // keeps the inputs of backward
/// network.backward(&d_loss_d_outputs);            // overwrites the gradient
/// let (parameters, gradient) = network.parameters_and_gradient();
/// adam.step(parameters, gradient);
/// network.parameters_changed();
/// ```
///
/// # Shapes
///
/// `outputs` and `d_outputs` are `[B, n_outputs]`, row-major, with B = [`Batch::len`].
pub trait Network: Send {
    /// Names, shapes and canonical offsets.
    fn layout(&self) -> &Layout;

    /// Values per row: 2 for the actor (mean v behind the sigmoid, mean ω behind tanh), 1 for the
    /// critic.
    fn n_outputs(&self) -> usize;

    /// Computes the outputs and keeps nothing.
    ///
    /// # Panics
    ///
    /// If the batch or the length of `outputs` does not fit ([`Batch::check`]), or if a GPU fails.
    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]);

    /// Computes the outputs and keeps the values that [`backward`](Self::backward) needs.
    ///
    /// # Panics
    ///
    /// As [`infer`](Self::infer).
    fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]);

    /// Overwrites the gradient with that of Σ `outputs` · `d_outputs`, for the batch of the last
    /// [`forward`](Self::forward).
    ///
    /// Parameters that the outputs do not depend on (the actor's `log_std`) are left to the caller:
    /// their entries stay as they are.
    ///
    /// # Panics
    ///
    /// If no `forward` came before, or if the length of `d_outputs` is not that of its outputs.
    fn backward(&mut self, d_outputs: &[f32]);

    /// The parameters and their gradient, in the back end's own order.
    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]);

    /// To be called after a change of the parameters, before the next pass.
    fn parameters_changed(&mut self);

    /// A vector in the back end's order (parameters, gradient, moments of an optimiser), put in
    /// canonical order.
    fn to_canonical(&self, native: &[f32]) -> Vec<f32>;

    /// The inverse of [`to_canonical`](Self::to_canonical). Both are exact permutations.
    fn to_native(&self, canonical: &[f32]) -> Vec<f32>;
}
