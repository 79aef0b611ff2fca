//! `cargo xtask ci`: what has to hold before a change is good.
//!
//! All steps that build use the release profile, so that a cold machine builds the dependencies
//! once for checking and once for running. Every tool's own output stays visible; each step ends
//! with one line of ours, with its time.
//!
//! Checks that need more than Rust are asked for by name (`--web`, `--python`, `--ros`, `--slurm`,
//! `--mpi`) and then run alone. The book needs mdBook, which cargo installs once; where that cannot
//! be had, the step is skipped and says so: what the book claims is tested anyway.

use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clap::Args;

use crate::{cluster, python, ranks, ros};
use jostle_runs::output;
use jostle_runs::progress::clock;
use jostle_runs::provenance::workspace;
use jostle_runs::tools::{self, MDBOOK};

/// Arguments of `ci`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask ci\n  cargo xtask ci --keep-going\n  cargo xtask ci --python\n  \
    cargo xtask ci --web --book\n\n\
    Without --web, --book, --slurm, --mpi, --python and --ros: format, lints, documentation, tests, doctests, sets of features, book. With them: these checks alone."
)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub(crate) struct CiArgs {
    /// Go on after a failed step and name all of them at the end.
    #[arg(long)]
    keep_going: bool,
    /// Check the Python package instead, in a virtual environment under target/ that is made for
    /// it.
    #[arg(long)]
    python: bool,
    /// Drive the replay page and the live page in Chromium, without a window.
    #[arg(long)]
    web: bool,
    /// Build the documentation as a book into target/book, with mdBook, which is installed if it is
    /// not there, and fail if it cannot be.
    #[arg(long)]
    book: bool,
    /// Start a Slurm of two nodes on this machine, kill one of them in the middle of a sweep, and
    /// compare every file with those of a local sweep. Needs Slurm, munge and unshare (root); on
    /// Debian they are installed.
    #[arg(long)]
    slurm: bool,
    /// Build the program with MPI, make one run in one, two and four processes, end them in the
    /// middle, and compare every file with those of a run of one process. Needs Open MPI and
    /// clang's library; on Debian they are installed.
    #[arg(long)]
    mpi: bool,
    /// Check the ROS 2 node in ros/, and drive it in closed loops with rclpy and Cyclone DDS, which
    /// pip installs into target/.
    #[arg(long)]
    ros: bool,
}

/// A step that calls cargo.
struct Step {
    name: &'static str,
    arguments: &'static [&'static str],
    environment: &'static [(&'static str, &'static str)],
}

/// The result of a step.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Passed,
    Failed,
    /// It needs what is not there.
    Skipped,
}

impl Verdict {
    fn from_passed(passed: bool) -> Self {
        if passed { Self::Passed } else { Self::Failed }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Passed => "ok",
            Self::Failed => "FAIL",
            Self::Skipped => "skip",
        }
    }
}

/// A check with its name.
type Check<'a> = (&'static str, Box<dyn Fn() -> Result<Verdict> + 'a>);

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

/// Features that other workspaces may leave out of the published crates: each feature of
/// `jostle-sim` without the others, and none. The rest of the steps build the default ones, and
/// `learned` of `jostle-peds`.
const FEATURE_SETS: [&[&str]; 5] = [
    &["-p", "jostle-sim", "-p", "jostle-peds"],
    &["-p", "jostle-sim", "--features", "dynamics"],
    &["-p", "jostle-sim", "--features", "toml"],
    &["-p", "jostle-sim", "--features", "yaml"],
    &["-p", "jostle-sim", "--features", "png"],
];

/// Most bytes of the book's replay.
const REPLAY_MAX: u64 = 1_000_000;

/// The pages in a browser, which not every machine has.
const WEB: Step = Step {
    name: "web",
    arguments: &[
        "test",
        "--release",
        "--package",
        "jostle-view",
        "--test",
        "browser",
        "--",
        "--ignored",
        "--nocapture",
    ],
    environment: &[],
};

/// Runs all steps in order; stops at the first that fails unless told to go on.
pub(crate) fn run(args: &CiArgs) -> Result<ExitCode> {
    let mut lines = Vec::new();
    let mut failed = Vec::new();
    for (name, check) in checks(args) {
        output::note(&format!("ci: {name} …"));
        let started = Instant::now();
        let verdict = check()?;
        let line =
            format!("ci: {name:<9} {:<4} {}\n", verdict.word(), clock(started.elapsed().as_secs_f64()));
        output::result(&line)?;
        lines.push(line);
        if verdict == Verdict::Failed {
            failed.push(name);
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

/// The checks asked for by name, or else the ordinary steps.
fn checks(args: &CiArgs) -> Vec<Check<'static>> {
    let mut checks: Vec<Check<'static>> = Vec::new();
    if args.web {
        checks.push((WEB.name, Box::new(|| run_step(&WEB))));
    }
    if args.book {
        checks.push(("book", Box::new(|| Ok(told(&MDBOOK.find().and_then(|mdbook| build_book(&mdbook)))))));
    }
    if args.slurm {
        checks.push(("slurm", Box::new(|| Ok(told(&cluster::check())))));
    }
    if args.mpi {
        checks.push(("mpi", Box::new(|| Ok(told(&ranks::check())))));
    }
    if args.python {
        let steps = python::STEPS.iter();
        checks.extend(
            steps.map(|(name, work)| -> Check { (name, Box::new(|| Ok(Verdict::from_passed(work()?)))) }),
        );
    }
    if args.ros {
        let steps = ros::STEPS.iter();
        checks.extend(
            steps.map(|(name, work)| -> Check { (name, Box::new(|| Ok(Verdict::from_passed(work()?)))) }),
        );
    }
    if checks.is_empty() {
        checks.extend(STEPS.iter().map(|step| -> Check { (step.name, Box::new(|| run_step(step))) }));
        checks.push(("features", Box::new(check_feature_sets)));
        checks.push(("book", Box::new(|| Ok(build_book_if_possible()))));
    }
    checks
}

/// A check of ours says why it failed, and the others still run.
fn told(outcome: &Result<()>) -> Verdict {
    if let Err(error) = outcome {
        output::note(&format!("error: {}", output::one_line(error)));
    }
    Verdict::from_passed(outcome.is_ok())
}

fn build_book_if_possible() -> Verdict {
    match MDBOOK.find() {
        Ok(mdbook) => told(&build_book(&mdbook)),
        Err(error) => {
            output::note(&format!("book: not built: {}", output::one_line(&error)));
            Verdict::Skipped
        }
    }
}

fn build_book(mdbook: &Path) -> Result<()> {
    let out = workspace().join("target/book");
    let built = Command::new(mdbook)
        .arg("build")
        .arg(workspace().join("docs"))
        .arg("--dest-dir")
        .arg(&out)
        .status()
        .context("cannot start mdbook")?;
    ensure!(built.success(), "mdbook cannot build the documentation");
    put_replay_into(&out)?;
    output::note(&format!("book: {}", out.join("index.html").display()));
    Ok(())
}

/// The replay that the quick start shows: the first episode of each of the two crowds that need no
/// policies, as the shipped policies of today drive it. It is simulated with the book, so that it
/// is never older than they are.
///
/// cargo runs the demo: the tests before may have built this program anew, and then its own file
/// is no longer there to be started.
fn put_replay_into(book: &Path) -> Result<()> {
    let folder = book.join("replay");
    let made = Command::new(tools::cargo())
        .args(["run", "--quiet", "--release", "--package", "xtask", "--"])
        .args(["demo", "--episodes", "1", "--no-open", "--out"])
        .arg(&folder)
        .current_dir(workspace())
        .stdout(Stdio::null())
        .status()
        .context("cannot start cargo for the demo")?;
    ensure!(made.success(), "the demo cannot make the book's replay");
    let page = folder.join("index.html");
    let bytes = std::fs::metadata(&page).with_context(|| format!("cannot read {}", page.display()))?.len();
    ensure!(bytes <= REPLAY_MAX, "{}: found {bytes} bytes, expected at most {REPLAY_MAX}", page.display());
    Ok(())
}

fn run_step(step: &Step) -> Result<Verdict> {
    cargo(step.name, step.arguments, step.environment).map(Verdict::from_passed)
}

fn check_feature_sets() -> Result<Verdict> {
    let check = ["check", "--release", "--quiet", "--no-default-features"];
    for set in FEATURE_SETS {
        if !cargo("features", &[&check[..], set].concat(), &[])? {
            output::note(&format!("features: cargo {} {}", check.join(" "), set.join(" ")));
            return Ok(Verdict::Failed);
        }
    }
    Ok(Verdict::Passed)
}

/// True if cargo succeeds in the workspace.
fn cargo(step: &str, arguments: &[&str], environment: &[(&str, &str)]) -> Result<bool> {
    let status = Command::new(tools::cargo())
        .args(arguments)
        .envs(environment.iter().copied())
        .current_dir(workspace())
        .status()
        .with_context(|| format!("cannot start cargo for step {step}"))?;
    Ok(status.success())
}
