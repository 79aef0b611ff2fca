//! A plan's runs as processes on this machine, some at a time.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::collect;
use super::plan::Plan;
use super::spec::Task;
use super::task::{Stage, last_line, log_path};
use jostle_runs::output::{self, note};
use jostle_runs::progress::clock;
use jostle_runs::stop::{self, Stopped};

/// Time between two looks at the processes.
const POLL: Duration = Duration::from_millis(200);
/// Exit statuses of a run that was asked to stop.
const ENDED: [i32; 2] = [stop::STOPPED as i32, stop::INTERRUPTED];
/// Time between two rounds of lines, one for each run, where standard error is no terminal.
const ROUND: Duration = Duration::from_secs(30);

/// Does what is not done yet, `jobs` runs at a time; the exit status tells whether all is done
/// then.
pub(super) fn run(plan: &Plan, jobs: usize) -> Result<ExitCode> {
    let mut waiting = VecDeque::new();
    let (mut done, mut elsewhere) = (0, Vec::new());
    for task in &plan.tasks {
        match Stage::read(plan, task)? {
            Stage::Done => done += 1,
            Stage::Running => elsewhere.push(task.name.as_str()),
            Stage::Waiting | Stage::Stopped | Stage::Trained => waiting.push_back(task),
        }
    }
    stop::on_signals()?;
    note(&format!("sweep: {} runs, {done} of them done", plan.tasks.len()));
    for name in &elsewhere {
        note(&format!("sweep: {name} is left to the process that works on it"));
    }
    let threads = plan.threads.unwrap_or_else(|| (cores() / jobs).max(1));
    let mut board = Board::new();
    let mut running: Vec<Job> = Vec::new();
    let mut failed = Vec::new();
    let mut stopping = false;
    while !(waiting.is_empty() && running.is_empty()) {
        if stop::asked() && !std::mem::replace(&mut stopping, true) {
            board.say("sweep: stopping; each run ends its update and writes a checkpoint");
            waiting.clear();
            for job in &mut running {
                // Their standard input ends, which asks them to stop.
                drop(job.child.stdin.take());
            }
        }
        while running.len() < jobs {
            let Some(task) = waiting.pop_front() else { break };
            running.push(Job::start(plan, task, threads, &board)?);
        }
        std::thread::sleep(POLL);
        let mut still = Vec::new();
        for mut job in running {
            let Some(status) = job.child.try_wait().context("cannot watch a run")? else {
                still.push(job);
                continue;
            };
            job.line.finish_and_clear();
            let (name, seconds) = (&job.task.name, job.started.elapsed().as_secs_f64());
            let said = last_line(&job.log).unwrap_or_default();
            if status.success() {
                done += 1;
                board.say(&format!("sweep: {name} is done after {} ({said})", clock(seconds)));
            } else if status.code().is_some_and(|code| ENDED.contains(&code)) {
                // What it said names the run.
                board.say(&format!("sweep: {said}"));
            } else {
                board.say(&format!("sweep: {name} failed: {said} (see {})", job.log.display()));
                failed.push(name.as_str());
            }
        }
        running = still;
        board.show(&running, (done, waiting.len(), failed.len(), plan.tasks.len()));
    }
    output::result(&collect::store(plan, None)?)?;
    for name in &failed {
        note(&format!("sweep: {name} failed; the same command tries it again"));
    }
    let complete = done == plan.tasks.len();
    if stopping && !complete {
        let again = "nothing is lost, and the same command goes on there";
        let told = format!("sweep: stopped with {done} of {} runs done; {again}", plan.tasks.len());
        return Err(Stopped(told).into());
    }
    Ok(if complete { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// A shell line for each run that is not done.
pub(super) fn lines(plan: &Plan) -> Result<String> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut text = String::new();
    for task in &plan.tasks {
        if Stage::read(plan, task)? != Stage::Done {
            let (program, path) = (quote(&program.to_string_lossy()), quote(&plan.path.to_string_lossy()));
            write!(text, "{program} sweep task {path} {}", quote(&task.name))?;
            writeln!(text, " --threads {}", plan.threads.unwrap_or(1))?;
        }
    }
    Ok(text)
}

/// A word of a shell.
pub(super) fn quote(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// This program. A sweep takes days, and the file may be replaced by a newer build meanwhile: all
/// runs of one call must be made by the same one.
pub(super) fn this_program() -> Result<PathBuf> {
    if cfg!(target_os = "linux") {
        return Ok(PathBuf::from("/proc/self/exe"));
    }
    std::env::current_exe().context("cannot find this program")
}

/// A run that a process works on.
struct Job<'p> {
    task: &'p Task,
    child: Child,
    log: PathBuf,
    started: Instant,
    line: ProgressBar,
}

impl<'p> Job<'p> {
    fn start(plan: &Plan, task: &'p Task, threads: usize, board: &Board) -> Result<Self> {
        let path = log_path(plan, &task.name);
        let folder = path.parent().unwrap_or(&plan.out);
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let cannot_write = || format!("cannot write {}", path.display());
        let mut log = OpenOptions::new().create(true).append(true).open(&path).with_context(cannot_write)?;
        writeln!(log, "--- sweep task {}", task.name).with_context(cannot_write)?;
        let again = log.try_clone().with_context(cannot_write)?;
        let child = Command::new(this_program()?)
            .args(["sweep", "task", "--lifeline", "--threads", &threads.to_string()])
            .args([plan.path.as_os_str(), task.name.as_ref()])
            // Its end tells the run that this process is gone.
            .stdin(Stdio::piped())
            .stdout(log)
            .stderr(again)
            .spawn()
            .with_context(|| format!("cannot start the run {}", task.name))?;
        board.say(&format!("sweep: {} begins, log in {}", task.name, path.display()));
        Ok(Self { task, child, log: path, started: Instant::now(), line: board.line() })
    }
}

/// The view for a person: a line for each run on a terminal, else the same lines now and then.
struct Board {
    terminal: Option<MultiProgress>,
    last_round: Instant,
}

impl Board {
    fn new() -> Self {
        let terminal = std::io::stderr().is_terminal().then(MultiProgress::new);
        Self { terminal, last_round: Instant::now() }
    }

    fn line(&self) -> ProgressBar {
        let Some(terminal) = &self.terminal else { return ProgressBar::hidden() };
        let line = terminal.add(ProgressBar::new_spinner());
        // The template is a constant; should indicatif ever refuse it, its default style serves.
        if let Ok(style) = ProgressStyle::with_template("{wide_msg}") {
            line.set_style(style);
        }
        line
    }

    fn say(&self, text: &str) {
        match &self.terminal {
            Some(terminal) => terminal.suspend(|| note(text)),
            None => note(text),
        }
    }

    fn show(&mut self, running: &[Job<'_>], (done, waiting, failed, all): (usize, usize, usize, usize)) {
        let line = |job: &Job<'_>| last_line(&job.log).unwrap_or_default();
        if self.terminal.is_some() {
            for job in running {
                job.line.set_message(line(job));
            }
        } else if self.last_round.elapsed() >= ROUND && !running.is_empty() {
            self.last_round = Instant::now();
            for job in running {
                note(&line(job));
            }
            let now = running.len();
            note(&format!("sweep: {done} of {all} done, {now} running, {waiting} waiting, {failed} failed"));
        }
    }
}
