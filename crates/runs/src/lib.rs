//! Run folders, and the policies that a path means.
//!
//! Reading order: [`folder`] (what `train` makes), [`policies`] (a file, a run folder, or a folder of either).
//!
//! Architecture invariants: the commands and the Python package find policies by this code only; nothing here trains, locks or
//! writes.

#![forbid(unsafe_code)]

pub mod error;
pub mod folder;
pub mod policies;

pub use error::RunsError;
