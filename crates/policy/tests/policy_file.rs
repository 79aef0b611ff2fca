//! Policies on disk: what is written comes back, and what is no policy is refused with one clear
//! line.

use crate::common;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::parameters;
use jostle_policy::file::network_json;
use jostle_policy::{
    Layout, NetworkConfig, PolicyFile, Precision, Provenance, TensorFile, TensorOut, Values, write_tensors,
};
use proptest::prelude::*;
use safetensors::SafeTensors;
use tempfile::TempDir;

fn small_policy() -> PolicyFile {
    let network = common::small();
    let provenance = Provenance {
        config_hash: "ab12".to_owned(),
        seed: u64::MAX,
        commit: "0123abc".to_owned(),
        update: 1500,
        transitions: 960_000,
        n_agents: 5,
        n_rooms: 1,
    };
    let metadata = BTreeMap::from([("config".to_owned(), "seed = 1\n\"ü\"".to_owned())]);
    PolicyFile { actor: parameters(Layout::actor(&network), 4), network, provenance, metadata }
}

/// A folder with a written policy in it.
fn written(precision: Precision) -> (TempDir, PathBuf, PolicyFile) {
    let (folder, policy) = (TempDir::new().unwrap(), small_policy());
    let path = folder.path().join("policy.safetensors");
    policy.write(&path, precision).unwrap();
    (folder, path, policy)
}

/// The error's line for a policy whose tensors and metadata were changed before it was written.
fn refused(change: impl FnOnce(&mut Vec<TensorOut<'_>>, &mut BTreeMap<String, String>)) -> String {
    let policy = small_policy();
    let mut tensors = TensorOut::all("actor", policy.actor.layout(), policy.actor.flat());
    let mut metadata = policy.metadata.clone();
    metadata.insert("format".to_owned(), "jostle-checkpoint-1".to_owned());
    metadata.insert("network".to_owned(), network_json(&policy.network));
    policy.provenance.write(&mut metadata);
    change(&mut tensors, &mut metadata);
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("changed.safetensors");
    write_tensors(&path, &tensors, &metadata).unwrap();
    line(&path)
}

/// The one line that `load` gives, which names the file.
fn line(path: &Path) -> String {
    let message = PolicyFile::load(path).expect_err("this file must be refused").to_string();
    assert_eq!(message.lines().count(), 1, "{message}");
    let rest = message.strip_prefix(&format!("{}: ", path.display()));
    rest.unwrap_or_else(|| panic!("no file name: {message}")).to_owned()
}

#[test]
fn a_policy_comes_back() {
    let (_folder, path, policy) = written(Precision::F32);
    let loaded = PolicyFile::load(&path).unwrap();
    assert_eq!(loaded.actor, policy.actor);
    assert_eq!((loaded.network, loaded.provenance), (policy.network, policy.provenance));
    assert_eq!(loaded.metadata["config"], policy.metadata["config"]);
}

#[test]
fn the_safetensors_crate_reads_it_and_the_bytes_are_the_same_each_time() {
    let (_folder, path, policy) = written(Precision::F32);
    let bytes = fs::read(&path).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(tensors.tensor("actor.conv1.weight").unwrap().shape(), [32, 2, 5]);
    assert_eq!(tensors.len(), policy.actor.layout().entries().len());
    policy.write(&path, Precision::F32).unwrap();
    assert_eq!(fs::read(&path).unwrap(), bytes);
}

#[test]
fn half_precision_rounds_within_its_bound() {
    let (_folder, path, policy) = written(Precision::F16);
    let loaded = PolicyFile::load(&path).unwrap();
    for (found, exact) in loaded.actor.flat().iter().zip(policy.actor.flat()) {
        // 11 significant bits; below 2⁻¹⁴ the spacing stays 2⁻²⁴.
        let bound = exact.abs() * 2_f32.powi(-11) + 2_f32.powi(-25);
        assert!((found - exact).abs() <= bound, "{exact} became {found}");
    }
    assert_ne!(loaded.actor, policy.actor);
}

#[test]
fn a_failed_write_changes_nothing() {
    let (folder, path, mut policy) = written(Precision::F32);
    let before = fs::read(&path).unwrap();
    let refuse = |policy: &PolicyFile, precision, message: &str| {
        let error = policy.write(&path, precision).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    };
    policy.actor.get_mut("fc1.bias").unwrap()[2] = 1e6;
    refuse(
        &policy,
        Precision::F16,
        "actor.fc1.bias: found 1000000 (in half precision), expected finite values",
    );
    policy.actor.get_mut("fc1.bias").unwrap()[2] = f32::NAN;
    refuse(&policy, Precision::F32, "actor.fc1.bias: found NaN, expected finite values");
    policy.network.n_behaviours = 4;
    refuse(&policy, Precision::F32, "embedding.weight [3, 4], expected embedding.weight [4, 4]");
    assert_eq!(fs::read(&path).unwrap(), before);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no partial file stays");

    // There is a folder in the place of the file: everything works but the last step.
    let taken = folder.path().join("taken");
    fs::create_dir(&taken).unwrap();
    let error = small_policy().write(&taken, Precision::F32).unwrap_err().to_string();
    assert!(error.contains("cannot replace"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "no partial file stays");

    let nowhere = folder.path().join("no such folder").join("policy");
    let error = small_policy().write(&nowhere, Precision::F32).unwrap_err().to_string();
    assert!(error.contains("cannot write"), "{error}");
}

#[test]
fn tensors_that_do_not_fit_are_named() {
    let check = |found: String, expected: &str| assert_eq!(found, expected);
    check(
        refused(|tensors, _| drop(tensors.remove(3))),
        "actor.conv2.bias: found nothing, expected a tensor",
    );
    check(
        refused(|tensors, _| tensors[0].shape = vec![32, 5, 2]),
        "actor.conv1.weight: found shape [32, 5, 2], expected shape [32, 2, 5]",
    );
    check(
        refused(|tensors, _| {
            tensors.push(TensorOut {
                name: "actor.extra".into(),
                shape: vec![1],
                values: Values::F32(&[0.0]),
            });
        }),
        "actor.extra: found a tensor, expected no tensor of this name",
    );
    check(
        refused(|tensors, _| {
            let log_std = tensors.last_mut().unwrap();
            (log_std.shape, log_std.values) = (vec![2], Values::F64(&[0.0, 0.0]));
        }),
        "actor.log_std: found type F64, expected type F32 or F16",
    );
    check(
        refused(|tensors, _| {
            // The writer refuses what is not finite, so the bits come in as bytes of another type.
            let log_std = tensors.last_mut().unwrap();
            (log_std.shape, log_std.values) = (vec![2], Values::U8(&[0, 0]));
        }),
        "actor.log_std: found type U8, expected type F32 or F16",
    );
    check(
        refused(|_, metadata| {
            let five = NetworkConfig { n_behaviours: 5, ..common::small() };
            metadata.insert("network".into(), network_json(&five));
        }),
        "actor.embedding.weight: found shape [3, 4], expected shape [5, 4]",
    );
}

#[test]
fn metadata_that_does_not_fit_is_named() {
    let set = |key: &'static str, value: &'static str| {
        refused(move |_, metadata| drop(metadata.insert(key.into(), value.into())))
    };
    let check = |found: String, expected: &str| assert!(found.starts_with(expected), "{found}");
    check(set("format", "other-1"), "metadata format: found other-1, expected jostle-checkpoint-1 or");
    check(set("seed", "-1"), "metadata seed: found -1, expected a number");
    check(set("network", "{"), "metadata network: found EOF while parsing");
    check(
        set("network", r#"{"n_behaviours":0}"#),
        "metadata network: found network configuration: n_behaviours: found 0",
    );
    check(
        set("network", r#"{"hidden":60000,"laser_feature":60000,"beams":60000}"#),
        "metadata network: found network configuration: sizes",
    );
    check(set("network", r#"{"layers":3}"#), "metadata network: found unknown field `layers`");
    check(
        refused(|_, metadata| drop(metadata.remove("commit"))),
        "metadata commit: found nothing, expected a value",
    );
}

#[test]
fn values_that_are_not_finite_are_refused() {
    let (_folder, path, _policy) = written(Precision::F32);
    let mut bytes = fs::read(&path).unwrap();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&f32::INFINITY.to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    // The checksum sees any change first; a foreign file without one is read tensor by tensor.
    assert!(line(&path).starts_with("content: found checksum"), "{}", line(&path));
    let file = TensorFile::read(&path).unwrap();
    let error = file.parameters("actor", Layout::actor(&common::small())).unwrap_err().to_string();
    assert!(error.contains("found inf at index"), "{error}");
}

#[test]
fn files_that_are_no_policy_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("file");
    let check = |content: &[u8], expected: &str| {
        fs::write(&path, content).unwrap();
        let found = line(&path);
        assert!(found.starts_with(expected), "{found}");
    };
    check(b"", "file: found 0 bytes, expected 8 to");
    check(&u64::MAX.to_le_bytes(), "header length: found 18446744073709551615, expected at most 0");
    check(
        &[&(1_u64 << 30).to_le_bytes()[..], &vec![b' '; 2 << 20]].concat(),
        "header length: found 1073741824",
    );
    check(b"\x02\0\0\0\0\0\0\0{}", "metadata format: found nothing, expected a value");
    let huge = br#"{"a":{"dtype":"F32","shape":[4294967296,4294967296],"data_offsets":[0,4]}}"#;
    check(&[&(huge.len() as u64).to_le_bytes()[..], huge, &[0; 4]].concat(), "header: found");
    assert!(line(folder.path()).starts_with("file: found something else, expected a regular file"));
    assert!(line(&folder.path().join("absent")).starts_with("cannot open"));
}

#[test]
fn a_truncated_file_is_refused_at_every_length() {
    let (_folder, path, _policy) = written(Precision::F16);
    let bytes = fs::read(&path).unwrap();
    for len in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
        fs::write(&path, &bytes[..len]).unwrap();
        line(&path);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// One changed byte is refused, or changes nothing (the header's JSON can be written in more
    /// than one way).
    #[test]
    fn a_changed_byte_is_refused(place in 0.0..1.0_f64, change in 1..=255_u8) {
        let (_folder, path, _policy) = written(Precision::F16);
        let intact = PolicyFile::load(&path).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        let idx = (place * bytes.len() as f64) as usize;
        bytes[idx] ^= change;
        fs::write(&path, &bytes).unwrap();
        match PolicyFile::load(&path) {
            Ok(loaded) => prop_assert_eq!(loaded, intact),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
