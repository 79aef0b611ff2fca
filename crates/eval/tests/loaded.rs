//! Policies from disk, and which of them drive which crowd.

use crate::common::{pools, untrained};
use jostle_arena::identity::hex_sha256;
use jostle_arena::{ArenaConfig, LoadedPolicy};
use jostle_peds::CrowdKind;
use jostle_policy::file::Precision;
use jostle_sim::SimConfig;

#[test]
fn a_file_is_known_by_its_bytes_and_its_provenance() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("baseline.safetensors");
    let mut policy = untrained(4);
    policy.file.write(&path, Precision::F32).unwrap();
    let loaded = LoadedPolicy::load(&path).unwrap();
    let identity = &loaded.identity;
    assert_eq!(identity.sha256, hex_sha256(&std::fs::read(&path).unwrap()));
    assert_eq!((identity.name.as_str(), identity.seed, identity.updates), ("baseline", Some(4), Some(0)));
    assert_eq!(identity.reference().config.as_deref(), Some("config-4"));
    assert_eq!(loaded.file.actor, policy.file.actor);
    assert!(loaded.sim_config().unwrap_err().to_string().contains("metadata sim"));

    let mut sim = SimConfig::default();
    sim.episode.goal_radius = 0.1;
    policy.file.metadata.insert("sim".to_owned(), serde_json::to_string(&sim).unwrap());
    assert_eq!(policy.sim_config().unwrap(), sim);
    policy.file.metadata.insert("sim".to_owned(), r#"{"laser":{"beams":0}}"#.to_owned());
    assert!(policy.sim_config().is_err());
    // Found by fuzzing: a long key was repeated whole.
    policy.file.metadata.insert("sim".to_owned(), format!("{{\"{}\":0}}", "k".repeat(1 << 16)));
    assert!(policy.sim_config().unwrap_err().to_string().len() < 1000);
    assert!(LoadedPolicy::load(&folder.path().join("none")).is_err());
}

#[test]
fn so_has_the_half_trained_policies_and_a_short_pool_is_said() {
    let pools = pools();
    let seeds = |crowd, n_pedestrians| -> Vec<u64> {
        pools.drivers(crowd, n_pedestrians).iter().map(|policy| policy.identity.seed.unwrap()).collect()
    };
    for crowd in [CrowdKind::Nh, CrowdKind::In, CrowdKind::Va] {
        assert_eq!(seeds(crowd, ArenaConfig::default().n_pedestrians()), [1, 2, 3, 4]);
    }
    assert_eq!(seeds(CrowdKind::So, 4), [5, 6]);
    assert_eq!(seeds(CrowdKind::Nh, 2), [1, 2]);
    assert!(seeds(CrowdKind::Vo, 4).is_empty() && pools.note(CrowdKind::Sf, 4).is_none());
    assert!(pools.note(CrowdKind::So, 4).unwrap().is_cycled());
    assert!(!pools.note(CrowdKind::Nh, 4).unwrap().is_cycled());
}
