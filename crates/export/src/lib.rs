//! Policies for software that knows nothing of jostle.
//!
//! Reading order: [`onnx`] (a policy's network as an ONNX model), `onnx/proto.rs` (the parts of the
//! format that it needs).
//!
//! Architecture invariants: nothing here learns, simulates or reads a clock; the same policy gives
//! the same bytes.

#![forbid(unsafe_code)]

pub mod error;
pub mod onnx;

pub use error::ExportError;
