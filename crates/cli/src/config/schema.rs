//! The configuration as a JSON Schema (draft 2020-12), from its comments, its checks and its defaults.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use serde_json::{Map, Value, json};

use super::range::{accepted, bounds, words};
use super::with_all_sections;
use jostle_runs::keys::{Key, keys, unstored_defaults};

/// The paper's letters for three keys, which a file may use.
const ALIASES: [(&str, &str); 3] = [("N", "n_agents"), ("M", "n_behaviours"), ("R", "n_rooms")];

/// The schema of a configuration file. `unit` and `origin` are our own words: no validator needs them.
///
/// # Errors
/// Defaults that are no JSON.
pub(super) fn schema() -> Result<Value> {
    let keys = keys();
    let defaults = serde_json::to_value(with_all_sections()?).context("defaults that are no JSON")?;
    let unstored = BTreeMap::from_iter(unstored_defaults());
    let mut root = section("A training run of jostle.");
    root["$schema"] = "https://json-schema.org/draft/2020-12/schema".into();
    root["title"] = "jostle training configuration".into();
    for key in &keys {
        let pointer = format!("/{}", key.path.replace('.', "/"));
        let named = unstored.get(&key.path).and_then(|text| serde_json::from_str(text).ok());
        let default = defaults.pointer(&pointer).or(named.as_ref());
        let entry = if key.section { section(&key.text) } else { leaf(&keys, key, default) };
        *place(&mut root, &key.path) = entry;
    }
    for (alias, name) in ALIASES {
        let mut entry = place(&mut root, name).clone();
        entry["description"] = format!("The paper's letter for {name}.").into();
        *place(&mut root, alias) = entry;
    }
    Ok(root)
}

/// A section that takes no keys but its own.
fn section(text: &str) -> Value {
    json!({ "type": "object", "description": text, "additionalProperties": false, "properties": {} })
}

/// Where a key stands in the schema.
fn place<'s>(root: &'s mut Value, path: &str) -> &'s mut Value {
    path.split('.').fold(root, |section, name| &mut section["properties"][name])
}

fn leaf(keys: &[Key], key: &Key, default: Option<&Value>) -> Value {
    let words_of = accepted(keys, key);
    let mut entry = Map::new();
    entry.insert("description".to_owned(), key.text.clone().into());
    let kind = match key.kind.as_str() {
        "u64" | "usize" | "u32" => "integer",
        "f64" | "f32" => "number",
        "bool" => "boolean",
        "Vec<PathBuf>" => "array",
        _ => "string",
    };
    entry.insert("type".to_owned(), kind.into());
    if kind == "array" {
        entry.insert("items".to_owned(), json!({ "type": "string" }));
    }
    if kind == "integer" {
        entry.insert("minimum".to_owned(), 0.into());
    }
    if let Some(text) = words_of.filter(|_| kind == "integer" || kind == "number") {
        let bounds = bounds(&text);
        if let Some(least) = bounds.least {
            entry.remove("minimum");
            let word = if bounds.above { "exclusiveMinimum" } else { "minimum" };
            entry.insert(word.to_owned(), number(kind, least));
        }
        entry.extend(bounds.most.map(|most| ("maximum".to_owned(), number(kind, most))));
    } else if let Some(text) = accepted(keys, key) {
        entry.insert("enum".to_owned(), words(&text).into());
    }
    entry.extend(
        default
            .filter(|default| !default.is_null())
            .map(|default| ("default".to_owned(), decimal(key, default))),
    );
    entry.extend(key.unit().map(|unit| ("unit".to_owned(), unit.into())));
    entry.extend(key.origin().map(|origin| ("origin".to_owned(), origin.into())));
    Value::Object(entry)
}

fn number(kind: &str, value: f64) -> Value {
    // 2⁶³ − 1 is no f64; the nearest one below it is as good for a schema.
    if kind == "integer" { (value.min(9_007_199_254_740_991.0) as i64).into() } else { value.into() }
}

/// A number of single precision in its own digits: 0.1, not the nearest f64 to it.
fn decimal(key: &Key, value: &Value) -> Value {
    match (key.kind.as_str(), value.as_f64()) {
        ("f32", Some(number)) => {
            (number as f32).to_string().parse::<f64>().map_or_else(|_| value.clone(), Value::from)
        }
        _ => value.clone(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::schema;
    use jostle_runs::provenance::workspace;

    /// What of a value does not fit a schema of the kind that is made here.
    fn misfits(schema: &Value, value: &Value, path: &str, found: &mut Vec<String>) {
        let mut miss = |what: &str| found.push(format!("{path}: {value} {what}"));
        match schema["type"].as_str().unwrap() {
            "object" => {
                for (name, inner) in value.as_object().unwrap() {
                    match schema["properties"].get(name) {
                        Some(known) => misfits(known, inner, &format!("{path}.{name}"), found),
                        None => found.push(format!("{path}.{name} is unknown")),
                    }
                }
                return;
            }
            "integer" if !value.is_u64() => miss("is no integer"),
            "number" if !value.is_number() => miss("is no number"),
            "boolean" if !value.is_boolean() => miss("is no truth value"),
            "string" if !value.is_string() => miss("is no text"),
            _ => {}
        }
        let bound = |name: &str| schema.get(name).and_then(Value::as_f64);
        if let Some(number) = value.as_f64() {
            let low = bound("minimum").is_some_and(|least| number < least);
            if low || bound("exclusiveMinimum").is_some_and(|least| number <= least) {
                miss("is too small");
            }
            if bound("maximum").is_some_and(|most| number > most) {
                miss("is too large");
            }
        }
        if schema.get("enum").is_some_and(|words| !words.as_array().unwrap().contains(value)) {
            miss("is none of the words");
        }
    }

    fn check(text: &str) -> Vec<String> {
        let value: Value = toml::from_str(text).unwrap();
        let mut found = Vec::new();
        misfits(&schema().unwrap(), &value, "", &mut found);
        found
    }

    #[test]
    fn the_shipped_configurations_fit() {
        let folder = std::fs::read_dir(workspace().join("configs")).unwrap();
        let mut n_files = 0;
        for path in folder
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        {
            assert_eq!(check(&std::fs::read_to_string(&path).unwrap()), [""; 0], "{}", path.display());
            n_files += 1;
        }
        assert!(n_files >= 4);
    }

    #[test]
    fn what_the_checks_refuse_does_not_fit() {
        for slip in [
            "gamma = 1.1",
            "n_agents = 0",
            "seed = -1",
            "backend = \"slow\"",
            "alfa = 1",
            "alpha = \"x\"",
            "[sim.laser]\nbeams = 9000",
            "[sim.laser]\nfov = 6.3",
            "[sim.laser]\nangle_min = -7",
            "[sim.robot]\nv_max = 0.0",
            "[sim.robot.acceleration]\nv = -1.0\nw = 1.0",
            "[discriminator]\nnoise = \"loud\"",
            "[network]\nhidden = 0",
            "[sim.episode]\nstep_limit = 0",
        ] {
            let none: &[&str] = &[];
            assert!(jostle_ppo::Config::parse(slip, "a", none).is_err(), "{slip}");
            assert!(!check(slip).is_empty(), "{slip} fits");
        }
        assert_eq!(check("N = 5\nM = 1\n[sim.robot.acceleration]\nv = 1.0\nw = 1.0"), [""; 0]);
    }

    #[test]
    fn a_key_says_what_it_is() {
        let schema = schema().unwrap();
        let noise = &schema["properties"]["sim"]["properties"]["laser"]["properties"]["noise_std"];
        assert_eq!((&noise["default"], &noise["unit"]), (&0.02.into(), &"m".into()));
        assert_eq!((&noise["minimum"], &noise["maximum"]), (&0.0.into(), &100.0.into()));
        assert_eq!(schema["properties"]["gamma"]["origin"], "paper");
        // Left out of what is stored while it has its default.
        let fov = &schema["properties"]["sim"]["properties"]["laser"]["properties"]["fov"];
        let circle = 6.283_185_5;
        assert_eq!(
            (&fov["default"], &fov["unit"], &fov["maximum"]),
            (&circle.into(), &"rad".into(), &circle.into())
        );
    }
}
