//! Runs to be read: those of folders, and those whose curves are shipped.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_runs::log::{DEPTH, RunLog, search};

use super::curve;
use super::manifest::{Manifest, RunEntry};

/// The runs at or below folders; a folder of shipped policies has the curves that are shipped with
/// them, in windows of updates.
///
/// # Errors
/// A folder without a run, and runs that cannot be read.
pub fn logs(folders: &[&PathBuf]) -> Result<Vec<RunLog>> {
    let mut logs = Vec::new();
    for folder in folders {
        let before = logs.len();
        if let Some(manifest) = Manifest::load_optional(folder)? {
            for run in &manifest.runs {
                logs.push(shipped(folder, run)?);
            }
        } else {
            let mut found = Vec::new();
            search(folder, DEPTH, &mut found)?;
            for folder in found {
                logs.push(RunLog::read(&folder)?);
            }
        }
        if logs.len() == before {
            bail!("{} holds no run; name a folder that `train` or `ship` made", folder.display());
        }
    }
    Ok(logs)
}

fn shipped(folder: &Path, run: &RunEntry) -> Result<RunLog> {
    let text = run.curve.read(folder)?;
    let reports = curve::reports(&text, run.config.rollout_len() as u64)
        .with_context(|| format!("{}", folder.join(&run.curve.file).display()))?;
    Ok(RunLog {
        folder: folder.to_owned(),
        name: run.name.clone(),
        config: run.config.clone(),
        reports,
        torn: false,
    })
}
