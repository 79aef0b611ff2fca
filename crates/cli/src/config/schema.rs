//! The JSON Schema that `config schema` prints: the types' own, with the paper's letters.

use anyhow::Result;
use jostle_runs::keys;
use serde_json::Value;

/// The paper's letters for three keys, which a file may use.
const ALIASES: [(&str, &str); 3] = [("N", "n_agents"), ("M", "n_behaviours"), ("R", "n_rooms")];

/// The schema of a configuration file.
///
/// # Errors
/// As [`keys::schema`].
pub(super) fn schema() -> Result<Value> {
    let mut root = keys::schema()?;
    root["title"] = "jostle training configuration".into();
    root["description"] = "A training run of jostle.".into();
    for (alias, name) in ALIASES {
        let mut entry = root["properties"][name].clone();
        entry["description"] = format!("The paper's letter for {name}.").into();
        root["properties"][alias] = entry;
    }
    Ok(root)
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::schema;
    use jostle_runs::provenance::workspace;

    /// The parts of a value that do not fit a schema of the kind that is made here.
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
