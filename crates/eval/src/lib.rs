//! The six unseen crowds, paired episodes, metrics, intervals and reports.
#![forbid(unsafe_code)]

pub mod cell;
pub mod error;
pub mod identity;
pub mod metrics;
pub mod outcome;
pub mod paper;
pub mod records;
pub mod report;
pub mod statistics;

pub use error::EvalError;
