//! `cargo xtask ci --python`: the Python package as a user gets it. The wheel is built, put into a
//! fresh virtual environment, and its types, tests and notebooks are checked from there, not from
//! the source tree.
//!
//! `target/python` holds the tools and what the tests need besides jostle; it is kept, since torch
//! is large. `target/python-wheel` is made anew each time, holds the wheel with what it asks for,
//! and finds the tests' other packages in the first. Torch is asked for where its builds without
//! CUDA are kept, and where the package index is pip's usual one if that cannot be reached: the
//! tests need the CPU only.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::wheel;
use jostle_runs::output;
use jostle_runs::provenance::workspace;
use jostle_runs::python::{PIP, environment, in_environment, pip, run_in};
use jostle_runs::tools::{cargo, target_folder};

/// Torch without CUDA, 200 MB instead of 3 GB.
const TORCH_INDEX: &str = "https://download.pytorch.org/whl/cpu";
/// The environment of tools and of what the tests need.
const TOOLS: &str = "python";
/// The environment with the wheel.
const FRESH: &str = "python-wheel";

/// A first use, with the wheel and the packages that it asks for only.
const FIRST_STEPS: &str = "import jostle; print(jostle.evaluate(jostle.planner('dwa'), 'VO', episodes=20))";

/// A step's work; true if it passed.
pub(crate) type Work = fn() -> Result<bool>;

/// The steps by their names.
pub(crate) const STEPS: [(&str, Work); 5] = [
    ("py-clippy", clippy),
    ("py-wheel", install),
    ("py-types", types),
    ("py-tests", test),
    ("py-books", notebooks),
];

/// The lints of what is compiled for Python alone; needs no Python.
fn clippy() -> Result<bool> {
    let arguments =
        ["clippy", "--release", "--package", "jostle-python", "--features", "extension", "--quiet"];
    run(Command::new(cargo()).args(arguments).args(["--", "-D", "warnings"]))
}

/// Builds the wheel and installs it into an environment that has nothing else.
fn install() -> Result<bool> {
    let tools = environment(TOOLS)?;
    let has_torch = Command::new(in_environment(&tools, "python"))
        .args(["-c", "import torch"])
        .output()?
        .status
        .success();
    if !has_torch
        && !pip(&tools, &["--retries", "0", "--timeout", "20", "--index-url", TORCH_INDEX, "torch"])?
    {
        output::note(&format!("ci: {TORCH_INDEX} gave no torch; pip's own index is asked, for more bytes"));
    }
    let wheel = wheel::build(&wheel::default_folder())?;
    let shown = wheel.to_str().context("a path that is no UTF-8")?;
    // What the wheel's extra `test` names. jostle comes along and is hidden by the one of the fresh
    // environment.
    if !pip(&tools, &["--force-reinstall", "--no-deps", shown])?
        || !pip(&tools, &[&format!("{shown}[test]")])?
    {
        return Ok(false);
    }
    let fresh = target_folder().join(FRESH);
    if fresh.exists() {
        std::fs::remove_dir_all(&fresh).with_context(|| format!("cannot remove {}", fresh.display()))?;
    }
    let (python, fresh) = (in_environment(&tools, "python"), std::path::absolute(fresh)?);
    let made = run(Command::new(&python).args(["-m", "venv", "--without-pip"]).arg(&fresh))?
        && run(Command::new(&python)
            .args(["-m", "pip", "--python"])
            .arg(&fresh)
            .args(&PIP[2..])
            .arg(&wheel))?
        && run(Command::new(in_environment(&fresh, "python")).args(["-P", "-c", FIRST_STEPS]))?;
    let link = packages(&fresh)?.join("tools.pth");
    std::fs::write(&link, format!("{}\n", packages(&tools)?.display()))
        .with_context(|| format!("cannot write {}", link.display()))?;
    Ok(made)
}

/// Annotations: mypy and pyright on the package, and the stub of the Rust side against the binary.
fn types() -> Result<bool> {
    let python = in_environment(&std::path::absolute(target_folder().join(FRESH))?, "python");
    let interpreter = python.to_str().context("a path that is no UTF-8")?;
    for arguments in [
        &["mypy", "python/jostle"][..],
        &["mypy.stubtest", "--ignore-disjoint-bases", "jostle._jostle"],
        &["pyright", "--pythonpath", interpreter],
    ] {
        if !run(Command::new(&python).args(["-P", "-m"]).args(arguments))? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The tests of `python/tests` on the wheel, with this program as the command line that they
/// compare with.
fn test() -> Result<bool> {
    pytest("python/tests")
}

/// The notebooks, run from top to bottom.
fn notebooks() -> Result<bool> {
    pytest("python/notebooks")
}

fn pytest(folder: &str) -> Result<bool> {
    let this = std::env::current_exe().context("cannot name this program")?;
    let fresh = std::path::absolute(target_folder().join(FRESH))?;
    // -P: nothing is imported from the working directory.
    let mut command = Command::new(in_environment(&fresh, "python"));
    command.args(["-P", "-m", "pytest", "--quiet", folder]);
    run(command.env("JOSTLE_XTASK", this).env("JOSTLE_INSTALLED", fresh))
}

fn run(command: &mut Command) -> Result<bool> {
    run_in(workspace(), command)
}

/// The folder in which an environment keeps its packages.
fn packages(environment: &Path) -> Result<PathBuf> {
    let script = "import sysconfig; print(sysconfig.get_path('purelib'))";
    let answer = Command::new(in_environment(environment, "python")).args(["-c", script]).output()?;
    ensure!(answer.status.success(), "{}: Python does not start", environment.display());
    Ok(PathBuf::from(String::from_utf8(answer.stdout)?.trim()))
}
