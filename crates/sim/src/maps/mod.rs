//! Maps: polygon files and ROS occupancy grids, turned into walls and obstacles.
//!
//! Every refusal is one [`SimError::File`] that names the file, the field, what was found and what was expected. Sizes are
//! capped before anything of that size is allocated.

mod grid;
mod image;
mod polygon;
mod yaml;

use crate::error::SimError;
use crate::scenario::Scenario;
use std::io::Read;
use std::path::Path;

/// Largest map file that is read, bytes.
const FILE_MAX: u64 = 64 << 20;

/// Reads a map: `.toml` or `.json` for polygons, `.yaml` or `.yml` for a ROS map.
///
/// # Errors
///
/// When the file cannot be read, is no such map, or holds a shape that the world refuses.
pub fn load(path: &Path) -> Result<Scenario, SimError> {
    let scenario = match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => polygon::from_toml(path)?,
        Some("json") => polygon::from_json(path)?,
        Some("yaml" | "yml") => grid::load(path)?,
        other => {
            let found = other.unwrap_or("none");
            return Err(SimError::file(path, "extension", found, "toml, json, yaml or yml"));
        }
    };
    // A shape that the world would refuse is refused here, where the file is known.
    scenario.build().map_err(|error| match error {
        SimError::Field { field, found, expected } => SimError::file(path, field, found, expected),
        other @ SimError::File { .. } => other,
    })?;
    Ok(scenario)
}

/// A file's bytes, up to the cap.
fn read(path: &Path) -> Result<Vec<u8>, SimError> {
    let unreadable = |error: std::io::Error| SimError::file(path, "file", error, "a readable file");
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

/// A file's text, up to the cap.
fn read_text(path: &Path) -> Result<String, SimError> {
    String::from_utf8(read(path)?).map_err(|e| {
        SimError::file(path, format!("byte {}", e.utf8_error().valid_up_to()), "no UTF-8", "text")
    })
}
