//! A network's parameters as an ordered list of candle tensors.

use std::sync::Arc;

use candle_core::{Device, Result, Tensor, Var};

use crate::error::PolicyError;
use crate::layout::Layout;

/// One tensor for each entry of a layout, in its order.
///
/// candle's `VarMap` is a hash map, whose order changes from run to run; this is a list.
#[derive(Debug, Clone)]
pub struct Weights {
    layout: Arc<Layout>,
    tensors: Vec<Tensor>,
}

impl Weights {
    /// Tensors that autograd follows, filled from a flat vector in canonical order.
    ///
    /// # Errors
    ///
    /// If the device refuses, or if `flat` is not as long as the layout.
    pub fn variables(layout: Arc<Layout>, flat: &[f32], device: &Device) -> Result<Self> {
        let make = |range: std::ops::Range<usize>, shape: &[usize]| -> Result<Tensor> {
            let values = flat.get(range).unwrap_or_default();
            Ok(Var::from_slice(values, shape, device)?.into_inner())
        };
        let tensors =
            layout.entries().iter().map(|entry| make(entry.range(), &entry.shape)).collect::<Result<_>>()?;
        Ok(Self { layout, tensors })
    }

    /// The same values (not copied), cut off from autograd: a pass over them keeps no graph.
    #[must_use]
    pub fn detached(&self) -> Self {
        let tensors = self.tensors.iter().map(Tensor::detach).collect();
        Self { layout: Arc::clone(&self.layout), tensors }
    }

    /// The tensor of that name.
    ///
    /// # Errors
    ///
    /// If the layout has no such tensor.
    pub fn get(&self, name: &str) -> Result<&Tensor> {
        let position = self.layout.entries().iter().position(|entry| entry.name == name);
        position
            .map(|idx| &self.tensors[idx])
            .ok_or_else(|| candle_core::Error::CannotFindTensor { path: name.to_owned() })
    }

    /// Names, shapes and offsets.
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// The tensors in the layout's order.
    pub fn tensors(&self) -> &[Tensor] {
        &self.tensors
    }

    /// The gradients of `loss`, written to `flat` in canonical order. Entries of tensors that the
    /// loss does not depend on stay as they are.
    ///
    /// # Errors
    ///
    /// If candle's backward pass fails.
    pub fn gradient(&self, loss: &Tensor, flat: &mut [f32]) -> std::result::Result<(), PolicyError> {
        let gradients = loss.backward()?;
        for (entry, tensor) in self.layout.entries().iter().zip(&self.tensors) {
            if let Some(gradient) = gradients.get(tensor) {
                flat[entry.range()].copy_from_slice(&gradient.flatten_all()?.to_vec1::<f32>()?);
            }
        }
        Ok(())
    }
}
