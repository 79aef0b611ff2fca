//! Virtual environments below `target/`, for commands that need Python's packages.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

use crate::provenance::workspace;
use crate::tools::target_folder;

/// Least version of Python, as in `pyproject.toml`.
const LEAST: (u32, u32) = (3, 11);

/// pip, which says nothing unless something is wrong.
pub const PIP: [&str; 5] = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];

/// Runs a program in a folder; whether it succeeded.
///
/// # Errors
/// A program that cannot be started.
pub fn run_in(folder: &Path, command: &mut Command) -> Result<bool> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command.current_dir(folder).status().with_context(|| format!("cannot start {program}"))?;
    Ok(status.success())
}

/// A virtual environment below `target/` by its name, made where there is none.
///
/// # Errors
/// No Python that is new enough; a Python that cannot make an environment.
pub fn environment(name: &str) -> Result<PathBuf> {
    let folder = std::path::absolute(target_folder().join(name))?;
    if !in_environment(&folder, "python").exists() {
        let mut command = Command::new(system_python()?);
        let made = run_in(workspace(), command.args(["-m", "venv"]).arg(&folder))?;
        ensure!(made, "{}: Python cannot make an environment", folder.display());
    }
    Ok(folder)
}

/// Installs packages into an environment; whether pip could.
///
/// # Errors
/// An environment whose Python cannot be started.
pub fn pip(environment: &Path, packages: &[&str]) -> Result<bool> {
    run_in(workspace(), Command::new(in_environment(environment, "python")).args(PIP).args(packages))
}

/// A program of an environment.
pub fn in_environment(environment: &Path, program: &str) -> PathBuf {
    let folder = if cfg!(windows) { "Scripts" } else { "bin" };
    environment.join(folder).join(program).with_extension(std::env::consts::EXE_EXTENSION)
}

/// A Python that is new enough: the one that the variable PYTHON names, else the first on the path.
///
/// # Errors
/// None that is, with what was found.
pub fn system_python() -> Result<PathBuf> {
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
