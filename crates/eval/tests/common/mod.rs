//! Policies and settings that several tests share.
#![allow(dead_code, unreachable_pub)]

use std::collections::BTreeMap;

use jostle_arena::{ArenaConfig, LoadedPolicy, Pools};
use jostle_policy::{NetworkConfig, Parameters, PolicyFile, Provenance};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Turns towards the goal and drives on; blind to everything else.
pub fn seek(row: &[f32]) -> [f32; 2] {
    let turn = row[row.len() - 3].atan2(row[row.len() - 4]);
    [turn.cos().max(0.0), (2.0 * turn).clamp(-1.0, 1.0)]
}

/// A policy with fresh parameters.
pub fn untrained(seed: u64) -> LoadedPolicy {
    let network = NetworkConfig { n_behaviours: 2, ..NetworkConfig::default() };
    let actor = Parameters::actor(&network, &mut ChaCha8Rng::seed_from_u64(seed));
    let provenance = Provenance {
        config_hash: format!("config-{seed}"),
        seed,
        commit: "0000000".to_owned(),
        update: 0,
        transitions: 0,
        n_agents: 5,
        n_rooms: 1,
    };
    let file = PolicyFile { actor, network, provenance, metadata: BTreeMap::new() };
    LoadedPolicy::from_file(file, &format!("untrained-{seed}"), format!("{seed:064x}"))
}

/// Four untrained policies, and two for SO.
pub fn pools() -> Pools {
    Pools { full: (1..=4).map(untrained).collect(), half: (5..=6).map(untrained).collect() }
}

/// The default settings with a shorter time limit.
pub fn brief(step_limit: u32) -> ArenaConfig {
    let mut config = ArenaConfig::default();
    config.sim.episode.step_limit = step_limit;
    config
}
