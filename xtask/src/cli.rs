//! The command line: the checks of this repository, and every command of the program `jostle`.

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::{chaos, ci, fuzz, wheel};

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    about = "Robots with 2D lasers learn among people: train, evaluate, reproduce the paper's tables, check.",
    version,
    after_help = "Example:\n  cargo xtask reproduce table1 --preset small"
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// One command with its arguments.
#[derive(Subcommand)]
#[expect(clippy::large_enum_variant, reason = "one value is made, from the command line")]
enum Command {
    #[command(flatten)]
    Product(jostle_cli::Command),
    /// Run our code on fixtures made by independent software.
    Conformance(jostle_conformance::ConformanceArgs),
    /// Kill training and evaluation at random moments, resume, and compare with an uninterrupted
    /// run.
    Chaos(chaos::ChaosArgs),
    /// Hand damaged files to every parser and look for panics, aborts and endless loops.
    Fuzz(fuzz::FuzzArgs),
    /// Measure: an update, the simulator, the evaluation, other software beside ours.
    Bench(jostle_bench::command::BenchArgs),
    /// Check everything: format, lints, documentation, tests, doctests.
    Ci(ci::CiArgs),
    /// Build the Python package as a wheel that pip installs without Rust.
    Wheel(wheel::WheelArgs),
}

impl Cli {
    /// Does the work.
    pub(crate) fn run(self) -> Result<ExitCode> {
        match self.command {
            Command::Product(command) => command.run(),
            Command::Conformance(args) => jostle_conformance::run(&args),
            Command::Chaos(args) => chaos::run(&args),
            Command::Fuzz(args) => fuzz::run(&args),
            Command::Bench(args) => jostle_bench::command::run(&args),
            Command::Ci(args) => ci::run(&args),
            Command::Wheel(args) => wheel::run(&args),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::Cli;
    use jostle_runs::provenance::workspace;

    #[test]
    fn every_command_in_the_documentation_is_understood() {
        let docs = std::fs::read_dir(workspace().join("docs")).unwrap().map(|entry| entry.unwrap().path());
        let pages = docs.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
        let mut found = 0;
        for page in pages.chain([workspace().join("README.md")]) {
            // A shell joins a line that ends in a backslash with the next.
            let text = std::fs::read_to_string(&page).unwrap().replace("\\\n", " ");
            for line in text.lines().filter_map(|line| line.strip_prefix("cargo xtask ")) {
                let command = line.split(['#', '>']).next().unwrap_or(line);
                let words = ["xtask"].into_iter().chain(command.split_whitespace());
                if let Err(error) = Cli::try_parse_from(words) {
                    panic!("{}: {command}: {error}", page.display());
                }
                found += 1;
            }
        }
        assert!(found > 20, "only {found} commands were found");
    }
}
