//! `cargo xtask wheel`: the Python package as one file that `pip install` takes on any Linux of the
//! last years.
//!
//! maturin builds it; on Linux zig links it against the C library of `manylinux_2_28` (glibc 2.28:
//! Debian 10, Ubuntu 18.10, RHEL 8), whatever the machine has. pip brings both into
//! `target/python`. The wheel is for every Python from 3.11 on (the stable ABI).

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context as _, Result, ensure};
use clap::Args;

use jostle_runs::folder::sorted;
use jostle_runs::output;
use jostle_runs::provenance::workspace;
use jostle_runs::python::{environment, in_environment, pip, run_in};
use jostle_runs::tools::target_folder;

/// The C library that the wheel asks for, at most.
const MANYLINUX: &str = "manylinux_2_28";
/// The packages that build and examine a wheel.
const BUILDERS: [&str; 3] = ["maturin[zig]>=1.9,<2", "ziglang", "auditwheel>=6"];

/// Arguments of `wheel`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask wheel && pip install target/wheels/jostle-*.whl")]
pub(crate) struct WheelArgs {
    /// Folder for the wheel (default: target/wheels). Wheels that are in it are left alone.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Builds the wheel and prints its path.
pub(crate) fn run(args: &WheelArgs) -> Result<ExitCode> {
    let wheel = build(&args.out.clone().unwrap_or_else(default_folder))?;
    output::result(&format!("{}\n", wheel.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// The default folder of wheels.
pub(crate) fn default_folder() -> PathBuf {
    target_folder().join("wheels")
}

/// Builds the wheel into a folder; its path.
///
/// # Errors
/// When a tool cannot be installed, when it does not build, and when it asks for more than its name
/// says.
pub(crate) fn build(out: &Path) -> Result<PathBuf> {
    let python = environment("python")?;
    ensure!(pip(&python, &BUILDERS)?, "pip cannot install {}", BUILDERS.join(", "));
    // An empty folder tells which file maturin made.
    let fresh = target_folder().join("wheel.tmp");
    if fresh.exists() {
        std::fs::remove_dir_all(&fresh).with_context(|| format!("cannot remove {}", fresh.display()))?;
    }
    let mut command = Command::new(in_environment(&python, "python"));
    command.args(["-m", "maturin", "build", "--release", "--quiet", "--out"]).arg(&fresh);
    if cfg!(target_os = "linux") {
        command.args(["--zig", "--compatibility", MANYLINUX]);
        // maturin looks for zig as a module of the first Python of the path.
        let folders = in_environment(&python, "python").parent().map(Path::to_path_buf).into_iter();
        let path = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::join_paths(folders.chain(std::env::split_paths(&path)));
        command.env("PATH", path.context("PATH: found a folder that cannot be in it")?);
    }
    ensure!(run_in(workspace(), &mut command)?, "maturin cannot build the wheel");
    let built = wheels(&fresh)?;
    ensure!(built.len() == 1, "maturin: found {} wheels, expected one", built.len());
    if cfg!(target_os = "linux") {
        examine(&python, &built[0])?;
    }
    std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let wheel = out.join(built[0].file_name().context("a wheel without a name")?);
    std::fs::rename(&built[0], &wheel).with_context(|| format!("cannot write {}", wheel.display()))?;
    Ok(wheel)
}

/// The wheels of a folder.
fn wheels(folder: &Path) -> Result<Vec<PathBuf>> {
    Ok(sorted(folder)?.into_iter().filter(|path| path.extension().is_some_and(|end| end == "whl")).collect())
}

/// Asks auditwheel, which reads the binary itself, what the wheel needs; its name is no witness.
fn examine(python: &Path, wheel: &Path) -> Result<()> {
    let shown = Command::new(in_environment(python, "python"))
        .args(["-m", "auditwheel", "show"])
        .arg(wheel)
        .output()
        .context("cannot start auditwheel")?;
    let text = String::from_utf8_lossy(&shown.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
    let found = platform(&text).with_context(|| format!("auditwheel: found no platform in: {text}"))?;
    let named = wheel.file_name().is_some_and(|name| {
        let name = name.to_string_lossy();
        name.contains("-abi3-") && name.contains(MANYLINUX)
    });
    ensure!(named, "{}: expected abi3 and {MANYLINUX} in its name", wheel.display());
    ensure!(
        glibc(found).is_some_and(|found| Some(found) <= glibc(MANYLINUX)),
        "{}: found {found}, expected {MANYLINUX} or older",
        wheel.display()
    );
    output::note(&format!("wheel: auditwheel: consistent with {found}"));
    Ok(())
}

/// The platform that auditwheel finds a wheel consistent with.
fn platform(text: &str) -> Option<&str> {
    let (_, rest) = text.split_once("is consistent with the following platform tag: \"")?;
    Some(rest.split_once('"')?.0)
}

/// The version of glibc in a platform such as `manylinux_2_28_x86_64`.
fn glibc(platform: &str) -> Option<(u32, u32)> {
    let mut words = platform.strip_prefix("manylinux_")?.split('_');
    Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_auditwheel_says_is_read() {
        let text =
            "jostle.whl is consistent with the following platform tag: \"manylinux_2_17_x86_64\". The wheel";
        assert_eq!(platform(text), Some("manylinux_2_17_x86_64"));
        assert_eq!(platform("jostle.whl is consistent with nothing"), None);
        assert!(glibc("manylinux_2_17_x86_64") < glibc(MANYLINUX));
        assert!(glibc("manylinux_2_34_x86_64") > glibc(MANYLINUX));
        assert_eq!(glibc("linux_x86_64"), None);
    }
}
