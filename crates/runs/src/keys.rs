//! The keys of a training configuration: their comments, read from the sources of its types, and a configuration's settings key by
//! key.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use jostle_ppo::Config;

/// The files that define the configuration's types.
const SOURCES: [&str; 5] = [
    include_str!("../../ppo/src/config.rs"),
    include_str!("../../ppo/src/population.rs"),
    include_str!("../../sim/src/config.rs"),
    include_str!("../../sim/src/traits.rs"),
    include_str!("../../diversity/src/config.rs"),
];
/// The type of the whole configuration.
const ROOT: &str = "Config";

/// A key with its comment.
#[derive(Clone, Debug)]
pub struct Key {
    /// Dotted, such as `sim.laser.beams`.
    pub path: String,
    /// The comment.
    pub text: String,
    /// The name of its type, without `Option`.
    pub kind: String,
    /// Whether it may be left out without a default taking its place.
    pub optional: bool,
    /// Whether it holds other keys.
    pub section: bool,
}

impl Key {
    /// The unit that the comment names behind a comma, such as `m` or `rad/s`.
    pub fn unit(&self) -> Option<&'static str> {
        const UNITS: [&str; 7] = ["m/s²", "rad/s²", "m/s", "rad/s", "rad", "m", "s"];
        let named = |unit: &str| {
            self.text.match_indices(&format!(", {unit}")).any(|(at, found)| {
                self.text[at + found.len()..].chars().next().is_none_or(|next| ".;,:".contains(next))
            })
        };
        UNITS.into_iter().find(|unit| named(unit))
    }

    /// The default that the comment names, as TOML.
    fn default(&self) -> Option<String> {
        let (_, rest) = self.text.split_once("Default ")?;
        let end = [" (", ". ", ", ", "; ", ": "].into_iter().filter_map(|end| rest.find(end)).min();
        let text = rest[..end.unwrap_or(rest.len())].trim_end_matches('.').trim_matches('`');
        Some(match self.kind.as_str() {
            "u64" | "usize" | "u32" | "bool" => text.to_owned(),
            "f64" => format!("{:?}", text.parse::<f64>().ok()?),
            "f32" => format!("{:?}", text.parse::<f32>().ok()?),
            _ => format!("{text:?}"),
        })
    }

    /// Where the default comes from: what stands in brackets behind it.
    pub fn origin(&self) -> Option<&str> {
        let (_, rest) = self.text.split_once("Default ")?;
        let (value, rest) = rest.split_once(" (")?;
        if value.contains(". ") {
            return None;
        }
        rest.split_once(')').map(|(origin, _)| origin)
    }
}

/// All keys in the order of the sources, each section before its own.
pub fn keys() -> Vec<Key> {
    let mut keys = Vec::new();
    list(&types(), ROOT, "", &mut keys);
    keys
}

/// Keys that are left out of what is stored while they have their default, each with that default, as the keys' comments
/// name it. Keys of a section that is off are not among them.
pub fn unstored_defaults() -> Vec<(String, String)> {
    let keys = keys();
    let is_off = |key: &Key| {
        keys.iter().any(|s| s.section && s.optional && key.path.starts_with(&format!("{}.", s.path)))
    };
    let always = |key: &&Key| !key.section && !key.optional && !is_off(key);
    let named = |key: &Key| Some((key.path.clone(), key.default()?));
    keys.iter().filter(always).filter_map(named).collect()
}

/// Every setting by its dotted key, those that are not stored because they have their default among them.
pub fn settings(config: &Config) -> Result<BTreeMap<String, String>> {
    let table = toml::Table::try_from(config).context("a configuration that is no TOML")?;
    let mut all = BTreeMap::from_iter(unstored_defaults());
    all.extend(flat(&table));
    Ok(all)
}

/// As [`settings`], of any table.
pub fn flat(table: &toml::Table) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    flatten("", table, &mut flat);
    flat
}

fn flatten(prefix: &str, table: &toml::Table, flat: &mut BTreeMap<String, String>) {
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => flatten(&format!("{prefix}{key}."), inner, flat),
            value => drop(flat.insert(format!("{prefix}{key}"), shown(value))),
        }
    }
}

/// A value as it was written: a number of single precision in its own digits.
fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(number) if f64::from(*number as f32) == *number => format!("{:?}", *number as f32),
        _ => value.to_string(),
    }
}

/// A field: its name, its type, its comment.
type Field = (String, String, String);

/// The structs of the sources by name.
fn types() -> BTreeMap<String, Vec<Field>> {
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

fn fields<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Vec<Field> {
    let mut fields = Vec::new();
    let mut text: Vec<&str> = Vec::new();
    for line in lines.by_ref().map(str::trim).take_while(|line| *line != "}") {
        if let Some(doc) = line.strip_prefix("///") {
            text.push(doc.trim());
        } else if let Some((name, kind)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(": ")) {
            fields.push((name.to_owned(), kind.trim_end_matches(',').to_owned(), text.join(" ")));
            text.clear();
        }
    }
    fields
}

fn list(types: &BTreeMap<String, Vec<Field>>, kind: &str, prefix: &str, keys: &mut Vec<Key>) {
    for (name, kind, text) in types.get(kind).into_iter().flatten() {
        let path = format!("{prefix}{name}");
        let inner = kind.strip_prefix("Option<").and_then(|rest| rest.strip_suffix('>'));
        let (optional, kind) = (inner.is_some(), inner.unwrap_or(kind).to_owned());
        let section = types.contains_key(&kind);
        keys.push(Key { path: path.clone(), text: text.clone(), kind: kind.clone(), optional, section });
        if section {
            list(types, &kind, &format!("{path}."), keys);
        }
    }
}

#[cfg(test)]
mod tests {
    use jostle_ppo::Config;

    use super::{keys, settings, unstored_defaults};

    /// What `explain` and `compare` say of a key that is not stored is what the key is.
    #[test]
    fn every_default_that_a_comment_names_is_the_default() {
        let defaults = unstored_defaults();
        for (path, default) in &defaults {
            let set = [format!("{path}={default}")];
            let config = Config::parse("", "", &set).unwrap_or_else(|error| panic!("{path}: {error}"));
            assert_eq!(config, Config::default(), "{path} is not {default} by default");
        }
        let named =
            |path: &str| defaults.iter().find(|(key, _)| key == path).map(|(_, default)| default.as_str());
        assert_eq!(named("sim.laser.fov"), Some("6.2831855"));
        assert_eq!(named("sim.laser.angle_min"), Some("0.0"));
    }

    #[test]
    fn units_and_origins_are_read_from_the_comments() {
        let keys = keys();
        let find = |path: &str| keys.iter().find(|key| key.path == path).unwrap();
        assert_eq!(find("sim.robot.w_max").unit(), Some("rad/s"));
        assert_eq!(find("sim.laser.noise_std").unit(), Some("m"));
        assert_eq!(find("gamma").unit(), None);
        assert_eq!(find("gamma").origin(), Some("paper"));
        assert_eq!(find("horizon").origin(), Some("lineage"));
        assert_eq!(find("add_log_m").origin(), None);
    }

    #[test]
    fn options_are_optional() {
        let keys = keys();
        let zone = keys.iter().find(|key| key.path == "sim.reward.safety_zone").unwrap();
        assert!(zone.optional && zone.section);
    }

    #[test]
    fn settings_are_flat_and_dotted() {
        let flat = settings(&Config::default()).unwrap();
        assert_eq!(flat["sim.laser.beams"], "512");
        assert_eq!((flat["gamma"].as_str(), flat["sim.laser.noise_std"].as_str()), ("0.99", "0.02"));
        // Not in the file that a run keeps, unless the laser sees a sector.
        assert_eq!(
            (flat["sim.laser.fov"].as_str(), flat["sim.laser.angle_min"].as_str()),
            ("6.2831855", "0.0")
        );
    }
}
