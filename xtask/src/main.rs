//! The project's only automation: `cargo xtask train | evaluate | reproduce | conformance | ci`.
//!
//! Results go to standard output; progress and messages to standard error. An error is one line and a non-zero exit.
//!
//! Reading order: [`cli`] (what can be asked for), [`train`] and [`run_folder`] (a run and its folder), [`evaluate`],
//! [`reproduce`] (the paper's tables), [`conformance`] (our code against recorded results of other software), [`ci`].

#![forbid(unsafe_code)]

mod cells;
mod chaos;
mod ci;
mod cli;
mod conformance;
mod evaluate;
mod fuzz;
mod ndjson;
mod output;
mod policies;
mod progress;
mod provenance;
mod reproduce;
mod run_folder;
mod threads;
mod train;

use std::process::ExitCode;

fn main() -> ExitCode {
    let outcome = match cli::parse() {
        Ok(command) => command.run(),
        Err(status) => return status,
    };
    outcome.unwrap_or_else(|error| {
        output::note(&format!("error: {}", output::one_line(&error)));
        ExitCode::FAILURE
    })
}
