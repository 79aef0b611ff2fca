//! A trained policy on disk: the actor, its sizes, and its origin.
//!
//! Two formats are read. A *checkpoint* is written by training (actor, critic, discriminators,
//! optimiser, state); of it only the actor and the metadata are used here. A *policy* holds only
//! the actor, in F32 or F16.

use std::collections::BTreeMap;
use std::path::Path;

use crate::config::NetworkConfig;
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::parameters::Parameters;
use crate::provenance::Provenance;
use crate::tensor_file::{CHECKSUM_KEY, TensorFile};
use crate::tensor_write::{TensorOut, Values, write_tensors};

/// `format` of a checkpoint.
pub const CHECKPOINT_FORMAT: &str = "jostle-checkpoint-1";
/// `format` of a policy.
pub const POLICY_FORMAT: &str = "jostle-policy-1";

/// The precision of a policy's tensors on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Exact.
    F32,
    /// Half the size; each value is rounded to 11 significant bits (relative error at most 2⁻¹¹
    /// above 6e-5).
    F16,
}

/// A policy that can act.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyFile {
    /// The actor's parameters.
    pub actor: Parameters,
    /// Its sizes.
    pub network: NetworkConfig,
    /// Its training run.
    pub provenance: Provenance,
    /// All metadata of the file, such as `config` (TOML) and `sim` (JSON).
    pub metadata: BTreeMap<String, String>,
}

impl PolicyFile {
    /// Reads a checkpoint or a policy.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Io`] if the file cannot be read; [`PolicyError::File`] with the field, what
    /// was found and what was expected if it is no safetensors file, is truncated or changed, or
    /// does not hold the actor that its `network` describes.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, PolicyError> {
        let file = TensorFile::read(path.as_ref())?;
        let format = file.metadata_value("format")?;
        if ![CHECKPOINT_FORMAT, POLICY_FORMAT].contains(&format) {
            let expected = format!("{CHECKPOINT_FORMAT} or {POLICY_FORMAT}");
            return Err(file.refuse("metadata format", format.to_owned(), expected));
        }
        file.verify_checksum()?;
        let network = read_network(&file)?;
        let actor = file.parameters("actor", Layout::actor(&network))?;
        Ok(Self { actor, network, provenance: Provenance::read(&file)?, metadata: file.metadata().clone() })
    }

    /// Writes the actor and the metadata, without critic, discriminators and optimiser, in one step
    /// (a file that was there is replaced whole or not at all).
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] if a parameter is not finite (in half precision: beyond ±65,504),
    /// [`PolicyError::Io`] if the disk refuses.
    pub fn write(&self, path: impl AsRef<Path>, precision: Precision) -> Result<(), PolicyError> {
        self.network.validate()?;
        self.actor.check_layout(&Layout::actor(&self.network))?;
        let mut metadata = self.metadata.clone();
        metadata.remove(CHECKSUM_KEY);
        metadata.insert("format".to_owned(), POLICY_FORMAT.to_owned());
        metadata.insert("network".to_owned(), network_json(&self.network));
        self.provenance.write(&mut metadata);

        let mut tensors = TensorOut::all("actor", self.actor.layout(), self.actor.flat());
        if precision == Precision::F16 {
            for tensor in &mut tensors {
                if let Values::F32(values) = tensor.values {
                    tensor.values = Values::F16(values);
                }
            }
        }
        write_tensors(path.as_ref(), &tensors, &metadata)
    }
}

/// The metadata value `network` of a config.
pub fn network_json(network: &NetworkConfig) -> String {
    serde_json::to_string(network).expect("plain numbers can be written")
}

/// The metadata value `network` of a file, validated.
///
/// # Errors
///
/// [`PolicyError::File`] if it is missing, is no JSON of a [`NetworkConfig`], or has sizes out of
/// bounds.
pub fn read_network(file: &TensorFile) -> Result<NetworkConfig, PolicyError> {
    let text = file.metadata_value("network")?;
    let refuse =
        |found: String| file.refuse("metadata network", found, "JSON of a network's sizes".to_owned());
    let network: NetworkConfig = serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
    network.validate().map_err(|error| refuse(error.to_string()))?;
    Ok(network)
}
