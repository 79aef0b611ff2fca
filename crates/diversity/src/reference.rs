//! The discriminator as a candle model: the definition to study, to compare with, and to run on a
//! GPU.
//!
//! The same in PyTorch:
//!
//! ```text
//! x = relu(fc1(x))      # [B, input] → [B, hidden]
//! x = relu(fc2(x))      #            → [B, hidden]
//! logits = out(x)       #            → [B, M]
//! ```

use candle_core::{Result, Tensor};
use jostle_policy::Layout;
use jostle_policy::reference::layers::{linear, relu};
use jostle_policy::reference::{Model, Weights};

use crate::DiscriminatorShape;

/// A discriminator as a pure function of its weights. Behaviour tokens are its answer, so it
/// ignores those it is given.
#[derive(Debug, Clone, Copy)]
pub struct Mlp {
    shape: DiscriminatorShape,
}

impl Mlp {
    /// A discriminator of this shape.
    pub fn new(shape: DiscriminatorShape) -> Self {
        Self { shape }
    }
}

impl Model for Mlp {
    fn layout(&self) -> Layout {
        self.shape.layout()
    }

    fn observation_len(&self) -> usize {
        self.shape.n_inputs
    }

    fn n_behaviours(&self) -> usize {
        self.shape.n_behaviours
    }

    fn n_outputs(&self) -> usize {
        self.shape.n_behaviours
    }

    fn forward(&self, weights: &Weights, rows: &Tensor, _tokens: &Tensor) -> Result<Tensor> {
        let hidden = relu(&linear(rows, weights, "fc1")?)?;
        let hidden = relu(&linear(&hidden, weights, "fc2")?)?;
        linear(&hidden, weights, "out")
    }
}
