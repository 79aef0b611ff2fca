//! Twenty updates at 1, 2 and 8 threads, with one room and with three: the same bytes, part by
//! part.
//!
//! When this fails, the message names the update and the part that moved first, in the order in
//! which an update makes them: rooms before networks, networks before optimisers.

use std::path::Path;

use crate::common::trainer;
use jostle_policy::TensorFile;
use jostle_ppo::Trainer;
use sha2::{Digest, Sha256};

const UPDATES: u64 = 20;
/// Updates between two looks at the parts.
const EVERY: u64 = 4;
/// Parts in the order in which an update makes them, by the start of their tensors' names.
const PARTS: [(&str, &str); 8] = [
    ("rooms", "state.rooms"),
    ("actor", "actor."),
    ("critic", "critic."),
    ("state-action discriminator", "discriminator.state_action."),
    ("state discriminator", "discriminator.state."),
    ("Adam's moments", "adam."),
    ("Adam's step counts", "state.adam_steps"),
    ("log", "log"),
];

/// One hash for each part at each look.
fn history(overrides: &[&str], folder: &Path) -> Vec<[String; PARTS.len()]> {
    let mut trainer = trainer(overrides);
    let mut looks = Vec::new();
    let mut log = String::new();
    for update in 1..=UPDATES {
        let report = trainer.update().expect("finite numbers").without_clock();
        log += &serde_json::to_string(&report).expect("JSON");
        if update.is_multiple_of(EVERY) {
            looks.push(parts(&mut trainer, &log, folder));
        }
    }
    looks
}

fn parts(trainer: &mut Trainer, log: &str, folder: &Path) -> [String; PARTS.len()] {
    let path = folder.join("look.safetensors");
    trainer.save(&path).expect("writable");
    let file = TensorFile::read(&path).expect("sound");
    PARTS.map(|(part, start)| {
        let mut hash = Sha256::new();
        if part == "log" {
            hash.update(log);
        }
        for name in file.names().filter(|name| name.starts_with(start)) {
            hash.update(file.raw(name).expect("listed").1);
        }
        hash.finalize().iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"))
    })
}

/// The first part that differs, if any does.
fn first_difference(a: &[[String; PARTS.len()]], b: &[[String; PARTS.len()]]) -> Option<String> {
    a.iter().zip(b).enumerate().find_map(|(look, (a, b))| {
        let part = (0..PARTS.len()).find(|part| a[*part] != b[*part])?;
        Some(format!("{} moved first, by update {}", PARTS[part].0, (look as u64 + 1) * EVERY))
    })
}

#[test]
fn twenty_updates_are_the_same_at_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for rooms in ["R=1", "R=3"] {
        let one = history(&[rooms, "threads=1"], folder.path());
        for threads in ["threads=2", "threads=8"] {
            let other = history(&[rooms, threads], folder.path());
            assert_eq!(first_difference(&one, &other), None, "{rooms}, {threads}");
        }
    }
}

#[test]
fn the_message_names_what_moved_first() {
    let look = |changed: &[usize]| {
        let hash = |part: usize| if changed.contains(&part) { "x".to_owned() } else { String::new() };
        std::array::from_fn(hash)
    };
    let (same, moved) = ([look(&[]), look(&[])], [look(&[]), look(&[5, 2])]);
    assert_eq!(first_difference(&same, &moved).as_deref(), Some("critic moved first, by update 8"));
    assert_eq!(first_difference(&same, &same), None);
}
