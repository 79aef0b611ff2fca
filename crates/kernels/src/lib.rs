//! The arithmetic of the networks on a CPU: few, large, well-shaped matrix products over memory that is allocated once, and Adam.
//!
//! Reading order: [`rows`] and [`outer`] (the two products that everything is made of), [`blocked`] (the one format of
//! activations), [`linear`] and [`head`] (layers), `sparse` and `sparse_conv` (what a ReLU saves), [`adam`].
//!
//! # Stability
//!
//! None: this crate is internal to the workspace. Its interface follows what the networks of `jostle-policy` need, and it
//! changes without notice.
//!
//! # Safety
//!
//! All functions here are safe: they check the lengths of their operands and panic if one is too short. `unsafe` is confined to
//! the few functions that use vector instructions ([`Isa`] proves that the processor has them) and to [`AlignedVec`]'s view of
//! its memory. Each product has a plain Rust version next to it, and tests hold them together at odd sizes.
//!
//! # Determinism
//!
//! Work is divided at boundaries that depend on sizes only, and every sum is made in one order: results have the same
//! bits at any number of threads, and with AVX-512 as with AVX2. Plain Rust does not fuse multiply-adds and rounds otherwise.

// Not `forbid`: the modules with vector instructions are excepted below, one by one.
#![deny(unsafe_code)]

#[allow(unsafe_code, reason = "vector instructions")]
pub mod adam;
#[allow(unsafe_code, reason = "a view of cache lines as floats")]
pub mod aligned;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "vector instructions")]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "vector instructions")]
mod avx2_sparse;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "vector instructions")]
mod avx512;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "vector instructions")]
mod avx512_sparse;
pub mod blocked;
pub mod head;
#[allow(unsafe_code, reason = "vector instructions")]
pub mod isa;
pub mod linear;
#[allow(unsafe_code, reason = "vector instructions")]
pub mod outer;
mod pieces;
#[allow(unsafe_code, reason = "vector instructions")]
mod prefetch;
#[allow(unsafe_code, reason = "vector instructions")]
pub mod rows;
#[allow(unsafe_code, reason = "vector instructions")]
mod sparse;
#[allow(unsafe_code, reason = "vector instructions")]
mod sparse_conv;
mod tile;
#[allow(unsafe_code, reason = "vector instructions")]
mod transpose;

#[cfg(test)]
mod tests;

pub use adam::{AdamStep, adam_step};
pub use aligned::AlignedVec;
pub use blocked::{BLOCK, Chunks};
pub use head::Head;
pub use isa::{Isa, Work};
pub use linear::{Forward, Linear};
pub use outer::{Count, Steps, outer_products};
pub use pieces::{Pieces, for_each_piece};
pub use prefetch::prefetch;
pub use rows::{Finish, Grid, HALF, PANEL, Start, Strips, rows_times_panel};
pub use sparse_conv::{SampleForward, SampleGradient, SampleMasks};
