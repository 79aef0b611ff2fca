//! Tests of a robot among crowds: paired episodes, records, statistics and reports (paper, section
//! "Experiments").
//!
//! Reading order: [`protocol`] (a policy in a crowd), [`suite`] (harder places), [`board`] (a
//! leaderboard of them); [`metrics`], [`driving`] and [`statistics`] (what is summed up, and how
//! sure it is), [`diversity`] (the metric D); [`cell`], [`records`] and [`compact`] (what is kept),
//! [`report`] (what is printed). The episodes themselves are `jostle_arena`'s.
//!
//! Architecture invariants: nothing here trains or knows the trainer; no result depends on the
//! clock, the number of threads or the lock step.

#![forbid(unsafe_code)]

pub mod board;
pub mod cell;
pub mod compact;
pub mod diversity;
pub mod driving;
pub mod error;
pub mod metrics;
pub mod protocol;
pub mod records;
pub mod report;
pub mod statistics;
pub mod suite;

pub use error::EvalError;
pub use protocol::{CellRun, Protocol, Subject};
