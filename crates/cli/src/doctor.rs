//! `cargo xtask doctor`: what of this machine and this checkout could get in the way, and what to
//! do about it.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::Result;
use clap::Args;

use jostle_runs::log::{DEPTH, RunLog, State, search};
use jostle_runs::output;
use jostle_runs::output::columns;
use jostle_runs::provenance::{commit, workspace};

/// Free space below which a run may not finish: a run keeps up to six checkpoints of 31 MB and its
/// log.
const DISK_MB: u64 = 2_000;
/// Memory below which building may not finish.
const MEMORY_MB: u64 = 2_000;

/// Arguments of `doctor`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask doctor\n  cargo xtask doctor --runs results")]
pub struct DoctorArgs {
    /// Folder whose runs are looked through for what a crash left behind.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    runs: PathBuf,
}

/// The result of a check.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Good,
    /// Worth knowing; work goes on.
    Odd,
    /// Something will not work.
    Bad,
}

/// A check: what was looked at, what was found, what to do.
struct Check {
    what: &'static str,
    verdict: Verdict,
    found: String,
    advice: Option<String>,
}

impl Check {
    fn good(what: &'static str, found: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::Good, found: found.into(), advice: None }
    }

    fn odd(what: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::Odd, found: found.into(), advice: Some(advice.into()) }
    }

    fn bad(what: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { verdict: Verdict::Bad, ..Self::odd(what, found, advice) }
    }
}

/// Prints all checks; the exit status is a failure where something will not work.
pub(crate) fn run(args: &DoctorArgs) -> Result<ExitCode> {
    let mut checks =
        vec![toolchain(), component("rustfmt"), component("clippy"), cores(), threads(), features()];
    checks.extend([memory(), disk(&args.runs), checkout()]);
    checks.extend(leftovers(&args.runs)?);
    let rows: Vec<Vec<String>> = checks
        .iter()
        .map(|check| {
            let sign = match check.verdict {
                Verdict::Good => "ok",
                Verdict::Odd => "note",
                Verdict::Bad => "BAD",
            };
            let advice = check.advice.as_ref().map(|advice| format!("; {advice}")).unwrap_or_default();
            vec![sign.to_owned(), check.what.to_owned(), format!("{}{advice}", check.found)]
        })
        .collect();
    output::result(&columns(&rows))?;
    let bad = checks.iter().any(|check| check.verdict == Verdict::Bad);
    Ok(if bad { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// First line that a program prints, if it runs.
fn answer(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).current_dir(workspace()).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).lines().next()?.trim().to_owned();
    output.status.success().then_some(text)
}

fn toolchain() -> Check {
    let wanted = env!("CARGO_PKG_RUST_VERSION");
    let advice = format!("this workspace needs Rust {wanted} or later: `rustup update stable`");
    let Some(text) = answer("rustc", &["--version"]) else {
        return Check::bad("toolchain", "rustc does not run", advice);
    };
    let version =
        |text: &str| -> Vec<u64> { text.split(['.', '-']).map_while(|part| part.parse().ok()).collect() };
    let found = text.split_whitespace().nth(1).map(version).unwrap_or_default();
    if found >= version(wanted) {
        Check::good("toolchain", text)
    } else {
        Check::bad("toolchain", text, advice)
    }
}

fn component(name: &'static str) -> Check {
    let subcommand = if name == "clippy" { "clippy" } else { "fmt" };
    match answer("cargo", &[subcommand, "--version"]) {
        Some(text) => Check::good(name, text),
        None => {
            Check::odd(name, "missing", format!("`cargo xtask ci` needs it: `rustup component add {name}`"))
        }
    }
}

fn cores() -> Check {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    match cores {
        1 => Check::odd(
            "cores",
            "1",
            "actor, critic and discriminators train one after the other; expect half the speed",
        ),
        _ => Check::good("cores", cores.to_string()),
    }
}

fn threads() -> Check {
    match std::env::var("RAYON_NUM_THREADS") {
        Ok(value) => Check::odd(
            "threads",
            format!("RAYON_NUM_THREADS={value}"),
            "it applies where neither --threads nor `threads` in the configuration is given",
        ),
        Err(_) => Check::good(
            "threads",
            "one for each core, unless --threads says otherwise; results do not depend on it",
        ),
    }
}

#[cfg(target_arch = "x86_64")]
fn features() -> Check {
    let all = [
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
    ];
    let has: Vec<&str> = all.iter().filter(|(_, here)| *here).map(|(name, _)| *name).collect();
    if all[1].1 && all[2].1 {
        Check::good("CPU features", format!("x86_64 with {}", has.join(", ")))
    } else {
        let found = if has.is_empty() { "none of AVX2, FMA, AVX-512".to_owned() } else { has.join(", ") };
        Check::odd("CPU features", found, "networks run, but several times slower")
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn features() -> Check {
    Check::good("CPU features", std::env::consts::ARCH)
}

fn memory() -> Check {
    let available = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("MemAvailable:"))?.to_owned();
        line.split_whitespace().nth(1)?.parse::<u64>().ok()
    });
    match available.map(|kib| kib / 1024) {
        Some(mb) if mb < MEMORY_MB => Check::odd(
            "memory",
            format!("{mb} MB free"),
            "building may run out of it: `cargo build --release -p xtask -j 1`",
        ),
        Some(mb) => Check::good("memory", format!("{mb} MB free")),
        None => Check::good("memory", "this system does not say"),
    }
}

fn disk(runs: &Path) -> Check {
    let place = if runs.is_dir() { runs } else { workspace() };
    let free = Command::new("df").arg("-Pk").arg(place).output().ok().and_then(|output| {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.lines().nth(1)?.split_whitespace().nth(3)?.parse::<u64>().ok()
    });
    match free.map(|kib| kib / 1024) {
        Some(mb) if mb < DISK_MB => Check::odd(
            "disk",
            format!("{mb} MB free at {}", place.display()),
            "a run of the paper's size needs about 200 MB, Table 1 about 3 GB; remove old runs or choose another --out",
        ),
        Some(mb) => Check::good("disk", format!("{mb} MB free at {}", place.display())),
        None => Check::good("disk", "this system does not say"),
    }
}

fn checkout() -> Check {
    match commit() {
        "unknown" => Check::odd(
            "checkout",
            "no git commit",
            "runs cannot say which source made them; use a git checkout",
        ),
        text if text.ends_with("-dirty") => Check::odd(
            "checkout",
            text,
            "runs are marked as made by changed sources; commit before a run that counts",
        ),
        text => Check::good("checkout", text),
    }
}

/// Files that killed runs left behind.
fn leftovers(folder: &Path) -> Result<Vec<Check>> {
    let mut found = Vec::new();
    search(folder, DEPTH, &mut found)?;
    let mut checks = Vec::new();
    for run in &found {
        let shown = run.display();
        match RunLog::read(run).and_then(|log| Ok((log.state()?, log))) {
            Ok((State::Stopped, log)) => {
                let torn = if log.torn { " with a torn last line, which a resume repairs" } else { "" };
                let made = format!(
                    "{shown} stopped at update {} of {}{torn}",
                    log.reports.len(),
                    log.config.updates
                );
                let resume = {
                    let program = output::program();
                    format!("go on: `{program} train --config {shown}/config.toml --out {shown} --resume`")
                };
                checks.push(Check::odd("leftovers", made, resume));
            }
            Ok((State::Finished, _)) => checks.extend(temporaries(run)),
            Ok((State::Running, _)) => {}
            Err(error) => checks.push(Check::odd(
                "leftovers",
                format!("{shown} cannot be read ({})", output::one_line(&error)),
                "move the folder away, or bring its files back",
            )),
        }
    }
    if checks.is_empty() {
        checks.push(Check::good(
            "leftovers",
            format!("none in {} runs under {}", found.len(), folder.display()),
        ));
    }
    Ok(checks)
}

/// Files that an interrupted write left in a finished run.
fn temporaries(run: &Path) -> Vec<Check> {
    let folders = [run.to_owned(), run.join("checkpoints")];
    let entries = folders.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten();
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "tmp"))
        .map(|path| {
            Check::odd(
                "leftovers",
                path.display().to_string(),
                "half a file of an interrupted write; delete it",
            )
        })
        .collect()
}
