//! A run folder: what it holds, and that a resumed run ends with the bytes of one that was not
//! interrupted.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::tiny::{config, finished_run, train};
use crate::common::{accepted, jostle, text};

/// The log without its clock.
fn curve(run: &Path) -> Vec<serde_json::Value> {
    let lines = fs::read_to_string(run.join("log.ndjson")).unwrap();
    let record = |line: &str| {
        let mut record: serde_json::Value = serde_json::from_str(line).unwrap();
        record.as_object_mut().unwrap().remove("clock").unwrap();
        record
    };
    lines.lines().map(record).collect()
}

fn last_checkpoint(run: &Path) -> Vec<u8> {
    let name = fs::read_to_string(run.join("latest")).unwrap();
    fs::read(run.join("checkpoints").join(name.trim())).unwrap()
}

fn resume(run: &Path, overrides: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    let mut arguments =
        vec!["train", "--config", text(&file), "--out", text(run), "--resume", "--threads", "2"];
    for argument in overrides {
        arguments.extend(["--set", argument]);
    }
    let output = jostle(&arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{message}");
    message
}

#[test]
fn a_run_folder_holds_config_log_and_checkpoints() {
    let run = finished_run();
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(config.contains("n_agents = 2") && config.contains("gamma = 0.99"), "{config}");
    let updates: Vec<u64> = curve(run).iter().map(|record| record["update"].as_u64().unwrap()).collect();
    assert_eq!(updates, [1, 2, 3, 4]);
    assert_eq!(fs::read_to_string(run.join("latest")).unwrap(), "000004.safetensors\n");
    assert!(run.join("checkpoints/000002.safetensors").exists());
    assert!(!run.join("checkpoints/000000.safetensors").exists(), "the first checkpoint has served its time");
}

#[test]
fn a_resumed_run_ends_like_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &["updates=2"]);
    resume(&run, &[]);
    assert_eq!(curve(&run), curve(finished_run()));
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn what_came_after_the_checkpoint_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &["updates=3"]);
    // As if the process had died while it wrote line 4, after it had lost checkpoint 3.
    fs::remove_file(run.join("checkpoints/000003.safetensors")).unwrap();
    let log = run.join("log.ndjson");
    let whole = fs::read_to_string(&log).unwrap();
    fs::write(&log, format!("{whole}{{\"update\":4,\"trans")).unwrap();
    let message = resume(&run, &[]);
    assert!(
        message.contains("torn") && message.contains("made again") && message.contains("update 2"),
        "{message}"
    );
    assert_eq!(curve(&run), curve(finished_run()));
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn a_damaged_newest_checkpoint_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &["updates=3"]);
    let newest = run.join("checkpoints/000003.safetensors");
    let mut bytes = fs::read(&newest).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&newest, bytes).unwrap();
    let message = resume(&run, &[]);
    assert!(message.contains("damaged"), "{message}");
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn a_finished_run_is_reused() {
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    let before = last_checkpoint(finished_run());
    let out = accepted(&["train", "--config", text(&file), "--out", text(finished_run()), "--resume"]);
    assert!(out.contains("finished already"), "{out}");
    assert!(last_checkpoint(finished_run()) == before);
}

/// A training that goes on until it is stopped and writes no checkpoint by itself.
fn endless(folder: &Path, run: &Path, overrides: &[&str]) -> Child {
    let file = config(folder);
    let length = ["updates=1000000", "checkpoint_every=1000000"];
    let mut arguments = vec![
        "train",
        "--config",
        text(&file),
        "--out",
        text(run),
        "--threads",
        "1",
        "--checkpoint-minutes",
        "0",
    ];
    for argument in length.iter().chain(overrides) {
        arguments.extend(["--set", argument]);
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_jostle"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn send(signal: &str, process: &Child) {
    let sent = Command::new("kill").args([signal, &process.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Waits until a run folder is so far.
fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_mins(2);
    while !is_so() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_signal_ends_a_run_at_a_checkpoint_and_nothing_is_lost() {
    for signal in ["-TERM", "-INT"] {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let process = endless(folder.path(), &run, &[]);
        let made = || fs::read_to_string(run.join("log.ndjson")).unwrap_or_default().lines().count();
        wait_for("training did not start", || made() >= 5);
        assert_eq!(fs::read_to_string(run.join("latest")).unwrap(), "000000.safetensors\n", "too early");
        send(signal, &process);
        let output = process.wait_with_output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        let last = message.lines().last().unwrap();
        assert_eq!(output.status.code(), Some(75), "{message}");
        let (at, next) =
            (format!("stopped at update {} of 1000000", made()), "the same command with --resume");
        assert!(last.contains(&at) && last.contains(next) && !last.contains("error"), "{message}");
        assert_eq!(fs::read_to_string(run.join("latest")).unwrap(), format!("{:06}.safetensors\n", made()));
        // It goes on there, and ends as a run that was never stopped.
        let length = format!("updates={}", made() + 2);
        let message = resume(&run, &[&length]);
        assert!(!message.contains("made again"), "{message}");
        let whole = folder.path().join("whole");
        train(&whole, &[&length]);
        assert_eq!(curve(&run), curve(&whole));
        assert!(last_checkpoint(&run) == last_checkpoint(&whole), "the last checkpoints differ");
    }
}

#[test]
fn a_second_signal_ends_a_run_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    // One update takes many seconds.
    let process = endless(folder.path(), &run, &["horizon=65536"]);
    wait_for("training did not start", || run.join("latest").exists());
    send("-INT", &process);
    std::thread::sleep(Duration::from_millis(200));
    send("-INT", &process);
    let output = process.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(fs::read_to_string(run.join("latest")).unwrap(), "000000.safetensors\n");
    assert_eq!(fs::read_to_string(run.join("log.ndjson")).unwrap(), "");
}

#[test]
fn every_help_has_an_example() {
    for command in ["train", "evaluate", "reproduce", "demo", "sweep"] {
        let help = accepted(&[command, "--help"]);
        assert!(help.contains("Example") && help.contains(&format!("jostle {command}")), "{help}");
    }
}
