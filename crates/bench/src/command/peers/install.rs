//! Installation of other software: a Python environment of its own, RVO2 built from a checkout,
//! Stage as it is.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, anyhow, bail};

use super::contest::{Contest, Peer};
use super::side::Side;
use super::{PeersArgs, packages, peers_folder};
use jostle_runs::output::note;

/// The packages asked of the package index: name and version. PyTorch's is the one whose figures
/// the project quotes.
const PINNED: [(&str, &str); 3] = [("torch", "2.8.0"), ("ir-sim", "2.12.0"), ("vmas", "1.5.2")];
/// The size of what PyTorch's Linux wheel on the package index needs: it cannot be imported without
/// CUDA's libraries.
const TORCH_SIZE: &str = "about 3.5 GB from PyPI (its Linux wheel does not load without CUDA's libraries; --torch-index takes a \
                          CPU wheel of about 0.2 GB from another index, --python uses a Python that has it)";

/// The folder of what is installed, and what has been found to work.
pub(super) struct Installed<'a> {
    args: &'a PeersArgs,
    out: &'a Path,
    /// The result of each peer that was asked for.
    ready: Vec<Peer>,
}

impl<'a> Installed<'a> {
    pub(super) fn new(args: &'a PeersArgs, out: &'a Path) -> Self {
        Self { args, out, ready: Vec::new() }
    }

    /// Installs or builds a peer where it is not there yet.
    ///
    /// # Errors
    /// Why it cannot be measured, for one line.
    pub(super) fn install(&mut self, peer: Peer) -> Result<()> {
        if self.ready.contains(&peer) {
            return Ok(());
        }
        match peer {
            Peer::PyTorch | Peer::IrSim | Peer::Vmas => self.python_packages(packages(peer))?,
            Peer::Rvo2 => self.build_rvo2()?,
            Peer::Stage => {
                let binary = self.args.stage.as_deref().context("give its binary with --stage")?;
                if !binary.is_file() {
                    bail!("--stage: no file {}", binary.display());
                }
            }
        }
        self.ready.push(peer);
        Ok(())
    }

    /// Starts the peer on a workload.
    pub(super) fn side(&self, contest: Contest) -> Result<Side> {
        let logs = self.out;
        match contest.peer {
            Peer::PyTorch => Side::python(&self.python(), "torch_driver.py", contest, logs),
            Peer::IrSim => Side::python(&self.python(), "irsim_driver.py", contest, logs),
            Peer::Vmas => Side::python(&self.python(), "vmas_driver.py", contest, logs),
            Peer::Rvo2 => Side::program(Command::new(self.rvo2_driver()), contest, logs),
            Peer::Stage => {
                let binary = self.args.stage.as_deref().context("give its binary with --stage")?;
                Side::stage(binary, self.out)
            }
        }
    }

    fn python(&self) -> PathBuf {
        self.args.python.clone().unwrap_or_else(|| self.out.join("python/bin/python"))
    }

    fn rvo2_driver(&self) -> PathBuf {
        self.out.join("rvo2_driver")
    }

    fn python_packages(&self, names: &[&str]) -> Result<()> {
        if self.args.python.is_none() && !self.python().is_file() {
            note(&format!("making a Python environment in {}", self.out.join("python").display()));
            let mut python = Command::new("python3");
            python.args(["-m", "venv"]).arg(self.out.join("python"));
            succeed(&mut python, "python3 with its modules venv and pip is needed")?;
        }
        for (name, version) in PINNED.into_iter().filter(|(name, _)| names.contains(name)) {
            if self.has(name, version) {
                continue;
            }
            if self.args.python.is_some() {
                bail!("--python: it has no package {name} {version}");
            }
            let size =
                if name == "torch" && self.args.torch_index.is_none() { TORCH_SIZE } else { "some MB" };
            note(&format!("installing {name} {version}: {size}"));
            let mut pip = Command::new(self.python());
            pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
            pip.arg(format!("{name}=={version}"));
            if let Some(index) = self.args.torch_index.as_ref().filter(|_| name == "torch") {
                pip.args(["--index-url", index]);
            }
            succeed(&mut pip, &format!("pip cannot install {name} {version}"))?;
        }
        Ok(())
    }

    fn has(&self, name: &str, version: &str) -> bool {
        let check = format!(
            "from importlib.metadata import version as v; assert v('{name}').split('+')[0] == '{version}'"
        );
        Command::new(self.python()).args(["-c", &check]).output().is_ok_and(|output| output.status.success())
    }

    fn build_rvo2(&self) -> Result<()> {
        let checkout = self.args.rvo2.as_deref().context("give a checkout of its sources with --rvo2")?;
        let sources = checkout.join("src");
        let entries = std::fs::read_dir(&sources)
            .with_context(|| format!("--rvo2: cannot read {}", sources.display()))?;
        let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "cc"));
        files.sort();
        let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
        let mut build = Command::new(&compiler);
        build.args(["-std=c++17", "-O3", "-DNDEBUG", "-DRVO_STATIC_DEFINE"]);
        build.arg(format!("-DRVO2_VERSION=\"{}\"", commit_of(checkout)));
        build.arg("-I").arg(&sources).arg(peers_folder().join("rvo2_driver.cpp")).args(files);
        build.arg("-o").arg(self.rvo2_driver());
        succeed(&mut build, &format!("{compiler} cannot build RVO2 with our driver"))
    }
}

/// The commit of a checkout that is a repository by itself.
fn commit_of(checkout: &Path) -> String {
    let hash = checkout.join(".git").exists().then(|| {
        let output =
            Command::new("git").arg("-C").arg(checkout).args(["rev-parse", "--short=10", "HEAD"]).output();
        output.ok().filter(|output| output.status.success())
    });
    let hash = hash.flatten().map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    hash.unwrap_or_else(|| "of unknown commit".to_owned())
}

/// Runs a command to its end; its last line of complaint explains a failure.
fn succeed(command: &mut Command, what: &str) -> Result<()> {
    let output = command.output().with_context(|| what.to_owned())?;
    if output.status.success() {
        return Ok(());
    }
    let complaint = String::from_utf8_lossy(&output.stderr);
    let last = complaint.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it says nothing");
    Err(anyhow!("{what}: {}", last.trim()))
}
