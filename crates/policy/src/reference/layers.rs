//! The small layers of the model: candle-nn's, on the tensors of [`Weights`].

use candle_core::{Module as _, Result, Tensor};

use super::Weights;

/// y = x·Wᵀ + b with PyTorch's `W` `[outputs, inputs]`.
///
/// # Shapes
///
/// `xs` `[B, inputs]` → `[B, outputs]`
pub fn linear(xs: &Tensor, weights: &Weights, name: &str) -> Result<Tensor> {
    let weight = weights.get(&format!("{name}.weight"))?;
    let bias = weights.get(&format!("{name}.bias"))?;
    candle_nn::Linear::new(weight.clone(), Some(bias.clone())).forward(xs)
}

/// The row of each index in a table, here `[M, width]`.
///
/// # Shapes
///
/// `indices` `[B]` (U32) → `[B, width]`
pub fn embedding(indices: &Tensor, weights: &Weights, name: &str) -> Result<Tensor> {
    let table = weights.get(&format!("{name}.weight"))?;
    candle_nn::Embedding::new(table.clone(), table.dim(1)?).forward(indices)
}

/// max(x, 0), with gradient 0 at 0.
///
/// candle's own `relu` has gradient 1 there; PyTorch's, whose numbers we are compared with, 0.
pub fn relu(xs: &Tensor) -> Result<Tensor> {
    let positive = xs.detach().gt(0_f32)?.to_dtype(xs.dtype())?;
    xs * positive
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    #[test]
    fn relu_passes_no_gradient_at_zero() {
        let xs = Var::new(&[-1.0_f32, 0.0, 2.0], &Device::Cpu).unwrap();
        let ys = relu(&xs).unwrap();
        assert_eq!(ys.to_vec1::<f32>().unwrap(), [0.0, 0.0, 2.0]);
        let gradients = ys.sum_all().unwrap().backward().unwrap();
        assert_eq!(gradients.get(&xs).unwrap().to_vec1::<f32>().unwrap(), [0.0, 0.0, 1.0]);
    }
}
