//! The victim: this program itself, training or evaluating something small.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use jostle_policy::TensorFile;

use super::trigger::{Moment, Trigger};
use jostle_runs::folder::latest_checkpoint;
use jostle_runs::run_folder::latest_update;
use jostle_runs::stop;

/// Two agents with 16 beams and networks of 32 units: an update takes milliseconds, a checkpoint as
/// long.
const CONFIG: &str = "\
    updates = 12\ncheckpoint_every = 2\nN = 2\nM = 2\nhorizon = 64\nminibatch = 32\n\
    network = { embedding = 4, laser_feature = 32, hidden = 32 }\ndiscriminator = { hidden = 32 }\n\
    [sim]\nroom = { width = 16.0, height = 16.0 }\nlaser = { beams = 16 }\nepisode = { step_limit = 40 }\n";

/// Time between two looks for the moment.
const POLL: Duration = Duration::from_micros(200);

/// A command that is started over and over.
pub(super) struct Victim {
    name: &'static str,
    folder: PathBuf,
    /// Everything but the output folder.
    arguments: Vec<String>,
    /// The file, below its output folder, that grows line by line.
    growing: &'static str,
    /// True if it is asked to stop instead of killed.
    gently: bool,
}

/// The end of a process.
pub(super) enum Ending {
    /// By itself, before the moment came.
    Finished,
    /// By our hand.
    Killed(Moment),
}

impl Victim {
    /// Training of the small configuration.
    pub(super) fn train(folder: &Path, gently: bool) -> Result<Self> {
        let config = folder.join("config.toml");
        fs::write(&config, CONFIG).with_context(|| format!("cannot write {}", config.display()))?;
        let arguments = ["train", "--config", &config.display().to_string(), "--resume"];
        Ok(Self {
            name: "train",
            folder: folder.to_owned(),
            arguments: arguments.map(str::to_owned).to_vec(),
            growing: "log.ndjson",
            gently,
        })
    }

    /// Evaluation of a trained run in the crowds that need no pool.
    pub(super) fn evaluate(folder: &Path, run: &Path) -> Result<Self> {
        let checkpoint = latest_checkpoint(run)?;
        let arguments = [
            "evaluate",
            &checkpoint.display().to_string(),
            "--crowds",
            "VO,SF",
            "--agents",
            "4",
            "--episodes",
            "40",
        ];
        Ok(Self {
            name: "evaluate",
            folder: folder.to_owned(),
            arguments: arguments.map(str::to_owned).to_vec(),
            growing: "records",
            gently: false,
        })
    }

    /// Its name.
    pub(super) fn name(&self) -> &'static str {
        self.name
    }

    /// An output folder of that name.
    pub(super) fn folder(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The output folder of the uninterrupted run.
    pub(super) fn reference(&self) -> PathBuf {
        self.folder(&format!("{}-uninterrupted", self.name))
    }

    /// Makes the uninterrupted run; returns how long it took.
    pub(super) fn uninterrupted(&self) -> Result<Duration> {
        let started = Instant::now();
        self.finish(&self.reference(), 1)?;
        Ok(started.elapsed())
    }

    /// Lets a run go on to its end.
    pub(super) fn finish(&self, out: &Path, threads: u32) -> Result<()> {
        self.check_end(self.start(out, threads)?)
    }

    /// Lets a run go on until the trigger's moment.
    pub(super) fn start_and_kill(&self, out: &Path, threads: u32, trigger: &Trigger) -> Result<Ending> {
        let mut child = self.start(out, threads)?;
        let started = Instant::now();
        let mut length = None;
        loop {
            if child.try_wait().context("cannot watch the process")?.is_some() {
                self.check_end(child)?;
                return Ok(Ending::Finished);
            }
            if started.elapsed() >= trigger.delay {
                let now = self.grown(out);
                let due = match trigger.moment {
                    Moment::Any => true,
                    Moment::Checkpoint => holds_partial(&out.join("checkpoints")),
                    Moment::Append => *length.get_or_insert(now) != now,
                };
                if due {
                    break;
                }
            }
            std::thread::sleep(POLL);
        }
        std::thread::sleep(trigger.pause);
        if self.gently {
            return self.stop(child, trigger.moment);
        }
        // SIGKILL; a process that has just ended by itself is no error.
        child.kill().context("cannot kill the process")?;
        child.wait().context("cannot wait for the process")?;
        Ok(Ending::Killed(trigger.moment))
    }

    /// Asks a process to stop, and waits until it has.
    fn stop(&self, mut child: Child, moment: Moment) -> Result<Ending> {
        let sent = Command::new("kill").args(["-TERM", &child.id().to_string()]).status();
        sent.context("cannot start kill")?;
        let status = child.wait().context("cannot wait for the process")?;
        match status.code() {
            Some(0) => Ok(Ending::Finished),
            Some(code) if code == i32::from(stop::STOPPED) => Ok(Ending::Killed(moment)),
            // The signal came before the process watched for it, and so before it made an update.
            None => Ok(Ending::Killed(moment)),
            Some(_) => {
                bail!("{}: found {status} after SIGTERM, expected {}", self.name, stop::STOPPED)
            }
        }
    }

    /// True if it is asked to stop instead of killed.
    pub(super) fn gently(&self) -> bool {
        self.gently
    }

    /// The updates that a process which was asked to stop has left behind its newest checkpoint,
    /// which should be nothing.
    pub(super) fn lost_updates(&self, out: &Path) -> Result<Option<String>> {
        let path = out.join(self.growing);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let (made, kept) = (text.lines().count() as u64, latest_update(out)?.unwrap_or(0));
        let told =
            format!("{}: {made} updates are logged, and the newest checkpoint has {kept}", out.display());
        Ok((made != kept).then_some(told))
    }

    /// Check that what was finished before the kill is still whole: the checkpoint that `latest`
    /// names.
    pub(super) fn lost_checkpoint(out: &Path) -> Option<String> {
        if !out.join("latest").exists() {
            return None;
        }
        let whole = latest_checkpoint(out)
            .map_err(anyhow::Error::from)
            .and_then(|path| Ok(TensorFile::read(&path)?.verify_checksum()?));
        whole.err().map(|error| format!("{}: the newest checkpoint was lost: {error:#}", out.display()))
    }

    /// The file that grows, once it is there.
    pub(super) fn growing_file(&self, out: &Path) -> Option<PathBuf> {
        let path = out.join(self.growing);
        if path.is_dir() {
            let mut files: Vec<PathBuf> =
                fs::read_dir(path).ok()?.filter_map(|e| Some(e.ok()?.path())).collect();
            files.sort();
            return files.pop();
        }
        path.exists().then_some(path)
    }

    fn grown(&self, out: &Path) -> u64 {
        let length = |path: PathBuf| fs::metadata(path).ok().map(|about| about.len());
        self.growing_file(out).and_then(length).unwrap_or(0)
    }

    fn start(&self, out: &Path, threads: u32) -> Result<Child> {
        let program = std::env::current_exe().context("cannot find this program")?;
        Command::new(program)
            .args(&self.arguments)
            .arg("--out")
            .arg(out)
            // By the environment, as the stored configuration names `threads`.
            .env("RAYON_NUM_THREADS", threads.to_string())
            // The source may change while this runs; without a repository all runs name the same
            // commit.
            .env("GIT_DIR", self.folder.join("no-repository"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", self.name))
    }

    fn check_end(&self, child: Child) -> Result<()> {
        let output = child.wait_with_output().context("cannot wait for the process")?;
        if !output.status.success() {
            bail!("{} failed: {}", self.name, String::from_utf8_lossy(&output.stderr).trim());
        }
        Ok(())
    }
}

/// True while a temporary file stands in the folder.
fn holds_partial(folder: &Path) -> bool {
    let partial = |entry: fs::DirEntry| entry.path().extension().is_some_and(|e| e == "partial");
    fs::read_dir(folder).is_ok_and(|entries| entries.flatten().any(partial))
}
