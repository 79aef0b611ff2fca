//! A command's remarks on a map, said once, before it works on it.

use anyhow::Result;
use jostle_sim::RoomConfig;

use crate::output;

/// Tells on standard error what the room's map file holds that is not read.
///
/// # Errors
/// When the file is no map.
pub fn tell(room: &RoomConfig) -> Result<()> {
    if let Some(map) = room.map_file() {
        jostle_sim::maps::notes(&map)?.iter().for_each(|line| output::note(line));
    }
    Ok(())
}
