//! Reading a configuration: TOML text, then `--set key=value` overrides, each error with its place.
//!
//! The text is read twice: once into [`Config`] for its values, once into a table with spans so
//! that an error found later (a range, a clash of two keys) can still name the line. Overrides are
//! applied one at a time, so that the one at fault is known.

use std::ops::Range;
use std::path::Path;

use jostle_policy::{excerpt, nearest};
use serde::Deserialize;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::Config;
use crate::PpoError;

/// Largest configuration file that is read, in bytes.
const TEXT_MAX: u64 = 1 << 20;
/// Most parts of an override's dotted key. Tables are cloned and dropped by recursion, which a long
/// key would exhaust.
const DEPTH_MAX: usize = 8;

/// The paper's letters for three keys.
const ALIASES: [(&str, &str); 3] = [("N", "n_agents"), ("M", "n_behaviours"), ("R", "n_rooms")];

impl Config {
    /// Reads `path`, applies the overrides in order, and validates the result.
    ///
    /// An override is `key=value` with a dotted key and a TOML value; a bare word is taken as a
    /// string (`intrinsic_reward=state`). A relative path of the file starts from the file's
    /// folder, one of an override from the working directory.
    ///
    /// # Errors
    ///
    /// [`PpoError::Io`] for an unreadable file, [`PpoError::Syntax`] for text that is not TOML,
    /// [`PpoError::Config`] for a key that is unknown, of the wrong type or out of range.
    pub fn load(path: &Path, overrides: &[impl AsRef<str>]) -> Result<Self, PpoError> {
        let io = |reason| PpoError::Io { path: path.to_path_buf(), action: "read", reason };
        let (about, location) = (std::fs::metadata(path).map_err(io)?, path.display().to_string());
        // A device or a pipe has no length, and may have no end.
        if !about.is_file() || about.len() > TEXT_MAX {
            let found = if about.is_file() { format!("{} bytes", about.len()) } else { "no file".to_owned() };
            let message = format!("found {found}, expected a configuration of at most {TEXT_MAX} bytes");
            return Err(PpoError::Syntax { location, message });
        }
        let text = std::fs::read_to_string(path).map_err(io)?;
        let mut config = Self::parse(&text, &location, overrides)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let is_set = |key: &str| overrides.iter().any(|argument| names(argument.as_ref(), key));
        if !is_set("sim.room.map") {
            config.sim.room.named_in(folder);
        }
        if !is_set("training_crowd.maps") {
            config.training_crowd.named_in(folder);
        }
        if !is_set("population.files") {
            config.population.named_in(folder);
        }
        Ok(config)
    }

    /// As [`Self::load`], from text; `label` stands for the file in errors.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn parse(text: &str, label: &str, overrides: &[impl AsRef<str>]) -> Result<Self, PpoError> {
        let source = Source { text, label };
        let mut config: Self = toml::from_str(text).map_err(|error| source.explain(&error))?;
        let mut table: Table = text.parse().map_err(|error| source.explain(&error))?;
        rename_aliases(&mut table);
        let mut set = Vec::new();
        for argument in overrides {
            let argument = argument.as_ref();
            let path = apply(&mut table, argument)?;
            config = Self::deserialize(Value::Table(table.clone()))
                .map_err(|error| translate(&format!("--set {argument}"), &path.join("."), error.message()))?;
            set.push((path.join("."), argument));
        }
        config.validate().map_err(|error| source.locate(error, &set))?;
        Ok(config)
    }
}

/// True if an override sets a key, by itself or with its whole section.
fn names(argument: &str, key: &str) -> bool {
    let found = argument.split('=').next().unwrap_or_default();
    let parts: Vec<&str> = found.split('.').map(str::trim).collect();
    key.split('.').collect::<Vec<_>>().starts_with(&parts)
}

/// Writes one override into the table; returns its path.
fn apply(table: &mut Table, argument: &str) -> Result<Vec<String>, PpoError> {
    let location = || excerpt(&format!("--set {argument}"));
    let syntax = |message: &str| PpoError::Syntax { location: location(), message: message.to_owned() };
    let (key, value) = argument.split_once('=').ok_or_else(|| syntax("expected key=value"))?;
    let path: Vec<String> = key.trim().split('.').map(|part| part.trim().to_owned()).collect();
    if path.iter().any(String::is_empty) {
        return Err(syntax("expected a dotted key before the ="));
    }
    let value = parse_value(value.trim()).ok_or_else(|| syntax("expected a TOML value after the ="))?;
    if path.len() > DEPTH_MAX {
        return Err(PpoError::Syntax {
            location: "--set".to_owned(),
            message: format!("found a key of {} parts, expected at most {DEPTH_MAX}", path.len()),
        });
    }
    let path = if path.len() == 1 { vec![full_name(&path[0]).to_owned()] } else { path };
    let (last, sections) = path.split_last().expect("a split yields at least one part");
    let mut place = table;
    for section in sections {
        let entry = place.entry(section.clone()).or_insert_with(|| Value::Table(Table::new()));
        place = entry.as_table_mut().ok_or_else(|| syntax(&format!("{section} is not a section")))?;
    }
    place.insert(last.clone(), value);
    Ok(path)
}

/// A TOML value, or a bare word as a string.
fn parse_value(text: &str) -> Option<Value> {
    let is_word = !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || "_-./:".contains(c));
    match format!("value = {text}").parse::<Table>() {
        // A line break could smuggle in further keys.
        Ok(mut table) if table.len() == 1 => table.remove("value"),
        _ => is_word.then(|| Value::String(text.to_owned())),
    }
}

fn full_name(key: &str) -> &str {
    ALIASES.iter().find(|(alias, _)| *alias == key).map_or(key, |(_, name)| name)
}

fn rename_aliases(table: &mut Table) {
    for (alias, name) in ALIASES {
        if let Some(value) = table.remove(alias) {
            table.insert(name.to_owned(), value);
        }
    }
}

/// A text and the name of its file.
struct Source<'a> {
    text: &'a str,
    label: &'a str,
}

impl Source<'_> {
    /// Our words for an error of the TOML crate.
    fn explain(&self, error: &toml::de::Error) -> PpoError {
        let Some(span) = error.span() else {
            return translate(self.label, "configuration", error.message());
        };
        let location = self.place(span.start);
        match DeTable::parse(self.text) {
            Ok(table) => {
                let path = path_at(table.get_ref(), &span).unwrap_or_else(|| "configuration".to_owned());
                translate(&location, &path, error.message())
            }
            Err(_) => PpoError::Syntax { location, message: excerpt(&one_line(error.message())) },
        }
    }

    /// `file:line:column` of a byte, both counted from 1, the column in characters.
    fn place(&self, byte: usize) -> String {
        let before = self.text.get(..byte).unwrap_or(self.text);
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
        format!("{}:{line}:{column}", self.label)
    }

    /// Gives a range error the place that its value came from: the last override, else the file's
    /// line, else the file.
    fn locate(&self, error: PpoError, set: &[(String, &str)]) -> PpoError {
        let PpoError::Config { field, found, expected, .. } = error else { return error };
        let from_override = set.iter().rev().find(|(path, _)| *path == field);
        let location = match from_override {
            Some((_, argument)) => format!("--set {argument}"),
            None => DeTable::parse(self.text)
                .ok()
                .and_then(|table| span_of(table.get_ref(), &field))
                .map_or_else(|| self.label.to_owned(), |span| self.place(span.start)),
        };
        PpoError::Config { location, field, found, expected }
    }
}

/// The dotted path of the innermost key or value that holds `span`.
fn path_at(table: &DeTable<'_>, span: &Range<usize>) -> Option<String> {
    let holds =
        |outer: Range<usize>| outer.start <= span.start && span.start < outer.end.max(outer.start + 1);
    table.iter().find_map(|(key, value)| {
        let name = key.get_ref().to_string();
        let inner = match value.get_ref() {
            DeValue::Table(inner) => path_at(inner, span).map(|path| format!("{name}.{path}")),
            _ => None,
        };
        inner.or_else(|| (holds(key.span()) || holds(value.span())).then_some(name))
    })
}

/// Place of the key of a dotted path.
fn span_of(table: &DeTable<'_>, path: &str) -> Option<Range<usize>> {
    let (first, rest) = path.split_once('.').map_or((path, None), |(first, rest)| (first, Some(rest)));
    let (key, value) = table.iter().find(|(key, _)| full_name(key.get_ref()) == first)?;
    match (rest, value.get_ref()) {
        (None, _) => Some(key.span()),
        (Some(rest), DeValue::Table(inner)) => span_of(inner, rest),
        _ => None,
    }
}

/// Turns serde's sentence into field, found and expected.
fn translate(location: &str, path: &str, message: &str) -> PpoError {
    let (location, path) = (excerpt(location), excerpt(path));
    let config = |found: String, expected: String| PpoError::Config {
        location: location.clone(),
        field: path.clone(),
        found: excerpt(&found),
        expected: excerpt(&expected),
    };
    if let Some((name, known)) = message.strip_prefix("unknown field `").and_then(|rest| rest.split_once('`'))
    {
        let names: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        // A name of a megabyte is near to nothing.
        let name = excerpt(name);
        let expected = match nearest(&name, names.iter().copied()).first() {
            Some(nearest) => (*nearest).to_owned(),
            None => format!("one of {}", names.join(", ")),
        };
        return config("an unknown key".to_owned(), expected);
    }
    for prefix in ["invalid type: ", "invalid value: ", "unknown variant "] {
        if let Some((found, expected)) =
            message.strip_prefix(prefix).and_then(|rest| rest.split_once(", expected "))
        {
            return config(found.replace('`', ""), one_line(expected).replace('`', ""));
        }
    }
    PpoError::Syntax { location, message: excerpt(&format!("{path}: {}", one_line(message))) }
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: &[&str] = &[];

    #[track_caller]
    fn check(text: &str, overrides: &[&str], expected: &str) {
        let error = Config::parse(text, "a.toml", overrides).expect_err("refused").to_string();
        assert_eq!(error, expected);
        assert_eq!(error.lines().count(), 1);
    }

    #[test]
    fn the_empty_text_is_the_default() {
        assert_eq!(Config::parse("", "a.toml", NONE).unwrap(), Config::default());
    }

    #[test]
    fn aliases_and_overrides_meet_in_one_key() {
        let config = Config::parse("N = 4\nM = 2\nR = 3", "a.toml", &["N=7", "n_rooms=5"]).unwrap();
        assert_eq!((config.n_agents, config.n_behaviours, config.n_rooms), (7, 2, 5));
    }

    #[test]
    fn overrides_take_toml_values_and_bare_words() {
        let overrides =
            ["intrinsic_reward=state", "discriminator.noise=\"off\"", "sim.laser.beams = 64", "alpha=1"];
        let config = Config::parse("", "a.toml", &overrides).unwrap();
        assert_eq!(config.intrinsic_reward, jostle_diversity::IntrinsicReward::State);
        assert_eq!(config.discriminator.noise, jostle_diversity::InputNoise::Off);
        assert_eq!((config.sim.laser.beams, config.alpha), (64, 1.0));
    }

    #[test]
    fn unknown_keys_suggest_the_nearest() {
        check(
            "seed = 1\nlearning_rte = 1",
            NONE,
            "a.toml:2:1: learning_rte: found an unknown key, expected learning_rate",
        );
        check(
            "[discriminator]\nnoise_scal = 1",
            NONE,
            "a.toml:2:1: discriminator.noise_scal: found an unknown key, expected noise_scale",
        );
        check("", &["gama=0.9"], "--set gama=0.9: gama: found an unknown key, expected gamma");
        check(
            "",
            &["sim.laser.beam=3"],
            "--set sim.laser.beam=3: sim.laser.beam: found an unknown key, expected beams",
        );
    }

    #[test]
    fn wrong_types_and_variants_are_named() {
        check("\n alpha = \"x\"", NONE, "a.toml:2:10: alpha: found string \"x\", expected f64");
        check("", &["horizon=1.5"], "--set horizon=1.5: horizon: found floating point 1.5, expected usize");
        check("", &["n_agents=-1"], "--set n_agents=-1: n_agents: found integer -1, expected usize");
        check("", &["backend=slow"], "--set backend=slow: backend: found slow, expected fast or reference");
    }

    #[test]
    fn ranges_are_located_where_the_value_came_from() {
        check("alpha = -0.1", NONE, "a.toml:1:1: alpha: found -0.1, expected a finite number ≥ 0");
        check("alpha = 0.1", &["alpha=-2"], "--set alpha=-2: alpha: found -2, expected a finite number ≥ 0");
        check("N = 0", NONE, "a.toml:1:1: n_agents: found 0, expected an integer from 1 to 1000");
        check("M = 0", NONE, "a.toml:1:1: n_behaviours: found 0, expected an integer from 1 to 1000");
        check(
            "[sim.laser]\nnoise_std = -1",
            NONE,
            "a.toml:2:1: sim.laser.noise_std: found -1, expected a number in [0, 100]",
        );
        check(
            "minibatch = 641",
            NONE,
            "a.toml:1:1: minibatch: found 641, expected 1 to 640 (horizon · n_agents · n_rooms)",
        );
        check(
            "minibatch = 0",
            NONE,
            "a.toml:1:1: minibatch: found 0, expected 1 to 640 (horizon · n_agents · n_rooms)",
        );
        check(
            "[discriminator]\nhidden = 0",
            NONE,
            "a.toml:2:1: discriminator.hidden: found 0, expected 1 to 65536",
        );
        check("[network]\nhidden = 0", NONE, "a.toml:2:1: network.hidden: found 0, expected 1 to 65536");
        check(
            "[sim.laser]\nfov = 270.0",
            NONE,
            "a.toml:2:1: sim.laser.fov: found 270, expected radians in (0, 6.2831855]",
        );
        // Bodies would be seen where none are.
        check(
            "[network]\ninputs = \"motion\"\n[sim.laser]\nfov = 3.0",
            NONE,
            "a.toml:2:1: network.inputs: found motion, with a laser that sees 3 rad from 0 rad, expected scans, or a \
             laser that sees all round from 0 rad",
        );
    }

    #[test]
    fn a_laser_that_sees_all_round_leaves_the_hash_alone() {
        let hash = |text: &str| Config::parse(text, "a.toml", NONE).expect("a configuration").hash();
        let usual = hash("");
        assert_eq!(hash("[sim.laser]\nfov = 6.283185307179586\nangle_min = 0.0"), usual);
        assert_ne!(hash("[sim.laser]\nfov = 3.0"), usual);
        assert_ne!(hash("[sim.laser]\nangle_min = 1.0"), usual);
    }

    #[test]
    fn what_is_not_toml_is_one_line() {
        let error = Config::parse("alpha = = 2", "a.toml", NONE).unwrap_err().to_string();
        assert!(error.starts_with("a.toml:1:") && error.lines().count() == 1, "{error}");
        check("", &["alpha"], "--set alpha: expected key=value");
        check("", &["alpha=[1"], "--set alpha=[1: expected a TOML value after the =");
        check("", &["=1"], "--set =1: expected a dotted key before the =");
        check("", &["alpha.x=1", "seed=2"], "--set alpha.x=1: alpha.x: found map, expected f64");
        let both = Config::parse("N = 1\nn_agents = 2", "a.toml", NONE).unwrap_err().to_string();
        assert!(both.contains("duplicate"), "{both}");
    }

    #[test]
    fn files_are_read_and_missing_ones_named() {
        let error = Config::load(Path::new("/nonexistent/a.toml"), NONE).unwrap_err().to_string();
        assert!(error.starts_with("/nonexistent/a.toml: cannot read"), "{error}");
    }

    #[test]
    fn a_map_starts_from_the_file_that_names_it_and_an_override_from_the_working_directory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        std::fs::write(&path, "[sim.room]\nmap = \"m.toml\"\n").unwrap();
        let map = |overrides: &[&str]| Config::load(&path, overrides).unwrap().sim.room.map_file().unwrap();
        let beside = folder.path().canonicalize().unwrap().join("m.toml");
        assert_eq!(map(&[]), beside);
        assert_eq!(map(&["sim.room.width=3"]), beside);
        assert_eq!(map(&["sim.room.map=n.toml"]), Path::new("n.toml"));
        assert_eq!(map(&["sim.room={ map = \"n.toml\" }"]), Path::new("n.toml"));
    }

    #[test]
    fn a_population_starts_from_the_file_that_names_it_and_an_override_from_the_working_directory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        std::fs::write(&path, "[population]\nfiles = [\"../p/a.safetensors\", \"/q/b.safetensors\"]\n")
            .unwrap();
        let files = |overrides: &[&str]| Config::load(&path, overrides).unwrap().population.located();
        let beside = folder.path().canonicalize().unwrap().join("../p/a.safetensors");
        assert_eq!(files(&[]), [beside.clone(), "/q/b.safetensors".into()]);
        assert_eq!(files(&["population.past=3"])[0], beside);
        assert_eq!(files(&["sim.room.map=n.toml"])[0], beside);
        assert_eq!(files(&["population.files=[\"c.safetensors\"]"]), [Path::new("c.safetensors")]);
        assert_eq!(files(&["population={ files = [\"c.safetensors\"] }"]), [Path::new("c.safetensors")]);
    }
}
