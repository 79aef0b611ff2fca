//! The program `jostle`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "jostle",
    about = "Robots with 2D lasers learn among people: train, evaluate, reproduce the paper's tables, look.",
    version,
    after_help = "Examples:\n  jostle demo\n  jostle evaluate dwa --crowds VO,SF --episodes 100\n  \
    jostle train --config strong --out runs/mine"
)]
struct Jostle {
    #[command(subcommand)]
    command: Program,
}

#[derive(Subcommand)]
#[expect(clippy::large_enum_variant, reason = "one is made for each run of the program")]
enum Program {
    #[command(flatten)]
    Command(jostle_cli::Command),
    /// Print a script that completes this program's commands in a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

fn main() -> ExitCode {
    jostle_cli::introduce("jostle", env!("JOSTLE_STAMP"));
    match jostle_cli::parse::<Jostle>() {
        Ok(Jostle { command: Program::Command(command) }) => jostle_cli::conclude(command.run()),
        Ok(Jostle { command: Program::Completions { shell } }) => {
            clap_complete::generate(
                shell,
                &mut jostle_cli::command::<Jostle>(),
                "jostle",
                &mut std::io::stdout(),
            );
            ExitCode::SUCCESS
        }
        Err(status) => status,
    }
}
