//! The processes of a test: each is killed when it goes out of scope.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

/// The software that carries the peer's messages.
#[derive(Clone, Copy)]
pub(crate) enum Over {
    Rclpy,
    CycloneDds,
}

impl Over {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Rclpy => "rclpy",
            Self::CycloneDds => "cyclonedds",
        }
    }

    pub(crate) fn peer(self) -> &'static str {
        match self {
            Self::Rclpy => "rclpy (Fast DDS)",
            Self::CycloneDds => "Cyclone DDS",
        }
    }

    /// A domain for each, so that a process that was left behind disturbs no other test.
    fn domain(self) -> &'static str {
        match self {
            Self::Rclpy => "77",
            Self::CycloneDds => "78",
        }
    }

    /// Everything on the loopback.
    fn environment(self, command: &mut Command) {
        let loopback = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='true'/></Interfaces>\
                        </General></Domain></CycloneDDS>";
        command
            .env("ROS_DOMAIN_ID", self.domain())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
            .env("CYCLONEDDS_URI", loopback);
    }
}

/// Seconds since 1970.
pub(crate) fn now() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970").as_secs_f64()
}

pub(crate) fn wait_until(longest: Duration, what: &str, mut is_so: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < longest, "{what}: not within {longest:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A file that the process's messages are added to.
fn messages(folder: &Path, name: &str) -> (PathBuf, File) {
    let path = folder.join(format!("{name}.txt"));
    let file = OpenOptions::new().create(true).append(true).open(&path).expect("writable");
    (path, file)
}

/// A Python process.
pub(crate) struct Peer {
    child: Child,
    what: String,
}

impl Peer {
    pub(crate) fn robot(
        python: &Path,
        folder: &Path,
        over: Over,
        stamped: bool,
        start: Option<[f64; 3]>,
    ) -> Self {
        let mut more: Vec<String> = stamped.then(|| "--stamped".to_owned()).into_iter().collect();
        if let Some(start) = start {
            more.push("--start".to_owned());
            more.extend(start.map(|number| number.to_string()));
        }
        Self::start(python, folder, over, "robot", &more)
    }

    pub(crate) fn observer(python: &Path, folder: &Path, over: Over) -> Self {
        let more = ["--stamped", "--seconds", "300"].map(str::to_owned);
        Self::start(python, folder, over, "observer", &more)
    }

    fn start(python: &Path, folder: &Path, over: Over, role: &str, more: &[String]) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/peer.py");
        let (path, file) = messages(folder, role);
        let mut command = Command::new(python);
        command.arg("-B").arg(script).args([role, "--over", over.name(), "--log"]);
        command.arg(folder.join(format!("{role}.ndjson"))).args(more);
        over.environment(&mut command);
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(file).spawn().expect("Python");
        Self { child, what: path.display().to_string() }
    }

    /// Waits for its end.
    pub(crate) fn wait(mut self, longest: Duration) {
        let (child, what) = (&mut self.child, &self.what);
        wait_until(longest, what, || child.try_wait().expect("a child").is_some());
        let status = child.wait().expect("a child");
        assert!(status.success(), "{what}: {status}");
    }

    /// kill -9.
    pub(crate) fn kill(mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("a child");
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// `jostle-ros`: the guarding process, with the driving one below it.
pub(crate) struct Node {
    child: Child,
    said: PathBuf,
}

impl Node {
    pub(crate) fn start(folder: &Path, over: Over, policy: &str, params: &str) -> Self {
        let file = folder.join("params.toml");
        std::fs::write(&file, params).expect("written");
        let (said, messages) = messages(folder, "node");
        let mut command = Command::new(env!("CARGO_BIN_EXE_jostle-ros"));
        command.args(["--policy", policy, "--scan", "/scan", "--odom", "/odom", "--goal", "/goal"]);
        command.args(["--cmd", "/cmd_vel", "--params"]).arg(file);
        over.environment(&mut command);
        let child = command.stdin(Stdio::null()).stderr(messages).spawn().expect("jostle-ros");
        Self { child, said }
    }

    /// SIGTERM; what all its processes said.
    pub(crate) fn stop(mut self) -> String {
        signal("-TERM", self.child.id());
        let child = &mut self.child;
        wait_until(Duration::from_secs(5), "jostle-ros ends", || {
            child.try_wait().expect("a child").is_some()
        });
        let said = std::fs::read_to_string(&self.said).expect("readable");
        let status = self.child.wait().expect("a child");
        assert!(status.success(), "{status}: {said}");
        said
    }

    /// kill -9 of the driving process.
    pub(crate) fn kill_driving(&self) {
        signal("-KILL", self.driving());
    }

    /// kill -9 of the guard; the driving process has to end by itself.
    pub(crate) fn kill_guard(mut self) {
        let driving = self.driving();
        self.child.kill().expect("killed");
        self.child.wait().expect("a child");
        let there = Path::new("/proc").join(driving.to_string()).join("exe");
        wait_until(Duration::from_secs(3), "the driving process ends with its guard", || {
            std::fs::read_link(&there).is_err()
        });
    }

    /// Waits for its end, which has to be a failure; what all its processes said.
    pub(crate) fn wait_failed(mut self) -> String {
        let child = &mut self.child;
        wait_until(Duration::from_secs(5), "jostle-ros ends", || {
            child.try_wait().expect("a child").is_some()
        });
        assert!(!self.child.wait().expect("a child").success());
        std::fs::read_to_string(&self.said).expect("readable")
    }

    fn driving(&self) -> u32 {
        let pid = self.child.id();
        let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).expect("Linux tells");
        let children: Vec<u32> = tasks
            .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("children")).ok())
            .flat_map(|text| {
                text.split_whitespace().map(|pid| pid.parse().expect("a number")).collect::<Vec<_>>()
            })
            .collect();
        assert_eq!(children.len(), 1, "{children:?}");
        children[0]
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // The driving process ends when its standard input does.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn signal(name: &str, pid: u32) {
    assert!(Command::new("kill").args([name, &pid.to_string()]).status().expect("kill").success());
}
