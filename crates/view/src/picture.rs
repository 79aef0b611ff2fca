//! Pictures as files: SVG, and PNG where it is asked for.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use jostle_runs::output::flatten;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::tools::RESVG;

/// Pixels of a PNG for each unit of the drawing.
const ZOOM: &str = "2";

/// Writes `folder/name.svg` and, with `png`, `folder/name.png`; gives the paths.
///
/// The letters of a PNG are those of a font of this system, so that two systems may differ in them.
///
/// # Errors
/// A folder that cannot be written; for a PNG, no program that draws it.
pub fn write(folder: &Path, name: &str, svg: &str, png: bool) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let mut paths = vec![folder.join(format!("{name}.svg"))];
    write_atomically(&paths[0], svg)?;
    if png {
        let path = folder.join(format!("{name}.png"));
        raster(&paths[0], &path)?;
        paths.push(path);
    }
    Ok(paths)
}

fn raster(svg: &Path, png: &Path) -> Result<()> {
    let unfinished = png.with_extension("png.tmp");
    let output = Command::new(RESVG.find()?)
        .args(["--zoom", ZOOM, "--sans-serif-family", "DejaVu Sans"])
        .args([svg, &unfinished])
        .output()
        .context("cannot start resvg")?;
    if !output.status.success() {
        bail!("resvg cannot draw {}: {}", svg.display(), flatten(&String::from_utf8_lossy(&output.stderr)));
    }
    std::fs::rename(&unfinished, png).with_context(|| format!("cannot write {}", png.display()))
}
