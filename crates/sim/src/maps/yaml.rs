//! The `map.yaml` of ROS's `map_server`: a strict reader of flat `key: value` lines, which is all such a file has.

use crate::error::SimError;
use std::path::{Path, PathBuf};

/// Longest name of an image, bytes.
const NAME_MAX: usize = 1024;

/// The metadata of an occupancy grid.
#[derive(Debug)]
pub(super) struct MapYaml {
    /// The image, beside the yaml unless absolute.
    pub(super) image: PathBuf,
    /// Side of a cell, m.
    pub(super) resolution: f64,
    /// World position of the lower left corner of the lower left cell, m.
    pub(super) origin: [f64; 2],
    /// Whether dark is free.
    pub(super) negate: bool,
    /// A cell is free below this probability of being occupied.
    pub(super) free_thresh: f64,
}

impl MapYaml {
    /// Reads the text of a `map.yaml`.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self, SimError> {
        let fields = fields(path, text)?;
        let get = |key: &str| {
            let entry = fields.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str());
            entry.ok_or_else(|| SimError::file(path, key, "nothing", "a value"))
        };
        let number = |key: &str, low: f64, high: f64| {
            let found = get(key)?;
            let value = found.parse::<f64>().ok().filter(|x| *x >= low && *x <= high);
            value.ok_or_else(|| SimError::file(path, key, found, format!("a number in [{low}, {high}]")))
        };
        let occupied_thresh = number("occupied_thresh", 0.0, 1.0)?;
        let free_thresh = number("free_thresh", 0.0, 1.0)?;
        if free_thresh > occupied_thresh {
            let expected = format!("at most occupied_thresh, {occupied_thresh}");
            return Err(SimError::file(path, "free_thresh", free_thresh, expected));
        }
        if let Some((_, mode)) = fields.iter().find(|(k, v)| k == "mode" && v != "trinary") {
            return Err(SimError::file(path, "mode", mode, "trinary"));
        }
        let image = get("image")?;
        // Such a name would forge lines in the messages about it, or fill a terminal.
        if image.len() > NAME_MAX || image.chars().any(char::is_control) {
            let expected = format!("a file name of at most {NAME_MAX} bytes without control characters");
            return Err(SimError::file(path, "image", image, expected));
        }
        Ok(Self {
            image: path.parent().unwrap_or(Path::new("")).join(image),
            resolution: number("resolution", 1e-3, 10.0)?,
            origin: origin(path, get("origin")?)?,
            negate: number("negate", 0.0, 1.0)? != 0.0,
            free_thresh,
        })
    }
}

/// The lines `key: value`, without comments and quotes.
fn fields(path: &Path, text: &str) -> Result<Vec<(String, String)>, SimError> {
    const KNOWN: [&str; 7] =
        ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];
    let mut fields: Vec<(String, String)> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split(" #").next().unwrap_or("").trim();
        if line.is_empty() || line.starts_with('#') || line == "---" {
            continue;
        }
        let place = format!("line {}", i + 1);
        let (key, value) =
            line.split_once(':').ok_or_else(|| SimError::file(path, &place, line, "key: value"))?;
        let (key, value) = (key.trim(), value.trim().trim_matches(['"', '\'']));
        if !KNOWN.contains(&key) || fields.iter().any(|(k, _)| k == key) {
            let expected = format!("one each of {}", KNOWN.join(", "));
            return Err(SimError::file(path, place, key, expected));
        }
        fields.push((key.into(), value.into()));
    }
    Ok(fields)
}

/// `[x, y, yaw]`, where yaw must be 0.
fn origin(path: &Path, found: &str) -> Result<[f64; 2], SimError> {
    let inner = found.strip_prefix('[').and_then(|s| s.strip_suffix(']')).unwrap_or("");
    let parts: Option<Vec<f64>> = inner.split(',').map(|part| part.trim().parse().ok()).collect();
    match parts.unwrap_or_default()[..] {
        [x, y, yaw] if x.abs() <= 1e4 && y.abs() <= 1e4 && yaw == 0.0 => Ok([x, y]),
        _ => Err(SimError::file(path, "origin", found, "[x, y, 0] within 10000 m; a turned map is not read")),
    }
}
