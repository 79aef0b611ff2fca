//! The checks of this repository, and the door to the program `jostle`: `cargo xtask ci | bench |
//! train | reproduce …`.
//!
//! Reading order: [`cli`] (what can be asked for), [`ci`] with [`python`], [`wheel`], [`cluster`],
//! [`ranks`] (what has to hold before a change is good), [`chaos`] and [`fuzz`] (attempts to break
//! what `docs/reliability.md` promises).

#![forbid(unsafe_code)]

mod chaos;
mod ci;
mod cli;
mod cluster;
mod fuzz;
mod python;
mod ranks;
mod ros;
mod wheel;

use std::process::ExitCode;

fn main() -> ExitCode {
    jostle_cli::introduce(jostle_runs::output::PROGRAM_OF_CHECKOUT, env!("JOSTLE_STAMP"));
    match jostle_cli::parse::<cli::Cli>() {
        Ok(cli) => jostle_cli::conclude(cli.run()),
        Err(status) => status,
    }
}
