//! What a key accepts, asked of the configuration's own checks by handing them a value that none of them takes.

use jostle_ppo::{Config, PpoError};

use jostle_runs::keys::Key;

/// Bounds of a number, as far as the checks name any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Bounds {
    pub(super) least: Option<f64>,
    /// Whether the least itself is excluded.
    pub(super) above: bool,
    pub(super) most: Option<f64>,
}

/// In the checks' own words, such as `an integer from 1 to 1000`; `None` for what has no bounds.
pub(super) fn accepted(keys: &[Key], key: &Key) -> Option<String> {
    let probes: &[&str] = match key.kind.as_str() {
        // What is too large is out of range, or else only 0 is.
        "u64" | "usize" => &["9223372036854775807", "0"],
        "u32" => &["0"],
        "f64" | "f32" => &["nan"],
        "bool" | "PathBuf" | "String" | "Vec<PathBuf>" => &[],
        _ => &["no-such-word"],
    };
    probes.iter().find_map(|probe| expected(keys, key, probe))
}

/// What the checks say of a value for a key, if they refuse it.
fn expected(keys: &[Key], key: &Key, value: &str) -> Option<String> {
    let mut overrides = Vec::new();
    // A section that is off is switched on with all its keys.
    if let Some(section) = keys.iter().find(|s| s.section && s.optional && is_in(key, s)) {
        let inside = keys.iter().filter(|other| is_in(other, section));
        overrides.extend(inside.map(|other| (other.path.clone(), "1.0".to_owned())));
        let name = |path: &str| path.rsplit('.').next().unwrap_or(path).to_owned();
        let table: Vec<String> =
            overrides.iter().map(|(path, value)| format!("{} = {value}", name(path))).collect();
        overrides = vec![(section.path.clone(), format!("{{ {} }}", table.join(", ")))];
    }
    overrides.push((key.path.clone(), value.to_owned()));
    let overrides: Vec<String> =
        overrides.into_iter().map(|(path, value)| format!("{path}={value}")).collect();
    match Config::parse("", "", &overrides) {
        Err(PpoError::Config { field, expected, .. }) if field == key.path => Some(expected),
        _ => None,
    }
}

fn is_in(key: &Key, section: &Key) -> bool {
    key.path.strip_prefix(&section.path).is_some_and(|rest| rest.starts_with('.'))
}

/// The words of a choice: `fast or reference`, `one of a, b, c`.
pub(super) fn words(accepted: &str) -> Vec<String> {
    let list = accepted.strip_prefix("one of ").unwrap_or(accepted);
    list.split(", ").flat_map(|part| part.split(" or ")).map(str::to_owned).collect()
}

/// The bounds that a sentence of the checks names.
pub(super) fn bounds(accepted: &str) -> Bounds {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    if let Some(least) = accepted.strip_prefix("at least ") {
        return Bounds { least: number(least), ..Bounds::default() };
    }
    if let Some((_, least)) = accepted.split_once(" > ") {
        return Bounds { least: number(least), above: true, most: None };
    }
    if let Some((_, least)) = accepted.split_once(" ≥ ") {
        return Bounds { least: number(least), ..Bounds::default() };
    }
    if let Some((_, interval)) = accepted.split_once(" in ") {
        let ends = interval.trim_matches(['[', ']', '(']).split_once(", ");
        let (least, most) = ends.map_or((None, None), |(least, most)| (number(least), number(most)));
        return Bounds { least, above: interval.starts_with('('), most };
    }
    let interval = accepted.split_once(" from ").map_or(accepted, |(_, interval)| interval);
    let Some((least, most)) = interval.split_once(" to ") else { return Bounds::default() };
    // Behind a bound that depends on other keys stands what it is made of: it is no bound of this key alone.
    Bounds { least: number(least), above: false, most: number(most) }
}

#[cfg(test)]
mod tests {
    use super::{Bounds, accepted, bounds, words};
    use jostle_runs::keys::keys;

    #[test]
    fn the_checks_words_are_understood() {
        let closed = |least, most| Bounds { least: Some(least), above: false, most: Some(most) };
        assert_eq!(bounds("an integer from 1 to 1000"), closed(1.0, 1000.0));
        assert_eq!(bounds("a number in [-1000000, 0]"), closed(-1e6, 0.0));
        assert_eq!(bounds("1 to 65536"), closed(1.0, 65_536.0));
        assert_eq!(bounds("a number in (0, 100]"), Bounds { above: true, ..closed(0.0, 100.0) });
        assert_eq!(
            bounds("1 to 640 (horizon · n_agents · n_rooms)"),
            Bounds { most: None, ..closed(1.0, 0.0) }
        );
        assert_eq!(bounds("a finite number ≥ 0"), Bounds { most: None, ..closed(0.0, 0.0) });
        assert_eq!(bounds("a finite number"), Bounds::default());
        assert_eq!(words("one of a, b"), words("a or b"));
    }

    #[test]
    fn every_number_of_the_configuration_has_bounds_or_is_any_finite_number() {
        let keys = keys();
        for key in
            keys.iter().filter(|key| ["u64", "usize", "u32", "f64", "f32"].contains(&key.kind.as_str()))
        {
            let words = accepted(&keys, key).unwrap_or_default();
            let free = words == "a finite number" || (key.kind.starts_with('u') && words.is_empty());
            assert!(free || bounds(&words).least.is_some(), "{}: {words:?}", key.path);
        }
    }
}
