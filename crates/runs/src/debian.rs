//! Software that a check needs and the workspace does not bring, installed where that can be done.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, ensure};

use crate::output::note;
use crate::tools::on_path;

/// Software by its name, with the programs that show that it is there and the Debian packages that
/// have them.
pub struct Software {
    /// What a reader calls it.
    pub name: &'static str,
    /// Programs that are needed.
    pub programs: &'static [&'static str],
    /// Packages that have them.
    pub packages: &'static [&'static str],
}

impl Software {
    /// Makes sure that the programs are there; installs them where this is root on a Debian.
    ///
    /// # Errors
    /// When a program is missing and cannot be installed.
    pub fn install(&self) -> Result<()> {
        let missing = || {
            let missing = self.programs.iter().filter(|name| find(name).is_none());
            missing.copied().collect::<Vec<_>>().join(", ")
        };
        if missing().is_empty() {
            return Ok(());
        }
        let packages = self.packages.join(" ");
        ensure!(
            on_path(&["apt-get"]).is_some(),
            "{} not found; install {} (on Debian: apt-get install {packages})",
            missing(),
            self.name
        );
        note(&format!("installing {packages}"));
        let install = Command::new("apt-get")
            .args(["install", "--yes", "--quiet", "--no-install-recommends"])
            .args(self.packages)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .stdout(Stdio::null())
            .status();
        let installed = install.context("cannot start apt-get")?.success();
        ensure!(
            installed && missing().is_empty(),
            "{} not found; as root: apt-get install {packages}",
            missing()
        );
        Ok(())
    }
}

/// A program on the path or among those of the system's administrator, which are not on everyone's
/// path.
pub fn find(name: &str) -> Option<PathBuf> {
    on_path(&[name]).or_else(|| Some(Path::new("/usr/sbin").join(name)).filter(|path| path.is_file()))
}

/// One of these programs, ready to be started.
pub fn program(name: &str) -> Command {
    Command::new(find(name).unwrap_or_else(|| name.into()))
}
