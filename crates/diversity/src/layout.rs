//! Shape and initialisation of a discriminator: input → hidden, `ReLU` → hidden, `ReLU` → M logits;
//! and the one place that chooses what computes it.
//!
//! Names and shapes are PyTorch's (`fc1.weight` [hidden, input] …); the fill is PyTorch's default
//! for linear layers, uniform in ±1/√`fan_in`.

use jostle_policy::fast;
use jostle_policy::reference::CandleNetwork;
use jostle_policy::{Backend, Engine, Layout, Network, Parameters};

use crate::DiversityError;
use crate::reference::Mlp;

/// Sizes of a discriminator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiscriminatorShape {
    /// Values in an input row.
    pub n_inputs: usize,
    /// Units of each hidden layer.
    pub hidden: usize,
    /// Logits, one for each behaviour.
    pub n_behaviours: usize,
}

impl DiscriminatorShape {
    /// The ordered tensors.
    ///
    /// # Examples
    ///
    /// ```
    /// use jostle_diversity::DiscriminatorShape;
    /// // The paper's q(z|s) for M = 5: 1540·128 + 128 + 128·128 + 128 + 128·5 + 5.
    /// let shape = DiscriminatorShape { n_inputs: 1540, hidden: 128, n_behaviours: 5 };
    /// assert_eq!(shape.layout().len(), 214_405);
    /// ```
    pub fn layout(&self) -> Layout {
        let mut layout = Layout::new();
        layout.push_linear("fc1", self.n_inputs, self.hidden);
        layout.push_linear("fc2", self.hidden, self.hidden);
        layout.push_linear("out", self.hidden, self.n_behaviours);
        layout
    }
}

/// A discriminator as a [`Network`]: rows [B, `n_inputs`] to logits `[B, M]`. The tokens of a batch
/// are not read.
///
/// # Errors
///
/// [`DiversityError::Network`] when the parameters are not of this shape, candle's device is not
/// there, or `hidden` is no multiple of 32 on the fast back end.
pub fn discriminator(
    shape: DiscriminatorShape,
    engine: impl Into<Engine>,
    parameters: &Parameters,
) -> Result<Box<dyn Network>, DiversityError> {
    parameters.check_layout(&shape.layout())?;
    let engine = engine.into();
    engine.validate()?;
    match engine.backend {
        Backend::Fast => {
            let DiscriminatorShape { n_inputs, hidden, n_behaviours } = shape;
            Ok(Box::new(fast::Mlp::new(n_inputs, hidden, n_behaviours, parameters)?))
        }
        Backend::Reference => {
            Ok(Box::new(CandleNetwork::new(Mlp::new(shape), parameters, engine.device.open()?)?))
        }
    }
}
