//! Maps as a user meets them: paths from the file that names them, content as a part of the
//! identity, foreign keys.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::text;
use crate::common::tiny::TINY;

const ROOM: &str = "walls = { min = [-10.0, -10.0], max = [10.0, 10.0] }\n";

/// Runs `jostle` in a working directory.
fn xtask_in(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jostle")).current_dir(folder).args(arguments).output().unwrap()
}

#[track_caller]
fn accepted_in(folder: &Path, arguments: &[&str]) -> (String, String) {
    let output = xtask_in(folder, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {error}");
    (String::from_utf8(output.stdout).unwrap(), error)
}

#[track_caller]
fn refused_in(folder: &Path, arguments: &[&str], part: &str) {
    let output = xtask_in(folder, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && error.contains(part) && error.lines().count() == 1, "{error}");
}

/// A folder with `project/configs/a.toml`, the map that it names by a relative path, and a folder
/// beside.
fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for path in ["project/configs", "project/maps", "elsewhere"] {
        fs::create_dir_all(folder.path().join(path)).unwrap();
    }
    let config = format!("{TINY}[sim.room]\nmap = \"../maps/m.toml\"\n");
    fs::write(folder.path().join("project/configs/a.toml"), config).unwrap();
    fs::write(folder.path().join("project/maps/m.toml"), ROOM).unwrap();
    folder
}

/// Records of the evaluation in a folder: file name and text, sorted.
fn records(out: &Path) -> Vec<(String, String)> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(out.join("records")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
    files.iter().map(|path| (name(path), fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn a_relative_map_is_found_from_the_file_that_names_it_wherever_one_works() {
    let folder = project();
    let (project, elsewhere) = (folder.path().join("project"), folder.path().join("elsewhere"));
    let (config, run) = (project.join("configs/a.toml"), project.join("runs/a"));
    let train = ["train", "--config", text(&config), "--out", text(&run), "--threads", "1"];
    accepted_in(&elsewhere, &[&train[..], &["--set", "updates=2"]].concat());
    // Going on, testing and looking, from a third place.
    accepted_in(folder.path(), &[&train[..], &["--resume"]].concat());
    let out = folder.path().join("out");
    let evaluate = ["evaluate", text(&run), "--crowds", "SF", "--episodes", "2", "--out", text(&out)];
    accepted_in(&elsewhere, &evaluate);
    let page = folder.path().join("page.html");
    let replay = ["replay", text(&run), "--crowd", "VO", "--episodes", "1", "--out", text(&page)];
    accepted_in(&elsewhere, &replay);
    // The whole project at another place: the run's files name the map relative to themselves.
    let before = records(&out);
    fs::rename(&project, folder.path().join("moved")).unwrap();
    let run = folder.path().join("moved/runs/a");
    let evaluate = ["evaluate", text(&run), "--crowds", "SF", "--episodes", "2", "--out", text(&out)];
    accepted_in(&elsewhere, &evaluate);
    assert_eq!(records(&out), before, "the same map at another place is the same test");
}

#[test]
fn a_map_on_the_command_line_is_found_from_the_working_directory() {
    let folder = project();
    let maps = folder.path().join("project/maps");
    let config = folder.path().join("a.toml");
    fs::write(&config, TINY).unwrap();
    let run = folder.path().join("run");
    let train = ["train", "--config", text(&config), "--out", text(&run), "--set", "updates=1"];
    refused_in(folder.path(), &[&train[..], &["--set", "sim.room.map=m.toml"]].concat(), "m.toml");
    accepted_in(&maps, &[&train[..], &["--set", "sim.room.map=m.toml"]].concat());
    let stored = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(stored.contains("map = \"../project/maps/m.toml\""), "{stored}");
}

#[test]
fn a_map_that_was_changed_gives_new_records_and_does_not_go_on_training() {
    let folder = project();
    let project = folder.path().join("project");
    let (config, run) = (project.join("configs/a.toml"), folder.path().join("run"));
    let train = ["train", "--config", text(&config), "--out", text(&run), "--threads", "1"];
    accepted_in(folder.path(), &[&train[..], &["--set", "updates=2"]].concat());
    let out = folder.path().join("out");
    let evaluate = ["evaluate", text(&run), "--crowds", "SF", "--episodes", "2", "--out", text(&out)];
    accepted_in(folder.path(), &evaluate);
    let first = records(&out);
    let changed = format!("{ROOM}[[obstacle]]\nbox = {{ centre = [0, 0], length = 9, width = 9 }}\n");
    fs::write(project.join("maps/m.toml"), changed).unwrap();
    accepted_in(folder.path(), &evaluate);
    let second = records(&out);
    assert_eq!((first.len(), second.len()), (1, 2), "the changed map is a cell of its own");
    let lines = |text: &String| {
        text.lines().map(|line| line.split("\"cell\"").next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let new = second.iter().find(|file| !first.contains(file)).unwrap();
    assert_ne!(lines(&new.1), lines(&first[0].1), "the episodes are those of the changed map");
    refused_in(folder.path(), &[&train[..], &["--resume"]].concat(), "map_sha256: found another content in");
    fs::write(project.join("maps/m.toml"), ROOM).unwrap();
    accepted_in(folder.path(), &[&train[..], &["--resume"]].concat());
}

#[test]
fn a_run_of_an_earlier_version_is_still_found_from_the_working_directory() {
    let folder = project();
    let project = folder.path().join("project");
    let run = project.join("run");
    let config = project.join("configs/a.toml");
    let train = ["train", "--config", text(&config), "--out", text(&run), "--threads", "1"];
    accepted_in(folder.path(), &[&train[..], &["--set", "updates=2"]].concat());
    // What it stored was the path as it was given, here from the folder of the project.
    let stored = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(stored.contains("map = \"../maps/m.toml\""), "{stored}");
    fs::write(run.join("config.toml"), stored.replace("../maps/m.toml", "maps/m.toml")).unwrap();
    accepted_in(&project, &[&train[..], &["--resume", "--set", "updates=2"]].concat());
    accepted_in(&project, &["runs", text(&run)]);
}

#[test]
fn keys_of_other_tools_are_told_once_and_ignored() {
    let folder = project();
    let maps = folder.path().join("project/maps");
    fs::write(maps.join("m.pgm"), [b"P5 200 200 255\n".to_vec(), vec![254; 40_000]].concat()).unwrap();
    let yaml = "image: m.pgm\nresolution: 0.1\norigin: [-10.0, -10.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n\
                free_thresh: 0.196\nmap_id: /a/7f\n";
    fs::write(maps.join("m.yaml"), yaml).unwrap();
    let config = folder.path().join("a.toml");
    fs::write(&config, format!("{TINY}[sim.room]\nmap = \"project/maps/m.yaml\"\n")).unwrap();
    let run = folder.path().join("run");
    let told = |error: &str| error.lines().filter(|line| line.ends_with("m.yaml: not read: map_id")).count();
    let train = ["train", "--config", text(&config), "--out", text(&run), "--set", "updates=1"];
    let (_, error) = accepted_in(folder.path(), &train);
    assert_eq!(told(&error), 1, "{error}");
    let out = folder.path().join("out");
    let evaluate = ["evaluate", text(&run), "--crowds", "SF,VO", "--episodes", "2", "--out", text(&out)];
    let (_, error) = accepted_in(folder.path(), &evaluate);
    assert_eq!(told(&error), 1, "{error}");
}
