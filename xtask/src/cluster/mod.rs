//! `cargo xtask ci --slurm`: a grid of small trainings on a real Slurm, one of whose nodes dies in
//! the middle.
//!
//! The same plan is done twice: here by `sweep`, without interruption, and by `sweep --slurm` on a
//! cluster of two nodes that [`slurm`] starts on this machine. When a training on the first node
//! has come some way, that node is killed with all that it runs. Slurm notices, queues its training
//! again, and the other node goes on from the last checkpoint. At the end every run folder must be
//! that of the uninterrupted sweep: the same files with the same bytes, but for the clock in the
//! log.

mod slurm;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};

use self::slurm::{Cluster, NODES, SLURM};
use crate::chaos::compare::differences;
use jostle_runs::output::note;
use jostle_runs::progress::clock;
use jostle_runs::run_folder::{last_holder, latest_update};
use jostle_runs::tools::process_folder;

/// Two agents with 16 beams and small networks: an update takes milliseconds.
const BASE: &str = "\
    checkpoint_every = 50\nN = 2\nM = 2\nhorizon = 64\nminibatch = 32\n\
    network = { embedding = 4, laser_feature = 32, hidden = 32 }\ndiscriminator = { hidden = 32 }\n\
    [sim]\nroom = { width = 16.0, height = 16.0 }\nlaser = { beams = 16 }\nepisode = { step_limit = 40 }\n";
/// The runs of the plan.
const RUNS: [&str; 4] = ["m1-seed1", "m2-seed1", "m1-seed2", "m2-seed2"];
/// Updates of a run, and how many of them the first node makes at least before it dies.
const UPDATES: u64 = 1500;
const UPDATES_BEFORE: u64 = 200;
/// Longest wait for the array.
const DEADLINE: Duration = Duration::from_mins(10);
/// Time between two looks at the runs.
const POLL: Duration = Duration::from_millis(50);

/// Runs the check; what is different is said line by line.
pub(crate) fn check() -> Result<()> {
    SLURM.install()?;
    let folder = process_folder("slurm")?;
    let (here, there) = (store_plan(&folder, "here")?, store_plan(&folder, "slurm")?);
    sweep(&here, &["--jobs", "2"], None)?;
    let mut cluster = Cluster::start(&folder.join("cluster"))?;
    let killed = on_cluster(&mut cluster, &there)?;
    drop(cluster);
    let out = |plan: &Path| plan.with_extension("");
    let mut different = Vec::new();
    for run in RUNS {
        let found = differences(&out(&here).join(run), &out(&there).join(run))?;
        different.extend(found.into_iter().map(|what| format!("{run}: {what}")));
    }
    for line in &different {
        note(line);
    }
    ensure!(different.is_empty(), "the runs on Slurm are others; kept for inspection: {}", folder.display());
    std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    note(&format!(
        "slurm: {} runs on {} nodes, node {} killed at update {} of {}, which was resumed elsewhere: every file has the \
         bytes of the local sweep's",
        RUNS.len(),
        NODES.len(),
        NODES[0],
        killed.update,
        killed.run
    ));
    Ok(())
}

/// The work of the killed node.
struct Killed {
    run: &'static str,
    update: u64,
}

/// Submits the plan, kills the first node at work, and waits until all is done.
fn on_cluster(cluster: &mut Cluster, plan: &Path) -> Result<Killed> {
    sweep(plan, &["--slurm"], Some(cluster))?;
    let began = Instant::now();
    let out = plan.with_extension("");
    let killed = loop {
        ensure!(began.elapsed() < DEADLINE, "no run of node {} came far enough to be killed", NODES[0]);
        std::thread::sleep(POLL);
        let of_node = |run: &&str| last_holder(&out.join(run)).is_some_and(|(host, _)| host == NODES[0]);
        let Some(run) = RUNS.into_iter().find(of_node) else { continue };
        let update = latest_update(&out.join(run))?.unwrap_or(0);
        ensure!(update < UPDATES, "{run} ended before its node could be killed");
        if update >= UPDATES_BEFORE {
            cluster.kill_node(0)?;
            break Killed { run, update };
        }
    };
    note(&format!("slurm: killed node {} at update {} of {}", NODES[0], killed.update, killed.run));
    let again = sweep(plan, &["--slurm"], Some(cluster))?;
    ensure!(again.contains("nothing to submit"), "a second submission was no empty one: {again}");
    // Slurm takes some seconds to notice that the node is gone.
    loop {
        let status = sweep_status(cluster, plan)?;
        if status.contains(&format!("{0} runs: {0} done", RUNS.len())) {
            break;
        }
        if began.elapsed() > DEADLINE {
            bail!("the runs were not done after {}:\n{status}", clock(DEADLINE.as_secs_f64()));
        }
        std::thread::sleep(Duration::from_secs(1));
    }
    let log = out.join("logs").join(format!("{}.txt", killed.run));
    let said = std::fs::read_to_string(&log).with_context(|| format!("cannot read {}", log.display()))?;
    ensure!(said.contains("resumed at update"), "{} was not resumed: {said}", killed.run);
    let (host, _) = last_holder(&out.join(killed.run)).context("a run that nobody made")?;
    ensure!(host == NODES[1], "{} was finished on {host}, which was dead", killed.run);
    Ok(killed)
}

/// Writes the plan whose runs go to the folder of that name.
fn store_plan(folder: &Path, name: &str) -> Result<PathBuf> {
    let write = |path: &Path, text: &str| {
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    };
    let base = folder.join("base.toml");
    write(&base, BASE)?;
    let path = folder.join(format!("{name}.toml"));
    let text = format!(
        "base = '{}'\nout = '{}'\nseeds = [1, 2]\nupdates = {UPDATES}\nthreads = 1\nmilestones = [20_000, 100_000]\n\
         [[variant]]\nname = \"m1\"\nset = [\"n_behaviours=1\"]\n[[variant]]\nname = \"m2\"\n\
         [evaluate]\ncrowds = [\"VO\"]\nepisodes = 3\nmilestones = true\n\
         [slurm]\npartition = \"main\"\ntime = \"30:00\"\nmemory = \"200M\"\n",
        base.display(),
        folder.join(name).display()
    );
    write(&path, &text)?;
    Ok(path)
}

/// Runs `sweep` on a plan; returns what it printed.
fn sweep(plan: &Path, more: &[&str], cluster: Option<&Cluster>) -> Result<String> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut command = Command::new(program);
    command.arg("sweep").arg(plan).args(more);
    answer(command, cluster)
}

fn sweep_status(cluster: &Cluster, plan: &Path) -> Result<String> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut command = Command::new(program);
    command.args(["sweep", "status"]).arg(plan);
    answer(command, Some(cluster))
}

fn answer(mut command: Command, cluster: Option<&Cluster>) -> Result<String> {
    command.stdin(Stdio::null());
    command.envs(cluster.map(Cluster::environment));
    let output = command.output().context("cannot start this program")?;
    if !output.status.success() {
        bail!("{command:?} failed: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
