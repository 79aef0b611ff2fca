//! Scenarios from a configuration: its rectangle, or a map file. Polygon files and ROS occupancy
//! grids become walls and obstacles.
//!
//! A refusal names the file, the field, what was found and what was expected. Sizes are capped
//! before anything of that size is allocated. A format whose feature is off is refused by
//! [`SimError::Feature`].

#[cfg(feature = "yaml")]
mod contour;
#[cfg(feature = "yaml")]
mod grid;
#[cfg(feature = "yaml")]
mod image;
mod polygon;
#[cfg(feature = "yaml")]
mod yaml;

use crate::config::RoomConfig;
use crate::error::{SimError, one_line};
use crate::scenario::Scenario;
use glam::Vec2;
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

/// Largest map file that is read, bytes.
const FILE_MAX: u64 = 64 << 20;

/// The scenario of a configuration: its map, or the rectangle if it names none.
///
/// # Errors
///
/// As [`load`].
///
/// # Examples
///
/// ```
/// use jostle_sim::{RoomConfig, maps};
/// let mut room = RoomConfig::default();
/// room.width = 8.0;
/// let (least, largest) = maps::scenario(&room)?.walls;
/// assert_eq!((least.x, largest.x), (-4.0, 4.0));
/// # Ok::<(), jostle_sim::SimError>(())
/// ```
pub fn scenario(config: &RoomConfig) -> Result<Scenario, SimError> {
    match config.map_file() {
        Some(path) => load(&path),
        None => Ok(Scenario::rectangle(Vec2::new(config.width, config.height))),
    }
}

/// Reads a map: `.toml` (feature `toml`) or `.json` for polygons, `.yaml` or `.yml` (feature
/// `yaml`) for a ROS map.
///
/// # Errors
///
/// When the file cannot be read, is no such map, or holds a shape that the world refuses; a format
/// whose feature is off.
pub fn load(path: &Path) -> Result<Scenario, SimError> {
    let scenario = match path.extension().and_then(|e| e.to_str()) {
        #[cfg(feature = "toml")]
        Some("toml") => polygon::from_toml(path)?,
        #[cfg(not(feature = "toml"))]
        Some("toml") => return Err(SimError::feature(path, "toml")),
        Some("json") => polygon::from_json(path)?,
        #[cfg(feature = "yaml")]
        Some("yaml" | "yml") => grid::load(path)?,
        #[cfg(not(feature = "yaml"))]
        Some("yaml" | "yml") => return Err(SimError::feature(path, "yaml")),
        other => {
            let found = other.unwrap_or("none");
            return Err(SimError::file(path, "extension", found, "toml, json, yaml or yml"));
        }
    };
    // A shape that the world would refuse is refused here, where the file is known.
    scenario.build().map_err(|error| match error.setting() {
        Some((field, found, expected)) => SimError::file(path, field, found, expected),
        None => error,
    })?;
    Ok(scenario)
}

/// Keys of a `map.yaml` that are not read because only other tools know them, as lines for the
/// user; none for other maps. Nothing here prints; a command does, once.
///
/// # Errors
///
/// When the file cannot be read or is no such map.
pub fn notes(path: &Path) -> Result<Vec<String>, SimError> {
    if !is_grid(path) {
        return Ok(Vec::new());
    }
    #[cfg(not(feature = "yaml"))]
    return Err(SimError::feature(path, "yaml"));
    #[cfg(feature = "yaml")]
    {
        let ignored = grid::ignored(path)?;
        let ignored_keys = one_line(&ignored.join(", "));
        let note = || format!("{}: not read: {ignored_keys}", path.display());
        Ok((!ignored.is_empty()).then(note).into_iter().collect())
    }
}

/// SHA-256 of a map's content, in hexadecimal: of the file's bytes; of a `map.yaml`, of the
/// hexadecimal hashes of the file and of its image, one behind the other. The files' folders do not
/// count.
///
/// # Errors
///
/// When a file cannot be read or a `map.yaml` names no image.
pub fn sha256(path: &Path) -> Result<String, SimError> {
    let file = hex_sha256(&read(path)?);
    if !is_grid(path) {
        return Ok(file);
    }
    #[cfg(not(feature = "yaml"))]
    return Err(SimError::feature(path, "yaml"));
    #[cfg(feature = "yaml")]
    Ok(hex_sha256((file + &hex_sha256(&read(&grid::image_of(path)?)?)).as_bytes()))
}

fn hex_sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut hex, byte| {
        write!(hex, "{byte:02x}").expect("a string takes everything");
        hex
    })
}

/// True if a file is a ROS map by its name.
fn is_grid(path: &Path) -> bool {
    matches!(path.extension().and_then(|e| e.to_str()), Some("yaml" | "yml"))
}

/// A file's bytes, up to the cap.
fn read(path: &Path) -> Result<Vec<u8>, SimError> {
    let unreadable = |error: std::io::Error| SimError::Unreadable {
        path: path.to_path_buf(),
        kind: error.kind(),
        reason: one_line(&error.to_string()),
    };
    // A pipe or a terminal would be waited for without an end.
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(SimError::file(path, "file", "something else", "a regular file"));
    }
    let file = std::fs::File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    file.take(FILE_MAX + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > FILE_MAX {
        return Err(SimError::file(path, "file", "a larger file", format!("at most {FILE_MAX} bytes")));
    }
    Ok(bytes)
}

/// A file's text, up to the cap: UTF-8, or UTF-16 where a byte order mark says so. The mark itself
/// is no part of the text.
fn read_text(path: &Path) -> Result<String, SimError> {
    let mut bytes = read(path)?;
    let units = |decode: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| decode([pair[0], pair[1]])).collect();
        String::from_utf16(&units)
            .map_err(|error| SimError::file(path, "content", error, "text in UTF-8 or UTF-16"))
    };
    match bytes.get(..2) {
        Some([0xFF, 0xFE]) => return units(u16::from_le_bytes),
        Some([0xFE, 0xFF]) => return units(u16::from_be_bytes),
        _ => {}
    }
    if bytes.starts_with(&[0xEF, 0xBB, 0xBF]) {
        bytes.drain(..3);
    }
    String::from_utf8(bytes).map_err(|e| {
        SimError::file(path, format!("byte {}", e.utf8_error().valid_up_to()), "no UTF-8", "text")
    })
}
