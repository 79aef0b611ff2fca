//! `cargo xtask reproduce table1 --preset small`: everything from nothing within minutes, to see
//! that every part works.

mod plan;
mod table1;

pub(super) use table1::run;

/// Default folder of its runs, records and reports.
pub(super) const FOLDER: &str = "runs/table1-small";
