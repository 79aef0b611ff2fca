//! `cargo xtask config`: every key of a configuration with its meaning, its range and where its default comes from.
//!
//! The explanations are the doc comments of the configuration's own types, taken from their source files when this
//! program is built: there is no second text that could go stale.

use std::collections::BTreeMap;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use jostle_ppo::Config;

use crate::compare::settings;
use crate::output;

/// The files that define the configuration's types.
const SOURCES: [&str; 3] = [
    include_str!("../../crates/ppo/src/config.rs"),
    include_str!("../../crates/sim/src/config.rs"),
    include_str!("../../crates/diversity/src/config.rs"),
];
/// The type of the whole configuration.
const ROOT: &str = "Config";

/// Arguments of `config`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask config explain alpha\n  cargo xtask config explain sim.laser\n  \
    cargo xtask config explain"
)]
pub(crate) struct ConfigArgs {
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
}

/// Prints the explanations.
pub(crate) fn run(args: &ConfigArgs) -> Result<ExitCode> {
    let Action::Explain { key } = &args.action;
    output::result(&explain(key.as_deref().unwrap_or(""))?)?;
    Ok(ExitCode::SUCCESS)
}

/// A key with its explanation.
struct Entry {
    key: String,
    text: String,
    section: bool,
}

/// The explanation of a key, or of all keys of a section.
fn explain(wanted: &str) -> Result<String> {
    let types = types();
    let mut entries = Vec::new();
    list(&types, ROOT, "", &mut entries);
    let defaults = settings(&Config::default())?;
    let within = |entry: &&Entry| {
        wanted.is_empty() || entry.key == wanted || entry.key.starts_with(&format!("{wanted}."))
    };
    let chosen: Vec<&Entry> = entries.iter().filter(within).collect();
    if chosen.is_empty() {
        bail!("{wanted}: no such key{}", nearest(wanted, &entries));
    }
    let line = |entry: &&Entry| {
        if entry.section {
            return format!("[{}] {}\n", entry.key, entry.text);
        }
        let default = defaults.get(&entry.key).map_or("(off)", String::as_str);
        format!("{} = {default}\n    {}\n", entry.key, entry.text)
    };
    Ok(chosen.iter().map(line).collect())
}

/// A suggestion: the key that shares the last part, or the longest start.
fn nearest(wanted: &str, entries: &[Entry]) -> String {
    let last = |key: &str| key.rsplit('.').next().unwrap_or(key).to_owned();
    let shared = |key: &str| key.chars().zip(wanted.chars()).take_while(|(a, b)| a == b).count();
    let same = entries.iter().find(|entry| last(&entry.key) == last(wanted));
    let best = same.or_else(|| entries.iter().max_by_key(|entry| shared(&entry.key)));
    best.map(|entry| format!("; did you mean {}?", entry.key)).unwrap_or_default()
}

/// Fields of a type in their order: name, type's name, explanation.
type Fields = Vec<(String, String, String)>;

/// The structs of the sources by name.
fn types() -> BTreeMap<String, Fields> {
    let mut types = BTreeMap::new();
    for source in SOURCES {
        let mut lines = source.lines();
        while let Some(line) = lines.next() {
            let name = line.strip_prefix("pub struct ").and_then(|rest| rest.strip_suffix(" {"));
            if let Some(name) = name {
                types.insert(name.to_owned(), fields(&mut lines));
            }
        }
    }
    types
}

fn fields<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Fields {
    let mut fields = Vec::new();
    let mut text: Vec<&str> = Vec::new();
    for line in lines.by_ref().map(str::trim).take_while(|line| *line != "}") {
        if let Some(doc) = line.strip_prefix("///") {
            text.push(doc.trim());
        } else if let Some((name, kind)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(": ")) {
            let kind = kind.trim_end_matches(',');
            let kind = kind.strip_prefix("Option<").and_then(|rest| rest.strip_suffix('>')).unwrap_or(kind);
            fields.push((name.to_owned(), kind.to_owned(), text.join(" ")));
            text.clear();
        }
    }
    fields
}

/// Lists a type's keys, each section before its own.
fn list(types: &BTreeMap<String, Fields>, kind: &str, prefix: &str, entries: &mut Vec<Entry>) {
    for (name, kind, text) in types.get(kind).into_iter().flatten() {
        let key = format!("{prefix}{name}");
        let section = types.contains_key(kind);
        entries.push(Entry { key: key.clone(), text: text.clone(), section });
        if section {
            list(types, kind, &format!("{key}."), entries);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{ROOT, explain, list, types};
    use crate::compare::settings;

    #[test]
    fn every_key_of_the_default_configuration_is_explained() {
        let mut entries = Vec::new();
        list(&types(), ROOT, "", &mut entries);
        for key in settings(&jostle_ppo::Config::default()).unwrap().keys() {
            let entry = entries.iter().find(|entry| entry.key == *key);
            assert!(entry.is_some_and(|entry| !entry.text.is_empty()), "{key} has no explanation");
        }
    }

    #[test]
    fn a_key_a_section_and_a_slip() {
        assert!(explain("alpha").unwrap().starts_with("alpha = 0.1\n    Weight"));
        assert!(explain("sim.laser").unwrap().contains("sim.laser.beams = 512"));
        let message = explain("laser.noise_std").unwrap_err().to_string();
        assert!(message.contains("did you mean sim.laser.noise_std?"), "{message}");
    }
}
