//! The `map.yaml` of ROS' map server, by a YAML parser: block and flow style, anchors, comments,
//! any number of lines.
//!
//! The keys that are read and the meaning of their values follow nav2's `map_io`; the numbers and
//! words are those that its YAML library takes. Keys that it does not know are passed over, and
//! told by [`MapYaml::ignored`].

use crate::error::SimError;
use crate::scenario::REACH;
use saphyr_parser::{Event, Parser, StrInput};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest text, bytes: a map's is a few lines.
const TEXT_MAX: usize = 1 << 20;
/// Longest name of an image, bytes.
const NAME_MAX: usize = 1024;
/// Longest list that is kept; an origin has three entries.
const LIST_MAX: usize = 16;
/// The keys that are read.
const KNOWN: [&str; 7] =
    ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];

/// The rule by which brightness becomes occupancy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    /// Free, occupied or unknown by the two thresholds.
    Trinary,
    /// As `Trinary`, and in between a share; what is not opaque is unknown.
    Scale,
    /// The brightness itself, 0 to 255, is a percentage; above 100 is unknown.
    Raw,
}

/// The metadata of an occupancy grid.
#[derive(Debug)]
pub(super) struct MapYaml {
    /// The image, beside the yaml unless absolute.
    pub(super) image: PathBuf,
    /// Side of a cell, m.
    pub(super) resolution: f64,
    /// World position of the lower left corner of the lower left cell, m, and the grid's heading
    /// around it, rad.
    pub(super) origin: [f64; 3],
    /// True if dark is free.
    pub(super) negate: bool,
    /// A cell is occupied above this probability of being occupied.
    pub(super) occupied_thresh: f64,
    /// A cell is free below this one.
    pub(super) free_thresh: f64,
    /// The rule by which brightness becomes occupancy.
    pub(super) mode: Mode,
    /// Keys that are not read.
    pub(super) ignored: Vec<String>,
}

impl MapYaml {
    /// Reads the text of a `map.yaml`.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self, SimError> {
        let Entries { known, ignored } = entries(path, text)?;
        let file = Fields { path, known: &known };
        let occupied_thresh = file.number("occupied_thresh", 0.0, 1.0)?;
        let free_thresh = file.number("free_thresh", 0.0, 1.0)?;
        if free_thresh > occupied_thresh {
            let expected = format!("at most occupied_thresh, {occupied_thresh}");
            return Err(SimError::file(path, "free_thresh", free_thresh, expected));
        }
        let image = file.text("image")?;
        // Such a name would forge lines in the messages about it, or fill a terminal.
        if image.is_empty() || image.len() > NAME_MAX || image.chars().any(char::is_control) {
            let expected = format!("a file name of 1 to {NAME_MAX} bytes without control characters");
            return Err(SimError::file(path, "image", image, expected));
        }
        Ok(Self {
            image: path.parent().unwrap_or(Path::new("")).join(image),
            resolution: file.number("resolution", 1e-3, 10.0)?,
            origin: file.origin()?,
            negate: file.negate()?,
            occupied_thresh,
            free_thresh,
            mode: file.mode()?,
            ignored,
        })
    }
}

/// A value, as far as one of a map's keys can have it.
#[derive(Clone, Debug)]
enum Value {
    Text(String),
    List(Vec<String>),
    /// A mapping, nested lists, a list too long.
    Other,
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::List(items) => write!(f, "[{}]", items.join(", ")),
            Self::Other => f.write_str("a nested or long value"),
        }
    }
}

/// The values of the known keys.
struct Fields<'a> {
    path: &'a Path,
    known: &'a BTreeMap<&'static str, Value>,
}

impl Fields<'_> {
    fn get(&self, key: &str) -> Result<&Value, SimError> {
        self.known.get(key).ok_or_else(|| SimError::file(self.path, key, "nothing", "a value"))
    }

    fn text(&self, key: &str) -> Result<&str, SimError> {
        match self.get(key)? {
            Value::Text(text) => Ok(text),
            other => Err(SimError::file(self.path, key, other, "a single value")),
        }
    }

    fn number(&self, key: &str, low: f64, high: f64) -> Result<f64, SimError> {
        let found = self.text(key)?;
        let value = found.parse::<f64>().ok().filter(|x| *x >= low && *x <= high);
        value.ok_or_else(|| SimError::file(self.path, key, found, format!("a number in [{low}, {high}]")))
    }

    /// A number, of which 0 is no, or a word.
    fn negate(&self) -> Result<bool, SimError> {
        let found = self.text("negate")?;
        if let Some(number) = found.parse::<f64>().ok().filter(|number| number.is_finite()) {
            return Ok(number != 0.0);
        }
        match found.to_ascii_lowercase().as_str() {
            "true" | "yes" | "y" | "on" => Ok(true),
            "false" | "no" | "n" | "off" => Ok(false),
            _ => Err(SimError::file(self.path, "negate", found, "a number, true or false")),
        }
    }

    fn mode(&self) -> Result<Mode, SimError> {
        if !self.known.contains_key("mode") {
            return Ok(Mode::Trinary);
        }
        match self.text("mode")? {
            "trinary" => Ok(Mode::Trinary),
            "scale" => Ok(Mode::Scale),
            "raw" => Ok(Mode::Raw),
            found => Err(SimError::file(self.path, "mode", found, "trinary, scale or raw")),
        }
    }

    /// `[x, y, yaw]`.
    fn origin(&self) -> Result<[f64; 3], SimError> {
        let found = self.get("origin")?;
        let numbers = match found {
            Value::List(items) => items.iter().map(|item| item.parse().ok()).collect::<Option<Vec<f64>>>(),
            _ => None,
        };
        let reach = f64::from(REACH);
        match numbers.as_deref() {
            Some([x, y, yaw]) if x.abs() <= reach && y.abs() <= reach && yaw.is_finite() => {
                Ok([*x, *y, *yaw])
            }
            _ => {
                let expected = format!("[x, y, yaw], x and y within ±{REACH} m, yaw in rad");
                Err(SimError::file(self.path, "origin", found, expected))
            }
        }
    }
}

/// The top level of a file.
struct Entries {
    known: BTreeMap<&'static str, Value>,
    ignored: Vec<String>,
}

fn entries(path: &Path, text: &str) -> Result<Entries, SimError> {
    if text.len() > TEXT_MAX {
        let expected = format!("at most {TEXT_MAX} bytes");
        return Err(SimError::file(path, "content", format!("{} bytes", text.len()), expected));
    }
    // The parser asks for a space behind the colon of a key; YAML, and ROS with it, takes a tab as
    // well. In a quoted name a tab would be refused anyway.
    let text = text.replace(":\t", ": ");
    let mut reader = Reader { path, parser: Parser::new_from_str(&text), anchors: BTreeMap::new() };
    let mut entries = Entries { known: BTreeMap::new(), ignored: Vec::new() };
    loop {
        match reader.next()? {
            Event::MappingStart(..) => break,
            Event::Nothing | Event::StreamStart | Event::DocumentStart(_) => {}
            _ => return Err(SimError::file(path, "content", "no mapping", "key: value")),
        }
    }
    loop {
        let key = match reader.next()? {
            Event::MappingEnd => return Ok(entries),
            Event::Scalar(text, ..) => text.into_owned(),
            other => reader.value(other)?.to_string(),
        };
        let first = reader.next()?;
        let value = reader.value(first)?;
        match KNOWN.into_iter().find(|known| *known == key) {
            Some(known) if entries.known.contains_key(known) => {
                return Err(SimError::file(path, known, "a second value", "one"));
            }
            Some(known) => drop(entries.known.insert(known, value)),
            None => entries.ignored.push(key),
        }
    }
}

struct Reader<'a> {
    path: &'a Path,
    parser: Parser<'a, StrInput<'a>>,
    anchors: BTreeMap<usize, Value>,
}

impl<'a> Reader<'a> {
    fn next(&mut self) -> Result<Event<'a>, SimError> {
        match self.parser.next() {
            Some(Ok((event, _))) => Ok(event),
            Some(Err(error)) => {
                let (line, column) = (error.marker().line(), error.marker().col() + 1);
                let place = format!("line {line}, column {column}");
                Err(SimError::file(self.path, place, error.info(), "YAML"))
            }
            None => Err(SimError::file(self.path, "content", "the end of the file", "a whole mapping")),
        }
    }

    /// The value that begins with an event.
    fn value(&mut self, first: Event<'a>) -> Result<Value, SimError> {
        let (anchor, value) = match first {
            Event::Scalar(text, _, anchor, _) => (anchor, Value::Text(text.into_owned())),
            Event::SequenceStart(anchor, _) => (anchor, self.list()?),
            Event::MappingStart(anchor, _) => {
                self.skip()?;
                (anchor, Value::Other)
            }
            Event::Alias(anchor) => {
                return Ok(self.anchors.get(&anchor).cloned().unwrap_or(Value::Other));
            }
            _ => return Err(SimError::file(self.path, "content", "the end of a list", "a value")),
        };
        if anchor > 0 {
            self.anchors.insert(anchor, value.clone());
        }
        Ok(value)
    }

    /// A list after its start.
    fn list(&mut self) -> Result<Value, SimError> {
        let (mut items, mut plain) = (Vec::new(), true);
        loop {
            match self.next()? {
                Event::SequenceEnd => break,
                Event::Scalar(text, ..) if items.len() < LIST_MAX => items.push(text.into_owned()),
                Event::Alias(anchor) if items.len() < LIST_MAX => match self.anchors.get(&anchor) {
                    Some(Value::Text(text)) => items.push(text.clone()),
                    _ => plain = false,
                },
                event => {
                    plain = false;
                    if matches!(event, Event::SequenceStart(..) | Event::MappingStart(..)) {
                        self.skip()?;
                    }
                }
            }
        }
        Ok(if plain { Value::List(items) } else { Value::Other })
    }

    /// Passes over the rest of a list or mapping that has begun, however deep.
    fn skip(&mut self) -> Result<(), SimError> {
        let mut depth = 1_usize;
        while depth > 0 {
            match self.next()? {
                Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
                Event::SequenceEnd | Event::MappingEnd => depth -= 1,
                _ => {}
            }
        }
        Ok(())
    }
}
