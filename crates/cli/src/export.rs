//! `cargo xtask export`: a policy for other software.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Args, ValueEnum};
use jostle_export::onnx;

use jostle_runs::output;
use jostle_runs::policies;
use jostle_runs::run_folder::write_bytes_atomically;

/// Arguments of `export`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask export checkpoints/m5-seed1-005000.safetensors\n  \
    cargo xtask export runs/ours --token 3 --out ours.onnx\n\n\
    docs/how-to-onnx.md says what goes in and what comes out.")]
pub struct ExportArgs {
    /// Checkpoint or policy file, or a run folder for its newest checkpoint.
    policy: PathBuf,
    /// The format.
    #[arg(long, value_enum, default_value_t = Format::Onnx)]
    format: Format,
    /// Behaviour token that is baked in (default: the model has an input for it).
    #[arg(long, value_name = "Z")]
    token: Option<u32>,
    /// The file that is written (default: the policy's name with the format's ending, in the
    /// working folder).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// The network as an ONNX model.
    Onnx,
}

/// Writes the model.
pub(crate) fn run(args: &ExportArgs) -> Result<ExitCode> {
    let policy = policies::load(&args.policy)?.file;
    let Format::Onnx = args.format;
    let bytes = onnx::model(&policy, args.token).with_context(|| args.policy.display().to_string())?;
    let out = args.out.clone().unwrap_or_else(|| {
        let stem = args.policy.file_stem().unwrap_or(args.policy.as_os_str());
        Path::new(stem).with_extension("onnx")
    });
    write_bytes_atomically(&out, &bytes)?;
    if policy.network.motion.is_some() {
        let inputs = "this policy reads motions: the model takes encoded rows (its input `inputs`)";
        output::note(&format!("{inputs}; docs/how-to-onnx.md says where they come from"));
    }
    output::result(&format!("{}\n", out.display()))?;
    Ok(ExitCode::SUCCESS)
}
