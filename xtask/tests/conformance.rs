//! The conformance command: passes on the fixtures beside this file, fails on everything that is
//! wrong with a folder.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{text, xtask};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// Exit status and standard output of the command on a folder.
fn conformance(folder: &Path) -> (bool, String) {
    let output = xtask(&["conformance", text(folder)]);
    (output.status.success(), String::from_utf8(output.stdout).unwrap())
}

/// A temporary folder with copies of fixtures.
fn folder_with(files: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let source = data().join(file);
        fs::copy(&source, folder.path().join(source.file_name().unwrap())).unwrap();
    }
    folder
}

/// Changes a fixture's text.
fn edit(folder: &Path, file: &str, from: &str, to: &str) {
    let path = folder.join(file);
    let before = fs::read_to_string(&path).unwrap();
    let after = before.replacen(from, to, 1);
    assert_ne!(before, after, "{file} holds no {from}");
    fs::write(path, after).unwrap();
}

#[track_caller]
fn fails(folder: &Path, part: &str) {
    let (passed, out) = conformance(folder);
    assert!(!passed && out.contains("FAIL") && out.contains(part), "{out}");
}

#[test]
fn all_fixtures_pass_with_one_line_each() {
    let (passed, out) = conformance(&data());
    assert!(passed, "{out}");
    assert!(!out.contains("FAIL") && out.ends_with("13 passed, 0 failed\n"), "{out}");
    assert_eq!(out.lines().filter(|line| line.starts_with("PASS")).count(), 13);
}

#[test]
fn the_recordings_of_the_crowds_pass() {
    let folder = data().join("../../../crates/peds/tests/data");
    let (passed, out) = conformance(&folder);
    assert!(passed && !out.contains("FAIL") && out.contains("e_polygons8_seed1_lines.csv"), "{out}");
}

#[test]
fn half_planes_that_are_missing_fail() {
    let files = ["e_polygons8_seed1.csv", "e_polygons8_seed1_lines.csv"];
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        fs::copy(data().join("../../../crates/peds/tests/data/rvo2").join(file), folder.path().join(file))
            .unwrap();
    }
    assert!(conformance(folder.path()).0);
    edit(folder.path(), files[1], "steps=12", "steps=13");
    fails(folder.path(), "step 13 agent 0: number of half-planes");
}

#[test]
fn the_name_of_a_file_does_not_matter() {
    let folder = folder_with(&["gae/gae.json"]);
    fs::rename(folder.path().join("gae.json"), folder.path().join("more cases.json")).unwrap();
    assert!(conformance(folder.path()).0);
}

#[test]
fn a_wrong_number_fails() {
    let folder = folder_with(&["gae/gae.json", "rvo2/d1_headon_symmetric.csv"]);
    edit(folder.path(), "gae.json", "-4.061323408486189", "-4.061323418486189");
    fails(folder.path(), "advantages[0]");
    let folder = folder_with(&["rvo2/d4b_wall_oblique.csv"]);
    edit(folder.path(), "d4b_wall_oblique.csv", "radius=0.349999994", "radius=0.36");
    fails(folder.path(), "d4b");
}

#[test]
fn an_unreadable_file_fails() {
    let folder = folder_with(&["kl/kl.json"]);
    let whole = fs::read(folder.path().join("kl.json")).unwrap();
    fs::write(folder.path().join("kl.json"), &whole[..whole.len() / 2]).unwrap();
    fails(folder.path(), "no JSON");
    fs::write(folder.path().join("x.safetensors"), [255; 40]).unwrap();
    fails(folder.path(), "no safetensors");
}

#[test]
fn a_file_of_no_known_kind_and_half_planes_without_a_run_fail() {
    let folder = folder_with(&["kl/kl.json"]);
    fs::write(folder.path().join("notes.dat"), "x").unwrap();
    fails(folder.path(), "no known kind");
    let folder = folder_with(&["rvo2/d1_headon_symmetric_lines.csv"]);
    fails(folder.path(), "its run");
}

#[test]
fn nothing_to_check_fails() {
    let folder = tempfile::tempdir().unwrap();
    assert!(!conformance(folder.path()).0);
    let readme = folder_with(&["README.md"]);
    assert!(!conformance(readme.path()).0);
    assert!(!conformance(&folder.path().join("missing")).0);
    let no_case = folder_with(&["kl/kl.json"]);
    fs::write(no_case.path().join("kl.json"), r#"{"format":1,"cases":[]}"#).unwrap();
    fails(no_case.path(), "no known kind");
}

#[test]
fn checksums_are_verified_where_they_are() {
    let folder = folder_with(&["kl/kl.json"]);
    fs::write(folder.path().join("SHA256SUMS"), format!("{}  kl.json\n", "0".repeat(64))).unwrap();
    fails(folder.path(), "SHA-256");
    fs::write(folder.path().join("SHA256SUMS"), format!("{}  gone.json\n", "0".repeat(64))).unwrap();
    fails(folder.path(), "not there");
}
