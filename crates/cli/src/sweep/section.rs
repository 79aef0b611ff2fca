//! A part of a plan file, read key by key, so that every mistake is named with its place: file,
//! field, what was found, what was expected, and for an unknown key the nearest one that there is.

use anyhow::{Result, bail};
use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// Most characters of a value that a message repeats.
const EXCERPT: usize = 60;

/// A table of the file that is being read.
pub(crate) struct Section {
    /// Such as `plan.toml` or `plan.toml: variant m5`.
    place: String,
    table: Table,
    /// Keys that were asked for.
    known: Vec<&'static str>,
}

impl Section {
    /// The table called `place` in messages.
    pub(super) fn new(place: &str, table: Table) -> Self {
        Self { place: place.to_owned(), table, known: Vec::new() }
    }

    /// A whole file, called `place` in messages.
    ///
    /// # Errors
    /// What is no TOML, with its line.
    pub(super) fn of_text(place: &str, text: &str) -> Result<Self> {
        match text.parse() {
            Ok(table) => Ok(Self::new(place, table)),
            Err(error) => bail!(syntax(place, text, &error)),
        }
    }

    /// The name of this section in messages.
    pub(super) fn place(&self) -> &str {
        &self.place
    }

    /// Calls the section by a better name, now that one is known.
    pub(super) fn call(&mut self, place: String) {
        self.place = place;
    }

    /// The value of a key, if the file has it; `expected` says in words what `T` takes.
    pub(super) fn optional<T: DeserializeOwned>(
        &mut self,
        key: &'static str,
        expected: &str,
    ) -> Result<Option<T>> {
        self.known.push(key);
        let Some(value) = self.table.remove(key) else { return Ok(None) };
        match T::deserialize(value.clone()) {
            Ok(read) => Ok(Some(read)),
            Err(_) => bail!(self.refusal(key, &shown(&value), expected)),
        }
    }

    /// The value of a key that the file must have.
    pub(super) fn required<T: DeserializeOwned>(&mut self, key: &'static str, expected: &str) -> Result<T> {
        match self.optional(key, expected)? {
            Some(value) => Ok(value),
            None => bail!(self.refusal(key, "nothing", expected)),
        }
    }

    /// The sub-section of that name, if the file has it.
    pub(super) fn section(&mut self, key: &'static str) -> Result<Option<Self>> {
        let table: Option<Table> = self.optional(key, "a section")?;
        Ok(table.map(|table| Self::new(&format!("{}: {key}", self.place), table)))
    }

    /// The sections `[[key]]`.
    pub(super) fn sections(&mut self, key: &'static str) -> Result<Vec<Self>> {
        let expected = format!("sections [[{key}]]");
        let tables: Option<Vec<Table>> = self.optional(key, &expected)?;
        let named = |(index, table)| Self::new(&format!("{}: {key} {}", self.place, index + 1), table);
        Ok(tables.unwrap_or_default().into_iter().enumerate().map(named).collect())
    }

    /// The keys that have not been taken yet.
    pub(super) fn table(&self) -> &Table {
        &self.table
    }

    /// All keys that were not asked for yet, with their values.
    pub(super) fn rest(&mut self) -> Table {
        std::mem::take(&mut self.table)
    }

    /// Refuses what nobody asked for.
    pub(super) fn finish(self) -> Result<()> {
        match self.table.keys().next() {
            Some(key) => bail!(self.refusal(key, "an unknown key", &nearest(key, &self.known))),
            None => Ok(()),
        }
    }

    /// The message for a key that cannot be taken.
    pub(super) fn refusal(&self, key: &str, found: &str, expected: &str) -> String {
        format!("{}: {}: found {found}, expected {expected}", self.place, excerpt(key))
    }
}

/// The known name that is nearest to a wrong one, or all of them where none is near.
pub(super) fn nearest(wrong: &str, known: &[&str]) -> String {
    match jostle_policy::nearest(wrong, known.iter().copied()).first() {
        Some(best) => (*best).to_owned(),
        None => format!("one of {}", known.join(", ")),
    }
}

/// The message for a text that is no TOML, with its line.
fn syntax(place: &str, text: &str, error: &toml::de::Error) -> String {
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.map_or_else(String::new, |before| format!(":{}", before.matches('\n').count() + 1));
    format!("{place}{line}: {}", error.message().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// A value as a message repeats it.
pub(super) fn shown(value: &Value) -> String {
    excerpt(&value.to_string())
}

/// The start of a text, without control characters.
fn excerpt(text: &str) -> String {
    let mut characters = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let start: String = characters.by_ref().take(EXCERPT).collect();
    if characters.next().is_some() { start + "…" } else { start }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(text: &str) -> Section {
        Section::new("a.toml", text.parse().unwrap())
    }

    #[test]
    fn each_mistake_is_named_with_its_place() {
        let error = section("seeds = \"x\"").optional::<Vec<u64>>("seeds", "a list of integers");
        assert_eq!(error.unwrap_err().to_string(), "a.toml: seeds: found \"x\", expected a list of integers");
        let error = section("").required::<u64>("seed", "an integer").unwrap_err().to_string();
        assert_eq!(error, "a.toml: seed: found nothing, expected an integer");
        let mut inner = section("[slurm]\npartitoin = \"main\"").section("slurm").unwrap().unwrap();
        inner.optional::<String>("partition", "a name").unwrap();
        let error = inner.finish().unwrap_err().to_string();
        assert_eq!(error, "a.toml: slurm: partitoin: found an unknown key, expected partition");
    }

    #[test]
    fn what_is_near_to_nothing_is_told_all_names() {
        assert_eq!(nearest("colour", &["base", "out"]), "one of base, out");
        assert_eq!(nearest("episode", &["episodes", "crowds"]), "episodes");
    }

    #[test]
    fn messages_stay_short_and_on_one_line() {
        let long = shown(&Value::String(format!("a\nb{}", "c".repeat(200))));
        assert!(long.chars().count() <= EXCERPT + 1 && long.ends_with('…') && !long.contains('\n'), "{long}");
    }
}
