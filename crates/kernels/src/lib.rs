//! The arithmetic of the networks on a CPU: few, large, well-shaped matrix products over memory
//! that is allocated once, and Adam.
//!
//! Reading order: [`operands`] and [`dense`] (the two products that everything is made of),
//! [`blocked`] (the one format of activations), [`linear`] and [`head`] (layers), [`sparse`]
//! (products that leave out the zeros of a ReLU), [`adam`]. `lanes` has one register of each
//! instruction set; a product has one body, which is compiled for each, and [`dispatch`] chooses.
//!
//! # Stability
//!
//! None: this crate is internal to the workspace. Its interface follows what the networks of
//! `jostle-policy` need, and it changes without notice.
//!
//! # Safety
//!
//! All functions here are safe: they check the lengths of their operands and panic if one is too
//! short. `unsafe` is confined to the few functions that use vector instructions ([`Isa`] proves
//! that the processor has them) and to [`AlignedVec`]'s view of its memory. Tests compare every set
//! with sums in double precision, at odd sizes.
//!
//! # Determinism
//!
//! Work is divided at boundaries that depend on sizes only, and every sum is made in one order:
//! results have the same bits at any number of threads, and with AVX-512 as with AVX2. Plain Rust
//! does not fuse multiply-adds and rounds otherwise.

// Not `forbid`: the modules with vector instructions are excepted below, one by one.
#![deny(unsafe_code)]

#[allow(unsafe_code, reason = "calls functions compiled for one instruction set")]
pub mod adam;
#[allow(unsafe_code, reason = "a view of cache lines as floats")]
pub mod aligned;
pub mod blocked;
#[allow(
    unsafe_code,
    reason = "calls functions compiled for one instruction set, with operands that are checked before"
)]
pub mod dense;
#[allow(unsafe_code, reason = "calls functions compiled for one instruction set, which the processor has")]
pub mod dispatch;
pub mod head;
#[allow(unsafe_code, reason = "vector instructions")]
mod lanes;
pub mod linear;
pub mod operands;
mod pieces;
#[allow(unsafe_code, reason = "an instruction that has no effect but on the cache")]
mod prefetch;
#[allow(
    unsafe_code,
    reason = "calls functions compiled for one instruction set, with operands that are checked before"
)]
pub mod sparse;
mod tile;
#[allow(
    unsafe_code,
    reason = "calls functions compiled for one instruction set, with operands that are checked before"
)]
mod transpose;

#[cfg(test)]
mod tests;

pub use adam::{AdamStep, adam_step};
pub use aligned::AlignedVec;
pub use blocked::{BLOCK, Chunks};
pub use dense::{outer_products, rows_times_panel};
pub use dispatch::{Isa, Work};
pub use head::Head;
pub use linear::{Forward, Linear};
pub use operands::{Count, Finish, Grid, HALF, PANEL, Start, Steps, Strips};
pub use pieces::{Pieces, for_each_piece};
pub use prefetch::prefetch;
pub use sparse::{SampleForward, SampleGradient, SampleMasks};
