//! A short slice of the long searches: `cargo xtask chaos` and `cargo xtask fuzz`.

use crate::common::{accepted, text, xtask};

#[test]
fn a_few_kills_lose_nothing() {
    let out = accepted(&["chaos", "--kills", "4", "--seed", "5"]);
    assert!(out.starts_with("chaos: 4 kills") && out.contains(" 0 lost or different, seed 5"), "{out}");
}

#[test]
fn a_few_hostile_files_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("crashes");
    let out = accepted(&["fuzz", "--cases", "150", "--seed", "11", "--out", text(&kept)]);
    assert_eq!(out.lines().count(), 9, "{out}");
    assert!(out.lines().all(|line| line.contains(" 150 inputs") && line.contains(" 0 crashes")), "{out}");
    assert!(!kept.exists());
}

#[test]
fn a_target_that_is_not_there_is_refused() {
    let output = xtask(&["fuzz", "--target", "sonnets"]);
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("polygons"));
}

#[test]
fn every_help_has_an_example_that_calls_this_program() {
    for command in ["train", "reproduce", "conformance", "ci"] {
        let help = accepted(&[command, "--help"]);
        assert!(help.contains("Example") && help.contains(&format!("cargo xtask {command}")), "{help}");
    }
}
