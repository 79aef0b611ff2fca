//! Runs the built binary.

pub(crate) mod tiny;

use std::path::Path;
use std::process::{Command, Output};

/// Runs `jostle` with the arguments.
pub(crate) fn jostle(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jostle")).args(arguments).output().unwrap()
}

/// Runs `jostle`, which must fail with exactly one line on standard error that holds all of
/// `parts`, and print nothing else.
#[track_caller]
pub(crate) fn refused(arguments: &[&str], parts: &[&str]) {
    let output = jostle(arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success(), "{arguments:?} succeeded");
    assert!(output.stdout.is_empty(), "{arguments:?} printed {}", String::from_utf8_lossy(&output.stdout));
    assert_eq!(message.lines().count(), 1, "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
    }
    let clauses: Vec<&str> = message.trim().split(": ").collect();
    for (i, clause) in clauses.iter().enumerate() {
        assert!(!clauses[..i].contains(clause), "{arguments:?}: {clause:?} is told twice in {message}");
    }
}

/// Standard output of a run that must succeed.
#[track_caller]
pub(crate) fn accepted(arguments: &[&str]) -> String {
    let output = jostle(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
