//! The commands: their arguments are parsed here, and handed to whoever does the work.

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};
use jostle_runs::output::{self, PROGRAM_OF_CHECKOUT};
use jostle_runs::stop;
use jostle_study::{leaderboard, reproduce, ship, verify};
use jostle_view::{demo, play, replay};

use crate::crew::ToldByTheFirst;
use crate::trainings::Here;
use crate::{
    behaviours, compare, config, doctor, evaluate, export, list, milestones, plot, sweep, tensorboard, train,
};

/// Exit status of a command line that cannot be read.
const USAGE: u8 = 2;

/// One command with its arguments.
#[derive(Subcommand)]
pub enum Command {
    /// Train a policy with Algorithm 1 into a run folder.
    Train(train::TrainArgs),
    /// Train many runs by a plan: configurations times seeds, resumable, with one table of results.
    Sweep(sweep::SweepArgs),
    /// Test a checkpoint or a planner among crowds that it never met.
    Evaluate(evaluate::EvaluateArgs),
    /// Print the paper's tables, figures and claims beside our own: from shipped policies, or
    /// trained from nothing.
    Reproduce(reproduce::ReproduceArgs),
    /// Rank robots on the standard suite; every entry runs again to the bit.
    Leaderboard(leaderboard::LeaderboardArgs),
    /// Put the policies of finished runs into `checkpoints/`, with a manifest.
    Ship(ship::ShipArgs),
    /// Verify what is shipped: files, training curves, stored results.
    Verify(verify::VerifyArgs),
    /// Show a policy among a crowd, on a page, within a minute.
    Demo(demo::DemoArgs),
    /// Write episodes of a policy as one page that a browser plays.
    Replay(replay::ReplayArgs),
    /// Drive a policy among a crowd in real time, on a page of this machine.
    Play(play::PlayArgs),
    /// List training runs with state and success.
    Runs(list::RunsArgs),
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
    /// Time messages between two processes of an MPI job.
    #[cfg(feature = "mpi")]
    #[command(hide = true)]
    Messages(crate::mpi::MessagesArgs),
}

impl Command {
    /// Does the work.
    ///
    /// # Errors
    /// What the command refuses, or [`stop::Stopped`] where a signal ended it.
    pub fn run(self) -> Result<ExitCode> {
        match self {
            Self::Train(args) => train::run(&args),
            Self::Sweep(args) => sweep::run(&args),
            Self::Evaluate(args) => evaluate::run(&args),
            Self::Export(args) => export::run(&args),
            Self::Reproduce(args) => reproduce::run(&args, &Here),
            Self::Leaderboard(args) => leaderboard::run(&args),
            Self::Ship(args) => ship::run(&args),
            Self::Verify(args) => verify::run(&args),
            Self::Demo(args) => demo::run(&args),
            Self::Replay(args) => replay::run(&args),
            Self::Play(args) => play::run(&args),
            Self::Runs(args) => list::run(&args),
            Self::Compare(args) => compare::run(&args),
            Self::Milestones(args) => milestones::run(&args),
            Self::Behaviours(args) => behaviours::run(&args),
            Self::Plot(args) => plot::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Config(args) => config::run(&args),
            Self::Tensorboard(args) => tensorboard::run(&args),
            #[cfg(feature = "mpi")]
            Self::Messages(args) => crate::mpi::time_messages(&args),
        }
    }
}

/// Reads the command line; `Err` carries the exit status where there is nothing to run (help,
/// version, a mistake).
///
/// # Errors
/// The exit status, when the command line has been answered already.
pub fn parse<C: Parser>() -> std::result::Result<C, ExitCode> {
    let matches = command::<C>().try_get_matches();
    matches.and_then(|matches| C::from_arg_matches(&matches)).map_err(|error| {
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

/// The program's exit status: a failure is told as one line, a stop that was asked for has a status
/// of its own.
pub fn conclude(outcome: Result<ExitCode>) -> ExitCode {
    outcome.unwrap_or_else(|error| {
        if let Some(stopped) = error.downcast_ref::<stop::Stopped>() {
            output::note(&stopped.to_string());
            return ExitCode::from(stop::STOPPED);
        }
        if error.is::<ToldByTheFirst>() {
            // A status of its own would make `mpirun` end the process that tells.
            return ExitCode::SUCCESS;
        }
        output::note(&format!("error: {}", output::one_line(&error)));
        ExitCode::FAILURE
    })
}

/// The parser of a command line, whose examples call the program by the name that it is called by.
pub fn command<C: Parser>() -> clap::Command {
    renamed(C::command())
}

/// Examples are written for a checkout; the program says its own name in them.
fn renamed(command: clap::Command) -> clap::Command {
    let examples = command.get_after_help().map(ToString::to_string);
    let command = match examples {
        Some(text) => command.after_help(text.replace(PROGRAM_OF_CHECKOUT, output::program())),
        None => command,
    };
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    names.into_iter().fold(command, |command, name| command.mut_subcommand(name, renamed))
}

/// clap explains a mistake in several paragraphs; the first one names it.
fn first_paragraph(message: &str) -> String {
    let paragraph = message.split("\n\n").next().unwrap_or(message);
    format!("{} (see --help)", output::flatten(paragraph))
}
