//! Kernels of the fast back end: few, large, well-shaped matrix products over memory that is allocated once.
//!
//! Reading order: [`rows`] and [`outer`] (the two products that everything is made of), [`blocked`] (the one format of
//! activations), [`linear`] and [`head`] (layers), `sparse` and `sparse_conv` (what a ReLU saves), [`adam`].
//!
//! All functions here are safe: they check lengths. `unsafe` is confined to this folder, to the few functions that use
//! vector instructions ([`Isa`] proves that the processor has them) and to [`AlignedVec`]'s view of its memory. Each
//! product has a plain Rust version next to it, and tests hold them together at odd sizes.
//!
//! # Determinism
//!
//! Work is divided at boundaries that depend on sizes alone, and every sum is made in one order: results have the same
//! bits at any number of threads, and with AVX-512 as with AVX2. Plain Rust does not fuse multiply-adds and rounds otherwise.

#![allow(unsafe_code)] // Vector intrinsics; see above.

pub mod adam;
pub mod aligned;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx2_sparse;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod avx512_sparse;
pub mod blocked;
pub mod head;
pub mod isa;
pub mod linear;
pub mod outer;
mod pieces;
mod prefetch;
pub mod rows;
mod sparse;
mod sparse_conv;
mod tile;
mod transpose;

#[cfg(test)]
pub(crate) mod tests;

pub use adam::{AdamStep, adam_step};
pub use aligned::AlignedVec;
pub use blocked::{BLOCK, Chunks};
pub use head::Head;
pub use isa::Isa;
pub use linear::{Forward, Linear};
pub use outer::{Count, Steps, outer_products};
pub(crate) use pieces::for_each_piece;
pub(crate) use prefetch::prefetch;
pub use rows::{Finish, Grid, HALF, PANEL, Start, Strips, rows_times_panel};
pub use sparse_conv::{SampleForward, SampleGradient, SampleMasks};
