//! Files that a configuration names: a relative path starts from the file that names it, whatever
//! the working directory of a command is.

use super::RoomConfig;
use crate::traits::TrainingCrowd;
use std::path::{Component, Path, PathBuf};

/// The folder that relative paths start from: that of the file that names them, or, by default, the
/// working directory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NamingFolder(Option<PathBuf>);

impl NamingFolder {
    /// That of files in `folder`.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self(Some(real(folder)))
    }

    /// The path as the system finds it from the working directory, for a `path` that a file in this
    /// folder names.
    pub fn locate(&self, path: &Path) -> PathBuf {
        self.0.as_ref().map_or_else(|| path.to_owned(), |folder| folder.join(path))
    }

    /// The path that leads from `other` to where `path` leads from here; an absolute one stays. A
    /// link that is named stays named, so that the name is the same from everywhere.
    pub fn rename(&self, path: &Path, other: &Self) -> PathBuf {
        if path.is_absolute() {
            return path.to_owned();
        }
        let here = PathBuf::new();
        path_from(&real(other.0.as_ref().unwrap_or(&here)), &real_folder(&self.locate(path)))
    }
}

impl RoomConfig {
    /// The map's file, if there is a map, as the system finds it from the working directory.
    pub fn map_file(&self) -> Option<PathBuf> {
        self.map.as_ref().map(|map| self.folder.locate(map))
    }

    /// Says that a file in `folder` names the map: a relative path starts there.
    pub fn named_in(&mut self, folder: &Path) {
        if self.map.as_ref().is_some_and(|map| map.is_relative()) {
            self.folder = NamingFolder::new(folder);
        }
    }

    /// As [`Self::named_in`], for what this program has written. Earlier versions wrote paths as
    /// they were given, relative to the working directory: such a path is taken from there if
    /// nothing lies where the folder says.
    pub fn stored_in(&mut self, folder: &Path) {
        let (as_given, mut here) = (self.clone(), self.clone());
        here.named_in(folder);
        let lies = |room: &Self| room.map_file().is_some_and(|map| map.exists());
        *self = if lies(&as_given) && !lies(&here) { as_given } else { here };
    }

    /// The room as a file in `folder` names it: a relative path leads from there to the same map.
    /// An absolute one stays.
    #[must_use]
    pub fn as_named_in(&self, folder: &Path) -> Self {
        let mut room = self.clone();
        room.named_in(folder);
        room.map = self.map.as_ref().map(|map| self.folder.rename(map, &room.folder));
        room
    }

    /// The room with the map's name only, which is the same on every machine.
    #[must_use]
    pub fn by_name(&self) -> Self {
        let map = self.map.as_deref().map(name_of);
        Self { map, folder: NamingFolder::default(), ..self.clone() }
    }
}

impl TrainingCrowd {
    /// The maps' files, as the system finds them from the working directory.
    pub fn map_files(&self) -> Vec<PathBuf> {
        self.maps.iter().map(|map| self.folder.locate(map)).collect()
    }

    /// Says that a file in `folder` names the maps: relative paths start there.
    pub fn named_in(&mut self, folder: &Path) {
        if self.maps.iter().any(|map| map.is_relative()) {
            self.folder = NamingFolder::new(folder);
        }
    }

    /// The crowd as a file in `folder` names it: relative paths lead from there to the same maps.
    #[must_use]
    pub fn as_named_in(&self, folder: &Path) -> Self {
        let mut crowd = self.clone();
        crowd.named_in(folder);
        crowd.maps = self.maps.iter().map(|map| self.folder.rename(map, &crowd.folder)).collect();
        crowd
    }

    /// The crowd with the maps' names only, which are the same on every machine.
    #[must_use]
    pub fn by_name(&self) -> Self {
        let maps = self.maps.iter().map(|map| name_of(map)).collect();
        Self { maps, folder: NamingFolder::default(), ..self.clone() }
    }
}

fn name_of(path: &Path) -> PathBuf {
    path.file_name().map_or_else(|| path.to_owned(), PathBuf::from)
}

/// As [`real`], but for a link that the last part of the path names.
fn real_folder(path: &Path) -> PathBuf {
    match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => real(parent).join(name),
        _ => real(path),
    }
}

/// An absolute path without links where it exists; folders that do not exist yet may follow.
fn real(path: &Path) -> PathBuf {
    // The folder of a file that is named without one.
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    if let Ok(path) = path.canonicalize() {
        return path;
    }
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match (absolute.parent(), absolute.file_name()) {
        (Some(parent), Some(name)) => real(parent).join(name),
        _ => absolute,
    }
}

/// The relative path from a folder to a file, both absolute; the file itself where nothing is
/// shared (two drives).
fn path_from(folder: &Path, file: &Path) -> PathBuf {
    let (from, to): (Vec<_>, Vec<_>) = (folder.components().collect(), file.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return file.to_owned();
    }
    let up = from[shared..].iter().map(|_| Component::ParentDir);
    up.chain(to[shared..].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(map: &str) -> RoomConfig {
        RoomConfig { map: Some(map.into()), ..RoomConfig::default() }
    }

    #[test]
    fn a_relative_path_starts_from_its_file_and_follows_it() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |path: &str| folder.path().join(path);
        for path in ["configs", "maps", "runs/a/checkpoints"] {
            std::fs::create_dir_all(at(path)).expect("folder");
        }
        std::fs::write(at("maps/m.toml"), "x").expect("map");
        let mut read = room("../maps/m.toml");
        read.named_in(&at("configs"));
        let text =
            |room: &RoomConfig| std::fs::read_to_string(room.map_file().expect("a map")).expect("text");
        assert_eq!(text(&read), "x");
        let stored = read.as_named_in(&at("runs/a/checkpoints"));
        assert_eq!(stored.map, Some("../../../maps/m.toml".into()));
        assert_eq!(text(&stored), "x");
        // A folder that is still to be made.
        assert_eq!(read.as_named_in(&at("runs/new")).map, Some("../../maps/m.toml".into()));
        let absolute = RoomConfig { map: Some(at("maps/m.toml")), ..RoomConfig::default() };
        assert_eq!(absolute.as_named_in(&at("runs/a")), absolute);
        assert_eq!(RoomConfig::default().as_named_in(&at("runs/a")).map_file(), None);
        // Without a file the working directory names it: tests run in the crate's folder.
        let given = room("src/lib.rs").as_named_in(&at("runs/a"));
        assert_eq!(text(&given), std::fs::read_to_string("src/lib.rs").expect("text"));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_keeps_its_name() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |path: &str| folder.path().join(path);
        for path in ["maps/a", "runs"] {
            std::fs::create_dir_all(at(path)).expect("folder");
        }
        std::fs::write(at("maps/a/m.toml"), "x").expect("map");
        std::os::unix::fs::symlink("maps/a", at("here")).expect("a link to a folder");
        std::os::unix::fs::symlink("m.toml", at("maps/a/newest.toml")).expect("a link to a file");
        let mut read = room("here/newest.toml");
        read.named_in(folder.path());
        let stored = read.as_named_in(&at("runs"));
        assert_eq!(stored.map, Some("../maps/a/newest.toml".into()));
        assert_eq!(std::fs::read_to_string(stored.map_file().expect("a map")).expect("text"), "x");
    }

    #[test]
    fn what_earlier_versions_stored_is_found_from_the_working_directory() {
        let folder = tempfile::tempdir().expect("folder");
        // Tests run in the crate's folder.
        let mut old = room("Cargo.toml");
        old.stored_in(folder.path());
        assert_eq!(old.map_file(), Some("Cargo.toml".into()));
        std::fs::write(folder.path().join("Cargo.toml"), "").expect("a map");
        let mut new = room("Cargo.toml");
        new.stored_in(folder.path());
        assert_eq!(new.map_file(), Some(real(folder.path()).join("Cargo.toml")));
    }
}
