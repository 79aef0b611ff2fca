//! The comparison of two folders: every file must be equal, but for clocks and the lock.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_policy::TensorFile;

/// Files that tell of time, or of nothing.
const LEFT_OUT: [&str; 2] = ["lock", "seconds.csv"];

/// One line for each file that is missing, too many or different. Empty where nothing was lost.
pub(crate) fn differences(expected: &Path, found: &Path) -> Result<Vec<String>> {
    let (expected, found) = (contents(expected)?, contents(found)?);
    let mut lines = Vec::new();
    for (name, content) in &expected {
        match found.get(name) {
            None => lines.push(format!("{name} is missing")),
            Some(other) if other != content => lines.push(format!("{name} differs{}", place(content, other))),
            Some(_) => {}
        }
    }
    lines.extend(
        found.keys().filter(|name| !expected.contains_key(*name)).map(|name| format!("{name} is left over")),
    );
    Ok(lines)
}

/// The tensor or line that moved first.
fn place(expected: &[Part], found: &[Part]) -> String {
    let moved = expected.iter().zip(found).find(|(a, b)| a != b).map(|(part, _)| part.0.as_str());
    match moved {
        Some(part) => format!(" in {part}"),
        None => format!(": {} parts, expected {}", found.len(), expected.len()),
    }
}

/// A named part of a file: a tensor, a line, or the whole.
type Part = (String, Vec<u8>);

fn contents(folder: &Path) -> Result<BTreeMap<String, Vec<Part>>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).with_context(|| format!("cannot list {}", next.display()))? {
            let path = entry?.path();
            let name = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
            if path.is_dir() {
                folders.push(path);
            } else if !LEFT_OUT.iter().any(|end| name.ends_with(end)) {
                found.insert(name, parts(&path)?);
            }
        }
    }
    Ok(found)
}

fn parts(path: &Path) -> Result<Vec<Part>> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut parts = Vec::new();
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("safetensors") => {
            let file = TensorFile::read(path)?;
            for name in file.names() {
                parts.push((name.to_owned(), file.raw(name)?.1.to_vec()));
            }
            parts.push(("its header".to_owned(), bytes));
        }
        Some("ndjson") => {
            for (index, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
                parts.push((format!("line {}", index + 1), without_clock(line)));
            }
        }
        _ => parts.push(("its bytes".to_owned(), bytes)),
    }
    Ok(parts)
}

/// A log line without its clock; any other line as it is.
fn without_clock(line: &[u8]) -> Vec<u8> {
    let Ok(serde_json::Value::Object(mut record)) = serde_json::from_slice(line) else {
        return line.to_vec();
    };
    match record.remove("clock") {
        Some(_) => serde_json::Value::Object(record).to_string().into_bytes(),
        None => line.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::differences;
    use std::fs;

    #[test]
    fn clocks_may_differ_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        for (place, seconds) in [(&a, 1), (&b, 2)] {
            fs::create_dir(place).unwrap();
            let log = format!("{{\"update\":1,\"clock\":{{\"total\":{seconds}}}}}\n{{\"update\":2}}\n");
            fs::write(place.join("log.ndjson"), log).unwrap();
        }
        fs::write(b.join("lock"), "").unwrap();
        assert!(differences(&a, &b).unwrap().is_empty());
        fs::write(b.join("log.ndjson"), "{\"update\":1,\"clock\":{}}\n{\"update\":3}\n").unwrap();
        fs::write(b.join("x.partial"), "").unwrap();
        fs::write(a.join("latest"), "").unwrap();
        let found = differences(&a, &b).unwrap();
        assert_eq!(found, ["latest is missing", "log.ndjson differs in line 2", "x.partial is left over"]);
    }
}
