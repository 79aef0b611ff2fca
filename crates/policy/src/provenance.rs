//! The origin of a policy, to which every reported number must be traceable.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::PolicyError;
use crate::tensor_file::TensorFile;

/// The training run behind a policy, as a file's metadata holds it (one string for each field).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// SHA-256 of the resolved config.
    pub config_hash: String,
    /// The root seed.
    pub seed: u64,
    /// The commit that trained it.
    pub commit: String,
    /// Updates done.
    pub update: u64,
    /// Transitions seen.
    pub transitions: u64,
    /// Agents in a room (N).
    pub n_agents: u64,
    /// Rooms (R).
    pub n_rooms: u64,
}

impl Provenance {
    /// Reads the metadata of a file.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] names the key that is missing or no number.
    pub fn read(file: &TensorFile) -> Result<Self, PolicyError> {
        let text = |key| file.metadata_value(key).map(str::to_owned);
        let number = |key: &str| {
            let value = file.metadata_value(key)?;
            let not_a_number =
                |_| file.refuse(&format!("metadata {key}"), value.to_owned(), "a number".to_owned());
            value.parse::<u64>().map_err(not_a_number)
        };
        Ok(Self {
            config_hash: text("config_hash")?,
            seed: number("seed")?,
            commit: text("commit")?,
            update: number("update")?,
            transitions: number("transitions")?,
            n_agents: number("n_agents")?,
            n_rooms: number("n_rooms")?,
        })
    }

    /// Puts every field into a file's metadata.
    pub fn write(&self, metadata: &mut BTreeMap<String, String>) {
        let fields = [
            ("config_hash", self.config_hash.clone()),
            ("seed", self.seed.to_string()),
            ("commit", self.commit.clone()),
            ("update", self.update.to_string()),
            ("transitions", self.transitions.to_string()),
            ("n_agents", self.n_agents.to_string()),
            ("n_rooms", self.n_rooms.to_string()),
        ];
        metadata.extend(fields.map(|(key, value)| (key.to_owned(), value)));
    }
}
