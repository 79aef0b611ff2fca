//! The command line: parsed, then handed to the command.

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::{
    behaviours, bench, chaos, ci, compare, config, conformance, demo, doctor, evaluate, export, fuzz,
    milestones, output, play, plot, replay, reproduce, runs, ship, sweep, tensorboard, train, verify,
};

/// Exit status of a command line that cannot be read.
const USAGE: u8 = 2;

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    about = "Robots with 2D lasers learn among people: train, evaluate, reproduce the paper's tables, check.",
    version,
    after_help = "Example:\n  cargo xtask reproduce table1 --preset small"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// One command with its arguments.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Train a policy with Algorithm 1 into a run folder.
    Train(train::TrainArgs),
    /// Train many runs by a plan: configurations times seeds, resumable, with one table of results.
    Sweep(sweep::SweepArgs),
    /// Test a checkpoint or a planner among crowds that it never met.
    Evaluate(evaluate::EvaluateArgs),
    /// Print the paper's tables, figures and claims beside our own: from shipped policies, or trained from nothing.
    Reproduce(reproduce::ReproduceArgs),
    /// Put the policies of finished runs into `checkpoints/`, with a manifest.
    Ship(ship::ShipArgs),
    /// Verify what is shipped: files, training curves, stored results.
    Verify(verify::VerifyArgs),
    /// Run our code on fixtures made by independent software.
    Conformance(conformance::ConformanceArgs),
    /// Kill training and evaluation at random moments, resume, and compare with an uninterrupted run.
    Chaos(chaos::ChaosArgs),
    /// Hand damaged files to every parser and look for panics, aborts and endless loops.
    Fuzz(fuzz::FuzzArgs),
    /// Show a policy among a crowd, on a page, within a minute.
    Demo(demo::DemoArgs),
    /// Write episodes of a policy as one page that a browser plays.
    Replay(replay::ReplayArgs),
    /// Drive a policy among a crowd in real time, on a page of this machine.
    Play(play::PlayArgs),
    /// List training runs with state and success.
    Runs(runs::RunsArgs),
    /// Print what two runs have in different.
    Compare(compare::CompareArgs),
    /// Print training measures of runs at chosen updates.
    Milestones(milestones::MilestonesArgs),
    /// Print what each behaviour of a run does in training, and what it is paid for it.
    Behaviours(behaviours::BehavioursArgs),
    /// Draw learning curves of runs, or the bars of a table.
    Plot(plot::PlotArgs),
    /// Name what is missing or odd here, and what to do.
    Doctor(doctor::DoctorArgs),
    /// Explain the keys of a configuration, or print its JSON Schema.
    Config(config::ConfigArgs),
    /// Write a policy for other software, as an ONNX model.
    Export(export::ExportArgs),
    /// Write the logs of runs as event files for TensorBoard.
    Tensorboard(tensorboard::TensorboardArgs),
    /// Measure: an update, the simulator, the evaluation, other software beside ours.
    Bench(bench::BenchArgs),
    /// Check everything: format, lints, documentation, tests, doctests.
    Ci(ci::CiArgs),
}

impl Command {
    /// Does the work.
    pub(crate) fn run(self) -> Result<ExitCode> {
        match self {
            Self::Train(args) => train::run(&args),
            Self::Sweep(args) => sweep::run(&args),
            Self::Evaluate(args) => evaluate::run(&args),
            Self::Export(args) => export::run(&args),
            Self::Reproduce(args) => reproduce::run(&args),
            Self::Ship(args) => ship::run(&args),
            Self::Verify(args) => verify::run(&args),
            Self::Conformance(args) => conformance::run(&args),
            Self::Chaos(args) => chaos::run(&args),
            Self::Fuzz(args) => fuzz::run(&args),
            Self::Demo(args) => demo::run(&args),
            Self::Replay(args) => replay::run(&args),
            Self::Play(args) => play::run(&args),
            Self::Runs(args) => runs::run(&args),
            Self::Compare(args) => compare::run(&args),
            Self::Milestones(args) => milestones::run(&args),
            Self::Behaviours(args) => behaviours::run(&args),
            Self::Plot(args) => plot::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Config(args) => config::run(&args),
            Self::Tensorboard(args) => tensorboard::run(&args),
            Self::Bench(args) => bench::run(&args),
            Self::Ci(args) => ci::run(&args),
        }
    }
}

/// Reads the command line; `Err` carries the exit status where there is nothing to run (help, version, a mistake).
pub(crate) fn parse() -> std::result::Result<Command, ExitCode> {
    Cli::try_parse().map(|cli| cli.command).map_err(|error| {
        if error.use_stderr() {
            output::note(&first_paragraph(&error.to_string()));
            ExitCode::from(USAGE)
        } else {
            // Help that cannot be printed has no other channel.
            let _ = error.print();
            ExitCode::SUCCESS
        }
    })
}

/// clap explains a mistake in several paragraphs; the first one names it.
fn first_paragraph(message: &str) -> String {
    let paragraph = message.split("\n\n").next().unwrap_or(message);
    format!("{} (see --help)", output::flatten(paragraph))
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::Cli;
    use crate::provenance::workspace;

    #[test]
    fn every_command_in_the_documentation_is_understood() {
        let docs = std::fs::read_dir(workspace().join("docs")).unwrap().map(|entry| entry.unwrap().path());
        let pages = docs.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
        let mut found = 0;
        for page in pages.chain([workspace().join("README.md")]) {
            let text = std::fs::read_to_string(&page).unwrap();
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
