//! The documentation keeps its word: pages exist, links lead somewhere, and what a block of code
//! claims is true.
//!
//! Commands in it are parsed by `xtask`'s own test of the command line, Rust in it is compiled by
//! the doctests of `jostle-bench`, and `cargo xtask ci` builds it with mdBook.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const NO_OVERRIDES: &[&str] = &[];

/// A fenced block: where, its language, its text.
struct Block {
    place: String,
    language: String,
    text: String,
}

#[test]
fn the_summary_lists_every_page_once() {
    let docs = workspace().join("docs");
    let listed: Vec<String> =
        links(&text(&docs.join("SUMMARY.md"))).into_iter().map(|(_, target)| target).collect();
    let unique: BTreeSet<&String> = listed.iter().collect();
    assert_eq!(unique.len(), listed.len(), "a page is listed twice");
    let names = fs::read_dir(&docs).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let pages: BTreeSet<String> =
        names.filter(|name| is_markdown(Path::new(name)) && name != "SUMMARY.md").collect();
    assert_eq!(unique.into_iter().cloned().collect::<BTreeSet<_>>(), pages);
}

#[test]
fn every_link_leads_somewhere() {
    let mut broken = Vec::new();
    let mut n_links = 0;
    for page in pages() {
        for (line, target) in links(&text(&page)) {
            n_links += 1;
            if let Err(why) = resolve(&page, &target) {
                broken.push(format!("{}:{line}: {target}: {why}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(n_links > 30, "only {n_links} links were found");
}

#[test]
fn every_source_file_that_is_named_is_there() {
    let mut missing = Vec::new();
    let mut n_named = 0;
    for page in pages().iter().filter(|page| !page.ends_with("CHANGELOG.md")) {
        for (line, name) in named_sources(&text(page)) {
            n_named += 1;
            let folder = page.parent().unwrap();
            let bases = [workspace(), workspace().join("crates"), folder.to_owned(), folder.join("src")];
            if !bases.iter().any(|base| base.join(&name).is_file()) {
                missing.push(format!("{}:{line}: {name}", page.display()));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(n_named > 50, "only {n_named} names were found");
}

#[test]
fn every_block_says_its_language_and_toml_is_what_it_claims() {
    let mut n_configurations = 0;
    for page in pages() {
        for block in blocks(&page) {
            assert!(!block.language.is_empty(), "{}: a block without a language", block.place);
            if block.language == "toml" {
                n_configurations += 1;
                check_toml(&block);
            }
        }
    }
    assert!(n_configurations >= 10, "only {n_configurations} blocks of TOML were found");
}

#[test]
fn rust_in_the_book_is_compiled() {
    let included = text(&workspace().join("crates/bench/src/documents.rs"));
    let docs = workspace().join("docs");
    for page in pages().into_iter().filter(|page| page.starts_with(&docs)) {
        for block in blocks(&page).iter().filter(|block| block.language.starts_with("rust")) {
            assert!(!block.language.contains("ignore"), "{}: a block that is not compiled", block.place);
            let name = page.file_name().unwrap().to_str().unwrap();
            assert!(included.contains(&format!("docs/{name}")), "{}: no crate compiles this", block.place);
        }
    }
}

/// A map, a suite, a plan of a sweep or its part for Slurm, or else a part of a training
/// configuration.
fn check_toml(block: &Block) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.toml");
    let has = |line: &str| block.text.lines().any(|found| found == line);
    fs::write(&path, &block.text).unwrap();
    if has("[[scene]]") {
        if let Err(error) = jostle_eval::suite::Suite::read(&path) {
            panic!("{}: {error}", block.place);
        }
    } else if has("[[variant]]") {
        check_plan(
            block,
            &path,
            &block.text.replace("out = \"runs/", "out = \"target/tmp/runs-of-the-book/"),
        );
    } else if has("[slurm]") {
        let plan = "out = \"target/tmp/runs-of-the-book\"\nbase = \"configs/headline.toml\"\nseeds = [1]\n";
        check_plan(block, &path, &format!("{plan}[[variant]]\nname = \"a\"\n{}", block.text));
    } else if has("[[obstacle]]") {
        let mut config = jostle_sim::SimConfig::default();
        config.room.map = Some(path);
        if let Err(error) = jostle_sim::maps::scenario(&config.room) {
            panic!("{}: {error}", block.place);
        }
    } else if let Err(error) = jostle_ppo::Config::parse(&block.text, &block.place, NO_OVERRIDES) {
        panic!("{error}");
    }
}

/// `sweep --print` checks all of a plan and writes nothing.
fn check_plan(block: &Block, path: &Path, plan: &str) {
    fs::write(path, plan).unwrap();
    let mut sweep = std::process::Command::new(env!("CARGO_BIN_EXE_xtask"));
    let answer = sweep.arg("sweep").arg(path).arg("--print").current_dir(workspace()).output().unwrap();
    assert!(answer.status.success(), "{}: {}", block.place, String::from_utf8_lossy(&answer.stderr));
}

/// The target of a page's link: another site (not asked), a file, a heading.
fn resolve(page: &Path, target: &str) -> Result<(), String> {
    if target.starts_with("https://") || target.starts_with("http://") || target.starts_with("mailto:") {
        return Ok(());
    }
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = if file.is_empty() { page.to_owned() } else { page.parent().unwrap().join(file) };
    if !path.exists() {
        return Err("no such file".to_owned());
    }
    match anchor {
        Some(anchor) if !headings(&text(&path)).contains(anchor) => Err("no such heading".to_owned()),
        _ => Ok(()),
    }
}

/// The headings' names in links: lower case, spaces as hyphens, punctuation left out.
fn headings(text: &str) -> BTreeSet<String> {
    let prose = outside_blocks(text);
    let name = |(_, line): &(usize, String)| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || *c == ' ' || *c == '-' || *c == '_');
        kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>()
    };
    prose.iter().filter(|(_, line)| line.starts_with('#')).map(name).collect()
}

/// Targets of links and images with their lines; code is left out.
fn links(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (number, line) in outside_blocks(text) {
        // Every second part lies between backticks.
        let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        let mut rest = prose.as_str();
        while let Some((_, after)) = rest.split_once("](") {
            let Some((target, after)) = after.split_once(')') else { break };
            found.push((number, target.to_owned()));
            rest = after;
        }
    }
    found
}

/// Paths of source files between backticks, with their lines. A name without a folder is somebody's
/// shorthand and left out.
fn named_sources(text: &str) -> Vec<(usize, String)> {
    let is_source = |name: &str| {
        let suffix = Path::new(name).extension().and_then(|suffix| suffix.to_str());
        name.contains('/') && !name.contains([' ', '*']) && matches!(suffix, Some("rs" | "py" | "js" | "css"))
    };
    let mut found = Vec::new();
    for (number, line) in outside_blocks(text) {
        let code = line.split('`').skip(1).step_by(2).filter(|name| is_source(name));
        found.extend(code.map(|name| (number, name.to_owned())));
    }
    found
}

fn outside_blocks(text: &str) -> Vec<(usize, String)> {
    let mut inside = false;
    let mut kept = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
        } else if !inside {
            kept.push((index + 1, line.to_owned()));
        }
    }
    kept
}

fn blocks(page: &Path) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut inside = false;
    for (index, line) in text(page).lines().enumerate() {
        if let Some(language) = line.trim_start().strip_prefix("```") {
            inside = !inside;
            if inside {
                let place = format!("{}:{}", page.display(), index + 1);
                found.push(Block { place, language: language.trim().to_owned(), text: String::new() });
            }
        } else if inside {
            let block = found.last_mut().unwrap();
            block.text += line;
            block.text.push('\n');
        }
    }
    assert!(!inside, "{}: a block without an end", page.display());
    found
}

/// The book's pages and the documents beside the code.
fn pages() -> Vec<PathBuf> {
    let root = workspace();
    let mut found = Vec::new();
    let mut folders = vec![root.join("docs"), root.join("crates")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if is_markdown(&path) {
                found.push(path);
            }
        }
    }
    let names = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"];
    found.extend(names.map(|name| root.join(name)));
    found.sort();
    found
}

fn is_markdown(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "md")
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}
