//! Map files.
use crate::error::SimError;
use crate::scenario::Scenario;
use std::path::Path;

/// Reads a map.
pub fn load(path: &Path) -> Result<Scenario, SimError> {
    Err(SimError::file(path, "format", "a map file", "none: maps are not read yet"))
}
