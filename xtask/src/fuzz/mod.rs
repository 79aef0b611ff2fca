//! `cargo xtask fuzz`: hostile files for every parser, for as long as one likes.
//!
//! Each target starts from valid inputs, damages them with draws from a seeded stream, and hands
//! them to the same functions that the commands use. A refusal must be one short line; a panic, an
//! abort (memory is limited), an endless loop or a message of many lines is a crash, whose input is
//! kept. Targets run in processes of their own, so that an abort is seen and survived.
//!
//! Reading order: this file (the supervisor); [`worker`] (one process); [`targets`] (what is called
//! on what); [`mutate`] and [`archive`] (how inputs are damaged).

mod archive;
mod mutate;
mod targets;
mod worker;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Args;

use jostle_runs::output;
use targets::TARGETS;

/// Address space of a worker, KiB: what a valid file needs many times over.
const MEMORY_KIB: u64 = 4 << 20;
/// A target is given up after this many crashes.
const CRASHES_MAX: u64 = 20;

/// Arguments of `fuzz`.
#[derive(Args, Clone)]
#[command(
    after_help = "Examples:\n  cargo xtask fuzz --minutes 10\n  cargo xtask fuzz --minutes 1 --target polygons --seed 3"
)]
pub(crate) struct FuzzArgs {
    /// Minutes for each target.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    minutes: f64,
    /// Inputs for each target, where that is reached before the time is up.
    #[arg(long, value_name = "N", default_value_t = u64::MAX)]
    cases: u64,
    /// One target alone (default: all, one after the other).
    #[arg(long, value_name = "T")]
    target: Option<String>,
    /// Seed of the inputs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for inputs that crashed.
    #[arg(long, value_name = "DIR", default_value = "runs/fuzz")]
    out: PathBuf,
    /// Be the process that tries inputs, in this scratch folder.
    #[arg(long, value_name = "DIR", hide = true)]
    worker: Option<PathBuf>,
}

/// Fuzzes as the arguments say; fails when anything crashed.
pub(crate) fn run(args: &FuzzArgs) -> Result<ExitCode> {
    let wanted = |name: &str| args.target.as_deref().is_none_or(|target| target == name);
    let names: Vec<&str> = TARGETS.iter().map(|target| target.name).filter(|name| wanted(name)).collect();
    if names.is_empty() {
        let all: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
        bail!("--target: expected one of {}", all.join(", "));
    }
    if !(args.minutes > 0.0 && args.minutes <= 1e6) {
        bail!("--minutes: found {}, expected more than 0 and at most 1000000", args.minutes);
    }
    let seconds = args.minutes * 60.0;
    if let Some(scratch) = &args.worker {
        return worker::run(
            names[0],
            scratch,
            args.seed,
            args.cases,
            Duration::from_secs_f64(seconds),
            &args.out,
        );
    }
    let mut crashes = 0;
    for name in names {
        let report = supervise(name, args, Duration::from_secs_f64(seconds))?;
        crashes += report.crashes;
        output::result(&format!(
            "fuzz {name:<11} {:>9} inputs ({} accepted, {} refused) in {:.0} s, {} crashes, seed {}\n",
            report.tried,
            report.accepted,
            report.tried - report.accepted - report.crashes.min(report.tried - report.accepted),
            report.seconds,
            report.crashes,
            args.seed,
        ))?;
    }
    if crashes > 0 {
        output::note(&format!("inputs that crashed: {}", args.out.display()));
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

/// The results of a target's inputs.
#[derive(Default)]
struct Report {
    tried: u64,
    accepted: u64,
    crashes: u64,
    seconds: f64,
}

/// Runs workers for one target until time or cases are used up; a worker that dies has met a crash.
fn supervise(name: &str, args: &FuzzArgs, time: Duration) -> Result<Report> {
    let scratch = scratch_folder(name);
    let started = Instant::now();
    let mut report = Report::default();
    for attempt in 0_u64.. {
        let left = time.saturating_sub(started.elapsed());
        if left.is_zero() || report.tried >= args.cases || report.crashes >= CRASHES_MAX {
            break;
        }
        std::fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
        let output = worker_command(name, args, &scratch, left, report.tried, attempt)?
            .output()
            .with_context(|| format!("cannot start a worker for {name}"))?;
        let text = String::from_utf8_lossy(&output.stdout);
        let last: Vec<u64> =
            text.lines().last().unwrap_or_default().split(' ').filter_map(|n| n.parse().ok()).collect();
        let [tried, accepted, crashes] = last[..] else {
            bail!("the worker for {name} said nothing: {}", String::from_utf8_lossy(&output.stderr).trim());
        };
        report.tried += tried;
        report.accepted += accepted;
        report.crashes += crashes;
        if !output.status.success() {
            let reason = format!("{}: {}", output.status, String::from_utf8_lossy(&output.stderr));
            worker::keep(&scratch, &args.out, name, &format!("abort-{}-{attempt}", args.seed), &reason)?;
            report.crashes += 1;
        }
    }
    std::fs::remove_dir_all(&scratch).with_context(|| format!("cannot remove {}", scratch.display()))?;
    report.seconds = started.elapsed().as_secs_f64();
    Ok(report)
}

/// This program as a worker, with a limit on memory (which only a shell can set without unsafe
/// code).
fn worker_command(
    name: &str,
    args: &FuzzArgs,
    scratch: &Path,
    left: Duration,
    tried: u64,
    attempt: u64,
) -> Result<Command> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut command = Command::new("sh");
    command
        .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")])
        .arg(program)
        .args(["fuzz", "--target", name, "--worker"])
        .arg(scratch)
        .args(["--seed", &args.seed.wrapping_add(attempt.wrapping_mul(1_000_003)).to_string()])
        .args(["--minutes", &(left.as_secs_f64() / 60.0).max(1e-4).to_string()])
        .args(["--cases", &(args.cases - tried).to_string(), "--out"])
        .arg(&args.out)
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null());
    Ok(command)
}

/// Folder for inputs: in memory where the system has such a place, as each input is a file.
fn scratch_folder(name: &str) -> PathBuf {
    let memory = Path::new("/dev/shm");
    let base = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    base.join(format!("jostle-fuzz-{name}-{}", std::process::id()))
}
