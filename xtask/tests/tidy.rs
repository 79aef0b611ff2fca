//! What the compiler does not check: every source file introduces itself, and the library crates keep their promises
//! about randomness, time and iteration order.

use std::fs;
use std::path::{Path, PathBuf};

/// A line may break a rule where it, or the line before it, says why.
const EXCUSE: &str = "tidy:";

#[test]
fn every_file_opens_with_what_it_is() {
    let silent: Vec<PathBuf> =
        sources(&workspace()).into_iter().filter(|path| !text(path).starts_with("//!")).collect();
    assert!(silent.is_empty(), "files that do not open with `//!`: {silent:?}");
}

#[test]
fn the_random_generators_of_candle_are_not_used() {
    // They cannot be seeded on the CPU.
    check(&["Tensor::rand", "rand_like(", "randn_like("], &[]);
}

#[test]
fn nothing_is_drawn_from_the_operating_system() {
    check(&["thread_rng", "rand::rng()", "from_os_rng", "from_entropy", "SysRng"], &[]);
}

#[test]
fn no_hash_map_decides_an_order() {
    check(&["HashMap", "HashSet"], &[]);
}

#[test]
fn no_result_depends_on_the_clock() {
    // The benches measure; the update report keeps its seconds apart from results.
    check(&["Instant::now", "SystemTime", "std::time"], &["crates/bench/", "crates/ppo/src/algorithm1.rs"]);
}

#[test]
fn no_error_shows_a_cause_that_it_also_hands_on() {
    // Whoever prints the chain would tell it twice.
    let mut found = Vec::new();
    for path in sources(&workspace().join("crates")) {
        let text = text(&path);
        for variant in text.split("#[error(").skip(1) {
            let (message, rest) = variant.split_once(")]").unwrap_or((variant, ""));
            let body = rest.split("#[error(").next().unwrap_or("");
            let body = body.split("\n    }").next().unwrap_or(body).split("),\n").next().unwrap_or(body);
            let hands_on = ["#[from]", "#[source]", " source:"].iter().any(|word| body.contains(word));
            if hands_on && (message.contains("{source") || message.contains("{0")) {
                found.push(format!("{}: {message}", path.display()));
            }
        }
    }
    assert!(found.is_empty(), "an error shows its cause and hands it on:\n{}", found.join("\n"));
}

/// Every use of `words` in the library crates, outside `exempt` places, must carry an excuse.
fn check(words: &[&str], exempt: &[&str]) {
    let mut found = Vec::new();
    let root = workspace();
    for path in sources(&root.join("crates")) {
        let name = path.strip_prefix(&root).unwrap().display().to_string();
        let library = name.contains("/src/") && !exempt.iter().any(|place| name.starts_with(place));
        if !library {
            continue;
        }
        let text = text(&path);
        let lines: Vec<&str> = text.lines().collect();
        for (index, line) in lines.iter().enumerate() {
            let code = !line.trim_start().starts_with("//");
            let excused = line.contains(EXCUSE) || (index > 0 && lines[index - 1].contains(EXCUSE));
            if code && !excused && words.iter().any(|word| line.contains(word)) {
                found.push(format!("{name}:{}: {}", index + 1, line.trim()));
            }
        }
    }
    assert!(found.is_empty(), "without `// {EXCUSE} reason` here or a line above:\n{}", found.join("\n"));
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

/// All Rust files of the project, sorted; build folders are left out.
fn sources(root: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = if root.ends_with("crates") {
        vec![root.to_owned()]
    } else {
        vec![root.join("crates"), root.join("xtask")]
    };
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.ends_with("target") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    assert!(found.len() > 5, "the sources were not found under {}", root.display());
    found
}
