//! Training runs on disk, and what every command tells its user.
//!
//! Reading order: [`folder`] (what `train` makes), [`run_folder`] (a folder that one process works
//! in), [`ndjson`] (its log), [`log`] and [`pace`] (a run as its readers see it), [`policies`] (the
//! policies that a path means), [`shipped`] (files that come with the program), [`keys`] (a
//! configuration's keys), [`changed`] (a room with some of them changed); [`provenance`] (which
//! source made a result), [`stop`] (signals), [`output`] and [`progress`] (what is printed),
//! [`maps`], [`threads`], [`tools`], [`debian`] and [`python`] (software that has to be installed).
//!
//! Architecture invariants: nothing here trains. [`folder`] and [`policies`], which the Python
//! package uses, neither lock nor write, and their errors are [`RunsError`]s.

#![forbid(unsafe_code)]

pub mod changed;
pub mod debian;
pub mod error;
pub mod folder;
pub mod keys;
pub mod log;
pub mod maps;
pub mod ndjson;
pub mod output;
pub mod pace;
pub mod policies;
pub mod progress;
pub mod provenance;
pub mod python;
pub mod run_folder;
pub mod shipped;
pub mod stop;
pub mod threads;
pub mod tools;

pub use error::RunsError;
