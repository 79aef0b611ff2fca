//! `cargo xtask ci --python`: the Python package, built and tested in a virtual environment of its own.
//!
//! Everything lands in `target/python`: the environment, and what pip brings. Torch is asked for where its builds without
//! CUDA are kept, and where the package index is pip's usual one if that cannot be reached: the tests need the CPU alone.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use jostle_runs::output;
use jostle_runs::provenance::workspace;
use jostle_runs::tools::target_folder;

/// Least version of Python, as in `pyproject.toml`.
const LEAST: (u32, u32) = (3, 11);
/// Torch without CUDA, 200 MB instead of 3 GB.
const TORCH_INDEX: &str = "https://download.pytorch.org/whl/cpu";

/// A step's work; true if it passed.
pub(crate) type Work = fn() -> Result<bool>;

/// The steps by their names.
pub(crate) const STEPS: [(&str, Work); 3] = [("py-clippy", clippy), ("py-setup", set_up), ("py-tests", test)];

/// The lints of what is compiled for Python alone; needs no Python.
fn clippy() -> Result<bool> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments =
        ["clippy", "--release", "--package", "jostle-python", "--features", "extension", "--quiet"];
    run(Command::new(cargo).args(arguments).args(["--", "-D", "warnings"]))
}

/// Makes the environment where there is none, and installs the package as a user would.
fn set_up() -> Result<bool> {
    let python = in_environment("python");
    if !python.exists() {
        let system = system_python()?;
        if !run(Command::new(system).args(["-m", "venv"]).arg(environment()))? {
            return Ok(false);
        }
    }
    let pip = |arguments: &[&str]| {
        let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        run(Command::new(&python).args(quiet).args(arguments))
    };
    let has_torch = Command::new(&python).args(["-c", "import torch"]).output()?.status.success();
    if !has_torch && !pip(&["--retries", "0", "--timeout", "20", "--index-url", TORCH_INDEX, "torch"])? {
        output::note(&format!("ci: {TORCH_INDEX} gave no torch; pip's own index is asked, for more bytes"));
    }
    pip(&[".[test]"])
}

/// The tests of `python/tests`, with this program as the command line that they compare with.
fn test() -> Result<bool> {
    let this = std::env::current_exe().context("cannot name this program")?;
    run(Command::new(in_environment("python")).args(["-m", "pytest", "--quiet"]).env("JOSTLE_XTASK", this))
}

fn run(command: &mut Command) -> Result<bool> {
    run_in(workspace(), command)
}

/// Runs a program in a folder; whether it succeeded.
pub(crate) fn run_in(folder: &Path, command: &mut Command) -> Result<bool> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command.current_dir(folder).status().with_context(|| format!("cannot start {program}"))?;
    Ok(status.success())
}

fn environment() -> PathBuf {
    target_folder().join("python")
}

fn in_environment(program: &str) -> PathBuf {
    let folder = if cfg!(windows) { "Scripts" } else { "bin" };
    environment().join(folder).join(program).with_extension(std::env::consts::EXE_EXTENSION)
}

/// A Python that is new enough: the one that the variable PYTHON names, else the first on the path.
pub(crate) fn system_python() -> Result<PathBuf> {
    let named = std::env::var_os("PYTHON").map(PathBuf::from);
    let candidates = named.map_or_else(|| vec!["python3".into(), "python".into()], |python| vec![python]);
    let mut found = Vec::new();
    for python in candidates {
        match version(&python) {
            Some(version) if version >= LEAST => return Ok(python),
            Some((major, minor)) => found.push(format!("{} {major}.{minor}", python.display())),
            None => {}
        }
    }
    let found = if found.is_empty() { "none".to_owned() } else { found.join(", ") };
    bail!("Python: found {found}, expected {}.{} or newer on the path or in PYTHON", LEAST.0, LEAST.1)
}

fn version(python: &Path) -> Option<(u32, u32)> {
    let script = "import sys; print(*sys.version_info[:2])";
    let answer = Command::new(python).args(["-c", script]).output().ok()?;
    let text = String::from_utf8(answer.stdout).ok()?;
    let (major, minor) = text.trim().split_once(' ')?;
    Some((major.parse().ok()?, minor.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_python_has_no_version() {
        assert_eq!(version(Path::new("/nonexistent/python")), None);
        assert_eq!(version(Path::new("echo")), None);
    }

    #[test]
    fn the_least_version_is_the_packages() {
        let project = std::fs::read_to_string(workspace().join("pyproject.toml")).unwrap();
        assert!(project.contains(&format!("requires-python = \">={}.{}\"", LEAST.0, LEAST.1)));
    }
}
