//! The folder of one training run, and the rules that keep two runs from mixing.
//!
//! ```text
//! DIR/config.toml                  the resolved configuration
//! DIR/log.ndjson                   one update report a line
//! DIR/checkpoints/000500.safetensors
//! DIR/milestones/001000000.safetensors   the policy after so many transitions, where it was asked for
//! DIR/latest                       the file name of the newest complete checkpoint
//! DIR/lock                         held while a process works here; says on which machine
//! ```
//!
//! The lock is the operating system's advisory file lock: it dies with its process, also by `kill
//! -9`.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};

use crate::folder::{CHECKPOINTS, CONFIG, LATEST, checkpoint_name, checkpoint_path, read_optional};
use crate::output::note;
use crate::stop::{self, Stopped};

const LOCK: &str = "lock";
const MILESTONES: &str = "milestones";
/// Time between two tries of a lock that another process holds.
const LOCK_INTERVAL: Duration = Duration::from_secs(1);

/// A locked run folder.
pub struct RunFolder {
    path: PathBuf,
    _lock: File,
}

impl RunFolder {
    /// Locks the folder at `path`, which is created if it is not there. With `wait` the end of
    /// another process that works there is waited for, however long that takes.
    ///
    /// # Errors
    /// When the folder cannot be written, another process works in it (without `wait`), or it holds
    /// files but no run.
    pub fn open(path: &Path, wait: bool) -> Result<Self> {
        let shown = path.display();
        fs::create_dir_all(path).with_context(|| format!("cannot create the run folder {shown}"))?;
        if !path.join(CONFIG).exists() && holds_foreign_files(path)? {
            bail!("{shown} holds files but no run; choose an empty or a new folder");
        }
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path.join(LOCK))
            .with_context(|| format!("cannot write in the run folder {shown}"))?;
        let mut told = false;
        loop {
            match lock.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) if wait && stop::asked() => {
                    let again = "nothing was begun, and the same command tries again";
                    return Err(Stopped(format!(
                        "{shown}: stopped while another process works there; {again}"
                    ))
                    .into());
                }
                Err(TryLockError::WouldBlock) if wait => {
                    if !std::mem::replace(&mut told, true) {
                        note(&format!("{shown}: waiting for the process that works there{}", holder(path)));
                    }
                    // Not `lock()`: over a network it may sleep through a lock that is lost with
                    // its machine.
                    std::thread::sleep(LOCK_INTERVAL);
                }
                Err(TryLockError::WouldBlock) => {
                    bail!("another process is working in {shown}{}", holder(path));
                }
                Err(TryLockError::Error(error)) => {
                    return Err(error).with_context(|| format!("cannot lock the run folder {shown}"));
                }
            }
        }
        remove_leftovers(path)?;
        sign(&lock).with_context(|| format!("cannot write in the run folder {shown}"))?;
        Ok(Self { path: path.to_owned(), _lock: lock })
    }

    /// The text of the stored configuration, if the folder holds a run.
    pub fn stored_config(&self) -> Result<Option<String>> {
        Ok(read_optional(&self.path.join(CONFIG))?)
    }

    /// Stores the resolved configuration.
    pub fn store_config(&self, text: &str) -> Result<()> {
        fs::create_dir_all(self.path.join(CHECKPOINTS))
            .with_context(|| format!("cannot create {}", self.path.join(CHECKPOINTS).display()))?;
        write_atomically(&self.path.join(CONFIG), text)
    }

    /// Path of the log.
    pub fn log(&self) -> PathBuf {
        self.path.join("log.ndjson")
    }

    /// Path of the checkpoint after `update` updates.
    pub fn checkpoint(&self, update: u64) -> PathBuf {
        checkpoint_path(&self.path, update)
    }

    /// Names the checkpoint after `update` updates as the newest complete one.
    pub fn set_latest(&self, update: u64) -> Result<()> {
        write_atomically(&self.path.join(LATEST), &format!("{}\n", checkpoint_name(update)))
    }

    /// Path of the policy after `transitions` transitions.
    pub fn milestone(&self, transitions: u64) -> PathBuf {
        milestone_path(&self.path, transitions)
    }

    /// Creates the folder of milestones.
    pub fn create_milestones(&self) -> Result<()> {
        let folder = self.path.join(MILESTONES);
        fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))
    }

    /// All checkpoint files, newest first. A file may still be damaged; its reader says so.
    pub fn checkpoints(&self) -> Result<Vec<(u64, PathBuf)>> {
        list_checkpoints(&self.path)
    }
}

/// Path of the policy after `transitions` transitions of the run in `folder`.
pub fn milestone_path(folder: &Path, transitions: u64) -> PathBuf {
    folder.join(MILESTONES).join(format!("{transitions:09}.safetensors"))
}

/// Updates of the newest complete checkpoint of the run in `folder`; `None` where there is none.
pub fn latest_update(folder: &Path) -> Result<Option<u64>> {
    let name = read_optional(&folder.join(LATEST))?;
    Ok(name.and_then(|name| name.trim().split_once('.').and_then(|(stem, _)| stem.parse().ok())))
}

/// True if a process works in `folder`.
///
/// # Errors
/// When the lock can be neither opened nor tested.
pub fn is_locked(folder: &Path) -> Result<bool> {
    let path = folder.join(LOCK);
    match File::open(&path) {
        // A shared lock that is given back at once: it is refused while the run's own process is
        // alive.
        Ok(file) => match file.try_lock_shared() {
            Ok(()) => Ok(false),
            Err(TryLockError::WouldBlock) => Ok(true),
            Err(TryLockError::Error(error)) => {
                Err(error).with_context(|| format!("cannot test {}", path.display()))
            }
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error).with_context(|| format!("cannot open {}", path.display())),
    }
}

/// Replaces a small file so that a reader sees the old text or the new one, never a part.
pub fn write_atomically(path: &Path, text: &str) -> Result<()> {
    write_bytes_atomically(path, text.as_bytes())
}

/// As [`write_atomically`], for what is no text.
pub fn write_bytes_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let temporary = path.with_file_name(temporary_name(&name));
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)?;
        // The rename itself is durable once the folder is.
        path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all())
    };
    write().with_context(|| format!("cannot write {}", path.display())).inspect_err(|_| {
        // The first error is the one to report; there may be no temporary file at all.
        let _ = fs::remove_file(&temporary);
    })
}

/// Writes into a held lock who holds it.
fn sign(mut lock: &File) -> std::io::Result<()> {
    lock.set_len(0)?;
    lock.write_all(format!("{} {}\n", host(), std::process::id()).as_bytes())
}

/// ` (HOST, process N)`, as the folder's lock says; nothing where it does not.
fn holder(folder: &Path) -> String {
    match last_holder(folder) {
        Some((host, process)) => format!(" ({host}, process {process})"),
        None => String::new(),
    }
}

/// Machine and process that work in the folder, or were the last to do so.
pub fn last_holder(folder: &Path) -> Option<(String, String)> {
    let text = fs::read_to_string(folder.join(LOCK)).ok()?;
    let (host, process) = text.trim().split_once(' ')?;
    Some((host.to_owned(), process.to_owned()))
}

/// The name of this machine; a node of a cluster is called what its scheduler calls it.
fn host() -> String {
    let kernel = || fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let names = [std::env::var("SLURMD_NODENAME").ok(), kernel(), std::env::var("HOSTNAME").ok()];
    let mut known = names.into_iter().flatten().map(|name| name.trim().to_owned());
    known.find(|name| !name.is_empty() && !name.contains(' ')).unwrap_or_else(|| "unknown".to_owned())
}

fn list_checkpoints(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let folder = folder.join(CHECKPOINTS);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(&folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry?.path();
        let update = path.file_stem().and_then(|stem| stem.to_str()).and_then(|stem| stem.parse().ok());
        if let (Some(update), Some("safetensors")) = (update, path.extension().and_then(|e| e.to_str())) {
            found.push((update, path));
        }
    }
    found.sort();
    found.reverse();
    Ok(found)
}

/// True where the folder holds anything but what a start that was killed early leaves behind: a
/// lock, an empty folder for checkpoints, half a configuration.
fn holds_foreign_files(path: &Path) -> Result<bool> {
    let early = [LOCK.to_owned(), CHECKPOINTS.to_owned(), temporary_name(CONFIG)];
    for entry in fs::read_dir(path).with_context(|| format!("cannot list {}", path.display()))? {
        let entry = entry?;
        let full_folder = || fs::read_dir(entry.path()).is_ok_and(|mut inside| inside.next().is_some());
        if !early.iter().any(|name| entry.file_name() == name.as_str()) || full_folder() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The name under which [`write_atomically`] prepares a file.
fn temporary_name(name: &str) -> String {
    format!("{name}.tmp")
}

/// Removes what processes that were killed left behind: they cannot be at work, as the folder is
/// locked.
fn remove_leftovers(path: &Path) -> Result<()> {
    let mut leftovers = vec![path.join(temporary_name(CONFIG)), path.join(temporary_name(LATEST))];
    for folder in [path.join(CHECKPOINTS), path.join(MILESTONES)].iter().filter(|folder| folder.is_dir()) {
        let cannot_list = || format!("cannot list {}", folder.display());
        for entry in fs::read_dir(folder).with_context(cannot_list)? {
            leftovers.push(entry.with_context(cannot_list)?.path());
        }
        leftovers.retain(|file| file.extension().is_some_and(|e| e == "tmp" || e == "partial"));
    }
    for file in leftovers.iter().filter(|file| file.exists()) {
        fs::remove_file(file).with_context(|| format!("cannot remove {}", file.display()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::RunFolder;

    #[test]
    fn a_second_process_is_kept_out_until_the_first_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(folder.path(), false).unwrap();
        let message = RunFolder::open(folder.path(), false).err().unwrap().to_string();
        assert!(message.contains("another process"), "{message}");
        drop(first);
        RunFolder::open(folder.path(), false).unwrap();
    }

    #[test]
    fn a_folder_of_other_files_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("thesis.tex"), "x").unwrap();
        let message = RunFolder::open(folder.path(), false).err().unwrap().to_string();
        assert!(message.contains("no run"), "{message}");
        assert!(!folder.path().join("lock").exists());
    }

    #[test]
    fn what_a_kill_left_behind_is_removed_and_no_foreign_file() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("checkpoints")).unwrap();
        std::fs::write(folder.path().join("config.toml.tmp"), "seed").unwrap();
        let run = RunFolder::open(folder.path(), false).unwrap();
        assert!(!folder.path().join("config.toml.tmp").exists());
        run.store_config("seed = 1\n").unwrap();
        drop(run);
        let partial = folder.path().join("checkpoints/.000002.safetensors.7.partial");
        std::fs::write(&partial, "x").unwrap();
        RunFolder::open(folder.path(), false).unwrap();
        assert!(!partial.exists());
    }

    #[test]
    fn checkpoints_come_newest_first() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open(folder.path(), false).unwrap();
        run.store_config("seed = 1\n").unwrap();
        for update in [5, 1_000_000, 50] {
            std::fs::write(run.checkpoint(update), "").unwrap();
        }
        std::fs::write(run.checkpoint(60).with_extension("tmp"), "").unwrap();
        let updates: Vec<u64> = run.checkpoints().unwrap().into_iter().map(|(update, _)| update).collect();
        assert_eq!(updates, [1_000_000, 50, 5]);
    }
}
