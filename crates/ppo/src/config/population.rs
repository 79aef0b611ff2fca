//! `[population]`: the policies that drive a training crowd's opponents.

use std::path::{Path, PathBuf};

use jostle_sim::NamingFolder;
use serde::{Deserialize, Serialize};

/// The frozen policies that are the opponents of a training crowd; the `[population]` part of a
/// training file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct PopulationConfig {
    /// Policies or checkpoints that drive opponents: other seeds, earlier runs. Relative paths
    /// start from the folder of the file that names them; those of a command or a program, from the
    /// working directory. A checkpoint records the files' SHA-256; with others a run does not go
    /// on. Default: none.
    pub files: Vec<PathBuf>,
    /// Snapshots of the run's own policy that are kept as opponents; 0 to 64. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("maximum" = 64)))]
    pub past: usize,
    /// Updates between two snapshots; ≥ 1. Default 100.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = i64::MAX)))]
    pub past_every: u64,
    // The folder that relative `files` start from.
    #[serde(skip)]
    folder: NamingFolder,
}

impl Default for PopulationConfig {
    fn default() -> Self {
        Self { files: Vec::new(), past: 0, past_every: 100, folder: NamingFolder::default() }
    }
}

impl PopulationConfig {
    /// Number of policies to choose from.
    pub fn len(&self) -> usize {
        self.files.len() + self.past
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The files as the system finds them from the working directory.
    pub fn located(&self) -> Vec<PathBuf> {
        self.files.iter().map(|file| self.folder.locate(file)).collect()
    }

    /// Says that a file in `folder` names the files: relative paths start there.
    pub(crate) fn named_in(&mut self, folder: &Path) {
        if self.files.iter().any(|file| file.is_relative()) {
            self.folder = NamingFolder::new(folder);
        }
    }

    /// As [`Self::named_in`], for what this program has written; as
    /// [`jostle_sim::RoomConfig::stored_in`].
    pub(crate) fn stored_in(&mut self, folder: &Path) {
        let (as_given, mut here) = (self.clone(), self.clone());
        here.named_in(folder);
        let lie = |population: &Self| population.located().iter().all(|file| file.exists());
        *self = if lie(&as_given) && !lie(&here) { as_given } else { here };
    }

    /// The population as a file in `folder` names it: relative paths lead from there to the same
    /// files.
    pub(crate) fn as_named_in(&self, folder: &Path) -> Self {
        let mut population = self.clone();
        population.named_in(folder);
        for file in &mut population.files {
            *file = self.folder.rename(file, &population.folder);
        }
        population
    }

    /// As it counts in the configuration's hash: of each file the name, which is the same in every
    /// folder and on every machine. A run's checkpoints are called by their updates; of those the
    /// two folders count that they lie in, the run's and its own.
    pub(crate) fn by_name(&self) -> Self {
        let named = |file: &PathBuf| -> PathBuf {
            let Some(name) = file.file_name() else { return file.clone() };
            let is_count = |stem: &str| stem.chars().all(|c| c.is_ascii_digit());
            if !file.file_stem().and_then(|stem| stem.to_str()).is_some_and(is_count) {
                return name.into();
            }
            let folder = NamingFolder::new(self.folder.locate(file).parent().unwrap_or(Path::new("")));
            let file = folder.locate(name.as_ref());
            let parts: Vec<_> = file.components().rev().take(3).collect();
            parts.into_iter().rev().collect()
        };
        Self {
            files: self.files.iter().map(named).collect(),
            folder: NamingFolder::default(),
            ..self.clone()
        }
    }
}
