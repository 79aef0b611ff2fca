//! Programs that a command may want and the workspace does not: found on the path, or installed
//! once with cargo.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::output::note;
use crate::provenance::workspace;

/// A program that crates.io has.
pub struct Tool {
    /// Its name there.
    pub name: &'static str,
    /// The version that is installed.
    pub version: &'static str,
    /// Arguments of `cargo install` beyond these.
    pub options: &'static [&'static str],
}

/// Draws SVG (<https://github.com/linebender/resvg>). As a library it would bring some thirty
/// crates into every build, and other features of crates that the networks are built on, for
/// pictures that few ask for.
pub const RESVG: Tool = Tool { name: "resvg", version: "0.49.0", options: &[] };

/// Makes a book of Markdown (<https://github.com/rust-lang/mdBook>). Without its web server and
/// without optimisation it is installed in a third of the time, and needs two seconds for our book.
pub const MDBOOK: Tool = Tool {
    name: "mdbook",
    version: "0.5.4",
    options: &["--debug", "--no-default-features", "--features", "search"],
};

impl Tool {
    /// The program, installed into the target folder where the path has none.
    ///
    /// # Errors
    /// When cargo cannot install it.
    pub fn find(&self) -> Result<PathBuf> {
        if let Some(path) = on_path(&[self.name]) {
            return Ok(path);
        }
        let root = target_folder().join("tools");
        let program = root.join("bin").join(format!("{}{}", self.name, std::env::consts::EXE_SUFFIX));
        if !program.is_file() {
            self.install(&root)?;
        }
        Ok(program)
    }

    fn install(&self, root: &std::path::Path) -> Result<()> {
        let Self { name, version, options } = self;
        note(&format!("installing {name} {version} into {} (once)", root.display()));
        let status = Command::new(cargo())
            .args(["install", name, "--version", version, "--locked", "--quiet", "--root"])
            .arg(root)
            .args(*options)
            .status()
            .with_context(|| format!("cannot start cargo to install {name}"))?;
        ensure!(status.success(), "cannot install {name} {version}: `cargo install {name}` tells why");
        Ok(())
    }
}

/// The cargo that runs this program, or else the one of `PATH`.
pub fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// The first of some programs that a folder of `PATH` holds.
pub fn on_path(names: &[&str]) -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let candidates = names.iter().flat_map(|name| {
        folders.iter().map(move |folder| folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX)))
    });
    candidates.into_iter().find(|path| path.is_file())
}

/// The folder that cargo builds in, and that commands install into.
pub fn target_folder() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), PathBuf::from)
}

/// A folder of this process in the target folder, made, by its whole path.
///
/// # Errors
/// When it cannot be made or found.
pub fn process_folder(name: &str) -> Result<PathBuf> {
    let folder = target_folder().join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    folder.canonicalize().with_context(|| format!("cannot find {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::on_path;

    #[test]
    fn a_program_is_found_by_the_first_of_its_names_that_exists() {
        assert!(on_path(&["no-such-program-of-jostle"]).is_none());
        let cargo = on_path(&["no-such-program-of-jostle", "cargo"]).expect("cargo runs this test");
        assert!(cargo.file_stem().is_some_and(|name| name == "cargo"));
    }
}
