//! The folder of one training run, as its readers see it.
//!
//! ```text
//! DIR/config.toml                  the resolved configuration
//! DIR/log.ndjson                   one update report a line
//! DIR/checkpoints/000500.safetensors
//! DIR/latest                       the file name of the newest complete checkpoint
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::RunsError;

/// The resolved configuration's file.
pub const CONFIG: &str = "config.toml";
/// The file that names the newest complete checkpoint.
pub const LATEST: &str = "latest";
/// The folder of the checkpoints.
pub const CHECKPOINTS: &str = "checkpoints";

/// True where `folder` looks like a training run's.
pub fn is_run_folder(folder: &Path) -> bool {
    folder.join(CONFIG).is_file() && folder.join(CHECKPOINTS).is_dir()
}

/// The file name of the checkpoint after `update` updates.
pub fn checkpoint_name(update: u64) -> String {
    format!("{update:06}.safetensors")
}

/// Path of the checkpoint after `update` updates of the run in `folder`.
pub fn checkpoint_path(folder: &Path, update: u64) -> PathBuf {
    folder.join(CHECKPOINTS).join(checkpoint_name(update))
}

/// The run folder that a checkpoint lies in, if it lies in one.
pub fn run_of(checkpoint: &Path) -> Option<&Path> {
    checkpoint.parent().and_then(Path::parent).filter(|folder| is_run_folder(folder))
}

/// The newest complete checkpoint of the run in `folder`, by its `latest` file.
///
/// # Errors
///
/// A run without a finished checkpoint; a file that cannot be read.
pub fn latest_checkpoint(folder: &Path) -> Result<PathBuf, RunsError> {
    match read_optional(&folder.join(LATEST))? {
        Some(name) => Ok(folder.join(CHECKPOINTS).join(name.trim())),
        None => Err(RunsError::NoCheckpoint { path: folder.to_owned() }),
    }
}

/// The text of a file, or `None` where there is none.
///
/// # Errors
///
/// A file that is there and cannot be read.
pub fn read_optional(path: &Path) -> Result<Option<String>, RunsError> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(RunsError::io(path, "read")(error)),
    }
}

/// The entries of a folder, in the order of the names.
///
/// # Errors
///
/// A folder that cannot be listed.
pub fn sorted(folder: &Path) -> Result<Vec<PathBuf>, RunsError> {
    let entries = fs::read_dir(folder).map_err(RunsError::io(folder, "list"))?;
    let mut paths = entries
        .map(|entry| Ok(entry.map_err(RunsError::io(folder, "list"))?.path()))
        .collect::<Result<Vec<_>, RunsError>>()?;
    paths.sort();
    Ok(paths)
}
