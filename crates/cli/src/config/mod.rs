//! `cargo xtask config`: every key of a configuration with its meaning, its range and where its
//! default comes from.
//!
//! The explanations are the doc comments of the configuration's own types, by way of their JSON
//! Schema, and what a key accepts is what the configuration's own checks answer. Reading order:
//! this file (what is asked for), [`jostle_runs::keys`] (the schema), [`range`] (the checks, and
//! the test that the schema's bounds are theirs), [`schema`] (what is printed).

mod range;
mod schema;

use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use jostle_policy::did_you_mean;

use jostle_runs::keys::{Key, defaults, keys};
use jostle_runs::output;

/// Arguments of `config`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask config explain alpha\n  cargo xtask config explain sim.laser\n  \
    cargo xtask config explain\n  cargo xtask config schema > jostle.schema.json"
)]
pub struct ConfigArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Explain one key, or all keys of a section.
    Explain {
        /// Key or section, such as `alpha` or `sim.laser.noise_std`; all keys when left out.
        key: Option<String>,
    },
    /// Print a JSON Schema of the configuration, for editors and other programs.
    Schema,
}

/// Prints what is asked for.
pub(crate) fn run(args: &ConfigArgs) -> Result<ExitCode> {
    let text = match &args.action {
        Action::Explain { key } => explain(key.as_deref().unwrap_or(""))?,
        Action::Schema => serde_json::to_string_pretty(&schema::schema()?)? + "\n",
    };
    output::result(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The explanation of a key, or of all keys of a section.
fn explain(wanted: &str) -> Result<String> {
    let (keys, defaults) = (keys()?, defaults()?);
    let within =
        |key: &&Key| wanted.is_empty() || key.path == wanted || key.path.starts_with(&format!("{wanted}."));
    let chosen: Vec<&Key> = keys.iter().filter(within).collect();
    if chosen.is_empty() {
        let known = did_you_mean(wanted, keys.iter().map(|key| key.path.as_str()));
        bail!("{wanted}: no such key{known}");
    }
    let line = |key: &&Key| {
        if key.is_section() {
            return format!("[{}] {}\n", key.path, key.text());
        }
        let default = defaults.get(&key.path).map_or("(off)", String::as_str);
        let accepted =
            range::accepted(&keys, key).map_or_else(String::new, |text| format!("    Accepted: {text}.\n"));
        format!("{} = {default}\n    {}\n{accepted}", key.path, key.text())
    };
    Ok(chosen.iter().map(line).collect())
}

#[cfg(test)]
mod tests {
    use super::{explain, keys};

    #[test]
    fn every_key_is_explained() {
        for key in keys().unwrap() {
            assert!(!key.text().is_empty(), "{} has no explanation", key.path);
        }
    }

    #[test]
    fn a_key_a_section_and_a_slip() {
        let alpha = explain("alpha").unwrap();
        assert!(
            alpha.starts_with("alpha = 0.1\n    Weight") && alpha.contains("Accepted: a finite number ≥ 0.")
        );
        assert!(explain("sim.laser").unwrap().contains("sim.laser.beams = 512"));
        let fov = explain("sim.laser.fov").unwrap();
        assert!(fov.starts_with("sim.laser.fov = 6.2831855\n"), "{fov}");
        assert!(fov.contains("Accepted: radians in (0, 6.2831855]."), "{fov}");
        let message = explain("laser.noise_std").unwrap_err().to_string();
        assert!(message.contains("no such key; did you mean sim.laser.noise_std?"), "{message}");
    }
}
