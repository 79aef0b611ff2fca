//! Which source a result was made by.

use std::path::Path;
use std::process::Command;

/// The variable that names the commit in the environment of runs that are started by something else: the sources may have
/// changed since.
pub const COMMIT: &str = "JOSTLE_COMMIT";

/// The commit of the work tree, with `-dirty` when tracked files differ from it; `unknown` outside a checkout. What
/// [`COMMIT`] says comes first.
pub fn commit() -> String {
    if let Ok(named) = std::env::var(COMMIT) {
        return named;
    }
    let Some(hash) = git(&["rev-parse", "--short=10", "HEAD"]) else { return "unknown".to_owned() };
    let clean =
        git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|changes| changes.is_empty());
    if clean { hash } else { format!("{hash}-dirty") }
}

/// The folder of the workspace's root manifest.
pub fn workspace() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own)
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(workspace()).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
