//! The values that a key accepts, asked of the configuration's own checks by handing them a value
//! that none of them takes.

use jostle_ppo::{Config, PpoError};
use jostle_runs::keys::Key;

/// In the checks' own words, such as `an integer from 1 to 1000`; `None` for what has no bounds.
pub(super) fn accepted(keys: &[Key], key: &Key) -> Option<String> {
    let probes: &[&str] = match key.schema["type"].as_str() {
        // What is too large for any bound that is not a type's own; or else only 0 is out of range.
        Some("integer") => &["4294967295", "0"],
        Some("number") => &["nan"],
        Some("string") if key.schema.get("enum").is_some() => &["no-such-word"],
        _ => &[],
    };
    probes.iter().find_map(|probe| expected(keys, key, probe))
}

/// The checks' answer to a value for a key, if they refuse it.
fn expected(keys: &[Key], key: &Key, value: &str) -> Option<String> {
    let mut overrides = Vec::new();
    // A section that is off is switched on with all its keys.
    if let Some(section) = keys.iter().find(|s| s.is_section() && s.optional && key.is_in(s)) {
        let name = |path: &str| path.rsplit('.').next().unwrap_or(path).to_owned();
        let inside = keys.iter().filter(|other| other.is_in(section));
        let table: Vec<String> = inside.map(|other| format!("{} = 1.0", name(&other.path))).collect();
        overrides.push(format!("{}={{ {} }}", section.path, table.join(", ")));
    }
    overrides.push(format!("{}={value}", key.path));
    match Config::parse("", "", &overrides) {
        Err(PpoError::Config { field, expected, .. }) if field == key.path => Some(expected),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use jostle_runs::keys::keys;
    use serde_json::Value;

    use super::expected;

    /// A bound as TOML.
    fn at(bound: &Value) -> String {
        bound.as_i64().map_or_else(|| format!("{:?}", bound.as_f64().unwrap()), |whole| whole.to_string())
    }

    /// A number a little beyond a bound, as TOML.
    fn beyond(bound: &Value, up: bool) -> String {
        let sign: i8 = if up { 1 } else { -1 };
        if let Some(whole) = bound.as_i64() {
            return (i128::from(whole) + i128::from(sign)).to_string();
        }
        let number = bound.as_f64().unwrap();
        format!("{:?}", number + f64::from(sign) * number.abs().max(1.0) * 1e-3)
    }

    /// The schema's bounds are those of the checks: at a bound a value is taken, beyond it it is
    /// refused.
    #[test]
    fn the_schemas_bounds_are_the_checks() {
        let keys = keys().unwrap();
        let mut n_bounds = 0;
        for key in &keys {
            let refused = |value: &str| expected(&keys, key, value);
            // Where another key decides, too, the checks name it.
            let names_another = |words: &String| {
                keys.iter().any(|other| words.contains(other.path.rsplit('.').next().unwrap_or_default()))
            };
            for (name, is_upper) in [("minimum", false), ("maximum", true), ("exclusiveMinimum", false)] {
                let Some(bound) = key.schema.get(name) else { continue };
                n_bounds += 1;
                let (inside, outside) = match name {
                    "exclusiveMinimum" => (beyond(bound, true), at(bound)),
                    _ => (at(bound), beyond(bound, is_upper)),
                };
                let answer = refused(&inside);
                assert!(
                    answer.as_ref().is_none_or(names_another),
                    "{} = {inside}: expected {answer:?}",
                    key.path
                );
                // An integer that is no i64 or below 0 is refused by TOML or by its type.
                let by_type = key.schema["type"] == "integer" && (outside == "-1" || outside.len() > 18);
                assert!(by_type || refused(&outside).is_some(), "{}: {name} {bound}", key.path);
            }
        }
        assert!(n_bounds > 90, "{n_bounds}");
    }

    /// Nothing that the checks bound is free in the schema.
    #[test]
    fn what_the_checks_bound_is_bound_in_the_schema() {
        let keys = keys().unwrap();
        for key in keys.iter().filter(|key| key.schema["type"] == "number") {
            let far = |value: &str| expected(&keys, key, value).is_some();
            let has = |name: &str| key.schema.get(name).is_some();
            assert_eq!(far("-1e30"), has("minimum") || has("exclusiveMinimum"), "{}", key.path);
        }
    }
}
