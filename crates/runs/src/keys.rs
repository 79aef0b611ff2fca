//! The keys of a training configuration: its JSON Schema, made from its types, and a
//! configuration's settings key by key.
//!
//! The schema is what the types in `ppo`, `sim` and `diversity` say of themselves: comments,
//! defaults, units, bounds. A test of the command `config` holds the bounds to what the
//! configuration's own checks accept.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use jostle_ppo::Config;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};

/// A key and what its schema says of it.
#[derive(Clone, Debug)]
pub struct Key {
    /// Dotted, such as `sim.laser.beams`.
    pub path: String,
    /// Its part of the [`schema`].
    pub schema: Value,
    /// True if it may be left out without a default taking its place.
    pub optional: bool,
}

impl Key {
    /// The comment.
    pub fn text(&self) -> &str {
        self.schema["description"].as_str().unwrap_or_default()
    }

    /// True if it holds other keys.
    pub fn is_section(&self) -> bool {
        self.schema["type"] == "object"
    }

    /// True if it is a key of this section, or of one within.
    pub fn is_in(&self, section: &Self) -> bool {
        self.path.strip_prefix(&section.path).is_some_and(|rest| rest.starts_with('.'))
    }
}

/// The JSON Schema of a configuration (draft 2020-12): every key with its comment, its bounds, its
/// default. `unit` and `origin` are our own words: no validator needs them.
///
/// # Errors
/// Types that give no schema of the form that is described here: a mistake in their attributes.
pub fn schema() -> Result<Value> {
    simplified(generated(SchemaSettings::draft2020_12()))
}

fn simplified(mut raw: Value) -> Result<Value> {
    simplify(&mut raw).context("the configuration's schema")?;
    Ok(raw)
}

fn generated(mut settings: SchemaSettings) -> Value {
    settings.inline_subschemas = true;
    settings.into_generator().into_root_schema_for::<Config>().to_value()
}

/// All keys: those that are always stored in the order of their types, then the others by name;
/// each section before its own.
///
/// # Errors
/// As [`schema`].
pub fn keys() -> Result<Vec<Key>> {
    let raw = generated(SchemaSettings::draft2020_12());
    let stored = generated(SchemaSettings::draft2020_12().for_serialize());
    let mut keys = Vec::new();
    list(&simplified(raw.clone())?, &raw, &stored, "", &mut keys);
    Ok(keys)
}

fn list(schema: &Value, raw: &Value, stored: &Value, prefix: &str, keys: &mut Vec<Key>) {
    let Some(properties) = schema["properties"].as_object() else { return };
    let always = stored["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let mut names: Vec<&str> = always.filter(|name| properties.contains_key(*name)).collect();
    let others = properties.keys().map(String::as_str).filter(|name| !names.contains(name));
    names.extend(others.collect::<Vec<_>>());
    for name in names {
        let (raw, stored) = (&raw["properties"][name], &stored["properties"][name]);
        let (path, schema) = (format!("{prefix}{name}"), properties[name].clone());
        let inner = format!("{path}.");
        keys.push(Key { path, schema: schema.clone(), optional: without_null(raw).is_some() });
        list(&schema, without_null(raw).unwrap_or(raw), without_null(stored).unwrap_or(stored), &inner, keys);
    }
}

/// The part of a schema beside null, if it accepts null: an option is left out of a file, for TOML
/// has no null.
fn without_null(schema: &Value) -> Option<&Value> {
    let is_null = |schema: &Value| schema["type"] == "null";
    if let Some(choices) = schema["anyOf"].as_array() {
        let others: Vec<&Value> = choices.iter().filter(|choice| !is_null(choice)).collect();
        return (others.len() == 1 && choices.len() == 2).then(|| others[0]);
    }
    schema["type"].as_array().is_some_and(|types| types.iter().any(|kind| kind == "null")).then_some(schema)
}

/// Makes a generated schema what a reader of configurations wants: no null, a choice of documented
/// words as `enum`, numbers in the digits of their own precision, comments on one line, no defaults
/// of whole sections.
fn simplify(schema: &mut Value) -> Result<()> {
    if let Some(inner) = without_null(schema) {
        let mut inner = inner.clone();
        if let (Some(entry), Some(outer)) = (inner.as_object_mut(), schema.as_object()) {
            // The comment at the key says more than that at its type.
            entry.extend(
                outer
                    .iter()
                    .filter(|(name, _)| *name != "anyOf" && *name != "type")
                    .map(|(k, v)| (k.clone(), v.clone())),
            );
        }
        *schema = inner;
    }
    let entry = schema.as_object_mut().context("found no object where a key is described")?;
    if let Some(kinds) = entry.get("type").and_then(Value::as_array) {
        let kind = kinds.iter().find(|kind| *kind != "null").cloned().unwrap_or_default();
        entry.insert("type".to_owned(), kind);
    }
    if let Some(Value::Array(choices)) = entry.remove("oneOf") {
        let words = choices.iter().map(|choice| choice["const"].clone()).collect();
        entry.insert("enum".to_owned(), Value::Array(words));
        entry.insert("type".to_owned(), "string".into());
    }
    if let Some(Value::String(text)) = entry.get_mut("description") {
        *text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    }
    let format = entry.remove("format");
    if format.as_ref().is_some_and(|format| format == "float") {
        in_own_digits(entry);
    }
    if entry.get("default").is_some_and(|default| default.is_null() || default.is_object()) {
        entry.remove("default");
    }
    if let Some(properties) = entry.get_mut("properties").and_then(Value::as_object_mut) {
        for (name, property) in properties {
            simplify(property).with_context(|| name.clone())?;
        }
    }
    Ok(())
}

/// Numbers of single precision in their own digits: 0.1, not the nearest f64 to it.
fn in_own_digits(entry: &mut Map<String, Value>) {
    for name in ["default", "minimum", "exclusiveMinimum", "maximum"] {
        if let Some(number) = entry.get(name).and_then(Value::as_f64) {
            let digits = (number as f32).to_string().parse::<f64>().map_or(Value::Null, Value::from);
            entry.insert(name.to_owned(), digits);
        }
    }
}

/// The default of every key that has one, as TOML, by its dotted key. Keys of a section that is off
/// are not among them.
///
/// # Errors
/// As [`schema`].
pub fn defaults() -> Result<BTreeMap<String, String>> {
    let keys = keys()?;
    let is_off = |key: &Key| keys.iter().any(|s| s.is_section() && s.optional && key.is_in(s));
    let of = |key: &Key| {
        let default = toml::Value::try_from(key.schema.get("default")?).ok()?;
        Some((key.path.clone(), shown(&default)))
    };
    Ok(keys.iter().filter(|key| !is_off(key)).filter_map(of).collect())
}

/// Every setting by its dotted key, those that are not stored because they have their default among
/// them.
///
/// # Errors
/// As [`schema`].
pub fn settings(config: &Config) -> Result<BTreeMap<String, String>> {
    let table = toml::Table::try_from(config).context("a configuration that is no TOML")?;
    let mut all = defaults()?;
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

#[cfg(test)]
mod tests {
    use jostle_ppo::Config;

    use super::{defaults, keys, settings};

    /// The default of the schema, which `explain` and `compare` print, is the key's default.
    #[test]
    fn every_default_of_the_schema_is_the_default() {
        let defaults = defaults().unwrap();
        for (path, default) in &defaults {
            let set = [format!("{path}={default}")];
            let config = Config::parse("", "", &set).unwrap_or_else(|error| panic!("{path}: {error}"));
            assert_eq!(config, Config::default(), "{path} is not {default} by default");
        }
        assert_eq!(defaults["sim.laser.fov"], "6.2831855");
        assert_eq!(defaults["sim.laser.angle_min"], "0.0");
        assert_eq!(defaults["training_crowd.stall_limit"], "10");
        assert!(!defaults.contains_key("sim.reward.safety_zone.ego_radius"), "the section is off");
    }

    #[test]
    fn keys_that_have_a_default_are_all_but_sections_and_options() {
        let (keys, defaults) = (keys().unwrap(), defaults().unwrap());
        for key in &keys {
            let off = keys.iter().any(|section| section.optional && key.is_in(section));
            let without = key.is_section() || key.optional || off;
            assert_eq!(!without, defaults.contains_key(&key.path), "{}", key.path);
        }
    }

    #[test]
    fn options_are_optional() {
        let keys = keys().unwrap();
        let zone = keys.iter().find(|key| key.path == "sim.reward.safety_zone").unwrap();
        assert!(zone.optional && zone.is_section());
        let map = keys.iter().find(|key| key.path == "sim.room.map").unwrap();
        assert!(map.optional && map.schema["type"] == "string");
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
