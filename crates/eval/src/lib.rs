//! The six unseen crowds, paired episodes, metrics, intervals and reports.
#![forbid(unsafe_code)]

pub mod metrics;
pub mod outcome;
pub mod statistics;
