//! Closed loops with independent peers: a Python robot in a room, over rclpy (Fast DDS) and over
//! Cyclone DDS, and this node.
//!
//! `cargo xtask ci --ros` installs the peers and sets the variables. Without `JOSTLE_ROS_PYTHON`,
//! the Python that has them, these tests say that they are skipped. `JOSTLE_ROS_OUT` names the
//! folder for figures, a picture and what the processes said; `JOSTLE_ROS_ISOLATED` says that this
//! runs in a network of its own, in which the loopback is all that there is.

mod figures;
mod log;
mod processes;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use figures::Figures;
use log::{Entry, commands, first_zero_after, read};
use processes::{Node, Over, Peer, now, wait_until};

/// The policy's period, and what a loaded machine may add to it, s.
const PERIOD: f64 = 0.1;
const MARGIN: f64 = 0.05;
/// A policy and a planner.
const STRONG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/strong-seed1-002035.safetensors");
const PLANNER: &str = "dwa";

/// One at a time: they measure time.
static TURN: Mutex<()> = Mutex::new(());

/// The peers' Python, if there is one, and this test's turn.
fn peers(test: &str) -> Option<(PathBuf, MutexGuard<'static, ()>)> {
    let Some(python) = std::env::var_os("JOSTLE_ROS_PYTHON") else {
        eprintln!(
            "skip: {test}: JOSTLE_ROS_PYTHON names no Python with rclpy and cyclonedds; `cargo xtask ci --ros` makes one"
        );
        return None;
    };
    let python = std::path::absolute(python).expect("a path");
    Some((python, TURN.lock().unwrap_or_else(PoisonError::into_inner)))
}

/// New folder for this test's measurements and the processes' output.
fn folder(name: &str) -> PathBuf {
    let out = std::env::var_os("JOSTLE_ROS_OUT").map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = out.join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder.canonicalize().expect("a folder")
}

#[test]
fn a_robot_over_rclpy_arrives() {
    let Some((python, _turn)) = peers("rclpy") else { return };
    arrives(&python, Over::Rclpy, STRONG);
}

#[test]
fn a_robot_over_cyclone_dds_arrives() {
    let Some((python, _turn)) = peers("cyclonedds") else { return };
    arrives(&python, Over::CycloneDds, STRONG);
}

#[test]
fn killed_processes_over_rclpy() {
    let Some((python, _turn)) = peers("rclpy, killed") else { return };
    killed(&python, Over::Rclpy);
}

#[test]
fn killed_processes_over_cyclone_dds() {
    let Some((python, _turn)) = peers("cyclonedds, killed") else { return };
    killed(&python, Over::CycloneDds);
}

#[test]
fn commands_without_stamps_and_a_planner() {
    let Some((python, _turn)) = peers("twist") else { return };
    for over in [Over::Rclpy, Over::CycloneDds] {
        let folder = folder(&format!("twist-{}", over.name()));
        let node = Node::start(&folder, over, PLANNER, "[command]\nv_max = 0.8\n");
        let robot = Peer::robot(&python, &folder, over, false, Some([1.0, 2.5, 0.0]));
        robot.wait(Duration::from_secs(40));
        let entries = read(&folder.join("robot.ndjson"));
        assert!(
            entries.iter().any(|entry| entry.event == "rests"),
            "{}: see {}",
            over.name(),
            folder.display()
        );
        let fastest = commands(&entries).map(|command| command.v).fold(0.0, f64::max);
        assert!(fastest > 0.5 && fastest <= 0.8, "{fastest}");
        node.stop();
    }
    assert_loopback();
}

/// A whole drive among obstacles: it arrives and rests, and what it took is measured.
fn arrives(python: &Path, over: Over, policy: &str) {
    let folder = folder(&format!("drive-{}", over.name()));
    let node = Node::start(&folder, over, policy, "[command]\ntype = \"TwistStamped\"\n");
    let robot = Peer::robot(python, &folder, over, true, None);
    robot.wait(Duration::from_mins(1));
    let said = node.stop();
    let entries = read(&folder.join("robot.ndjson"));
    let why = || format!("{}: see {}", over.name(), folder.display());
    let rest = entries.iter().find(|entry| entry.event == "rests").unwrap_or_else(|| panic!("{}", why()));
    assert_eq!((rest.v, rest.w), (0.0, 0.0), "{}", why());
    let clearance = entries.iter().filter_map(|entry| entry.clearance).fold(f64::INFINITY, f64::min);
    assert!(clearance > 0.25, "the robot touched something: {clearance} m; {}", why());
    let figures = Figures::new(&entries, &said);
    // A scan that is answered too late is dangerous; one that is never, too.
    assert!(figures.median < 0.05 && figures.p95 < PERIOD, "{figures:?}; {}", why());
    assert!(figures.unanswered * 50 <= figures.scans, "{figures:?}; {}", why());
    assert!(figures.lost_in * 100 <= figures.received, "{figures:?}; {}", why());
    println!("{}", figures.row(over.peer()));
    std::fs::write(folder.join("figures.md"), figures.row(over.peer()) + "\n").expect("written");
    std::fs::write(folder.join("drive.svg"), figures::picture(&entries)).expect("written");
    assert_loopback();
}

/// Either side is killed and started again; then the node is asked to end.
fn killed(python: &Path, over: Over) {
    let folder = folder(&format!("killed-{}", over.name()));
    // Odometry comes every 20 ms; without it for a period, the robot has to stand.
    let params = "[command]\ntype = \"TwistStamped\"\nv_max = 0.3\n[odom]\ntimeout = 0.08\n";
    let log = folder.join("observer.ndjson");
    let _observer = Peer::observer(python, &folder, over);
    let mut node = Node::start(&folder, over, STRONG, params);
    let mut robot = Peer::robot(python, &folder, over, true, None);
    let mut found = Vec::new();
    let drives = |since: f64| {
        wait_until(Duration::from_secs(20), "it drives", || {
            commands(&read(&log)).filter(|command| command.t > since && command.v > 0.1).count() > 8
        });
    };

    // The robot dies.
    drives(0.0);
    let died = now();
    robot.kill();
    let stopped = stands(&log, died);
    found.push(("the robot's side", stopped));
    let from = last_pose(&folder);
    let restarted = now();
    robot = Peer::robot(python, &folder, over, true, Some(from));
    drives(restarted);

    // The driving process dies.
    let died = now();
    node.kill_driving();
    found.push(("the driving process", stands(&log, died)));
    let said = node.wait_failed();
    assert!(
        said.contains("ended by itself (signal: 9 (SIGKILL)); the robot has been commanded to stop"),
        "{said}"
    );
    let restarted = now();
    node = Node::start(&folder, over, STRONG, params);
    drives(restarted);

    // Its guard dies.
    let died = now();
    node.kill_guard();
    found.push(("the guard", stands(&log, died)));
    let restarted = now();
    node = Node::start(&folder, over, STRONG, params);
    drives(restarted);

    // It is asked to end.
    let asked = now();
    node.stop();
    found.push(("SIGTERM", stands(&log, asked)));
    robot.kill();
    let rows: Vec<String> =
        found.iter().map(|(who, time)| format!("| {} | {who} | {:.0} |", over.peer(), time * 1e3)).collect();
    println!("{}", rows.join("\n"));
    std::fs::write(folder.join("killed.md"), rows.join("\n") + "\n").expect("written");
    for (who, time) in found {
        assert!(time <= PERIOD + MARGIN, "{who}: zero {time:.3} s after its end; see {}", folder.display());
    }
    assert_loopback();
}

/// Time after `from` of the first zero command, s; no other may follow.
fn stands(log: &Path, from: f64) -> f64 {
    std::thread::sleep(Duration::from_secs_f64(1.2));
    let entries: Vec<Entry> = read(log);
    let zero = first_zero_after(&entries, from).expect("a zero command");
    let driven =
        commands(&entries).filter(|command| command.t > zero && (command.v != 0.0 || command.w != 0.0));
    assert_eq!(driven.count(), 0, "it drove on; see {}", log.display());
    zero - from
}

fn last_pose(folder: &Path) -> [f64; 3] {
    let entries = read(&folder.join("robot.ndjson"));
    let last = entries.iter().rev().find(|entry| entry.event == "scan").expect("a scan");
    [last.x, last.y, last.heading]
}

/// In a network of its own, nothing but the loopback has carried anything.
fn assert_loopback() {
    if std::env::var_os("JOSTLE_ROS_ISOLATED").is_none() {
        eprintln!("skip: whether traffic stays on the loopback: this is no network of its own");
        return;
    }
    let table = std::fs::read_to_string("/proc/self/net/dev").expect("Linux tells");
    let mut loopback = 0;
    for line in table.lines().skip(2) {
        let (name, counts) = line.split_once(':').expect("an interface");
        let numbers: Vec<u64> =
            counts.split_whitespace().map(|number| number.parse().expect("a count")).collect();
        if name.trim() == "lo" {
            loopback = numbers[0];
        } else {
            assert_eq!((numbers[0], numbers[8]), (0, 0), "{} carried something", name.trim());
        }
    }
    assert!(loopback > 100_000, "the loopback carried {loopback} bytes");
}
