//! The fast back end: actor, critic and multi-layer perceptrons on the [`kernels`](jostle_kernels),
//! for any CPU.
//!
//! Reading order: `conv` (the convolutions), [`network`] (forward pass), `backward`, [`mlp`] (for
//! discriminators).
//!
//! Architecture invariant: no graph, no tape and no tensor type; a network is a fixed sequence of
//! products over memory that is allocated at the first batch and kept. Parameters, gradient and the
//! optimiser's moments live in the order that the kernels read (native); files and comparisons see
//! only canonical order.

mod backward;
mod conv;
pub mod mlp;
pub mod network;
mod permutation;

#[cfg(test)]
mod tests;

pub use mlp::Mlp;
pub use network::FastNetwork;

use jostle_kernels::PANEL;

use crate::error::PolicyError;

/// Refuses a layer's width that the kernels cannot hold in panels.
fn check_width(field: &'static str, found: usize) -> Result<(), PolicyError> {
    if found > 0 && found.is_multiple_of(PANEL) {
        Ok(())
    } else {
        let expected =
            format!("a multiple of {PANEL} on the fast back end (the reference back end takes any size)");
        Err(PolicyError::Config { field, found: found.to_string(), expected })
    }
}
