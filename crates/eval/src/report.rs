//! Results as plain data and their renderings: text for a terminal, Markdown, CSV and JSON.
//!
//! Reading order: [`cell`] (one policy in one crowd), [`table`] (the success tables, Table I
//! first), [`evaluation`] (one policy in detail), [`suite`] (one policy on harder scenes),
//! [`pooled`] (tables over several training seeds), [`grid`] (how text and Markdown are laid out),
//! [`timing`] (wall times, kept apart).
//!
//! Architecture invariant: no rendering reads a clock; wall times pass through [`timing`] alone, so
//! that the same records give the same bytes.

pub mod cell;
pub mod evaluation;
pub mod grid;
pub mod pooled;
pub mod suite;
pub mod table;
pub mod timing;

pub use cell::{CellResult, Comparison};
pub use evaluation::Evaluation;
pub use pooled::{PooledCell, PooledRow, PooledTable, SeedValue, Source};
pub use suite::{SceneResult, SuiteReport, SuiteScore};
pub use table::{SuccessRow, SuccessTable};
pub use timing::{CellTiming, timings_csv};
