//! The program `jostle`: everything but the checks of the repository itself.
//!
//! Results go to standard output; progress and messages to standard error. An error is one line and
//! a non-zero exit.
//!
//! Reading order: [`Command`] (what can be asked for), `train` (a run and its folder), with `crew`
//! and `mpi` (a run in several processes), `evaluate`,
//! `sweep` (many runs by one plan); what a person looks at: `plot` (curves, bars, tokens, ways),
//! `list` (runs), `compare`, `milestones`, `behaviours`, `tensorboard` (logs of training),
//! `config`, `doctor`. The other commands have crates of their own: `jostle-study` (`reproduce`,
//! `ship`, `verify`) and `jostle-view` (`demo`, `replay`, `play`).

#![forbid(unsafe_code)]

mod behaviours;
mod command;
mod compare;
mod config;
mod crew;
mod doctor;
mod embedded;
mod evaluate;
mod export;
mod list;
mod milestones;
#[cfg(feature = "mpi")]
mod mpi;
mod plot;
mod suite;
mod sweep;
mod tensorboard;
mod train;
mod trainings;

pub use command::{Command, command, conclude, parse};

/// Tells the program who it is: how the user calls it, and the commit that it is built from
/// (`JOSTLE_STAMP` of its build script).
pub fn introduce(program: &'static str, stamp: &'static str) {
    jostle_runs::output::set_program(program);
    jostle_runs::provenance::set_stamp(stamp);
    jostle_runs::shipped::set_embedded(embedded::FILES);
}
