//! A policy's identity: enough to trace a record or a table's cell to config, seed and commit.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Identity of a policy. Fields that a policy of the user's own does not have are `None`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicyIdentity {
    /// Its name in a report.
    pub name: String,
    /// SHA-256 of the policy's file (hexadecimal); of its name and version for a policy without a
    /// file.
    pub sha256: String,
    /// Hash of the training config.
    pub config_hash: Option<String>,
    /// Training seed.
    pub seed: Option<u64>,
    /// Commit of the program that trained it.
    pub commit: Option<String>,
    /// Updates done.
    pub updates: Option<u64>,
    /// Transitions seen in training.
    pub transitions: Option<u64>,
    /// The members of its training rooms that did not learn, as keys of `[training_crowd]` with
    /// their shares, such as "blind 0.5".
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trained_among: Vec<String>,
    /// The runs whose policies were its opponents in training.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub opponents: Vec<Opponent>,
}

/// A training run whose policy was another one's opponent in training.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Opponent {
    /// SHA-256 of the policy's file.
    pub sha256: String,
    /// Hash of its training config.
    pub config_hash: String,
    /// Its training seed.
    pub seed: u64,
    /// Its updates.
    pub update: u64,
}

impl PolicyIdentity {
    /// Identity of a policy that is code and not a file. The version must change when its behaviour
    /// does, since records are reused by hash.
    pub fn custom(name: &str, version: &str) -> Self {
        Self {
            name: name.to_owned(),
            sha256: hex_sha256(format!("custom policy {name:?} {version:?}").as_bytes()),
            config_hash: None,
            seed: None,
            commit: None,
            updates: None,
            transitions: None,
            trained_among: Vec::new(),
            opponents: Vec::new(),
        }
    }

    /// True if members of its training crowd were of this kind, by the key of `[training_crowd]`.
    pub fn was_among(&self, kind: &str) -> bool {
        self.trained_among.iter().any(|member| member.split(' ').next() == Some(kind))
    }

    /// True if it was trained against the run of the other policy, at whatever stage of it.
    pub fn has_seen(&self, other: &Self) -> bool {
        let run = (other.config_hash.as_deref(), other.seed);
        self.opponents.iter().any(|seen| (Some(seen.config_hash.as_str()), Some(seen.seed)) == run)
    }

    /// The short form that every record carries.
    pub fn reference(&self) -> ProvenanceRef {
        ProvenanceRef {
            policy: short(&self.sha256).to_owned(),
            config: self.config_hash.as_deref().map(|hash| short(hash).to_owned()),
            seed: self.seed,
            commit: self.commit.as_deref().map(|commit| short(commit).to_owned()),
            updates: self.updates,
        }
    }
}

/// A record's reference to its policy: hashes by their first 16 digits, to keep the records small.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProvenanceRef {
    /// Start of the policy's SHA-256.
    pub policy: String,
    /// Start of the training config's hash.
    pub config: Option<String>,
    /// Training seed.
    pub seed: Option<u64>,
    /// Start of the commit.
    pub commit: Option<String>,
    /// Updates done.
    pub updates: Option<u64>,
}

/// SHA-256 in lower-case hexadecimal.
pub fn hex_sha256(bytes: &[u8]) -> String {
    jostle_policy::hex(&Sha256::digest(bytes))
}

/// The first 16 characters of a hash, or all of a shorter one.
pub fn short(hash: &str) -> &str {
    hash.get(..16).unwrap_or(hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_sha256_and_shorten_safely() {
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(hex_sha256(b""), empty);
        assert_eq!(short(empty), "e3b0c44298fc1c14");
        assert_eq!((short("abc"), short("ééééééééé")), ("abc", "éééééééé"));
        assert_ne!(PolicyIdentity::custom("a", "1").sha256, PolicyIdentity::custom("a", "2").sha256);
    }
}
