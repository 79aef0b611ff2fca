//! `cargo xtask ci --ros`: the ROS 2 node in `ros/`, a workspace of its own, and closed loops with
//! two independent peers.
//!
//! The peers are Python: rclpy with Fast DDS, as ROS 2 has it, and Cyclone DDS. pip brings them
//! into `target/ros-python`; ROS need not be installed. The loops run in a network of their own, in
//! which nothing but a loopback exists (`unshare`), where the system allows it; elsewhere they are
//! told to keep to the loopback, and whether they do is not checked.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::python::Work;
use jostle_runs::output;
use jostle_runs::provenance::workspace;
use jostle_runs::python::{run_in, system_python};
use jostle_runs::tools::{self, target_folder};

/// Packages that pip installs. The first four are unofficial builds of ROS 2 Kilted, good for
/// tests.
const PEERS: [&str; 6] = [
    "ros-rclpy[fastrtps]==9.1.2",
    "ros-sensor-msgs",
    "ros-nav-msgs",
    "ros-geometry-msgs",
    "cyclonedds==11.0.1",
    "numpy",
];
/// A loopback that multicasts, in an empty network.
const LOOPBACK: &str = "ip link set lo up && ip link set lo multicast on && ip route add 239.0.0.0/8 dev lo";

/// The steps by their names.
pub(crate) const STEPS: [(&str, Work); 6] = [
    ("ros-fmt", || cargo(&["fmt", "--check"])),
    ("ros-clippy", || cargo(&["clippy", "--release", "--all-targets", "--quiet", "--", "-D", "warnings"])),
    ("ros-docs", || cargo(&["doc", "--release", "--no-deps", "--quiet"])),
    ("ros-tests", || cargo(&["test", "--release"])),
    ("ros-setup", set_up),
    ("ros-loops", drive),
];

/// cargo in the workspace of the node. It shares this one's target folder, and so what both build
/// of the same crates.
fn cargo(arguments: &[&str]) -> Result<bool> {
    let mut command = Command::new(tools::cargo());
    command.args(arguments).env("CARGO_TARGET_DIR", target()?).env("RUSTDOCFLAGS", "-D warnings");
    run_in(&folder(), &mut command)
}

/// Makes the environment where there is none, and installs the peers.
fn set_up() -> Result<bool> {
    let (python, here) = (environment().join("bin/python"), workspace());
    if !python.exists()
        && !run_in(here, Command::new(system_python()?).args(["-m", "venv"]).arg(environment()))?
    {
        return Ok(false);
    }
    let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    run_in(here, Command::new(python).args(quiet).args(PEERS))
}

/// The closed loops; then what they took, as the page on ROS 2 has it.
fn drive() -> Result<bool> {
    let out = target()?.join("ros-loops");
    let tests = ["test", "--release", "--offline", "--test", "closed_loop", "--", "--nocapture"];
    let isolated = ["-n", "-rn"].into_iter().find(|option| {
        let tried = Command::new("unshare").args([option, "sh", "-c", LOOPBACK]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    let mut command = if let Some(option) = isolated {
        let mut command = Command::new("unshare");
        command.args([option, "sh", "-c", &format!("{LOOPBACK} && exec \"$@\""), "sh"]).arg(tools::cargo());
        command.env("JOSTLE_ROS_ISOLATED", "1");
        command
    } else {
        output::note(
            "ci: skip: whether traffic stays on the loopback: no network of its own can be made here",
        );
        Command::new(tools::cargo())
    };
    command.args(tests).env("CARGO_TARGET_DIR", target()?).env("JOSTLE_ROS_OUT", &out);
    command.env("JOSTLE_ROS_PYTHON", std::path::absolute(environment().join("bin/python"))?);
    if !run_in(&folder(), &mut command)? {
        return Ok(false);
    }
    let rows = |test: &str, file: &str| -> Result<String> {
        let read = |peer: &&str| {
            let path = out.join(format!("{test}-{peer}")).join(file);
            std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
        };
        ["rclpy", "cyclonedds"].iter().map(read).collect()
    };
    output::result(&format!(
        "| peer | drive (s) | median (ms) | 95 % (ms) | messages lost on the way in | scans without an answer |\n\
         |---|---:|---:|---:|---:|---:|\n{}\n\
         | peer | what ended | zero command after (ms) |\n|---|---|---:|\n{}\npicture: {}\n",
        rows("drive", "figures.md")?,
        rows("killed", "killed.md")?,
        out.join("drive-rclpy/drive.svg").display()
    ))?;
    Ok(true)
}

fn folder() -> PathBuf {
    workspace().join("ros")
}

fn target() -> Result<PathBuf> {
    std::path::absolute(target_folder()).context("cannot find the working directory")
}

fn environment() -> PathBuf {
    target_folder().join("ros-python")
}
