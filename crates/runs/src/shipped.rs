//! Files that come with the program: configurations, maps, policies.
//!
//! In a checkout they are the checkout's. Elsewhere the program brings those that it was built with
//! ([`set_embedded`]) and unpacks them into the user's cache folder, so that whatever takes a path
//! takes them, too.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context as _, Result, bail};
use jostle_arena::identity::{hex_sha256, short};
use jostle_policy::did_you_mean;

use crate::output::note;
use crate::provenance::{is_checkout, workspace};
use crate::run_folder::write_bytes_atomically;

/// A file that is part of the program.
#[derive(Clone, Copy, Debug)]
pub struct Embedded {
    /// Its path below the root of a checkout, such as `configs/strong.toml`.
    pub path: &'static str,
    /// Its content.
    pub bytes: &'static [u8],
}

static EMBEDDED: OnceLock<&'static [Embedded]> = OnceLock::new();
static UNPACKED: OnceLock<PathBuf> = OnceLock::new();

/// Sets the files that are part of the program; the first call counts.
pub fn set_embedded(files: &'static [Embedded]) {
    EMBEDDED.get_or_init(|| files);
}

/// The path of a shipped file or folder, such as `configs/strong.toml` or `checkpoints`: the
/// checkout's, else the program's own, which are unpacked.
///
/// # Errors
/// Neither a checkout nor the program has it; the cache folder cannot be written.
pub fn shipped(path: &str) -> Result<PathBuf> {
    let here = workspace().join(path);
    if here.exists() {
        return Ok(here);
    }
    let files = embedded();
    if !is_embedded(path) {
        let known = did_you_mean(path, files.iter().map(|file| file.path));
        bail!("{}: found no such file, and the program itself has none of this name{known}", here.display());
    }
    Ok(unpacked(files)?.join(path))
}

/// True if [`shipped`] has this file or folder.
pub fn is_shipped(path: &str) -> bool {
    workspace().join(path).exists() || is_embedded(path)
}

fn embedded() -> &'static [Embedded] {
    EMBEDDED.get().copied().unwrap_or_default()
}

fn is_embedded(path: &str) -> bool {
    let below = format!("{path}/");
    embedded().iter().any(|file| file.path == path || file.path.starts_with(&below))
}

/// The configuration that a word of the command line means: a file, or the name of a shipped one,
/// such as `strong`.
///
/// # Errors
/// A name that is no shipped one's, without a file of that name.
pub fn config(named: &Path) -> Result<PathBuf> {
    let is_name = |name: &&str| name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    match named.to_str().filter(is_name) {
        Some(name) if !named.exists() => {
            let path = format!("configs/{name}.toml");
            if !is_shipped(&path) {
                let known = did_you_mean(name, embedded().iter().filter_map(|file| config_name(file.path)));
                bail!("{name}: found neither a file nor a shipped configuration of this name{known}");
            }
            shipped(&path)
        }
        _ => Ok(named.to_owned()),
    }
}

/// `strong` of `configs/strong.toml`.
fn config_name(path: &str) -> Option<&str> {
    path.strip_prefix("configs/")?.strip_suffix(".toml").filter(|name| !name.contains('/'))
}

/// The root of the checkout, for what needs its policies and results.
///
/// # Errors
/// No checkout at or above the working directory, and none where the program was built.
pub fn checkout() -> Result<&'static Path> {
    let root = workspace();
    if !is_checkout(root) {
        bail!(
            "found no checkout of jostle here, expected one: `git clone {}` makes it",
            env!("CARGO_PKG_REPOSITORY")
        );
    }
    Ok(root)
}

/// The folder of the program's own files, after they were written there.
fn unpacked(files: &[Embedded]) -> Result<&'static Path> {
    if let Some(folder) = UNPACKED.get() {
        return Ok(folder);
    }
    let folder = cache_folder()?.join(version(files));
    unpack(files, &folder)?;
    note(&format!(
        "no checkout of jostle here; shipped policies and configurations are the program's own, in {}",
        folder.display()
    ));
    Ok(UNPACKED.get_or_init(|| folder))
}

/// Writes the files that are not in the folder, or not whole.
fn unpack(files: &[Embedded], folder: &Path) -> Result<()> {
    for file in files {
        let path = folder.join(file.path);
        let is_there = std::fs::metadata(&path).is_ok_and(|about| about.len() == file.bytes.len() as u64);
        if !is_there {
            let parent = path.parent().context("a path of a file without a folder")?;
            std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
            write_bytes_atomically(&path, file.bytes)?;
        }
    }
    Ok(())
}

/// The name of these very files.
fn version(files: &[Embedded]) -> String {
    let list: Vec<String> =
        files.iter().map(|file| format!("{} {}", file.path, hex_sha256(file.bytes))).collect();
    format!("{}-{}", env!("CARGO_PKG_VERSION"), short(&hex_sha256(list.join("\n").as_bytes())))
}

/// The user's folder for what a program can make again.
fn cache_folder() -> Result<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = variable("XDG_CACHE_HOME")
        .or_else(|| variable("LOCALAPPDATA"))
        .or_else(|| variable("HOME").map(|home| home.join(".cache")));
    Ok(folder
        .context(
            "found none of XDG_CACHE_HOME, LOCALAPPDATA and HOME, expected one: where files may be kept",
        )?
        .join("jostle"))
}

#[cfg(test)]
mod tests {
    use super::{Embedded, config_name, unpack, version};

    const FILES: [Embedded; 2] = [
        Embedded { path: "configs/a.toml", bytes: b"one" },
        Embedded { path: "maps/b/c.toml", bytes: b"four" },
    ];

    #[test]
    fn what_is_missing_or_cut_short_is_written_and_the_rest_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let read = |path: &str| std::fs::read(folder.path().join(path)).unwrap();
        unpack(&FILES, folder.path()).unwrap();
        assert_eq!((read("configs/a.toml"), read("maps/b/c.toml")), (b"one".to_vec(), b"four".to_vec()));
        std::fs::write(folder.path().join("configs/a.toml"), "on").unwrap();
        std::fs::write(folder.path().join("maps/b/c.toml"), "ours").unwrap();
        unpack(&FILES, folder.path()).unwrap();
        assert_eq!((read("configs/a.toml"), read("maps/b/c.toml")), (b"one".to_vec(), b"ours".to_vec()));
        // A folder where a file belongs: said, with its path.
        std::fs::remove_file(folder.path().join("configs/a.toml")).unwrap();
        std::fs::create_dir_all(folder.path().join("configs/a.toml/x")).unwrap();
        let error = format!("{:#}", unpack(&FILES, folder.path()).unwrap_err());
        assert!(error.contains("cannot write") && error.contains("a.toml"), "{error}");
    }

    #[test]
    fn other_files_have_another_folder() {
        assert_eq!(version(&FILES), version(&FILES));
        assert_ne!(version(&FILES), version(&FILES[..1]));
        let changed = [FILES[0], Embedded { bytes: b"five", ..FILES[1] }];
        assert_ne!(version(&FILES), version(&changed));
    }

    #[test]
    fn configurations_have_names_and_plans_have_none() {
        assert_eq!(config_name("configs/strong.toml"), Some("strong"));
        assert_eq!(
            (config_name("configs/plans/study.toml"), config_name("maps/obstacle.toml")),
            (None, None)
        );
    }
}
