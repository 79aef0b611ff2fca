//! Pages, pictures and lists that a person looks at. Each must hold the data that it claims to
//! show.

use crate::common;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::tiny::finished_run;
use crate::common::{accepted, refused, text};
use serde_json::Value;

/// The data inside a page.
fn data_of(page: &str) -> Value {
    let start = page.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + page[start..].find("</script>").unwrap();
    serde_json::from_str(&page[start..end]).unwrap()
}

/// Every element of an SVG is closed, in the order of nesting.
#[track_caller]
fn check_svg(svg: &str) {
    let mut open = Vec::new();
    let mut rest = svg;
    while let Some(start) = rest.find('<') {
        let end = start + rest[start..].find('>').unwrap();
        let tag = &rest[start + 1..end];
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name));
        } else if !tag.ends_with('/') && !tag.starts_with(['?', '!']) {
            open.push(name);
        }
        rest = &rest[end + 1..];
    }
    assert!(open.is_empty() && svg.contains("<svg"), "{open:?}");
    assert!(!svg.contains("NaN"));
}

#[test]
fn a_replay_shows_the_episodes_that_evaluate_records() {
    let folder = tempfile::tempdir().unwrap();
    let (records, out) = (folder.path().join("records"), folder.path().join("page"));
    let run = text(finished_run());
    accepted(&["evaluate", run, "--crowds", "SF", "--episodes", "3", "--out", text(&records)]);
    accepted(&["replay", run, "--against", "goal-seeker", "--episodes", "3", "--out", text(&out)]);
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(
        !page.contains("http:")
            && !page.contains("https:")
            && !page.contains("src=")
            && !page.contains("@import")
    );
    assert!(!page.contains("{{"));
    let data = data_of(&page);
    assert_eq!(data["policies"].as_array().unwrap().len(), 2);
    let file = fs::read_dir(records.join("records")).unwrap().next().unwrap().unwrap().path();
    let lines = fs::read_to_string(file).unwrap();
    assert_eq!(data["episodes"].as_array().unwrap().len(), lines.lines().count());
    for (shown, line) in data["episodes"].as_array().unwrap().iter().zip(lines.lines()) {
        let record: Value = serde_json::from_str(line).unwrap();
        assert_eq!(shown["episode"], record["episode"]);
        assert_eq!(shown["goal"], record["goal"]);
        let run = &shown["runs"][0];
        assert_eq!((&run["outcome"], &run["steps"]), (&record["outcome"], &record["steps"]));
        // Three numbers of two bytes for each frame, in base 64.
        let frames = record["steps"].as_u64().unwrap() as usize + 1;
        assert_eq!(run["robot"].as_str().unwrap().len(), (6 * frames).div_ceil(3) * 4);
    }
}

#[test]
fn episodes_are_searched_by_their_end() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path());
    accepted(&[
        "replay",
        "goal-seeker",
        "--crowd",
        "VO",
        "--episodes",
        "2",
        "--outcome",
        "success",
        "--out",
        out,
    ]);
    let data = data_of(&fs::read_to_string(folder.path().join("index.html")).unwrap());
    let episodes = data["episodes"].as_array().unwrap();
    assert_eq!(episodes.len(), 2);
    assert!(episodes.iter().all(|episode| episode["runs"][0]["outcome"] == "success"));
}

#[test]
fn planners_are_named_where_policies_are() {
    let folder = tempfile::tempdir().unwrap();
    let (out, page) = (folder.path().join("records"), folder.path().join("page"));
    let evaluate = ["evaluate", "brake", "--crowds", "straight", "--episodes", "4", "--out", text(&out)];
    let printed = accepted(&evaluate);
    assert!(printed.starts_with("brake (sha256 ") && printed.contains("N = 5"), "{printed}");
    assert!(printed.contains("brake is a planner"), "{printed}");
    let report = fs::read(out.join("brake-z0.json")).unwrap();
    // Records are found again by the planner's identity.
    let again = common::jostle(&evaluate);
    assert!(!String::from_utf8_lossy(&again.stderr).contains("episodes"), "run twice");
    assert!(fs::read(out.join("brake-z0.json")).unwrap() == report && out.join("records").is_dir());
    let crowds = ["--crowds", "VO", "--episodes", "2", "--out", text(&out)];
    assert!(accepted(&[&["evaluate", "orca"], &crowds[..]].concat()).contains("knows everyone's position"));
    accepted(&["replay", "dwa", "--against", "social-force", "--episodes", "2", "--out", text(&page)]);
    let data = data_of(&fs::read_to_string(page.join("index.html")).unwrap());
    assert_eq!(
        (&data["policies"][0]["name"], &data["policies"][1]["name"]),
        (&"dwa".into(), &"social-force".into())
    );
    refused(&["evaluate", "dwx"], &["dwx", "did you mean dwa?"]);
    refused(&["replay", "social_force"], &["social_force", "did you mean social-force?"]);
    refused(&["evaluate", "dwa", "--token", "1", "--crowds", "VO"], &["token: found 1", "dwa"]);
    refused(&["replay", "dwa", "--token", "1"], &["token: found 1", "dwa"]);
}

#[test]
fn learned_crowds_ask_for_their_pool() {
    refused(&["replay", "goal-seeker", "--crowd", "IN"], &["IN", "--pool", "SF"]);
    refused(&["replay", "goal-seeker", "--episodes", "0"], &["--episodes"]);
    refused(&["replay", "no-such-run"], &["no-such-run"]);
}

#[test]
fn the_demo_names_its_page() {
    let folder = tempfile::tempdir().unwrap();
    let printed = accepted(&["demo", "--no-open", "--out", text(folder.path())]);
    let page = folder.path().join("index.html");
    assert_eq!(printed.lines().last(), Some(text(&page)));
    let data = data_of(&fs::read_to_string(page).unwrap());
    assert_eq!(data["episodes"].as_array().unwrap().len(), 20);
}

#[test]
fn curves_and_bars_are_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("plots");
    let printed = accepted(&["plot", text(finished_run()), "--window", "2", "--out", text(&out)]);
    let curves = fs::read_to_string(out.join("curves.svg")).unwrap();
    assert!(printed.contains("curves.svg") && curves.contains("Success of training episodes"));
    check_svg(&curves);

    let table = folder.path().join("table1.json");
    fs::write(&table, jostle_study::success_tables::table_1().json()).unwrap();
    accepted(&["plot", text(&table), "--out", text(&out)]);
    let bars = fs::read_to_string(out.join("table1.svg")).unwrap();
    check_svg(&bars);
    assert!(bars.contains("Table 1") && bars.contains("SF"));
    refused(&["plot", text(folder.path())], &["holds no run"]);
}

#[test]
fn tokens_become_a_grid() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path());
    for token in ["0", "1"] {
        accepted(&[
            "evaluate",
            text(finished_run()),
            "--crowds",
            "SF",
            "--episodes",
            "2",
            "--token",
            token,
            "--out",
            out,
        ]);
    }
    let files = ["0", "1"].map(|token| format!("{out}/run-z{token}.json"));
    let printed = accepted(&["plot", &files[0], &files[1], "--out", out]);
    let grid = fs::read_to_string(printed.trim()).unwrap();
    check_svg(&grid);
    assert!(grid.contains("z = 1") && grid.contains("2 episodes a cell"));
    refused(&["plot", &files[0], &files[0], "--out", out], &["token 0", "twice"]);
}

#[test]
fn runs_are_listed_with_their_state() {
    let listed = accepted(&["runs", text(finished_run().parent().unwrap())]);
    let line = listed.lines().nth(1).unwrap();
    assert!(line.contains("finished") && line.contains("4/4"), "{listed}");
}

#[test]
fn a_comparison_names_what_differs() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other");
    common::tiny::train(&other, &["seed=2", "updates=2"]);
    let printed = accepted(&["compare", text(finished_run()), text(&other)]);
    let line =
        |start: &str| printed.lines().find(|line| line.starts_with(start)).unwrap_or_default().to_owned();
    assert_eq!(line("seed").split_whitespace().collect::<Vec<_>>(), ["seed", "1", "2"]);
    assert!(line("updates made").contains("4/4") && line("updates made").contains("2/2"));
    assert!(!printed.contains("gamma") && printed.contains("over updates 1 to 2"), "{printed}");
}

#[test]
fn milestones_stand_where_the_log_has_them() {
    let printed = accepted(&["milestones", text(finished_run()), "--at", "2,4,5", "--window", "2"]);
    let log = fs::read_to_string(finished_run().join("log.ndjson")).unwrap();
    let diversity: Vec<f64> = log
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["diversity"].as_f64().unwrap())
        .collect();
    let row = |update: usize| {
        let rows = printed.lines().map(|line| line.split('|').map(str::trim).collect::<Vec<_>>());
        rows.filter(|row| row.len() == 14).find(|row| row[2] == update.to_string())
    };
    for end in [2, 4] {
        let mean = diversity[end - 2..end].iter().sum::<f64>() / 2.0;
        assert_eq!(row(end).expect("a row for each update asked for")[10], format!("{mean:.3}"), "{printed}");
    }
    assert!(row(5).is_none(), "the run has four updates: {printed}");
    assert!(printed.contains("`horizon="), "what the run varies: {printed}");
    refused(&["milestones", "nowhere"], &["nowhere"]);
}

#[test]
fn shipped_curves_are_drawn_and_read_like_runs() {
    let folder = tempfile::tempdir().unwrap();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../checkpoints");
    accepted(&["plot", text(&shipped), "--window", "100", "--out", text(folder.path())]);
    let curves = fs::read_to_string(folder.path().join("curves.svg")).unwrap();
    check_svg(&curves);
    // The pool's seeds are those of the baseline's setting: one curve.
    assert!(curves.contains("m1-seed1 and ") && curves.contains("m5-seed1"), "labels");
    // They do not hold the return of an episode.
    assert!(curves.contains("Task reward of a step") && !curves.contains("Return of an episode"), "titles");

    let printed = accepted(&["milestones", text(&shipped), "--at", "5000", "--window", "100"]);
    let curve = fs::read_to_string(shipped.join("curves/m1-seed1.csv")).unwrap();
    let (mut ended, mut success) = (0.0, 0.0);
    for line in curve.lines().rev().take(4) {
        let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        assert_eq!(fields[1], 25.0, "four windows are 100 updates");
        (ended, success) = (ended + fields[2], success + fields[3]);
    }
    let row = printed.lines().find(|line| line.starts_with("| m1-seed1 | 5000 |")).expect("a row");
    assert!(row.contains(&format!("| {:.3} [", success / ended)), "{row}: {success} of {ended}");
}

#[test]
fn each_behaviour_of_a_run_has_its_line() {
    let before = fs::read(finished_run().join("log.ndjson")).unwrap();
    let printed = accepted(&["behaviours", text(finished_run()), "--rollouts", "3"]);
    let rows: Vec<Vec<&str>> = printed
        .lines()
        .map(|line| line.split('|').map(str::trim).collect::<Vec<_>>())
        .filter(|row| row.len() == 13 && row[1].parse::<u32>().is_ok())
        .collect();
    let config = fs::read_to_string(finished_run().join("config.toml")).unwrap();
    let config: toml::Table = config.parse().unwrap();
    assert_eq!(rows.len() as i64, config["n_behaviours"].as_integer().unwrap(), "{printed}");
    for (token, row) in rows.iter().enumerate() {
        assert_eq!(row[1], token.to_string());
        let speed: f64 = row[6].parse().unwrap();
        assert!((0.0..=1.0).contains(&speed), "{printed}");
        // The intrinsic reward is what the two discriminators differ by, to the digits that are
        // shown.
        let [intrinsic, sa, s] = [9, 10, 11].map(|at| row[at].parse::<f64>().unwrap());
        assert!((intrinsic - (sa - s)).abs() < 0.011 + 0.001, "{printed}");
    }
    let alpha = config["alpha"].as_float().unwrap();
    assert!(printed.contains(&format!("α = {alpha}, weighs the reward.")), "{printed}");
    assert_eq!(printed, accepted(&["behaviours", text(finished_run()), "--rollouts", "3"]));
    assert_eq!(fs::read(finished_run().join("log.ndjson")).unwrap(), before, "a look changes nothing");
    refused(&["behaviours", "nowhere"], &["nowhere", "expected a run folder or a checkpoint"]);
    refused(&["behaviours", text(finished_run()), "--rollouts", "0"], &["--rollouts", "found 0"]);
}

#[test]
fn an_event_file_has_a_record_for_each_update() {
    let folder = tempfile::tempdir().unwrap();
    let printed = accepted(&["tensorboard", text(finished_run()), "--out", text(folder.path())]);
    let bytes = fs::read(printed.trim()).unwrap();
    let (mut at, mut records) = (0, 0);
    while at < bytes.len() {
        let length = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        at += 16 + length as usize;
        records += 1;
    }
    assert_eq!((at, records), (bytes.len(), 1 + 4));
}

#[test]
fn keys_are_explained_and_slips_answered() {
    assert!(accepted(&["config", "explain", "gamma"]).starts_with("gamma = 0.99"));
    refused(&["config", "explain", "gama"], &["gama", "did you mean gamma?"]);
    let schema: Value = serde_json::from_str(&accepted(&["config", "schema"])).unwrap();
    assert_eq!(schema["properties"]["gamma"]["maximum"], 1.0);
}

#[test]
fn play_says_what_it_cannot_play_and_names_its_page() {
    refused(&["play", "--crowd", "IN", "--no-open"], &["IN", "--pool"]);
    refused(&["play", "no-such-run", "--no-open"], &["no-such-run"]);
    let mut server = Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(["play", "--no-open", "--seed", "7"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address =
        line.trim().strip_prefix("http://").and_then(|rest| rest.strip_suffix('/')).unwrap().to_owned();
    let page = get(&address, &address);
    let stranger = get(&address, "elsewhere.example");
    server.kill().unwrap();
    server.wait().unwrap();
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("jostle: live"), "{page}");
    assert!(!page.contains("{{") && !page.contains("https:") && !page.contains("src="));
    assert!(stranger.starts_with("HTTP/1.1 403"), "{stranger}");
}

/// Asks a server for its page under a name.
fn get(address: &str, host: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET / HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    let mut reply = String::new();
    stream.read_to_string(&mut reply).unwrap();
    reply
}

#[test]
fn the_doctor_looks_at_everything() {
    let printed = accepted(&["doctor", "--runs", text(finished_run().parent().unwrap())]);
    for what in ["toolchain", "cores", "memory", "disk", "CPU features", "checkout", "leftovers"] {
        assert!(printed.contains(what), "no {what} in {printed}");
    }
}

#[test]
fn every_help_has_an_example() {
    let help = accepted(&["--help"]);
    let listed =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<&str> = listed.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(commands.len() > 15 && commands.contains(&"play"), "{commands:?}");
    for command in commands.into_iter().filter(|command| *command != "help") {
        let help = accepted(&[command, "--help"]);
        assert!(help.contains(&format!("jostle {command}")), "{help}");
    }
}
