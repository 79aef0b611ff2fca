//! A disk that is full, a folder that cannot be written, a checkpoint that is gone, a second
//! process: one clear line each time, and what was good before stays good.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::tiny::{config, finished_run, train};
use crate::common::{accepted, refused, text};

/// Runs the command where no file may grow beyond `kib` KiB, as on a disk that is full: writes
/// fail, no signal is sent.
fn on_a_full_disk(kib: u32, arguments: &[&str]) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", kib * 2);
    Command::new("sh").args(["-c", &script, env!("CARGO_BIN_EXE_jostle")]).args(arguments).output().unwrap()
}

#[track_caller]
fn one_line(output: &Output, part: &str) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && message.lines().count() == 1 && message.contains(part), "{message}");
}

fn last_checkpoint(run: &Path) -> Vec<u8> {
    fs::read(run.join("checkpoints/000004.safetensors")).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn training_on_a_full_disk_stops_with_one_line_and_goes_on_later() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &["updates=2"]);
    let before = names(&run.join("checkpoints"));
    let file = config(folder.path());
    let arguments = ["train", "--config", text(&file), "--out", text(&run), "--resume"];
    let output = on_a_full_disk(16, &arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    let last = message.lines().last().unwrap_or_default();
    assert!(
        !output.status.success() && last.starts_with("error:") && last.contains("cannot write"),
        "{message}"
    );
    assert_eq!(names(&run.join("checkpoints")), before, "no half checkpoint stays");
    accepted(&arguments);
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn a_run_that_finds_no_place_at_all_can_start_later() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let file = config(folder.path());
    let arguments = ["train", "--config", text(&file), "--out", text(&run)];
    one_line(&on_a_full_disk(0, &arguments), "cannot write");
    accepted(&arguments);
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn evaluation_on_a_full_disk_stops_with_one_line_and_goes_on_later() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let short = folder.path().join("short");
    let arguments =
        |out| ["evaluate", text(finished_run()), "--crowds", "SF", "--episodes", "8", "--out", out];
    accepted(&arguments(text(&whole)));
    let output = on_a_full_disk(1, &arguments(text(&short)));
    one_line(&output, "cannot write");
    let records = fs::read(short.join("records").join(&names(&short.join("records"))[0])).unwrap();
    assert_eq!(records.len(), 1024, "as much as there was place for");
    accepted(&arguments(text(&short)));
    assert_eq!(names(&short), names(&whole));
    for name in names(&whole.join("records")) {
        let read = |out: &Path| fs::read(out.join("records").join(&name)).unwrap();
        assert!(read(&short) == read(&whole), "{name}");
    }
}

#[test]
fn folders_that_nobody_can_write_are_named() {
    // The system's own table of processes takes no folder, not even root's.
    if !Path::new("/proc/self").exists() {
        let _ = writeln!(std::io::stderr(), "skip: folders that nobody can write: this machine has no /proc");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    refused(&["train", "--config", text(&file), "--out", "/proc/jostle"], &["/proc/jostle"]);
    refused(
        &["evaluate", text(finished_run()), "--crowds", "SF", "--episodes", "1", "--out", "/proc/jostle"],
        &["/proc/jostle"],
    );
}

#[test]
fn what_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    refused(&["evaluate", text(&missing), "--crowds", "SF"], &["missing"]);
    refused(&["train", "--config", text(&missing), "--out", text(folder.path())], &["missing"]);
}

#[test]
fn a_deleted_checkpoint_is_named_and_its_run_goes_on_from_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &[]);
    fs::remove_file(run.join("checkpoints/000004.safetensors")).unwrap();
    refused(&["evaluate", text(&run), "--crowds", "SF"], &["000004.safetensors"]);
    let file = config(folder.path());
    accepted(&["train", "--config", text(&file), "--out", text(&run), "--resume"]);
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn a_kill_after_the_last_checkpoint_leaves_no_old_name_behind() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    train(&run, &[]);
    // As if the process had died after it had written checkpoint 4, and before it named it.
    fs::write(run.join("latest"), "000003.safetensors\n").unwrap();
    fs::write(run.join("checkpoints/.000004.safetensors.1.partial"), "half").unwrap();
    let file = config(folder.path());
    accepted(&["train", "--config", text(&file), "--out", text(&run), "--resume"]);
    assert_eq!(fs::read_to_string(run.join("latest")).unwrap(), "000004.safetensors\n");
    assert_eq!(names(&run.join("checkpoints")), names(&finished_run().join("checkpoints")));
}

#[test]
fn a_second_process_is_refused_and_the_first_not_disturbed() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let file = config(folder.path());
    let endless = [
        "train",
        "--config",
        text(&file),
        "--out",
        text(&run),
        "--set",
        "updates=1000000",
        "--set",
        "checkpoint_every=1000000",
    ];
    let mut first = Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(endless)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !run.join("latest").exists() && begun.elapsed() < Duration::from_mins(1) {
        std::thread::sleep(Duration::from_millis(5));
    }
    refused(&[&endless[..], &["--resume"]].concat(), &["another process is working in"]);
    assert!(first.try_wait().unwrap().is_none(), "the first goes on");
    first.kill().unwrap();
    first.wait().unwrap();
    // The lock dies with its process.
    let shorter = ["train", "--config", text(&file), "--out", text(&run), "--resume"];
    accepted(&shorter);
    assert!(last_checkpoint(&run) == last_checkpoint(finished_run()), "the last checkpoints differ");
}

#[test]
fn a_run_that_stops_at_a_number_names_it_and_keeps_its_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let file = config(folder.path());
    let arguments = ["train", "--config", text(&file), "--out", text(&run), "--set", "learning_rate=1e38"];
    refused(&arguments, &["update 1", "is not finite"]);
    assert_eq!(names(&run.join("checkpoints")), ["000000.safetensors"]);
    refused(&[&arguments[..], &["--resume"]].concat(), &["update 1", "is not finite"]);
}
