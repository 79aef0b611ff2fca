//! Configurations and checkpoints that were made to mislead: valid in form, impossible in size or
//! content.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use crate::common::trainer;
use jostle_policy::{TensorFile, TensorOut, Values, write_tensors};
use jostle_ppo::{Config, PpoError, Trainer};

const NONE: &[&str] = &[];

#[track_caller]
fn one_short_line(error: &PpoError) -> String {
    let message = error.to_string();
    assert!(message.len() < 1500 && !message.chars().any(char::is_control), "{message:?}");
    message
}

#[test]
fn an_override_of_many_parts_does_not_exhaust_the_stack() {
    let argument = format!("{}b=1", "a.".repeat(60_000));
    let message = one_short_line(&Config::parse("", "a.toml", &[argument]).expect_err("refused"));
    assert!(message.starts_with("--set: found a key of 60001 parts"), "{message}");
}

#[test]
fn nested_text_and_long_names_are_refused_in_one_short_line() {
    for text in [
        format!("a = {}", "[".repeat(100_000)),
        format!("{}b = 1", "a.".repeat(100_000)),
        format!("[{}b]\nc = 1", "a.".repeat(100_000)),
        format!("{} = 1", "k".repeat(1 << 19)),
        format!("backend = \"{}\"", "\\n".repeat(1 << 18)),
    ] {
        one_short_line(&Config::parse(&text, "a.toml", NONE).expect_err("refused"));
    }
    one_short_line(
        &Config::parse("", "a.toml", &[format!("alpha={}", "x\n".repeat(1 << 16))]).expect_err("refused"),
    );
}

#[test]
fn a_configuration_without_an_end_is_not_read() {
    if Path::new("/dev/zero").exists() {
        let message = one_short_line(&Config::load(Path::new("/dev/zero"), NONE).expect_err("a device"));
        assert!(message.contains("found no file"), "{message}");
    } else {
        let _ = writeln!(
            std::io::stderr(),
            "skip: a configuration without an end: this machine has no /dev/zero"
        );
    }
}

#[test]
fn a_rollout_that_no_machine_holds_is_refused() {
    let text = "horizon = 65536\nN = 1\nR = 16\nminibatch = 64\n[sim.laser]\nbeams = 8192";
    let message = one_short_line(&Config::parse(text, "a.toml", NONE).expect_err("100 GB"));
    assert!(message.starts_with("a.toml:1:1: horizon: found 25773998080 values"), "{message}");
}

/// A checkpoint whose metadata and floats were changed, with a checksum that holds.
fn changed(
    change: impl FnOnce(&mut BTreeMap<String, String>, &mut BTreeMap<String, Vec<f32>>),
) -> Result<Trainer, PpoError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.safetensors");
    trainer(&[]).save(&path).expect("writable");
    let file = TensorFile::read(&path).expect("sound");
    let mut metadata = file.metadata().clone();
    let is_blob = |name: &str| name.starts_with("state.");
    let mut floats: BTreeMap<String, Vec<f32>> = file
        .names()
        .filter(|name| !is_blob(name))
        .map(|name| (name.to_owned(), file.f32s(name, file.shape(name).expect("listed")).expect("floats")))
        .collect();
    change(&mut metadata, &mut floats);
    let tensor = |name: &str| TensorOut {
        name: name.to_owned(),
        shape: file.shape(name).expect("listed").to_vec(),
        values: match floats.get(name) {
            Some(values) => Values::F32(values),
            None => Values::U8(file.raw(name).expect("listed").1),
        },
    };
    let tensors: Vec<TensorOut<'_>> = file.names().map(tensor).collect();
    write_tensors(&path, &tensors, &metadata).expect("writable");
    Trainer::resume(&path)
}

/// Replaces the configuration, with the hash that belongs to it.
fn claim(metadata: &mut BTreeMap<String, String>, from: &str, to: &str) {
    let text = metadata["config"].replace(from, to);
    assert_ne!(text, metadata["config"], "no {from} in {text}");
    let config = Config::parse(&text, "claim", NONE).expect("valid in form");
    metadata.insert("config_hash".to_owned(), config.hash());
    metadata.insert("config".to_owned(), text);
}

#[test]
fn sizes_that_are_claimed_must_be_there() {
    for (from, to) in [
        ("beams = 16", "beams = 8192"),
        ("laser_feature = 32", "laser_feature = 65536"),
        ("hidden = 32", "hidden = 65536"),
    ] {
        let error = changed(|metadata, _| claim(metadata, from, to)).err().expect("refused");
        let message = one_short_line(&error);
        assert!(message.contains("actor.") && message.contains("expected shape"), "{message}");
    }
}

#[test]
fn counts_that_cannot_go_on_are_refused() {
    for key in ["update", "transitions"] {
        let error = changed(|metadata, _| drop(metadata.insert(key.to_owned(), u64::MAX.to_string())));
        let message = one_short_line(&error.err().expect("refused"));
        assert!(message.contains(&format!("{key}: found 18446744073709551615")), "{message}");
    }
}

#[test]
fn an_action_that_is_not_finite_is_named_with_its_agent() {
    // exp(300) is beyond every float.
    let mut resumed =
        changed(|_, floats| floats.get_mut("actor.log_std").expect("there").fill(300.0)).expect("finite");
    let error = resumed.update().expect_err("an infinite action");
    assert!(matches!(error, PpoError::NotFinite { update: 1, agent: Some(0), .. }), "{error}");
    assert_eq!(error.to_string(), "update 1: action of agent 0 is not finite");
}

#[test]
fn a_run_that_stops_at_a_number_leaves_its_checkpoint_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.safetensors");
    let mut doomed = trainer(&["learning_rate=1e38", "epochs_policy=1", "epochs_value=1", "minibatch=64"]);
    doomed.save(&path).expect("writable");
    let good = std::fs::read(&path).expect("readable");
    doomed.update().expect_err("parameters overflow");
    // Even a caller who ignores the error cannot replace the good file.
    doomed.save(&path).expect_err("a parameter that is not finite");
    assert!(std::fs::read(&path).expect("readable") == good);
    Trainer::resume(&path).expect("still good");
}
