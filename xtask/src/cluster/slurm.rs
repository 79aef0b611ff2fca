//! A cluster of two nodes on this machine: a real slurmctld, two slurmd, and munge, all of them in
//! one folder and gone with it.
//!
//! Each node lives in a process namespace of its own (`unshare --pid`), whose first process is its
//! slurmd. Where that is killed, the kernel kills everything that the node runs, as a power cut
//! would.

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};

use jostle_runs::debian::{Software, find, program};

/// What is needed.
pub(super) const SLURM: Software = Software {
    name: "Slurm and munge",
    programs: &["slurmctld", "slurmd", "sbatch", "munged", "mungekey", "unshare"],
    packages: &["slurm-wlm", "munge", "util-linux"],
};

/// The nodes' names.
pub(super) const NODES: [&str; 2] = ["n1", "n2"];
/// Ports of the controller and of the first node; the second has the next one.
const PORT: u16 = 16_817;
const NODE_PORT: u16 = 17_001;
/// Longest wait for the nodes to be ready.
const READY: Duration = Duration::from_mins(2);

/// A running cluster; its processes end when it is dropped.
pub(super) struct Cluster {
    folder: PathBuf,
    controller: Child,
    munged: Child,
    nodes: [Option<Child>; NODES.len()],
}

impl Cluster {
    /// Starts a cluster whose files are in `folder`, and waits until both nodes are ready.
    pub(super) fn start(folder: &Path) -> Result<Self> {
        for name in ["state", "n1", "n2", "log"] {
            let folder = folder.join(name);
            std::fs::create_dir_all(&folder)
                .with_context(|| format!("cannot create {}", folder.display()))?;
        }
        let munged = start_munge(folder)?;
        let conf = folder.join("slurm.conf");
        std::fs::write(&conf, configuration(folder)?)
            .with_context(|| format!("cannot write {}", conf.display()))?;
        let mut controller = program("slurmctld");
        controller.args(["-c", "-D", "-f"]).arg(&conf);
        let controller = start(controller, folder, "slurmctld")?;
        let mut cluster =
            Self { folder: folder.to_owned(), controller, munged, nodes: [const { None }; NODES.len()] };
        for node in 0..NODES.len() {
            cluster.start_node(node)?;
        }
        let began = Instant::now();
        loop {
            let idle = cluster.ask("sinfo", &["--noheader", "--Node", "--format=%T"]);
            if idle.is_ok_and(|text| text.lines().filter(|state| *state == "idle").count() == NODES.len()) {
                return Ok(cluster);
            }
            if began.elapsed() > READY {
                bail!("the nodes did not become ready; see the logs in {}", folder.join("log").display());
            }
            std::thread::sleep(Duration::from_millis(500));
        }
    }

    /// Starts a node, or starts it again.
    pub(super) fn start_node(&mut self, node: usize) -> Result<()> {
        let mut unshare = program("unshare");
        unshare
            .args(["--pid", "--fork", "--kill-child", "--mount-proc"])
            .arg(find("slurmd").context("slurmd is not there")?)
            .args(["-D", "-N", NODES[node], "-f"])
            .arg(self.folder.join("slurm.conf"));
        self.nodes[node] = Some(start(unshare, &self.folder, NODES[node])?);
        Ok(())
    }

    /// Takes a node away with everything that it runs, by `kill -9`.
    pub(super) fn kill_node(&mut self, node: usize) -> Result<()> {
        if let Some(mut process) = self.nodes[node].take() {
            process.kill().context("cannot kill a node")?;
            process.wait().context("cannot wait for a node's end")?;
        }
        Ok(())
    }

    /// The variables by which a program finds this cluster.
    pub(super) fn environment(&self) -> (&'static str, PathBuf) {
        ("SLURM_CONF", self.folder.join("slurm.conf"))
    }

    /// The answer of one of Slurm's programs.
    pub(super) fn ask(&self, name: &str, arguments: &[&str]) -> Result<String> {
        let (variable, path) = self.environment();
        let output = program(name).args(arguments).env(variable, path).output();
        let Output { status, stdout, stderr } = output.with_context(|| format!("cannot start {name}"))?;
        if !status.success() {
            bail!("{name} failed: {}", String::from_utf8_lossy(&stderr).trim());
        }
        Ok(String::from_utf8_lossy(&stdout).into_owned())
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let nodes = self.nodes.iter_mut().flatten();
        // Whoever is gone already has nothing left to end.
        for process in nodes.chain([&mut self.controller, &mut self.munged]) {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

/// Starts a process whose messages go to a file in the folder's `log`.
fn start(mut command: Command, folder: &Path, name: &str) -> Result<Child> {
    let path = folder.join("log").join(format!("{name}.out"));
    let log = File::options().create(true).append(true).open(&path);
    let log = log.with_context(|| format!("cannot write {}", path.display()))?;
    let again = log.try_clone().with_context(|| format!("cannot write {}", path.display()))?;
    command
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(again)
        .spawn()
        .with_context(|| format!("cannot start {name}"))
}

/// Starts a munge of this cluster's own.
fn start_munge(folder: &Path) -> Result<Child> {
    let key = folder.join("munge.key");
    let made = program("mungekey").arg("--create").arg(format!("--keyfile={}", key.display())).status();
    ensure!(made.context("cannot start mungekey")?.success(), "mungekey cannot make {}", key.display());
    let mut munged = program("munged");
    munged.args(["--force", "--foreground"]);
    for (option, name) in [
        ("socket", "munge.sock"),
        ("key-file", "munge.key"),
        ("pid-file", "munge.pid"),
        ("log-file", "log/munge.log"),
        ("seed-file", "munge.seed"),
    ] {
        munged.arg(format!("--{option}={}", folder.join(name).display()));
    }
    start(munged, folder, "munged")
}

/// Slurm's own configuration: the controller and both nodes are this machine, a job has one
/// processor.
fn configuration(folder: &Path) -> Result<String> {
    let answer = |name: &str, argument: &str| -> Result<String> {
        let output =
            Command::new(name).arg(argument).output().with_context(|| format!("cannot start {name}"))?;
        Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let (host, user) = (answer("hostname", "-s")?, answer("id", "-un")?);
    let d = folder.display();
    let mut text = format!(
        "ClusterName=jostle\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser={user}\nSlurmdUser={user}\n\
         AuthType=auth/munge\nAuthInfo=socket={d}/munge.sock\nCredType=cred/munge\nSlurmctldPort={PORT}\n\
         StateSaveLocation={d}/state\nSlurmdSpoolDir={d}/%n\nSlurmctldPidFile={d}/slurmctld.pid\n\
         SlurmdPidFile={d}/slurmd-%n.pid\nSlurmctldLogFile={d}/log/slurmctld.log\nSlurmdLogFile={d}/log/slurmd-%n.log\n\
         ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
         MpiDefault=none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nSchedulerType=sched/backfill\n\
         SchedulerParameters=bf_interval=2,sched_interval=2\nReturnToService=2\nSlurmdParameters=config_overrides\n\
         SlurmdTimeout=10\n"
    );
    for (port, node) in (NODE_PORT..).zip(NODES) {
        writeln!(
            text,
            "NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 RealMemory=1000"
        )?;
    }
    writeln!(text, "PartitionName=main Nodes={} Default=YES MaxTime=INFINITE State=UP", NODES.join(","))?;
    Ok(text)
}
