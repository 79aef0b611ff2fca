//! `checkpoints/manifest.json`: which policies are shipped, where each comes from, and what its
//! file must be.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use jostle_arena::identity::hex_sha256;
use jostle_arena::loaded::LoadedPolicy;
use jostle_ppo::Config;
use serde::{Deserialize, Serialize};

use jostle_runs::folder::read_optional;
use jostle_runs::provenance::workspace;
use jostle_runs::run_folder::write_atomically;

/// The manifest's name in its folder.
pub(crate) const MANIFEST: &str = "manifest.json";
/// The format's name.
const FORMAT: &str = "jostle-checkpoints-1";
/// Most bytes of all files together.
pub(crate) const FOLDER_MAX: u64 = 80_000_000;

/// The default folder.
pub(crate) fn default_folder() -> PathBuf {
    workspace().join("checkpoints")
}

/// All that is shipped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    format: String,
    /// Training runs, by name.
    pub(crate) runs: Vec<RunEntry>,
    /// Policies, by name.
    pub(crate) policies: Vec<PolicyEntry>,
}

/// A training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RunEntry {
    /// `VARIANT-seedS`.
    pub(crate) name: String,
    /// The training setting that it belongs to.
    pub(crate) variant: String,
    pub(crate) seed: u64,
    /// Hash of the configuration as the run's own program computed it.
    pub(crate) config_hash: String,
    /// Commit of that program.
    pub(crate) commit: String,
    /// Updates made.
    pub(crate) updates: u64,
    pub(crate) transitions: u64,
    /// Seconds of all updates together, over all parts of a run that was resumed.
    pub(crate) wall_seconds: f64,
    /// The first update reports without their clock, one a line, byte for byte.
    pub(crate) first_updates: FileEntry,
    /// The whole curve, in means over windows of updates.
    pub(crate) curve: FileEntry,
    /// The whole configuration.
    pub(crate) config: Config,
}

/// A small file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileEntry {
    /// Path below the folder.
    pub(crate) file: String,
    /// SHA-256 in hexadecimal.
    pub(crate) sha256: String,
    pub(crate) bytes: u64,
}

/// A policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PolicyEntry {
    /// `RUN-UPDATES`.
    pub(crate) name: String,
    /// Name of its run.
    pub(crate) run: String,
    /// Updates that it has seen.
    pub(crate) updates: u64,
    pub(crate) transitions: u64,
    /// Seconds of those updates together.
    pub(crate) wall_seconds: f64,
    /// `f16` or `f32`.
    pub(crate) precision: String,
    /// File name in the folder.
    pub(crate) file: String,
    /// Its SHA-256 in hexadecimal.
    pub(crate) sha256: String,
    pub(crate) bytes: u64,
    /// Rows and crowds that it serves.
    pub(crate) serves: Vec<String>,
}

impl Manifest {
    /// A manifest without a policy.
    pub(crate) fn empty() -> Self {
        Self { format: FORMAT.to_owned(), runs: Vec::new(), policies: Vec::new() }
    }

    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// A file that is missing or is no manifest, and entries that contradict one another.
    pub(crate) fn load(folder: &Path) -> Result<Self> {
        Self::load_optional(folder)?.with_context(|| {
            format!(
                "{} is missing: no policy is shipped yet (`{} ship` makes it, `--train` trains from nothing)",
                folder.join(MANIFEST).display(),
                jostle_runs::output::program()
            )
        })
    }

    /// As [`Manifest::load`]; `None` where there is no manifest.
    pub(crate) fn load_optional(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let Some(text) = read_optional(&path)? else { return Ok(None) };
        let shown = path.display();
        let manifest: Self =
            serde_json::from_str(&text).map_err(|error| anyhow::anyhow!("{shown}: {error}"))?;
        manifest.check().with_context(|| format!("{shown}"))?;
        Ok(Some(manifest))
    }

    fn check(&self) -> Result<()> {
        ensure!(self.format == FORMAT, "format: found {}, expected {FORMAT}", self.format);
        for (i, run) in self.runs.iter().enumerate() {
            let name = format!("{}-seed{}", run.variant, run.seed);
            ensure!(run.name == name, "run {}: name: expected {name}", run.name);
            ensure!(
                self.runs[..i].iter().all(|other| other.name != run.name),
                "run {}: listed twice",
                run.name
            );
            let config_seed = run.config.seed;
            ensure!(
                config_seed == run.seed,
                "run {}: seed: found {}, its config has {config_seed}",
                run.name,
                run.seed
            );
            for file in [&run.first_updates, &run.curve] {
                check_file_name(&file.file)?;
            }
        }
        for (i, policy) in self.policies.iter().enumerate() {
            let name = &policy.name;
            ensure!(
                self.policies[..i].iter().all(|other| other.name != *name),
                "policy {name}: listed twice"
            );
            ensure!(
                self.runs.iter().any(|run| run.name == policy.run),
                "policy {name}: run {} is not listed",
                policy.run
            );
            check_file_name(&policy.file)?;
        }
        Ok(())
    }

    /// Writes the manifest of a folder, its entries in the order of their names.
    pub(crate) fn store(&mut self, folder: &Path) -> Result<()> {
        self.runs.sort_by(|a, b| a.name.cmp(&b.name));
        self.policies.sort_by(|a, b| a.name.cmp(&b.name));
        let text = serde_json::to_string_pretty(self).context("a manifest that is no JSON")?;
        write_atomically(&folder.join(MANIFEST), &(text + "\n"))
    }

    /// A run by its name.
    pub(crate) fn run(&self, name: &str) -> Result<&RunEntry> {
        self.runs.iter().find(|run| run.name == name).with_context(|| {
            let names: Vec<&str> = self.runs.iter().map(|run| run.name.as_str()).collect();
            format!("no run {name} in the manifest; there are {}", names.join(", "))
        })
    }

    /// Bytes of all files together, without the manifest.
    pub(crate) fn bytes(&self) -> u64 {
        let of_runs = self.runs.iter().map(|run| run.first_updates.bytes + run.curve.bytes).sum::<u64>();
        of_runs + self.policies.iter().map(|policy| policy.bytes).sum::<u64>()
    }
}

impl PolicyEntry {
    /// Reads the policy and compares it with what the manifest says.
    ///
    /// # Errors
    /// A file that is missing or damaged or is another policy's.
    pub(crate) fn load(&self, folder: &Path, run: &RunEntry) -> Result<LoadedPolicy> {
        let path = folder.join(&self.file);
        check_sha256(&path, &self.sha256)?;
        let mut policy = LoadedPolicy::load(&path)?;
        let of_file = &policy.file.provenance;
        let shown = path.display();
        for (field, found, expected) in [
            ("seed", of_file.seed.to_string(), run.seed.to_string()),
            ("updates", of_file.update.to_string(), self.updates.to_string()),
            ("config_hash", of_file.config_hash.clone(), run.config_hash.clone()),
            (
                "n_behaviours",
                policy.file.network.n_behaviours.to_string(),
                run.config.n_behaviours.to_string(),
            ),
        ] {
            ensure!(found == expected, "{shown}: {field}: found {found}, the manifest has {expected}");
        }
        policy.identity.name.clone_from(&self.name);
        Ok(policy)
    }
}

impl FileEntry {
    /// The entry of a text that will be stored under a name.
    pub(crate) fn of(file: String, text: &str) -> Self {
        Self { file, sha256: hex_sha256(text.as_bytes()), bytes: text.len() as u64 }
    }

    /// The file's text, if it is the one that the manifest means.
    pub(crate) fn read(&self, folder: &Path) -> Result<String> {
        let path = folder.join(&self.file);
        check_sha256(&path, &self.sha256)?;
        std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
    }
}

fn check_sha256(path: &Path, expected: &str) -> Result<()> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let found = hex_sha256(&bytes);
    if found != expected {
        bail!("{}: sha256: found {found}, the manifest has {expected}", path.display());
    }
    Ok(())
}

/// Refuses names that leave the folder.
fn check_file_name(name: &str) -> Result<()> {
    let plain = Path::new(name).components().all(|part| matches!(part, std::path::Component::Normal(_)));
    ensure!(plain && !name.is_empty(), "file: found {name:?}, expected a path below the folder");
    Ok(())
}
