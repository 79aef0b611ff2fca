//! Checks that the compiler does not make: every source file introduces itself, the library crates
//! keep their promises about randomness, time and iteration order, and the crates depend on one
//! another as ARCHITECTURE.md says.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A line may break a rule where it, or the line before it, says why.
const EXCUSE: &str = "tidy:";
/// The crates of the commands: their errors are sentences for the user, and some of them measure
/// time.
const COMMANDS: [&str; 7] = ["bench", "cli", "conformance", "runs", "study", "view", "xtask"];

#[test]
fn every_file_opens_with_what_it_is() {
    let silent: Vec<PathBuf> =
        sources(&workspace()).into_iter().filter(|path| !text(path).starts_with("//!")).collect();
    assert!(silent.is_empty(), "files that do not open with `//!`: {silent:?}");
}

#[test]
fn comments_end_within_a_hundred_columns() {
    let mut long = Vec::new();
    for path in sources(&workspace()) {
        let mut is_code = false;
        for (index, line) in text(&path).lines().enumerate() {
            let Some(comment) = line.trim_start().strip_prefix("//") else {
                is_code = false;
                continue;
            };
            let words = comment.trim_start_matches(['/', '!']);
            is_code ^= words.trim_start().starts_with("```");
            // Code and tables in comments are as wide as they have to be.
            let is_prose = !is_code && !words.trim_start().starts_with('|') && !words.starts_with("    ");
            if is_prose && line.chars().count() > 100 {
                long.push(format!("{}:{}", path.display(), index + 1));
            }
        }
    }
    assert!(long.is_empty(), "comments of more than 100 columns:\n{}", long.join("\n"));
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
    // The benches measure; the update report keeps its seconds apart from results. Commands wait,
    // and tell how long they take.
    let timed = [
        "bench/",
        "ppo/src/algorithm1.rs",
        "ppo/src/shard.rs",
        "cli/",
        "runs/src/progress.rs",
        "runs/src/run_folder.rs",
        "study/src/cell.rs",
    ]
    .into_iter()
    .chain(["study/src/reproduce/hours.rs", "view/src/demo.rs", "view/src/play/"]);
    let timed: Vec<String> = timed.map(|place| format!("crates/{place}")).collect();
    let timed: Vec<&str> = timed.iter().map(String::as_str).collect();
    check(&["Instant::now", "SystemTime", "std::time"], &timed);
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

#[test]
fn crates_depend_on_one_another_as_the_architecture_says() {
    let page = text(&workspace().join("ARCHITECTURE.md"));
    let section = page.split("## Directions").nth(1).expect("a section of that name");
    let block = section.split("```text\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a block");
    let names: Vec<&str> = block.lines().filter_map(|line| line.split_whitespace().next()).collect();
    let allowed: BTreeMap<String, BTreeSet<String>> = block
        .lines()
        .map(|line| {
            let (name, rest) = line.split_once('→').unwrap_or_else(|| panic!("no arrow in {line:?}"));
            // What follows the last name is a remark.
            let others = rest.split_whitespace().take_while(|word| names.contains(word));
            (name.trim().to_owned(), others.map(str::to_owned).collect())
        })
        .collect();
    let found: BTreeMap<String, BTreeSet<String>> = manifests()
        .into_iter()
        .map(|(name, manifest)| {
            let jostle = dependencies(&manifest);
            (
                name,
                jostle.iter().filter_map(|other| other.strip_prefix("jostle-")).map(str::to_owned).collect(),
            )
        })
        .collect();
    assert_eq!(found, allowed, "manifests on the left, ARCHITECTURE.md on the right");
    // Without circles cargo would refuse the workspace anyway; the order of the block is one that
    // shows it.
    for (at, name) in names.iter().enumerate() {
        assert!(
            allowed[*name].iter().all(|other| names[..at].contains(&other.as_str())),
            "{name} looks down"
        );
    }
}

#[test]
fn what_may_be_left_out_is_optional() {
    let manifests = manifests();
    for (name, dependency) in [("peds", "jostle-policy"), ("python", "pyo3")] {
        let optional = manifests[name]["dependencies"][dependency].get("optional");
        assert_eq!(optional.and_then(toml::Value::as_bool), Some(true), "{dependency} in {name}");
    }
}

/// Other projects depend on these. What they depend on in turn has to be published, too.
#[test]
fn published_crates_say_what_they_are() {
    let manifests = manifests();
    for name in ["sim", "peds", "policy", "kernels"] {
        let package = &manifests[name]["package"];
        let says = |key: &str| package.get(key).unwrap_or_else(|| panic!("{name} does not say its {key}"));
        assert_eq!(says("publish").as_bool(), Some(true), "{name}");
        for key in ["description", "license", "repository", "documentation", "readme"] {
            says(key);
        }
        for (key, most) in [("keywords", 5), ("categories", 5)] {
            let words = says(key).as_array().unwrap_or_else(|| panic!("{key} of {name}"));
            assert!((1..=most).contains(&words.len()), "{name} has {} {key}", words.len());
        }
        for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
            assert!(crate_folder(name).join(file).is_file(), "{name} has no {file}");
        }
        for other in dependencies(&manifests[name]).iter().filter_map(|other| other.strip_prefix("jostle-")) {
            let is_published = manifests[other]["package"].get("publish").and_then(toml::Value::as_bool);
            assert_eq!(is_published, Some(true), "{name} depends on {other}");
        }
    }
}

/// RVO2 is under Apache-2.0: what is derived from it keeps its notice, file by file.
#[test]
fn what_is_ported_from_rvo2_keeps_its_notice() {
    let folder = crate_folder("peds");
    let notice = text(&folder.join("NOTICE"));
    assert!(notice.contains("The files of `src/orca/` except `crowd.rs` are derived from the RVO2 Library"));
    let files = sources(&folder.join("src/orca"));
    assert!(files.len() > 8, "only {} files of the port were found", files.len());
    for file in files.iter().filter(|file| !file.ends_with("crowd.rs")) {
        for line in [
            "//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill",
            "//! SPDX-License-Identifier: Apache-2.0",
        ] {
            assert!(text(file).lines().any(|found| found == line), "{}: expected {line}", file.display());
        }
    }
}

/// Whoever cites, installs or depends on it reads the same version.
#[test]
fn there_is_one_version() {
    let root: toml::Table = toml::from_str(&text(&workspace().join("Cargo.toml"))).unwrap();
    let version = root["workspace"]["package"]["version"].as_str().unwrap();
    let python: toml::Table = toml::from_str(&text(&workspace().join("pyproject.toml"))).unwrap();
    assert_eq!(python["project"]["version"].as_str(), Some(version), "pyproject.toml");
    let citation = text(&workspace().join("CITATION.cff"));
    assert!(
        citation.lines().any(|line| line == format!("version: {version}")),
        "CITATION.cff: expected {version}"
    );
}

/// Otherwise `cargo install --locked --path ros` is refused, and `ci --ros` leaves a changed file.
#[test]
fn the_driver_locks_what_the_crates_need() {
    let lock: toml::Table = toml::from_str(&text(&workspace().join("ros/Cargo.lock"))).unwrap();
    let packages = lock["package"].as_array().unwrap();
    let mut looked_at = 0;
    for (folder, manifest) in manifests() {
        let name = manifest["package"]["name"].as_str().unwrap();
        let Some(locked) = packages.iter().find(|package| package["name"].as_str() == Some(name)) else {
            continue;
        };
        // A version stands behind a name that the file has more than once.
        let locked: BTreeSet<&str> = locked
            .get("dependencies")
            .and_then(toml::Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(|entry| entry.as_str()?.split(' ').next())
            .collect();
        let needed = manifest.get("dependencies").and_then(toml::Value::as_table).into_iter().flatten();
        for (dependency, value) in needed {
            let optional = value.get("optional").and_then(toml::Value::as_bool).unwrap_or(false);
            let package = package(dependency, value);
            assert!(
                optional || locked.contains(package),
                "ros/Cargo.lock: {name} has no {package}, expected what crates/{folder}/Cargo.toml asks for; \
                 `cargo metadata --manifest-path ros/Cargo.toml` adds it"
            );
        }
        looked_at += 1;
    }
    assert!(looked_at > 5, "{looked_at}");
}

#[test]
fn the_checks_and_the_workspace_share_what_they_build() {
    // `cargo xtask` builds the package xtask, its tests build the workspace. A feature that only
    // one of them turns on has its crate, and all that depend on it, built twice.
    let built = |packages: &[&str]| -> BTreeSet<String> {
        let mut cargo = Command::new(jostle_runs::tools::cargo());
        cargo.args(["tree", "--offline", "--edges", "normal,build", "--prefix", "none"]);
        let output = cargo.args(["--format", "{p} {f}"]).args(packages).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let lines = String::from_utf8(output.stdout).unwrap();
        lines.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
    };
    let (checks, all) = (built(&["--package", "xtask"]), built(&["--workspace"]));
    let twice: Vec<&String> = checks.difference(&all).collect();
    assert!(checks.len() > 50 && twice.is_empty(), "built with other features: {twice:?}");
}

#[test]
fn every_file_of_tests_is_run() {
    // With `autotests = false` cargo does not look for them.
    let mut left_out = Vec::new();
    for (name, manifest) in manifests() {
        if manifest["package"].get("autotests").and_then(toml::Value::as_bool) != Some(false) {
            continue;
        }
        let folder = crate_folder(&name);
        let declared: BTreeSet<PathBuf> = manifest["test"]
            .as_array()
            .unwrap_or_else(|| panic!("{name} has no [[test]]"))
            .iter()
            .map(|test| folder.join(test["path"].as_str().expect("a path")))
            .collect();
        let all = text(&folder.join("tests/all.rs"));
        let is_run = |path: &PathBuf| {
            let module = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
            declared.contains(path) || all.lines().any(|line| line == format!("mod {module};"))
        };
        let files = sources(&folder.join("tests"));
        left_out.extend(
            files
                .into_iter()
                .filter(|path| path.parent() == Some(&folder.join("tests")))
                .filter(|path| !is_run(path)),
        );
    }
    assert!(left_out.is_empty(), "files of tests that nothing runs: {left_out:?}");
}

#[test]
fn anyhow_is_for_commands_only() {
    for (name, manifest) in manifests() {
        let found = dependencies(&manifest).contains("anyhow");
        assert_eq!(found, COMMANDS.contains(&&*name), "anyhow in {name}");
    }
}

#[test]
fn a_library_crate_has_one_error_enum() {
    // A kernel cannot fail: operands that do not fit are a fault of the caller, and it panics.
    // Errors of commands are `anyhow`'s; `runs` has its own for what the Python package uses.
    const NONE: [&str; 2] = ["kernels", "python"];
    let has_one = |name: &String| name == "runs" || !(NONE.contains(&&**name) || COMMANDS.contains(&&**name));
    for name in manifests().into_keys().filter(has_one) {
        let folder = crate_folder(&name).join("src");
        let derives = |line: &str| {
            line.trim_start().starts_with("#[derive(") && line.split(['(', ',', ')', ' ']).any(is_error)
        };
        let is_here = |path: &PathBuf| text(path).lines().filter(|line| derives(line)).count();
        let found: Vec<(PathBuf, usize)> = sources(&folder)
            .into_iter()
            .map(|path| (path.strip_prefix(&folder).unwrap().to_owned(), is_here(&path)))
            .filter(|(_, count)| *count > 0)
            .collect();
        assert_eq!(found, [(PathBuf::from("error.rs"), 1)], "errors of {name}");
    }
}

fn is_error(word: &str) -> bool {
    word == "Error" || word == "thiserror::Error"
}

#[test]
fn unsafe_code_is_where_the_page_on_reliability_says() {
    const DENIED: [&str; 2] = ["kernels", "sim"];
    let page = text(&workspace().join("docs/reliability.md"));
    for name in manifests().into_keys() {
        let folder = crate_folder(&name).join("src");
        let root = ["lib.rs", "main.rs"].map(|file| folder.join(file)).into_iter().find(|file| file.exists());
        let rule = if DENIED.contains(&&*name) { "#![deny(unsafe_code)]" } else { "#![forbid(unsafe_code)]" };
        let says = text(&root.expect("a root")).lines().any(|line| line == rule);
        assert!(says, "the root of {name} does not say {rule}");
        for path in sources(&folder) {
            let code = text(&path);
            let mut lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
            let has_unsafe = lines.any(|line| line.contains("unsafe {") || line.contains("unsafe fn "));
            let file = path.file_name().unwrap().to_str().unwrap();
            // `avx2.rs` or `kernels/src/avx2.rs`, between backticks.
            let named = page.contains(&format!("`{file}`")) || page.contains(&format!("/{file}`"));
            assert!(
                !has_unsafe || named,
                "{}: unsafe code that docs/reliability.md does not name",
                path.display()
            );
        }
    }
}

/// The manifests of all crates by their folders' names.
fn manifests() -> BTreeMap<String, toml::Table> {
    let folders = fs::read_dir(workspace().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let found: BTreeMap<String, toml::Table> = folders
        .chain([workspace().join("xtask")])
        .filter(|folder| folder.join("Cargo.toml").exists())
        .map(|folder| {
            let name = folder.file_name().unwrap().to_str().unwrap().to_owned();
            (name, text(&folder.join("Cargo.toml")).parse().unwrap())
        })
        .collect();
    assert!(found.len() >= 10, "{:?}", found.keys());
    found
}

/// All that a crate depends on, in its tests, builds, features and for whatever target, by the
/// packages' names.
fn dependencies(manifest: &toml::Table) -> BTreeSet<String> {
    let targets =
        manifest.get("target").and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::values);
    let tables = targets.filter_map(toml::Value::as_table).chain([manifest]);
    let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
    let lists =
        tables.flat_map(|table| kinds.into_iter().filter_map(move |kind| table.get(kind)?.as_table()));
    lists.flatten().map(|(name, value)| package(name, value).to_owned()).collect()
}

/// The package behind a dependency's name.
fn package<'a>(name: &'a str, value: &'a toml::Value) -> &'a str {
    value.get("package").and_then(toml::Value::as_str).unwrap_or(name)
}

fn crate_folder(name: &str) -> PathBuf {
    if name == "xtask" { workspace().join("xtask") } else { workspace().join("crates").join(name) }
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
    let mut folders: Vec<PathBuf> = if root == workspace() {
        vec![root.join("crates"), root.join("xtask"), root.join("ros")]
    } else {
        vec![root.to_owned()]
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
    assert!(found.len() > 2, "the sources were not found under {}", root.display());
    found
}
