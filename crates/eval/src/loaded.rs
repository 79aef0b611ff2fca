//! Policies as they are read from disk, with their identity.

use std::path::Path;

use jostle_policy::{PolicyFile, excerpt};
use jostle_sim::SimConfig;

use crate::error::EvalError;
use crate::identity::{PolicyIdentity, hex_sha256};

/// A policy with its identity.
#[derive(Clone, Debug)]
pub struct LoadedPolicy {
    /// Parameters, sizes, metadata.
    pub file: PolicyFile,
    /// Name, hash, provenance.
    pub identity: PolicyIdentity,
}

impl LoadedPolicy {
    /// Reads a checkpoint or a policy; its name is the file's.
    ///
    /// # Errors
    ///
    /// As [`PolicyFile::load`].
    pub fn load(path: &Path) -> Result<Self, EvalError> {
        let file = PolicyFile::load(path)?;
        let bytes = std::fs::read(path).map_err(EvalError::io(path, "read"))?;
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy();
        Ok(Self::from_file(file, &name, hex_sha256(&bytes)))
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
        };
        Self { file, identity }
    }

    /// The simulator's settings that the policy was trained with.
    ///
    /// # Errors
    ///
    /// If the file's metadata holds none, or what it holds is not valid.
    pub fn sim_config(&self) -> Result<SimConfig, EvalError> {
        let refuse = |found: String| EvalError::Setting {
            field: "metadata sim",
            found: format!("{} in {}", excerpt(&found), self.identity.name),
            expected: "JSON of the simulator's settings".to_owned(),
        };
        let text = self.file.metadata.get("sim").ok_or_else(|| refuse("nothing".to_owned()))?;
        let config: SimConfig = serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
        config.validate()?;
        Ok(config)
    }
}
