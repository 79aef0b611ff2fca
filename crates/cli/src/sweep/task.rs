//! One run of a plan: train what is missing, then test what is asked for.

use std::io::Read as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;

use super::plan::Plan;
use super::spec::Task;
use crate::crew::Crew;
use crate::train::train;
use jostle_runs::folder::is_run_folder;
use jostle_runs::run_folder::{RunFolder, is_locked, latest_update};
use jostle_runs::stop;
use jostle_runs::threads;

/// Arguments of `sweep task`.
#[derive(Args)]
pub(super) struct TaskArgs {
    /// The plan.
    pub(super) plan: PathBuf,
    /// Name of the run, such as `m5-seed1`.
    pub(super) name: String,
    /// Worker threads (default: the plan's, else all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Test the policies that are there, milestones of unfinished runs among them, and train
    /// nothing.
    #[arg(long, conflicts_with = "wait")]
    only_tests: bool,
    /// Wait where another process works in the run's folder, instead of failing.
    #[arg(long)]
    wait: bool,
    /// End when standard input ends: whoever started this process holds the other side.
    #[arg(long, hide = true)]
    lifeline: bool,
}

/// Progress of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// Nothing has been made.
    Waiting,
    /// A process works on it.
    Running,
    /// Updates are missing, and nobody makes them.
    Stopped,
    /// All updates are made, a test is missing.
    Trained,
    /// Nothing is left to do.
    Done,
}

impl Stage {
    /// In the folder of the run.
    pub(super) fn read(plan: &Plan, task: &Task) -> Result<Self> {
        if is_locked(&task.folder)? {
            return Ok(Self::Running);
        }
        if !is_run_folder(&task.folder) {
            return Ok(Self::Waiting);
        }
        if latest_update(&task.folder)?.is_none_or(|update| update < task.config.updates) {
            return Ok(Self::Stopped);
        }
        let tested = plan.evaluation.as_ref().map_or(Ok(true), |evaluation| evaluation.is_done(task))?;
        Ok(if tested { Self::Done } else { Self::Trained })
    }

    /// In a word.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Stopped => "stopped",
            Self::Trained => "trained",
            Self::Done => "done",
        }
    }
}

/// Does the run that the arguments name.
pub(super) fn run(args: &TaskArgs) -> Result<()> {
    stop::on_signals()?;
    if args.lifeline {
        end_with_standard_input();
    }
    let plan = Plan::load(&args.plan)?;
    let task = plan.task(&args.name)?;
    let n_threads = args.threads.map(NonZeroUsize::get).or(plan.threads);
    threads::set(n_threads.and_then(NonZeroUsize::new))?;
    let mut config = task.config.clone();
    config.threads = n_threads.unwrap_or(config.threads);
    let mut care = plan.care(task)?;
    care.wait = args.wait;
    if !args.only_tests {
        train(&config, &task.folder, true, &task.name, &care, &Crew::alone())?;
    } else if plan.evaluation.is_none() || !is_run_folder(&task.folder) {
        bail!(
            "{}: --only-tests: found {}, expected a plan with [evaluate] and a run that has begun",
            args.plan.display(),
            if plan.evaluation.is_none() {
                "no [evaluate]".to_owned()
            } else {
                format!("no run in {}", task.folder.display())
            },
        );
    }
    if let Some(evaluation) = &plan.evaluation {
        let _held = RunFolder::open(&task.folder, args.wait)?;
        stop::anywhere();
        evaluation.run(task)?;
    }
    Ok(())
}

/// Ends this process at the next good place when standard input ends: a sweep that is killed takes
/// its runs along in this way.
fn end_with_standard_input() {
    std::thread::spawn(|| {
        let mut stdin = std::io::stdin().lock();
        let mut bytes = [0; 64];
        while matches!(stdin.read(&mut bytes), Ok(1..)) {}
        stop::ask();
    });
}

/// File that keeps the output of a run's processes.
pub(super) fn log_path(plan: &Plan, name: &str) -> PathBuf {
    plan.out.join("logs").join(format!("{name}.txt"))
}

/// The last line of a file that is not empty, if it has one.
pub(super) fn last_line(path: &Path) -> Option<String> {
    /// Bytes at the end that are searched: a line of progress is far shorter.
    const TAIL: u64 = 4096;
    use std::io::{Seek as _, SeekFrom};
    let mut file = std::fs::File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL))).ok()?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    text.lines().rev().find(|line| !line.trim().is_empty()).map(|line| line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::last_line;

    #[test]
    fn the_last_line_of_a_long_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.txt");
        assert_eq!(last_line(&path), None);
        std::fs::write(&path, format!("{}\nlast one\n\n", "ü".repeat(9000))).unwrap();
        assert_eq!(last_line(&path).as_deref(), Some("last one"));
    }
}
