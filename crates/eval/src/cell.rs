//! A cell of a table, the unit of work that is cached: one policy with one token in one crowd.

use jostle_peds::CrowdName;
use serde::{Deserialize, Serialize};

use jostle_arena::identity::hex_sha256;

/// To be raised whenever an episode's result may change for the same settings; old records are then
/// not reused.
pub const PROTOCOL_VERSION: u32 = 1;

/// Everything that episode k of a cell depends on.
///
/// The number of episodes is absent on purpose: episode k does not depend on it, so that a file of
/// 1000 episodes also answers for 100, and one of 100 is continued to 1000. So are thread count and
/// lock-step width.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellKey {
    /// [`PROTOCOL_VERSION`].
    pub protocol_version: u32,
    /// SHA-256 of the robot's policy.
    pub policy: String,
    /// The robot's behaviour token.
    pub token: u32,
    /// Name of the crowd.
    pub crowd: CrowdName,
    /// SHA-256 of the pedestrians' policies in their order; empty for crowds without.
    pub pool: Vec<String>,
    /// One robot and `n_agents` − 1 pedestrians.
    pub n_agents: usize,
    /// Root seed of the episodes.
    pub seed: u64,
    /// SHA-256 of the simulator's and the crowds' settings and of the back end's name.
    pub settings: String,
}

impl CellKey {
    /// SHA-256 of the key as JSON with its fields in the order of the struct.
    pub fn hash(&self) -> String {
        hex_sha256(&serde_json::to_vec(self).expect("strings and integers are always JSON"))
    }

    /// A name for the file of its records: crowd, token and the start of the hash.
    pub fn file_name(&self) -> String {
        format!("{}-z{}-{}.ndjson", self.crowd, self.token, jostle_arena::identity::short(&self.hash()))
    }
}

#[cfg(test)]
mod tests {
    use jostle_peds::CrowdKind;

    use super::*;

    #[test]
    fn every_field_changes_the_hash() {
        let key = CellKey {
            protocol_version: 1,
            policy: "p".into(),
            token: 0,
            crowd: CrowdKind::Nh.into(),
            pool: vec!["a".into(), "b".into()],
            n_agents: 5,
            seed: 0,
            settings: "s".into(),
        };
        let hash = key.hash();
        let changed = [
            CellKey { protocol_version: 2, ..key.clone() },
            CellKey { policy: "q".into(), ..key.clone() },
            CellKey { token: 1, ..key.clone() },
            CellKey { crowd: CrowdKind::So.into(), ..key.clone() },
            CellKey { pool: vec!["b".into(), "a".into()], ..key.clone() },
            CellKey { n_agents: 6, ..key.clone() },
            CellKey { seed: 1, ..key.clone() },
            CellKey { settings: "t".into(), ..key.clone() },
        ];
        assert!(changed.iter().all(|other| other.hash() != hash));
        assert_eq!(key.hash(), hash);
        assert!(key.file_name().starts_with("NH-z0-"));
    }

    /// Stored cells are found by these very bytes, which came before crowds of one's own and for
    /// validation.
    #[test]
    fn hashes_of_stored_cells_stay() {
        let key = |crowd| CellKey {
            protocol_version: 1,
            policy: "p".into(),
            token: 0,
            crowd,
            pool: vec!["a".into()],
            n_agents: 5,
            seed: 0,
            settings: "s".into(),
        };
        let text = r#"{"protocol_version":1,"policy":"p","token":0,"crowd":"VO","pool":["a"],"n_agents":5,"seed":0,"settings":"s"}"#;
        assert_eq!(key(CrowdKind::Vo.into()).hash(), hex_sha256(text.as_bytes()));
        let own = key(CrowdName::new("shy").unwrap());
        assert!(own.file_name().starts_with("shy-z0-"));
    }
}
