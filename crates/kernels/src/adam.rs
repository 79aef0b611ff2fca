//! One step of Adam over flat vectors, in one pass.
//!
//! # Formula
//!
//! ```text
//! m ← β₁·m + (1 − β₁)·g          v ← β₂·v + (1 − β₂)·g²
//! p ← p − lr/(1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)
//! ```
//!
//! ε is outside the root and there is no weight decay, as in PyTorch's `Adam`. The step is element
//! by element, so any order of the parameters does and the bits do not depend on threads or on the
//! instruction set (no multiply-add is fused).
//!
//! # References
//!
//! Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015, arXiv:1412.6980,
//! algorithm 1.

use crate::dispatch::{Isa, on_set};
use crate::pieces::for_each_piece;

/// Constants of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamStep {
    /// Learning rate.
    pub learning_rate: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Number of this step, t ≥ 1.
    pub step: u64,
}

/// The constants as the loop uses them.
#[derive(Debug, Clone, Copy)]
struct Factors {
    beta1: f32,
    rest1: f32,
    beta2: f32,
    rest2: f32,
    step_size: f32,
    root_correction: f32,
    epsilon: f32,
}

impl AdamStep {
    fn factors(&self) -> Factors {
        let exponent = self.step as f64;
        Factors {
            beta1: self.beta1 as f32,
            rest1: (1.0 - self.beta1) as f32,
            beta2: self.beta2 as f32,
            rest2: (1.0 - self.beta2) as f32,
            step_size: (self.learning_rate / (1.0 - self.beta1.powf(exponent))) as f32,
            root_correction: (1.0 - self.beta2.powf(exponent)).sqrt() as f32,
            epsilon: self.epsilon as f32,
        }
    }
}

/// Elements of one task.
const PART: usize = 1 << 16;

/// Steps `parameters` along `gradient` and updates both moments.
///
/// # Panics
///
/// If the lengths differ or `step.step` is 0.
pub fn adam_step(
    isa: Isa,
    parameters: &mut [f32],
    gradient: &[f32],
    m: &mut [f32],
    v: &mut [f32],
    step: &AdamStep,
) {
    assert!(step.step > 0, "steps are counted from 1");
    let lengths = [gradient.len(), m.len(), v.len()];
    assert!(
        lengths.iter().all(|len| *len == parameters.len()),
        "{} parameters, {lengths:?}",
        parameters.len()
    );
    let factors = step.factors();
    let count = gradient.len().div_ceil(PART);
    for_each_piece(count, [(parameters, PART), (m, PART), (v, PART)], &|part, [parameters, m, v]| {
        let gradient = &gradient[part * PART..][..parameters.len()];
        // SAFETY: no condition but the set.
        unsafe { on_set!(isa, step(parameters, gradient, m, v, &factors)) }
    });
}

/// The step itself.
#[inline(always)]
#[allow(clippy::inline_always, reason = "it must be inlined into what is compiled for a set")]
fn step_piece(parameters: &mut [f32], gradient: &[f32], m: &mut [f32], v: &mut [f32], factors: &Factors) {
    let Factors { beta1, rest1, beta2, rest2, step_size, root_correction, epsilon } = *factors;
    for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(m).zip(v) {
        *m = beta1 * *m + rest1 * g;
        *v = beta2 * *v + rest2 * (g * g);
        *p -= step_size * (*m / (v.sqrt() / root_correction + epsilon));
    }
}

/// [`step_piece`] for one set. Not by [`Isa::run`](crate::Isa::run): with operands in a struct
/// instead of arguments, which the compiler knows to be apart, a step takes 1.4 times as long with
/// AVX-512.
macro_rules! step {
    ($set:ident $(#[$feature:meta])?) => {
        mod $set {
            use super::{Factors, step_piece};

            /// # Safety
            ///
            /// The instruction set.
            $(#[$feature])?
            pub(super) unsafe fn step(
                parameters: &mut [f32],
                gradient: &[f32],
                m: &mut [f32],
                v: &mut [f32],
                factors: &Factors,
            ) {
                step_piece(parameters, gradient, m, v, factors);
            }
        }
    };
}
#[cfg(target_arch = "x86_64")]
step!(avx512 #[target_feature(enable = "avx512f")]);
#[cfg(target_arch = "x86_64")]
step!(avx2 #[target_feature(enable = "avx2")]);
step!(plain);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_formula_in_double_precision() {
        for isa in Isa::available() {
            let n = 131;
            let mut p: Vec<f32> = (0..n).map(|i| (i as f32 * 0.37).sin()).collect();
            let (mut m, mut v) = (vec![0.0; n], vec![0.0; n]);
            let mut oracle: Vec<[f64; 3]> = p.iter().map(|p| [f64::from(*p), 0.0, 0.0]).collect();
            for t in 1..=5 {
                let g: Vec<f32> = (0..n).map(|i| (i as f32 + 3.0 * t as f32).cos() * 0.1).collect();
                let step = AdamStep { learning_rate: 1e-2, beta1: 0.9, beta2: 0.999, epsilon: 1e-8, step: t };
                adam_step(isa, &mut p, &g, &mut m, &mut v, &step);
                for ([p, m, v], g) in oracle.iter_mut().zip(&g) {
                    let g = f64::from(*g);
                    *m = 0.9 * *m + 0.1 * g;
                    *v = 0.999 * *v + 0.001 * g * g;
                    let (m_hat, v_hat) =
                        (*m / (1.0 - 0.9_f64.powf(t as f64)), *v / (1.0 - 0.999_f64.powf(t as f64)));
                    *p -= 1e-2 * m_hat / (v_hat.sqrt() + 1e-8);
                }
            }
            for (p, [expected, ..]) in p.iter().zip(&oracle) {
                assert!((f64::from(*p) - expected).abs() < 1e-6, "{p} {expected}");
            }
        }
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let run = |isa| {
            let n = 100_003;
            let mut p: Vec<f32> = (0..n).map(|i| (i as f32 * 0.01).sin()).collect();
            let g: Vec<f32> = p.iter().map(|p| p * p - 0.3).collect();
            let (mut m, mut v) = (vec![0.5; n], vec![0.25; n]);
            let step = AdamStep { learning_rate: 1e-3, beta1: 0.9, beta2: 0.999, epsilon: 1e-8, step: 3 };
            adam_step(isa, &mut p, &g, &mut m, &mut v, &step);
            (p, m, v)
        };
        let first = run(Isa::detect());
        assert!(Isa::available().into_iter().all(|isa| run(isa) == first));
    }
}
