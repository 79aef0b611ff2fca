//! Bad input is refused with exactly one clear line and a non-zero exit, and nothing is
//! overwritten.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::tiny::{TINY, config, finished_run, train};
use crate::common::{jostle, refused, text};

/// Every file under a folder with its bytes; locks come and go.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else if path.file_name().unwrap() != "lock" {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

/// Copies a folder.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

/// `train` with a configuration text is refused, and its folder is not even made.
#[track_caller]
fn config_refused(text_of_config: &str, parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("config.toml");
    fs::write(&file, text_of_config).unwrap();
    let out = folder.path().join("run");
    refused(&["train", "--config", text(&file), "--out", text(&out)], parts);
    assert!(!out.exists());
}

#[track_caller]
fn evaluate_refused(checkpoint: &Path, more: &[&str], parts: &[&str]) {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("records");
    let mut arguments = vec!["evaluate", text(checkpoint), "--out", text(&out)];
    for default in [["--crowds", "SF"], ["--episodes", "1"]] {
        if !more.contains(&default[0]) {
            arguments.extend(default);
        }
    }
    arguments.extend(more);
    refused(&arguments, parts);
    assert!(!out.exists(), "a refused evaluation left records");
}

#[test]
fn a_name_that_no_shipped_configuration_has() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let arguments = ["train", "--config", "smal_m1", "--out", text(&run)];
    refused(
        &arguments,
        &["smal_m1: found neither a file nor a shipped configuration", "did you mean small_m1"],
    );
    assert!(!run.exists());
}

#[test]
fn unknown_key() {
    config_refused("sede = 3\n", &["config.toml:1:1", "sede", "expected seed"]);
}

#[test]
fn wrong_type() {
    config_refused("updates = \"many\"\n", &["updates", "many"]);
}

#[test]
fn negative_alpha() {
    config_refused("alpha = -0.1\n", &["alpha", "-0.1"]);
}

#[test]
fn no_agent_and_no_behaviour() {
    config_refused("N = 0\n", &["n_agents", "found 0"]);
    config_refused("M = 0\n", &["n_behaviours", "found 0"]);
}

#[test]
fn an_override_is_checked_like_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    let out = folder.path().join("run");
    refused(
        &["train", "--config", text(&file), "--out", text(&out), "--set", "alpha=-1"],
        &["--set alpha=-1"],
    );
}

#[test]
fn a_configuration_that_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.toml");
    refused(&["train", "--config", text(&missing), "--out", text(folder.path())], &["missing.toml"]);
}

#[test]
fn a_cause_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let (nothing, map) =
        (folder.path().join("nothing.safetensors"), folder.path().canonicalize().unwrap().join("m.yaml"));
    let line = |path: &Path, rest: &str| format!("error: {}: {rest}\n", path.display());
    let check = |arguments: &[&str], expected: &str| {
        let out = jostle(arguments);
        assert_eq!((out.status.success(), String::from_utf8_lossy(&out.stderr).as_ref()), (false, expected));
    };
    let missing =
        "found no such file or folder, expected a checkpoint file, a run folder or a planner's name";
    check(&["evaluate", text(&nothing)], &line(&nothing, missing));
    fs::write(folder.path().join("a.toml"), "[sim.room]\nmap = \"m.yaml\"\n").unwrap();
    let (file, out) = (folder.path().join("a.toml"), folder.path().join("run"));
    let unreadable = "file: found No such file or directory (os error 2), expected a readable file";
    check(&["train", "--config", text(&file), "--out", text(&out)], &line(&map, unreadable));
}

#[test]
fn a_token_beyond_the_checkpoints_behaviours() {
    evaluate_refused(finished_run(), &["--token", "2"], &["token", "2"]);
}

#[test]
fn no_episode() {
    evaluate_refused(finished_run(), &["--episodes", "0"], &["episodes"]);
}

#[test]
fn an_unknown_crowd_is_answered_with_the_known_ones() {
    evaluate_refused(finished_run(), &["--crowds", "SF,XX"], &["XX", "NH", "IN", "VA", "SO", "VO"]);
}

#[test]
fn learned_pedestrians_without_a_pool() {
    evaluate_refused(finished_run(), &["--crowds", "NH"], &["pool"]);
}

#[test]
fn a_truncated_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cut.safetensors");
    let whole = fs::read(finished_run().join("checkpoints/000004.safetensors")).unwrap();
    for length in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        fs::write(&file, &whole[..length]).unwrap();
        evaluate_refused(&file, &[], &["cut.safetensors"]);
    }
}

#[test]
fn resuming_over_damaged_checkpoints_alone_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    copy(finished_run(), &run);
    for entry in fs::read_dir(run.join("checkpoints")).unwrap() {
        let path = entry.unwrap().path();
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    }
    let before = contents(&run);
    let file = config(folder.path());
    refused(&["train", "--config", text(&file), "--out", text(&run), "--resume"], &["checkpoint"]);
    assert_eq!(contents(&run), before);
}

#[test]
fn a_checkpoint_of_another_shape() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other");
    train(&other, &["sim.laser.beams=32", "updates=1"]);
    // A pedestrian's policy that sees with another laser than the robot.
    let pool = ["--crowds", "NH", "--pool", text(&other)];
    evaluate_refused(finished_run(), &pool, &["observation"]);
    // A checkpoint of another run, put where this run keeps its own.
    let run = folder.path().join("run");
    copy(finished_run(), &run);
    for entry in fs::read_dir(run.join("checkpoints")).unwrap() {
        fs::copy(other.join("checkpoints/000001.safetensors"), entry.unwrap().path()).unwrap();
    }
    let before = contents(&run);
    let file = config(folder.path());
    refused(&["train", "--config", text(&file), "--out", text(&run), "--resume"], &["checkpoint"]);
    assert_eq!(contents(&run), before);
}

#[test]
fn a_folder_that_holds_another_run() {
    let before = contents(finished_run());
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    let arguments = ["train", "--config", text(&file), "--out", text(finished_run())];
    refused(&[&arguments[..], &["--set", "seed=2"]].concat(), &["another run"]);
    refused(&[&arguments[..], &["--set", "seed=2", "--resume"]].concat(), &["another run"]);
    refused(&arguments, &["--resume"]);
    assert_eq!(contents(finished_run()), before);
}

#[test]
fn a_folder_that_holds_something_else() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("thesis.tex"), "years of work").unwrap();
    let file = tempfile::tempdir().unwrap();
    let file = config(file.path());
    let before = contents(folder.path());
    refused(&["train", "--config", text(&file), "--out", text(folder.path())], &["no run"]);
    assert_eq!(contents(folder.path()), before);
}

#[test]
fn an_unwritable_folder() {
    // Below a regular file nobody can write, not even root.
    let folder = tempfile::tempdir().unwrap();
    let file = config(folder.path());
    let below = file.join("run");
    refused(&["train", "--config", text(&file), "--out", text(&below)], &["tiny.toml/run"]);
    assert_eq!(fs::read_to_string(&file).unwrap(), TINY);
    let arguments =
        ["evaluate", text(finished_run()), "--crowds", "SF", "--episodes", "1", "--out", text(&below)];
    refused(&arguments, &["tiny.toml/run"]);
}

#[test]
fn a_command_line_that_cannot_be_read() {
    refused(&["train"], &["--config"]);
    refused(&["evaluate", "x", "--episodes", "many"], &["many"]);
    refused(&["conquer"], &["conquer"]);
}

#[test]
#[cfg(not(feature = "cuda"))]
fn a_device_that_cannot_be_had_is_refused() {
    config_refused("device = \"gpu\"\n", &[":1:", "device: found gpu, expected cpu, cuda:N or metal:N"]);
    config_refused(
        "device = \"cuda:0\"\n",
        &[":1:1: device: found cuda:0, expected cpu, or the back end `reference`"],
    );
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("config.toml"), folder.path().join("run"));
    fs::write(&file, TINY).unwrap();
    let parts =
        ["device: found cuda:0, expected cpu, since this program is built without the feature `cuda`"];
    refused(&["train", "--config", text(&file), "--out", text(&out), "--device", "cuda:0"], &parts);
    refused(
        &["train", "--config", text(&file), "--out", text(&out), "--device", "tpu"],
        &["--device", "found tpu, expected cpu, cuda:N or metal:N"],
    );
}

#[test]
#[cfg(not(feature = "mpi"))]
fn several_processes_without_mpi_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("config.toml"), folder.path().join("run"));
    fs::write(&file, TINY).unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(["train", "--config", text(&file), "--out", text(&out)])
        .env("OMPI_COMM_WORLD_SIZE", "2")
        .output()
        .unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && message.lines().count() == 1, "{message}");
    assert!(message.contains("found 2 processes of one MPI job, expected one"), "{message}");
    assert!(!out.exists());
}
