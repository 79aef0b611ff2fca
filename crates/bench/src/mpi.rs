//! The program `jostle` with MPI, and jobs of it under `mpirun`.

use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};

use jostle_runs::debian::{Software, program};
use jostle_runs::output::note;
use jostle_runs::provenance::workspace;
use jostle_runs::tools::{cargo, target_folder};

/// An MPI library, and what its bindings are made with.
const MPI: Software = Software {
    name: "Open MPI and clang's library",
    programs: &["mpirun", "mpicc", "clang"],
    packages: &["libopenmpi-dev", "openmpi-bin", "libclang-dev", "clang"],
};
const POLL: Duration = Duration::from_millis(20);
/// Number of the next job.
static JOBS: AtomicU32 = AtomicU32::new(0);

/// The program, built with MPI.
pub struct Program {
    path: PathBuf,
    folder: PathBuf,
}

impl Program {
    /// Builds it, installing what that needs, and puts a copy into a folder, where the messages of
    /// its jobs go, too.
    ///
    /// # Errors
    /// When something is missing and cannot be installed, or the program cannot be built.
    pub fn build(folder: &Path) -> Result<Self> {
        MPI.install()?;
        note("building jostle with MPI");
        let built = Command::new(cargo())
            .args(["build", "--release", "--quiet", "--workspace", "--bin", "jostle"])
            .args(["--features", "jostle-cli/mpi"])
            .current_dir(workspace())
            .status()
            .context("cannot start cargo")?;
        ensure!(built.success(), "jostle cannot be built with the feature `mpi`");
        // The next build without MPI writes to the same place.
        let name = format!("jostle{}", std::env::consts::EXE_SUFFIX);
        let (from, path) = (target_folder().join("release").join(&name), folder.join(&name));
        std::fs::copy(&from, &path).with_context(|| format!("cannot copy {}", from.display()))?;
        Ok(Self { path, folder: folder.to_owned() })
    }

    /// A job of so many ranks, or of one process without MPI.
    pub fn job(&self, ranks: Option<usize>) -> Job {
        self.job_with(ranks, &[])
    }

    /// As [`Self::job`], with options of `mpirun`.
    pub fn job_with(&self, ranks: Option<usize>, options: &[&str]) -> Job {
        let mut command = match ranks {
            None => Command::new(&self.path),
            Some(ranks) => {
                let mut command = program("mpirun");
                command.args(["--oversubscribe", "--allow-run-as-root", "--bind-to", "none"]);
                command.args(options).args(["-n", &ranks.to_string()]);
                command.arg(&self.path);
                command
            }
        };
        command.stdin(Stdio::null()).current_dir(&self.folder);
        let number = JOBS.fetch_add(1, Ordering::Relaxed);
        Job { command, messages: self.folder.join(format!("messages-{number}.txt")) }
    }
}

/// A job that is about to be started.
pub struct Job {
    command: Command,
    messages: PathBuf,
}

impl Job {
    /// Adds arguments of `jostle`.
    pub fn add(&mut self, arguments: &[impl AsRef<OsStr>]) -> &mut Self {
        self.command.args(arguments);
        self
    }

    /// Starts it; its messages go to a file.
    pub fn start(mut self) -> Result<Running> {
        let shown = self.messages.display();
        let messages = File::create(&self.messages).with_context(|| format!("cannot write {shown}"))?;
        let again = messages.try_clone().with_context(|| format!("cannot write {shown}"))?;
        let child = self.command.stdout(again).stderr(messages).spawn();
        let child = child.with_context(|| format!("cannot start {:?}", self.command))?;
        let shown = format!("{:?}", self.command);
        Ok(Running { child, shown, messages: self.messages })
    }

    /// Runs it to a good end; returns all that it said.
    pub fn run_to_end(self) -> Result<String> {
        self.start()?.good_end()
    }
}

/// A job at work.
pub struct Running {
    child: Child,
    /// Its command line.
    shown: String,
    messages: PathBuf,
}

impl Running {
    /// Waits for a good end; returns all that was said.
    pub fn good_end(mut self) -> Result<String> {
        let status = self.child.wait().context("cannot wait for a job")?;
        let said = self.said()?;
        ensure!(status.success(), "{} failed: {}", self.shown, said.trim());
        Ok(said)
    }

    /// True while it works.
    pub fn is_running(&mut self) -> Result<bool> {
        Ok(self.child.try_wait().context("cannot wait for a job")?.is_none())
    }

    /// Sends the last of its ranks a signal.
    pub fn signal_last_rank(&self, signal: &str) -> Result<()> {
        let ranks = self.ranks()?;
        let rank = ranks.last().context("the job has no ranks")?;
        let sent = Command::new("kill").args(["-s", signal, &rank.to_string()]).status();
        ensure!(sent.context("cannot start kill")?.success(), "cannot send {signal} to a rank");
        Ok(())
    }

    /// The processes that `mpirun` has started.
    fn ranks(&self) -> Result<Vec<u32>> {
        let id = self.child.id();
        let path = format!("/proc/{id}/task/{id}/children");
        let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {path}"))?;
        Ok(text.split_whitespace().filter_map(|word| word.parse().ok()).collect())
    }

    /// Waits for the end; returns the exit status, if no signal ended it, and all that was said.
    ///
    /// # Errors
    /// When it takes longer; the job is killed then.
    pub fn wait(mut self, at_most: Duration) -> Result<(Option<i32>, String)> {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().context("cannot wait for a job")? {
                return Ok((status.code(), self.said()?));
            }
            if began.elapsed() > at_most {
                for rank in self.ranks().unwrap_or_default() {
                    let _ = Command::new("kill").args(["-s", "KILL", &rank.to_string()]).status();
                }
                let _ = self.child.kill();
                let _ = self.child.wait();
                bail!("the job did not end within {} s: {}", at_most.as_secs(), self.said()?.trim());
            }
            std::thread::sleep(POLL);
        }
    }

    fn said(&self) -> Result<String> {
        std::fs::read_to_string(&self.messages)
            .with_context(|| format!("cannot read {}", self.messages.display()))
    }
}
