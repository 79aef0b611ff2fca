//! Where policies are found: a checkpoint file, a run folder, or a folder of either.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_eval::crowds::Pools;
use jostle_eval::loaded::LoadedPolicy;
use jostle_peds::CrowdKind;

use crate::run_folder::{checkpoint_path, is_run_folder, latest_checkpoint};

/// The checkpoint that a path means: the file itself, or a run's newest.
pub(crate) fn checkpoint(path: &Path) -> Result<PathBuf> {
    if is_run_folder(path) {
        return latest_checkpoint(path);
    }
    if path.is_dir() {
        bail!("{} is no run folder; name a checkpoint file or a folder that `train` made", path.display());
    }
    Ok(path.to_owned())
}

/// Reads a checkpoint; a run's is called by its folder, as the file's own name is only a count of updates.
pub(crate) fn load(path: &Path) -> Result<LoadedPolicy> {
    let mut policy = LoadedPolicy::load(path)?;
    let run = path.parent().and_then(Path::parent).filter(|folder| is_run_folder(folder));
    if let Some(name) = run.and_then(Path::file_name) {
        policy.identity.name = name.to_string_lossy().into_owned();
    }
    Ok(policy)
}

/// The checkpoints of a pool: each path is a file, a run folder, or a folder of files or run folders (taken in the order
/// of their names).
pub(crate) fn pool(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() && !is_run_folder(path) {
            let before = found.len();
            for entry in sorted(path)? {
                if is_run_folder(&entry)
                    || entry.extension().is_some_and(|extension| extension == "safetensors")
                {
                    found.push(checkpoint(&entry)?);
                }
            }
            if found.len() == before {
                bail!("{} holds no run folder and no checkpoint", path.display());
            }
        } else {
            found.push(checkpoint(path)?);
        }
    }
    Ok(found)
}

/// The same policies at half their training, where the runs that they belong to have kept that checkpoint.
pub(crate) fn half_trained(pool: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let half = |path: &PathBuf| -> Result<PathBuf> {
        let update: u64 =
            path.file_stem().and_then(|stem| stem.to_str()).and_then(|stem| stem.parse().ok()).with_context(
                || {
                    format!(
                        "{} is no run's checkpoint; name the half-trained ones with --pool-half",
                        path.display()
                    )
                },
            )?;
        let run = path.parent().and_then(Path::parent).context("a checkpoint outside a run folder")?;
        let half = checkpoint_path(run, update / 2);
        anyhow::ensure!(
            half.is_file(),
            "crowd SO needs {}, which is not there; name another with --pool-half",
            half.display()
        );
        Ok(half)
    };
    pool.iter().map(half).collect()
}

fn sorted(folder: &Path) -> Result<Vec<PathBuf>> {
    let cannot_list = || format!("cannot list {}", folder.display());
    let entries = std::fs::read_dir(folder).with_context(cannot_list)?;
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>().with_context(cannot_list)?;
    paths.sort();
    Ok(paths)
}

/// The pedestrians' policies, as far as the crowds ask for them: SO takes `half`, or the pool's own half-trained checkpoints.
pub(crate) fn pools(full: &[PathBuf], half: &[PathBuf], crowds: &[CrowdKind]) -> Result<Pools> {
    let load_all =
        |paths: Vec<PathBuf>| paths.iter().map(|path| load(path)).collect::<Result<Vec<LoadedPolicy>>>();
    let full = pool(full)?;
    let half = if !half.is_empty() {
        pool(half)?
    } else if crowds.contains(&CrowdKind::So) {
        half_trained(&full)?
    } else {
        Vec::new()
    };
    Ok(Pools { full: load_all(full)?, half: load_all(half)? })
}
