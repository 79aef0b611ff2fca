//! `cargo xtask reproduce`: a table of the paper from nothing, beside the paper's figures.
//!
//! Whatever is there already is used again, known by the hash of its configuration (runs) or of everything it depends on
//! (episodes); what was interrupted goes on where it stopped.

mod plan;
mod table1;

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Args, ValueEnum};

use crate::threads;
pub(crate) use plan::Preset;

/// Arguments of `reproduce`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask reproduce table1 --preset small --out runs/table1-small")]
pub(crate) struct ReproduceArgs {
    /// What to reproduce.
    #[arg(value_enum)]
    target: Target,
    /// How much of the paper's effort to spend.
    #[arg(long, value_enum, default_value = "small")]
    preset: Preset,
    /// Folder for runs, records and reports (default: `runs/table1-PRESET`).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Worker threads (default: all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Target {
    /// Success rate against the number of behaviours M, among all six crowds.
    Table1,
}

/// Reproduces what the arguments name.
pub(crate) fn run(args: &ReproduceArgs) -> Result<ExitCode> {
    threads::set(args.threads)?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(args.preset.folder()));
    let threads = args.threads.map_or(0, NonZeroUsize::get);
    match args.target {
        Target::Table1 => table1::run(args.preset, &out, threads)?,
    }
    Ok(ExitCode::SUCCESS)
}
