//! Append-only files of one JSON object a line, and their repair after a crash.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use serde::Serialize;

/// A log that is being written; every line reaches the operating system before `append` returns.
pub struct Log {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Log {
    /// Opens the log for appending and creates it where it is missing.
    pub fn append_to(path: &Path) -> Result<Self> {
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .with_context(|| format!("cannot open {}", path.display()))?;
        Ok(Self { path: path.to_owned(), file: BufWriter::new(file) })
    }

    /// Adds one line.
    pub fn append(&mut self, record: &impl Serialize) -> Result<()> {
        let mut line = serde_json::to_string(record).context("a record that is no JSON")?;
        line.push('\n');
        self.file
            .write_all(line.as_bytes())
            .and_then(|()| self.file.flush())
            .with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Waits until all lines are on the disk.
    pub fn sync(&mut self) -> Result<()> {
        self.file.get_ref().sync_data().with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// The findings of a repair.
#[derive(Debug, PartialEq, Eq)]
pub struct Repair {
    /// Lines that belong to updates after the checkpoint; they will be made again.
    pub dropped: usize,
    /// True where the last line was cut short.
    pub torn: bool,
}

/// Cuts a log of `{"update": 1, …}`, `{"update": 2, …}` … back to its first `updates` lines.
///
/// # Errors
/// When a line that must stay is missing, damaged or out of order: a curve with a hole would look
/// like a whole one.
pub fn truncate_log(path: &Path, updates: u64) -> Result<Repair> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
    };
    let torn = bytes.last().is_some_and(|&byte| byte != b'\n');
    let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    let mut kept = 0;
    let mut lines = 0;
    let mut dropped = 0;
    for line in bytes[..whole].split_inclusive(|&byte| byte == b'\n') {
        if lines == updates {
            dropped += 1;
            continue;
        }
        lines += 1;
        if update_of(line) != Some(lines) {
            bail!("{} line {lines} is not the report of update {lines}", path.display());
        }
        kept += line.len();
    }
    if lines < updates {
        bail!("{} ends at update {lines}, before the checkpoint's update {updates}", path.display());
    }
    if kept < bytes.len() {
        let file = OpenOptions::new().write(true).open(path);
        file.and_then(|file| {
            file.set_len(kept as u64)?;
            file.sync_all()
        })
        .with_context(|| format!("cannot repair {}", path.display()))?;
    }
    Ok(Repair { dropped, torn })
}

fn update_of(line: &[u8]) -> Option<u64> {
    serde_json::from_slice::<serde_json::Value>(line).ok()?.get("update")?.as_u64()
}

#[cfg(test)]
mod tests {
    use super::{Repair, truncate_log};

    fn check(text: &str, updates: u64, expected: &str, repair: &Repair) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.ndjson");
        std::fs::write(&path, text).unwrap();
        assert_eq!(&truncate_log(&path, updates).unwrap(), repair);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }

    #[test]
    fn lines_after_the_checkpoint_and_a_torn_tail_are_cut() {
        let whole = "{\"update\":1}\n{\"update\":2}\n";
        check(whole, 2, whole, &Repair { dropped: 0, torn: false });
        check("{\"update\":1}\n{\"update\":2}\n{\"upd", 2, whole, &Repair { dropped: 0, torn: true });
        check(
            "{\"update\":1}\n{\"update\":2}\n{\"upd",
            1,
            "{\"update\":1}\n",
            &Repair { dropped: 1, torn: true },
        );
        check("{\"upd", 0, "", &Repair { dropped: 0, torn: true });
    }

    #[test]
    fn a_hole_is_an_error_and_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.ndjson");
        for text in ["{\"update\":1}\n{\"update\":3}\n", "{\"update\":1}\n", "{\"update\":1}\nnonsense\n"] {
            std::fs::write(&path, text).unwrap();
            assert!(truncate_log(&path, 2).is_err(), "{text}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
    }
}
