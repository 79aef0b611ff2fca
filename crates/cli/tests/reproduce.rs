//! From training runs to shipped policies, tables, verdicts and figures, with policies that a test
//! can afford.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::common::{accepted, jostle, refused, text};

/// Small enough for a test: two agents with 16 beams. Five behaviours, as the base setting has.
const BASE: &str = "updates = 4\ncheckpoint_every = 1\nN = 2\nM = 5\nhorizon = 16\nminibatch = 16\n\
    [sim.laser]\nbeams = 16\n[network]\nembedding = 4\nlaser_feature = 32\nhidden = 32\n[discriminator]\nhidden = 32\n";
const BASELINE: [&str; 4] = ["n_behaviours=1", "intrinsic_reward=none", "alpha=0", "network.embedding_std=3"];

/// Runs of two rows with two seeds each and of two pedestrians, and where they are shipped.
struct Shipped {
    folder: PathBuf,
}

impl Shipped {
    fn path(&self, name: &str) -> String {
        text(&self.folder.join(name)).to_owned()
    }

    /// A command of `reproduce` on the shipped policies.
    fn reproduce(&self, target: &str, out: &str, more: &[&str]) -> Vec<String> {
        let words = ["reproduce", target, "--episodes", "6", "--base"].map(str::to_owned);
        let places = [self.path("base.toml"), "--checkpoints".to_owned(), self.path("checkpoints")];
        let out = ["--out".to_owned(), self.path(out)];
        words.into_iter().chain(places).chain(out).chain(more.iter().map(|word| (*word).to_owned())).collect()
    }
}

fn strs(words: &[String]) -> Vec<&str> {
    words.iter().map(String::as_str).collect()
}

fn train(base: &Path, out: &Path, overrides: &[&str]) {
    let mut words = vec!["train", "--config", text(base), "--out", text(out), "--threads", "1"];
    words.extend(overrides.iter().flat_map(|setting| ["--set", setting]));
    accepted(&words);
}

/// Everything that the tests read; they change copies alone.
fn shipped() -> &'static Shipped {
    static SHIPPED: OnceLock<Shipped> = OnceLock::new();
    SHIPPED.get_or_init(|| {
        // The guard would never be dropped; the system clears its temporary folder.
        let folder = tempfile::tempdir().unwrap().keep();
        let base = folder.join("base.toml");
        fs::write(&base, BASE).unwrap();
        let run = |name: &str, seed: &str, more: &[&str]| {
            let seed = format!("seed={seed}");
            train(&base, &folder.join(name), &[&[seed.as_str()], more].concat());
        };
        let mut runs = Vec::new();
        for seed in ["1", "2"] {
            run(&format!("m1-{seed}"), seed, &BASELINE);
            run(&format!("m5-{seed}"), seed, &[]);
            runs.extend([format!("m1-{seed}"), format!("m5-{seed}")]);
        }
        for seed in ["101", "102"] {
            run(&format!("pool-{seed}"), seed, &BASELINE);
            runs.push(format!("pool-{seed}"));
        }
        let shipped = Shipped { folder };
        let paths: Vec<String> = runs.iter().map(|run| shipped.path(run)).collect();
        let (base, out) = (shipped.path("base.toml"), shipped.path("checkpoints"));
        accepted(&[&["ship", "--base", &base, "--out", &out], &strs(&paths)[..]].concat());
        shipped
    })
}

/// A copy of the shipped folder that a test may damage.
fn copy() -> tempfile::TempDir {
    let (copy, from) = (tempfile::tempdir().unwrap(), shipped().folder.join("checkpoints"));
    fs::create_dir(copy.path().join("curves")).unwrap();
    for below in ["", "curves"] {
        for entry in fs::read_dir(from.join(below)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                fs::copy(&path, copy.path().join(below).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    copy
}

#[test]
fn runs_are_shipped_under_the_rows_that_they_serve() {
    let shipped = shipped();
    let manifest = fs::read_to_string(shipped.folder.join("checkpoints/manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let names: Vec<&str> = manifest["policies"]
        .as_array()
        .unwrap()
        .iter()
        .map(|policy| policy["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        [
            "m1-seed1-000004",
            "m1-seed2-000004",
            "m5-seed1-000004",
            "m5-seed2-000004",
            "pool-seed101-000002",
            "pool-seed101-000004",
            "pool-seed102-000002",
            "pool-seed102-000004",
        ]
    );
    let policy = &manifest["policies"][4];
    assert_eq!((policy["serves"][0].as_str(), policy["precision"].as_str()), (Some("crowd SO"), Some("f16")));
    let run = &manifest["runs"][2];
    assert_eq!((run["updates"].as_u64(), run["transitions"].as_u64()), (Some(4), Some(128)));
    assert_eq!(
        (run["config"]["n_behaviours"].as_u64(), run["config"]["sim"]["laser"]["beams"].as_u64()),
        (Some(5), Some(16))
    );
    assert!(run["wall_seconds"].as_f64().unwrap() > 0.0);
    let (base, folder) = (shipped.path("base.toml"), shipped.path("checkpoints"));
    let printed = accepted(&["verify", "checkpoints", "--checkpoints", &folder, "--base", &base]);
    assert!(
        printed.contains("m5-seed1: 4 updates, 4 of them to the byte\n") && printed.contains("8 policies"),
        "{printed}"
    );
}

#[test]
fn a_shipped_curve_is_made_again_to_the_byte() {
    let folder = shipped().path("checkpoints");
    let printed = accepted(&["verify", "curve", "m5-seed2", "--updates", "3", "--checkpoints", &folder]);
    assert_eq!(printed, "m5-seed2: the first 3 updates are the shipped ones, byte for byte\n");
    refused(
        &["verify", "curve", "m5-seed2", "--updates", "5", "--checkpoints", &folder],
        &["--updates", "found 5", "1 to 4"],
    );
    refused(&["verify", "curve", "m9", "--checkpoints", &folder], &["no run m9", "m5-seed1"]);
}

#[test]
fn a_curve_that_moved_names_update_and_field() {
    let copy = copy();
    let path = copy.path().join("curves/m5-seed1.first.ndjson");
    let lines = fs::read_to_string(&path).unwrap();
    let second = lines.lines().nth(1).unwrap();
    let value = second.split("\"value_loss\":").nth(1).unwrap().split(',').next().unwrap();
    let moved = lines.replacen(value, "1.25", 1);
    fs::write(&path, &moved).unwrap();
    let folder = text(copy.path());
    refused(
        &["verify", "curve", "m5-seed1", "--updates", "4", "--checkpoints", folder],
        &["sha256", "m5-seed1.first.ndjson"],
    );
    let manifest = copy.path().join("manifest.json");
    let sha = |text: &str| jostle_arena::identity::hex_sha256(text.as_bytes());
    let changed = fs::read_to_string(&manifest).unwrap().replace(&sha(&lines), &sha(&moved));
    fs::write(&manifest, changed).unwrap();
    let output = jostle(&["verify", "curve", "m5-seed1", "--updates", "4", "--checkpoints", folder]);
    let message = String::from_utf8(output.stderr).unwrap();
    let expected =
        format!("m5-seed1: update 2 is not the shipped one: value_loss: shipped 1.25, now {value}");
    assert!(!output.status.success() && message.contains(&expected), "{message}");
}

#[test]
fn tables_are_the_same_from_stored_and_from_fresh_cells() {
    let shipped = shipped();
    let words = shipped.reproduce("table1", "results", &[]);
    let first = accepted(&strs(&words));
    for part in [
        "Table 1. Success rate",
        "paper    0.87",
        "M 1, updates 5000, updates/M 5000: trained for 4 updates, not for the paper's 5000",
        "M 1, updates 5000, updates/M 5000: m1-seed2-000004 (sha256",
        "M 10, updates 5000, updates/M 500: not trained yet; `cargo xtask reproduce table1 --train --rows m10` trains it",
        "dwa                             –        –          planner",
        "orca (knows positions)",
        "straight: against M = 1: NH ",
        "Not trained yet",
        "  m20: 20000 updates, 1 seed, about ",
    ] {
        assert!(first.contains(part), "no {part:?} in\n{first}");
    }
    let results = shipped.folder.join("results");
    let csv = fs::read_to_string(results.join("table1.csv")).unwrap();
    // Two trained rows: seven columns with two seeds and their pool; four rows without; five
    // planners.
    assert_eq!(csv.lines().count(), 1 + 2 * 7 * 3 + 4 * 7 + 5 * 7);
    for extension in ["md", "tex", "json"] {
        assert!(fs::metadata(results.join(format!("table1.{extension}"))).unwrap().len() > 500);
    }
    let cells = || fs::read_dir(results.join("cells")).unwrap().count();
    assert_eq!(cells(), (2 * 2 + 5) * 6);
    let markdown = fs::read(results.join("table1.md")).unwrap();
    let again = jostle(&strs(&words));
    assert!(String::from_utf8(again.stderr).unwrap().contains("54 cells read, 0 run, 0 run again"));
    let fresh = jostle(&strs(&shipped.reproduce("table1", "results", &["--fresh", "--threads", "1"])));
    assert!(String::from_utf8(fresh.stderr).unwrap().contains("54 run again with the same result"));
    assert_eq!(fs::read(results.join("table1.md")).unwrap(), markdown);
    let folder = shipped.path("checkpoints");
    let verify = ["verify", "results", "--out", text(&results), "--checkpoints"];
    let printed = accepted(&[&verify[..], &[folder.as_str()]].concat());
    assert!(printed.starts_with("54 cells, 324 episodes"), "{printed}");
    // The cells serve no row beside other policies.
    refused(&verify[..4], &["-z0-", "policy ", "checkpoints/manifest.json", "remove it"]);
}

#[test]
fn what_the_repository_holds_is_what_it_says() {
    let printed = accepted(&["verify", "checkpoints"]);
    assert!(printed.contains("m5-seed1: 5000 updates, 50 of them to the byte"), "{printed}");
    let printed = accepted(&["verify", "results"]);
    assert!(printed.contains(" cells, "), "{printed}");
}

#[test]
fn a_stored_cell_that_is_wrong_is_found() {
    let shipped = shipped();
    accepted(&strs(&shipped.reproduce("table2", "spoilt", &[])));
    let cells = shipped.folder.join("spoilt/cells");
    let path = fs::read_dir(&cells).unwrap().next().unwrap().unwrap().path();
    let sound = fs::read_to_string(&path).unwrap();
    let name = path.file_name().unwrap().to_str().unwrap().to_owned();
    let last = sound.lines().last().unwrap();
    let steps = last.split(' ').nth(1).unwrap();
    let moved = format!("{} 399 ", &last[..1]);
    fs::write(&path, sound.replace(last, &last.replacen(&format!("{} {steps} ", &last[..1]), &moved, 1)))
        .unwrap();
    let output = jostle(&strs(&shipped.reproduce("table2", "spoilt", &["--fresh"])));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && message.contains("episode 5 now comes out otherwise"), "{message}");
    fs::write(&path, "nonsense\n").unwrap();
    let output = jostle(&strs(&shipped.reproduce("table2", "spoilt", &[])));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains(&name) && message.contains("line 1"), "{message}");
}

#[test]
fn everything_is_reproduced_from_shipped_policies() {
    let shipped = shipped();
    let printed = accepted(&strs(&shipped.reproduce("all", "everything", &[])));
    for part in [
        "Table 2.",
        "Table 3.",
        "σ = (",
        "Table 4.",
        "extra distance ≤ v_max · extra time",
        "Table 5.",
        "every behaviour token",
        "how episodes end",
        "The paper's claims",
        "not tested",
        "figure-loss.csv",
        "figure-paths.csv",
        "cargo xtask reproduce table5 --mujoco runs what is missing",
    ] {
        assert!(printed.contains(part), "no {part:?} in\n{printed}");
    }
    let results = shipped.folder.join("everything");
    let dynamics = fs::read_to_string(results.join("dynamics.csv")).unwrap();
    assert!(dynamics.lines().any(|line| line.contains("mujoco")), "{dynamics}");
    for cell in fs::read_dir(results.join("cells")).unwrap() {
        let head = fs::read_to_string(cell.unwrap().path()).unwrap();
        assert!(!head.contains("simulator"), "none but our own without --mujoco");
    }
    let claims: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(results.join("claims.json")).unwrap()).unwrap();
    let headline = &claims[0];
    assert_eq!(headline["id"], "headline");
    // Policies that know nothing confirm nothing.
    assert_eq!(headline["verdict"], "not_confirmed");
    assert_eq!(headline["parts"][0]["pairs"].as_array().unwrap().len(), 2);
    assert_eq!(headline["shorter"][0], serde_json::json!(["m5", 4, 5000]));
    let paths = fs::read_to_string(results.join("figure-paths.csv")).unwrap();
    for token in 0..5 {
        assert!(paths.contains(&format!("\n{token},0,0.0000,0.0000,")), "{token}");
    }
    let losses = fs::read_to_string(results.join("figure-loss.csv")).unwrap();
    assert_eq!(losses.lines().count(), 1 + 4);
    let tokens = fs::read_to_string(results.join("tokens.csv")).unwrap();
    assert_eq!(tokens.lines().count(), 1 + 5 * 7 * 3);
}

#[test]
fn a_foreign_run_is_not_shipped() {
    let shipped = shipped();
    let run = shipped.folder.join("foreign");
    let base = shipped.folder.join("base.toml");
    train(&base, &run, &["gamma=0.5", "updates=1"]);
    let out = tempfile::tempdir().unwrap();
    let words = ["ship", "--base", text(&base), "--out", text(out.path()), text(&run)];
    refused(&words, &["foreign cannot be shipped", "nearest is m5", "gamma: found 0.5, expected 0.99"]);
    assert!(!out.path().join("manifest.json").exists());
    // The same name with other content is replaced on demand alone.
    let copy = copy();
    let other = shipped.folder.join("m5-other");
    train(&base, &other, &["seed=1", "updates=2"]);
    let words = ["ship", "--base", text(&base), "--out", text(copy.path()), text(&other)];
    refused(&words, &["m5-seed1 is shipped already", "--replace"]);
    let printed = accepted(&[&words[..], &["--replace"]].concat());
    assert!(
        printed.contains("m5-seed1-000002  f16  Table 1: M = 5 (trained for 2 updates only)"),
        "{printed}"
    );
}

#[test]
fn a_damaged_folder_is_refused_in_one_line() {
    let base = shipped().path("base.toml");
    let check = |change: &dyn Fn(&Path), parts: &[&str]| {
        let copy = copy();
        change(copy.path());
        let out = copy.path().join("results");
        let folder = text(copy.path());
        refused(&["verify", "checkpoints", "--checkpoints", folder, "--base", &base], parts);
        let words = [
            "reproduce",
            "table1",
            "--episodes",
            "2",
            "--base",
            &base,
            "--checkpoints",
            folder,
            "--out",
            text(&out),
        ];
        refused(&words, parts);
    };
    let edit = |folder: &Path, from: &str, to: &str| {
        let path = folder.join("manifest.json");
        let manifest = fs::read_to_string(&path).unwrap();
        assert!(manifest.contains(from));
        fs::write(path, manifest.replacen(from, to, 1)).unwrap();
    };
    check(
        &|folder| fs::remove_file(folder.join("manifest.json")).unwrap(),
        &["manifest.json is missing", "jostle ship"],
    );
    check(&|folder| edit(folder, "\"runs\": [", "\"runs\": ("), &["manifest.json", "line"]);
    check(&|folder| edit(folder, "\"seed\"", "\"sede\""), &["manifest.json", "sede"]);
    check(
        &|folder| edit(folder, "jostle-checkpoints-1", "jostle-checkpoints-9"),
        &["format: found jostle-checkpoints-9"],
    );
    check(
        &|folder| edit(folder, "\"run\": \"pool-seed101\"", "\"run\": \"pool-seed109\""),
        &["run pool-seed109 is not listed"],
    );
    check(
        &|folder| edit(folder, "\"file\": \"pool-seed101-000004.safetensors\"", "\"file\": \"../x\""),
        &["file: found \"../x\"", "below the folder"],
    );
    check(
        &|folder| {
            let path = folder.join("pool-seed101-000004.safetensors");
            let mut bytes = fs::read(&path).unwrap();
            let last = bytes.len() - 1;
            bytes[last] ^= 1;
            fs::write(&path, bytes).unwrap();
        },
        &["pool-seed101-000004.safetensors", "sha256"],
    );
    check(
        &|folder| fs::remove_file(folder.join("pool-seed102-000004.safetensors")).unwrap(),
        &["cannot read", "pool-seed102-000004.safetensors"],
    );
    // A sound policy of another shape under the name of this one.
    check(
        &|folder| {
            let (five, one) =
                (folder.join("m5-seed1-000004.safetensors"), folder.join("pool-seed101-000004.safetensors"));
            let sha = |path: &Path| jostle_arena::identity::hex_sha256(&fs::read(path).unwrap());
            let (from, to) = (sha(&one), sha(&five));
            fs::copy(&five, &one).unwrap();
            edit(folder, &from, &to);
        },
        &["pool-seed101-000004.safetensors", "seed: found 1, the manifest has 101"],
    );
    refused(&["reproduce", "table2", "--preset", "small"], &["--preset small"]);
    refused(&["reproduce", "table2", "--mujoco"], &["--mujoco: found Table2, expected table5 or all"]);
    refused(&["reproduce", "table1", "--rows", "m10"], &["--train"]);
    refused(&["reproduce", "table1", "--train", "--rows", "m7"], &["--rows: found m7", "m10"]);
}
