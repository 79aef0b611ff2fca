//! Policies as they are read from disk, with their identity.

use std::path::{Path, PathBuf};

use jostle_policy::{PolicyFile, excerpt};
use jostle_sim::{SimConfig, TrainingCrowd};
use serde::Deserialize;

use crate::error::ArenaError;
use crate::identity::{Opponent, PolicyIdentity, hex_sha256};

/// The part of a training configuration that matters here.
#[derive(Deserialize)]
struct TrainedWith {
    #[serde(default)]
    training_crowd: TrainingCrowd,
}

/// A policy with its identity.
#[derive(Clone, Debug)]
pub struct LoadedPolicy {
    /// Parameters, sizes, metadata.
    pub file: PolicyFile,
    /// Name, hash, provenance.
    pub identity: PolicyIdentity,
    /// The folder of its file, from which a relative map starts.
    folder: Option<PathBuf>,
}

impl LoadedPolicy {
    /// Reads a checkpoint or a policy; its name is the file's.
    ///
    /// # Errors
    ///
    /// As [`PolicyFile::load`].
    pub fn load(path: &Path) -> Result<Self, ArenaError> {
        let file = PolicyFile::load(path)?;
        let bytes = std::fs::read(path).map_err(ArenaError::io(path, "read"))?;
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy();
        let mut policy = Self::from_file(file, &name, hex_sha256(&bytes));
        policy.identity.trained_among = policy.training_crowd()?;
        policy.identity.opponents = policy.opponents()?;
        policy.folder = path.parent().map(Path::to_owned);
        Ok(policy)
    }

    /// A policy that did not come from a path, such as one that was just trained.
    pub fn from_file(file: PolicyFile, name: &str, sha256: String) -> Self {
        let provenance = &file.provenance;
        let identity = PolicyIdentity {
            name: name.to_owned(),
            sha256,
            config_hash: Some(provenance.config_hash.clone()),
            seed: Some(provenance.seed),
            commit: Some(provenance.commit.clone()),
            updates: Some(provenance.update),
            transitions: Some(provenance.transitions),
            trained_among: Vec::new(),
            opponents: Vec::new(),
        };
        Self { file, identity, folder: None }
    }

    /// The shares of its training crowd, where it had one.
    fn training_crowd(&self) -> Result<Vec<String>, ArenaError> {
        let Some(text) = self.file.metadata.get("config") else { return Ok(Vec::new()) };
        let config: TrainedWith =
            toml::from_str(text).map_err(|error| self.refuse("metadata config", "TOML", error.message()))?;
        Ok(config
            .training_crowd
            .shares()
            .into_iter()
            .filter(|(_, share, _)| *share > 0.0)
            .map(|(key, share, _)| format!("{key} {share}"))
            .collect())
    }

    /// The opponents of its population that came from files.
    fn opponents(&self) -> Result<Vec<Opponent>, ArenaError> {
        let Some(text) = self.file.metadata.get("opponents") else { return Ok(Vec::new()) };
        serde_json::from_str(text)
            .map_err(|error| self.refuse("metadata opponents", "JSON of opponents", &error.to_string()))
    }

    fn refuse(&self, field: &'static str, expected: &str, found: &str) -> ArenaError {
        let found = format!("{} in {}", excerpt(found), self.identity.name);
        ArenaError::Setting { field, found, expected: expected.to_owned() }
    }

    /// The simulator's settings that the policy was trained with. A map is found from the policy's
    /// file.
    ///
    /// # Errors
    ///
    /// If the file's metadata holds none, or what it holds is not valid.
    pub fn sim_config(&self) -> Result<SimConfig, ArenaError> {
        let refuse = |found: String| ArenaError::Setting {
            field: "metadata sim",
            found: format!("{} in {}", excerpt(&found), self.identity.name),
            expected: "JSON of the simulator's settings".to_owned(),
        };
        let text = self.file.metadata.get("sim").ok_or_else(|| refuse("nothing".to_owned()))?;
        let mut config: SimConfig = serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
        if let Some(folder) = &self.folder {
            config.room.stored_in(folder);
        }
        config.validate()?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use jostle_policy::{NetworkConfig, Parameters, Precision, Provenance};

    use super::*;

    /// The identity of a policy file with this metadata.
    fn identity(metadata: &[(&str, &str)]) -> Result<PolicyIdentity, ArenaError> {
        let network =
            NetworkConfig { beams: 8, laser_feature: 4, hidden: 4, embedding: 1, ..Default::default() };
        let actor = Parameters::actor(&network, &mut jostle_sim::Streams::new(1).stream("init.actor", &[]));
        let provenance = Provenance {
            config_hash: "c".to_owned(),
            seed: 1,
            commit: "a".to_owned(),
            update: 2,
            transitions: 3,
            n_agents: 5,
            n_rooms: 1,
        };
        let metadata: BTreeMap<String, String> =
            metadata.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("policy.safetensors");
        PolicyFile { actor, network, provenance, metadata }.write(&path, Precision::F32).expect("writable");
        Ok(LoadedPolicy::load(&path)?.identity)
    }

    #[test]
    fn an_identity_names_whom_the_policy_was_trained_among() {
        let config = "gamma = 0.9\n[training_crowd]\nstanding = 0.1\nblind = 0.4\nspeed_max = 1.5\n";
        let opponents = r#"[{"sha256":"s","config_hash":"h","seed":4,"update":9}]"#;
        let found = identity(&[("config", config), ("opponents", opponents)]).unwrap();
        assert_eq!(found.trained_among, ["blind 0.4", "standing 0.1"]);
        assert_eq!((found.opponents.len(), found.opponents[0].seed), (1, 4));
        let json = serde_json::to_string(&identity(&[("config", "gamma = 0.9\n")]).unwrap()).unwrap();
        assert!(!json.contains("trained_among") && !json.contains("opponents"), "{json}");
        let refusal = identity(&[("opponents", "{}")]).unwrap_err().to_string();
        assert!(refusal.starts_with("metadata opponents: found invalid type"), "{refusal}");
    }
}
