//! Stamps the program with the commit that it is built from: the provenance of everything that it
//! trains.
//!
//! `JOSTLE_STAMP` is the commit's first ten digits, with `-dirty` where a file that the program is
//! made of differs from it; `unknown` outside a checkout.

use std::path::Path;
use std::process::Command;

/// The sources of the program, below the root.
const MADE_OF: [&str; 4] = ["crates", "Cargo.toml", "Cargo.lock", ".cargo"];

fn main() {
    let root = git(&["rev-parse", "--show-toplevel"]);
    println!(
        "cargo:rustc-env=JOSTLE_STAMP={}",
        stamp(root.as_deref()).unwrap_or_else(|| "unknown".to_owned())
    );
    let Some(root) = root else { return };
    for made_of in MADE_OF {
        println!("cargo:rerun-if-changed={}", Path::new(&root).join(made_of).display());
    }
    // Where a new commit shows: the head, and the branch that it names.
    let branch = git(&["symbolic-ref", "--quiet", "HEAD"]);
    for name in ["HEAD", "packed-refs"].into_iter().chain(branch.as_deref()) {
        if let Some(path) = git(&["rev-parse", "--path-format=absolute", "--git-path", name])
            .filter(|path| Path::new(path).exists())
        {
            println!("cargo:rerun-if-changed={path}");
        }
    }
}

fn stamp(root: Option<&str>) -> Option<String> {
    let root = root?;
    let head = git(&["rev-parse", "--short=10", "HEAD"])?;
    let status = ["-C", root, "status", "--porcelain", "--untracked-files=no", "--"];
    let changes = git(&[&status[..], &MADE_OF].concat())?;
    Some(if changes.is_empty() { head } else { format!("{head}-dirty") })
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
