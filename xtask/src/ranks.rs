//! `cargo xtask ci --mpi`: one run in several processes, over a real MPI.
//!
//! Each kind of run is made by one process without MPI, and then by one, two and four ranks under
//! `mpirun`: every run folder must have the same files with the same bytes, but for the clock in
//! the log. Then runs are ended in the middle, by SIGTERM and by the death of one rank, and go on
//! with another number of ranks: to the same bytes. What cannot be trained must end all ranks with
//! one line.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};

use crate::chaos::compare::differences;
use jostle_bench::mpi::{Job, Program};
use jostle_runs::output::note;
use jostle_runs::run_folder::latest_update;
use jostle_runs::stop::STOPPED;
use jostle_runs::tools::process_folder;

/// Four rooms of two agents with 16 beams in as many shards: an update takes milliseconds.
const BASE: &str = "\
    checkpoint_every = 20\nN = 2\nM = 5\nR = 4\nshards = 4\nhorizon = 32\nminibatch = 64\n\
    network = { embedding = 4, laser_feature = 32, hidden = 32 }\ndiscriminator = { hidden = 32 }\n\
    [sim]\nroom = { width = 16.0, height = 16.0 }\nlaser = { beams = 16 }\nepisode = { step_limit = 40 }\n";
/// The kinds of a run.
const KINDS: [(&str, &[&str]); 3] =
    [("m1", &["n_behaviours=1"]), ("m5", &[]), ("pooled", &["sim.laser.beams=64", "network.scan_pool=4"])];
/// Updates of a run that is compared.
const UPDATES: u64 = 40;
/// Updates of a run that is ended, and after how many of them that is at the earliest.
const UPDATES_LONG: u64 = 2000;
const UPDATES_BEFORE: u64 = 100;
/// Longest wait for an end.
const DEADLINE: Duration = Duration::from_mins(5);
const POLL: Duration = Duration::from_millis(20);

/// Runs the check; what is different is said line by line.
pub(crate) fn check() -> Result<()> {
    let folder = process_folder("mpi")?;
    let program = Program::build(&folder)?;
    let config = folder.join("base.toml");
    std::fs::write(&config, BASE).with_context(|| format!("cannot write {}", config.display()))?;
    let mut different = Vec::new();
    for (kind, set) in KINDS {
        let run = |name: &str, ranks| -> Result<_> {
            let out = folder.join(format!("{kind}-{name}"));
            train(&program, &config, &out, ranks, UPDATES, set).run_to_end()?;
            Ok(out)
        };
        let alone = run("alone", None)?;
        for ranks in [1, 2, 4] {
            let found = differences(&alone, &run(&format!("on-{ranks}"), Some(ranks))?)?;
            different.extend(found.into_iter().map(|what| format!("{kind} on {ranks} ranks: {what}")));
        }
        note(&format!("mpi: {kind}: one process, and 1, 2 and 4 ranks"));
    }
    let whole = folder.join("whole");
    train(&program, &config, &whole, None, UPDATES_LONG, &[]).run_to_end()?;
    for end in [End::Stopped, End::Killed] {
        let out = folder.join(end.word());
        let update = end_in_the_middle(&program, &config, &out, end)?;
        let mut again = train(&program, &config, &out, Some(end.ranks_after()), UPDATES_LONG, &[]);
        again.add(&["--resume"]);
        let said = again.run_to_end()?;
        ensure!(said.contains("resumed at update"), "the run was not resumed: {said}");
        different
            .extend(differences(&whole, &out)?.into_iter().map(|what| format!("{}: {what}", end.word())));
        let (before, after) = (end.ranks_before(), end.ranks_after());
        note(&format!("mpi: {} at update {update} on {before} ranks, resumed on {after}", end.word()));
    }
    refusals(&program, &config, &folder)?;
    for line in &different {
        note(line);
    }
    ensure!(different.is_empty(), "the runs on ranks are others; kept for inspection: {}", folder.display());
    std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    note("mpi: every file has the bytes of the run of one process");
    Ok(())
}

/// A training of the configuration into a folder.
fn train(
    program: &Program,
    config: &Path,
    out: &Path,
    ranks: Option<usize>,
    updates: u64,
    set: &[&str],
) -> Job {
    let mut job = program.job(ranks);
    job.add(&["train", "--threads", "1", "--config"]).add(&[config]).add(&["--out"]).add(&[out]);
    job.add(&["--set", &format!("updates={updates}")]);
    for key in set {
        job.add(&["--set", *key]);
    }
    job
}

/// How a run is ended.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    /// One rank is asked to end, as a scheduler asks all of them.
    Stopped,
    /// One rank dies.
    Killed,
}

impl End {
    fn word(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Killed => "killed",
        }
    }

    fn signal(self) -> &'static str {
        match self {
            Self::Stopped => "TERM",
            Self::Killed => "KILL",
        }
    }

    fn ranks_before(self) -> usize {
        match self {
            Self::Stopped => 4,
            Self::Killed => 2,
        }
    }

    fn ranks_after(self) -> usize {
        match self {
            Self::Stopped => 2,
            Self::Killed => 4,
        }
    }
}

/// Begins a long run and sends its last rank a signal; all ranks must end. Returns the update of
/// the last checkpoint.
fn end_in_the_middle(program: &Program, config: &Path, out: &Path, end: End) -> Result<u64> {
    let mut running = train(program, config, out, Some(end.ranks_before()), UPDATES_LONG, &[]).start()?;
    let began = Instant::now();
    while latest_update(out)?.unwrap_or(0) < UPDATES_BEFORE {
        ensure!(running.is_running()?, "the run ended before it could be {}", end.word());
        ensure!(began.elapsed() < DEADLINE, "the run did not come to update {UPDATES_BEFORE}");
        std::thread::sleep(POLL);
    }
    running.signal_last_rank(end.signal())?;
    let (status, said) = running.wait(DEADLINE)?;
    let update = latest_update(out)?.context("no checkpoint")?;
    ensure!(update < UPDATES_LONG, "the run was done before it could be {}", end.word());
    match end {
        End::Stopped => {
            ensure!(
                status == Some(i32::from(STOPPED)),
                "found exit status {status:?}, expected {STOPPED}: {said}"
            );
            let told = said.lines().filter(|line| line.contains("train: stopped at update")).count();
            ensure!(told == 1, "one rank was to tell of the stop: {said}");
        }
        End::Killed => ensure!(status != Some(0), "a run whose rank died was a success: {said}"),
    }
    Ok(update)
}

/// Runs that cannot be: all ranks end, and one line says why.
fn refusals(program: &Program, config: &Path, folder: &Path) -> Result<()> {
    let out = folder.join("refused");
    for (ranks, set, expected) in [
        (3, &[][..], "found 3 ranks, expected a power of two of at most 4 (shards)"),
        (2, &["learning_rate=1e38"], "is not finite"),
        (2, &["shards=3"], "shards: found 3, expected a power of two"),
    ] {
        let running = train(program, config, &out, Some(ranks), UPDATES, set).start()?;
        let (status, said) = running.wait(DEADLINE)?;
        let lines: Vec<&str> = said.lines().filter(|line| line.starts_with("error: ")).collect();
        ensure!(status != Some(0), "{set:?} on {ranks} ranks was a success");
        ensure!(
            lines.len() == 1 && lines[0].contains(expected),
            "{set:?} on {ranks} ranks: found {lines:?}, expected one line with {expected:?}: {said}"
        );
        if out.exists() {
            std::fs::remove_dir_all(&out).with_context(|| format!("cannot remove {}", out.display()))?;
        }
    }
    note("mpi: what cannot be trained ends all ranks with one line");
    Ok(())
}
