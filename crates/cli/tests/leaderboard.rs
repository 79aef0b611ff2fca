//! The leaderboard: an entry runs again to the bit, and what is stored is held to what it says.

use std::fs;

use crate::common::{accepted, jostle, refused, text};

#[test]
fn an_entry_runs_again_to_the_bit_and_a_changed_one_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let place = text(folder.path());
    let enter = ["leaderboard", "straight", "--episodes", "1", "--folder", place];
    let check = ["leaderboard", "--check", "--folder", place];
    let printed = accepted(&enter);
    assert!(printed.contains("1  straight  planner"), "{printed}");
    assert!(accepted(&check).contains("1 entries of the leaderboard, 54 episodes, 0 of the user's own"));
    let entry = folder.path().join("straight.json");
    let stored = fs::read_to_string(&entry).unwrap();
    assert!(stored.contains("\"command\": \"cargo xtask leaderboard straight --episodes 1\""), "{stored}");

    // The hash of one cell's episodes: only a run finds it.
    let hash = stored.split("\"episodes_sha256\": \"").nth(1).unwrap()[..64].to_owned();
    fs::write(&entry, stored.replacen(&hash, &"0".repeat(64), 1)).unwrap();
    let output = jostle(&enter);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && message.contains("density-5, NH: found"), "{message}");
    assert!(message.contains("--replace stores what was found"), "{message}");
    assert_eq!(fs::read_to_string(&entry).unwrap(), stored.replacen(&hash, &"0".repeat(64), 1));

    // A hash of what the episodes depend on, a count, a page: nothing has to be run.
    let key = stored.split("\"cell\": \"").nth(1).unwrap()[..64].to_owned();
    fs::write(&entry, stored.replacen(&key, &"0".repeat(64), 1)).unwrap();
    refused(&check, &["straight.json: cell: found density-5, NH 0000", "expected density-5, NH "]);
    fs::write(&entry, stored.replacen("\"timeout\": 0", "\"timeout\": 1", 1)).unwrap();
    refused(&check, &["straight.json: cell ", "found 2 episodes in its counts, expected 1"]);
    fs::write(&entry, &stored).unwrap();
    accepted(&check);
    fs::write(folder.path().join("index.html"), "").unwrap();
    refused(&check, &["index.html: found another text than the entries make"]);
    accepted(&["leaderboard", "--folder", place]);
    accepted(&check);
}

#[test]
fn what_cannot_be_entered_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let place = text(folder.path());
    refused(&["leaderboard", "dwb", "--folder", place], &["dwb", "did you mean dwa?"]);
    refused(
        &["leaderboard", "dwa", "orca", "--name", "both", "--folder", place],
        &["--name: found it for 2 robots, expected one robot"],
    );
    refused(
        &["leaderboard", "--sort", "speed", "--folder", place],
        &["--sort: found speed, expected one of mean"],
    );
    refused(&["leaderboard", "dwa", "--episodes", "0", "--folder", place], &["--episodes: found 0"]);
}
