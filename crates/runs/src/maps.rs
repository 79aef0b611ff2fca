//! A command's remarks on a map, said once, before it works on it.

use std::path::PathBuf;

use anyhow::Result;
use jostle_sim::RoomConfig;

use crate::output;

/// Tells on standard error what the room's map file holds that is not read.
///
/// # Errors
/// When the file is no map.
pub fn tell(room: &RoomConfig) -> Result<()> {
    tell_all(room.map_file().as_slice())
}

/// As [`tell`], of several files.
///
/// # Errors
/// When one of them is no map.
pub fn tell_all(maps: &[PathBuf]) -> Result<()> {
    for map in maps {
        jostle_sim::maps::notes(map)?.iter().for_each(|line| output::note(line));
    }
    Ok(())
}
