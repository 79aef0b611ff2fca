//! A run so small that a test can afford it.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::{accepted, text};

/// Two agents with 16 beams, small layers, short rollouts.
pub(crate) const TINY: &str = "\
    updates = 4\ncheckpoint_every = 1\nN = 2\nM = 2\nhorizon = 16\nminibatch = 16\n\
    [sim.laser]\nbeams = 16\n[network]\nembedding = 4\nlaser_feature = 32\nhidden = 32\n[discriminator]\nhidden = 32\n";

/// Writes the tiny configuration to `folder/tiny.toml`.
pub(crate) fn config(folder: &Path) -> PathBuf {
    let path = folder.join("tiny.toml");
    std::fs::write(&path, TINY).unwrap();
    path
}

/// Trains the tiny configuration with overrides into `out`.
pub(crate) fn train(out: &Path, overrides: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path());
    let mut arguments = vec!["train", "--config", text(&config), "--out", text(out), "--threads", "1"];
    for argument in overrides {
        arguments.extend(["--set", argument]);
    }
    accepted(&arguments);
}

/// A finished tiny run that all tests of one binary share; they must not change it.
pub(crate) fn finished_run() -> &'static Path {
    static RUN: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        train(&folder.path().join("run"), &[]);
        folder
    });
    // The guard of a static is never dropped; the system clears its temporary folder.
    Box::leak(folder.path().join("run").into_boxed_path())
}
