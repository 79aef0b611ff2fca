//! The source that a result was made by.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

static STAMP: OnceLock<&str> = OnceLock::new();

/// Sets what [`commit`] answers: the stamp that the program's build script gave it. The first call
/// counts.
pub fn set_stamp(stamp: &'static str) {
    STAMP.get_or_init(|| stamp);
}

/// The commit that the program was built from, with `-dirty` where the sources differed from it;
/// `unknown` for a program that was built outside a checkout.
pub fn commit() -> &'static str {
    STAMP.get().copied().unwrap_or("unknown")
}

/// The root of the checkout: the nearest one at or above the working directory, else the one that
/// the program was built in, whether or not it is still there.
pub fn workspace() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let here = std::env::current_dir().unwrap_or_default();
        let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(""));
        here.ancestors().find(|folder| is_checkout(folder)).unwrap_or(built_in).to_owned()
    })
}

/// True if a folder is the root of a checkout.
pub(crate) fn is_checkout(folder: &Path) -> bool {
    folder.join("crates/sim/Cargo.toml").is_file() && folder.join("configs").is_dir()
}
