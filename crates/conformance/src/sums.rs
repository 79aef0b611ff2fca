//! `SHA256SUMS` of a fixture folder: verified where it is there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_arena::identity::hex_sha256;

/// Expected digests by full path; empty where there is no list.
pub(crate) struct Sums(BTreeMap<PathBuf, String>);

/// Reads `folder/SHA256SUMS`.
pub(crate) fn read(folder: &Path) -> Result<Sums> {
    let mut sums = BTreeMap::new();
    let text = jostle_runs::folder::read_optional(&folder.join("SHA256SUMS"))?.unwrap_or_default();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let (digest, name) =
            line.split_once(char::is_whitespace).context("SHA256SUMS has a line without a name")?;
        sums.insert(folder.join(name.trim_start().trim_start_matches('*')), digest.to_ascii_lowercase());
    }
    Ok(Sums(sums))
}

impl Sums {
    /// Compares a file with its listed digest; a file that is not listed passes.
    pub(crate) fn verify(&self, path: &Path) -> Result<()> {
        let Some(expected) = self.0.get(path) else { return Ok(()) };
        let bytes = std::fs::read(path).context("cannot be read")?;
        if &hex_sha256(&bytes) != expected {
            bail!("does not match its SHA-256 in SHA256SUMS");
        }
        Ok(())
    }

    /// Listed files that are not there, by their names in `folder`.
    pub(crate) fn missing(&self, folder: &Path) -> Vec<String> {
        let absent = self.0.keys().filter(|path| !path.exists());
        absent.map(|path| path.strip_prefix(folder).unwrap_or(path).display().to_string()).collect()
    }
}
