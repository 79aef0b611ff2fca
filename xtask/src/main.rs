//! The project's only automation: `cargo xtask train | evaluate | reproduce | conformance | ci`.
//!
//! Results go to standard output; progress and messages to standard error. An error is one line and a non-zero exit.
//!
//! Reading order: [`cli`] (what can be asked for), [`train`] and [`run_folder`] (a run and its folder), [`evaluate`],
//! [`sweep`] (many runs by one plan), [`reproduce`] (the paper's tables), [`ship`] and [`verify`] (what the repository holds of them), [`conformance`] (our code against recorded results of other software), [`mod@bench`] (how
//! fast it all is), [`ci`].
//!
//! What a person looks at: [`demo`] and [`replay`] (episodes on a page), [`play`] (a policy in real time), [`plot`]
//! (curves, bars, tokens, ways), [`runs`], [`compare`], [`milestones`], [`tensorboard`] (logs of training), [`config`],
//! [`doctor`].

#![forbid(unsafe_code)]

mod behaviours;
mod bench;
mod browser;
mod cells;
mod chaos;
mod ci;
mod cli;
mod cluster;
mod compare;
mod config;
mod conformance;
mod demo;
mod doctor;
mod evaluate;
mod export;
mod fuzz;
mod maps;
mod milestones;
mod ndjson;
mod output;
mod play;
mod plot;
mod policies;
mod progress;
mod provenance;
mod python;
mod replay;
mod reproduce;
mod ros;
mod run_folder;
mod runs;
mod ship;
mod stop;
mod suite;
mod sweep;
mod tensorboard;
mod threads;
mod tools;
mod train;
mod verify;

use std::process::ExitCode;

fn main() -> ExitCode {
    let outcome = match cli::parse() {
        Ok(command) => command.run(),
        Err(status) => return status,
    };
    outcome.unwrap_or_else(|error| {
        if let Some(stopped) = error.downcast_ref::<stop::Stopped>() {
            output::note(&stopped.to_string());
            return ExitCode::from(stop::STOPPED);
        }
        output::note(&format!("error: {}", output::one_line(&error)));
        ExitCode::FAILURE
    })
}
