//! `cargo xtask ci`: what has to hold before a change is good.
//!
//! All steps that build use the release profile, so that a cold machine builds the dependencies once for checking and
//! once for running. Every tool's own output stays visible; each step ends with one line of ours, with its time.

use std::process::{Command, ExitCode};
use std::time::Instant;

use anyhow::{Context as _, Result};
use clap::Args;

use crate::output;
use crate::progress::clock;
use crate::provenance::workspace;
use crate::python;

/// Arguments of `ci`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask ci\n  cargo xtask ci --python")]
pub(crate) struct CiArgs {
    /// Go on after a failed step and name all of them at the end.
    #[arg(long)]
    keep_going: bool,
    /// Check the Python package instead, in a virtual environment under target/ that is made for it.
    #[arg(long)]
    python: bool,
}

/// A step at work; whether it passed.
type Work = dyn Fn() -> Result<bool>;

struct Step {
    name: &'static str,
    arguments: &'static [&'static str],
    environment: &'static [(&'static str, &'static str)],
}

const STEPS: [Step; 5] = [
    Step { name: "fmt", arguments: &["fmt", "--all", "--check"], environment: &[] },
    Step {
        name: "clippy",
        arguments: &[
            "clippy",
            "--release",
            "--workspace",
            "--all-targets",
            "--quiet",
            "--",
            "-D",
            "warnings",
        ],
        environment: &[],
    },
    Step {
        name: "docs",
        arguments: &["doc", "--release", "--workspace", "--no-deps", "--quiet"],
        environment: &[("RUSTDOCFLAGS", "-D warnings")],
    },
    Step {
        name: "tests",
        // Benches are left out: clippy compiles them, and running them as tests would time nothing.
        arguments: &["test", "--release", "--workspace", "--lib", "--bins", "--tests", "--examples"],
        environment: &[],
    },
    Step { name: "doctests", arguments: &["test", "--release", "--workspace", "--doc"], environment: &[] },
];

/// Runs all steps in order; stops at the first that fails unless told to go on.
pub(crate) fn run(args: &CiArgs) -> Result<ExitCode> {
    let mut lines = Vec::new();
    let mut failed = Vec::new();
    let steps: Vec<(&str, Box<Work>)> = if args.python {
        python::STEPS.iter().map(|(name, work)| (*name, Box::new(work) as _)).collect()
    } else {
        STEPS.iter().map(|step| (step.name, Box::new(|| run_step(step)) as _)).collect()
    };
    for (name, work) in &steps {
        output::note(&format!("ci: {name} …"));
        let started = Instant::now();
        let passed = work()?;
        let verdict = if passed { "ok" } else { "FAIL" };
        let line = format!("ci: {name:<9} {verdict:<4} {}\n", clock(started.elapsed().as_secs_f64()));
        output::result(&line)?;
        lines.push(line);
        if !passed {
            failed.push(*name);
            if !args.keep_going {
                break;
            }
        }
    }
    if failed.is_empty() {
        output::result(&format!("\n{}ci: passed\n", lines.concat()))?;
        return Ok(ExitCode::SUCCESS);
    }
    output::result(&format!("\n{}ci: failed: {}\n", lines.concat(), failed.join(", ")))?;
    Ok(ExitCode::FAILURE)
}

fn run_step(step: &Step) -> Result<bool> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo)
        .args(step.arguments)
        .envs(step.environment.iter().copied())
        .current_dir(workspace())
        .status()
        .with_context(|| format!("cannot start cargo for step {}", step.name))?;
    Ok(status.success())
}
