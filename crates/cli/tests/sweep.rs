//! A sweep: what it makes, that it goes on where it stopped, and that a killed one ends with the
//! same bytes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::tiny::TINY;
use crate::common::{accepted, jostle, refused, text};

/// Two variants with two seeds each; more keys of the plan in `more`, more sections in `sections`.
fn plan(folder: &Path, more: &str, sections: &str) -> PathBuf {
    let base = folder.join("tiny.toml");
    fs::write(&base, TINY).unwrap();
    let path = folder.join("plan.toml");
    let text = format!(
        "base = '{}'\nout = '{}'\nseeds = [1, 2]\n{more}\n\
         [[variant]]\nname = \"m1\"\nset = [\"n_behaviours=1\"]\n[[variant]]\nname = \"m2\"\n{sections}",
        base.display(),
        folder.join("runs").display()
    );
    fs::write(&path, text).unwrap();
    path
}

/// Every checkpoint and policy below a folder.
fn policies(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "safetensors") {
                found.insert(
                    path.strip_prefix(folder).unwrap().display().to_string(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    found
}

#[test]
fn a_sweep_trains_tests_and_collects_and_a_second_call_does_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // An update is 32 transitions: the second one reaches 40, the fourth ends the run.
    let plan = plan(
        folder.path(),
        "milestones = [40]",
        "[evaluate]\ncrowds = [\"VO\"]\nepisodes = 2\nagents = 3\nmilestones = true\nplanners = [\"straight\"]\n",
    );
    let printed = accepted(&["sweep", text(&plan), "--jobs", "2"]);
    let out = folder.path().join("runs");
    for run in ["m1-seed1", "m1-seed2", "m2-seed1", "m2-seed2"] {
        assert!(out.join(run).join("checkpoints/000004.safetensors").is_file(), "{run}");
        assert!(out.join(run).join("milestones/000000040.safetensors").is_file(), "{run}");
        let said = fs::read_to_string(out.join(format!("logs/{run}.txt"))).unwrap();
        assert!(said.contains(&format!("{run}: 4/4")), "{said}");
        assert_eq!(printed.matches(&format!("{run}  done")).count(), 2, "{printed}");
    }
    let csv = fs::read_to_string(out.join("results.csv")).unwrap();
    let mut lines = csv.lines();
    let heads: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<BTreeMap<&str, &str>> =
        lines.map(|line| heads.iter().copied().zip(line.split(',')).collect()).collect();
    assert_eq!(rows.len(), 8 + 1);
    let planner = rows[8].clone();
    assert_eq!(
        (planner["run"], planner["variant"], planner["VO_episodes"]),
        ("straight", "not learned", "2")
    );
    let rows = &rows[..8];
    assert_eq!((rows[0]["updates"], rows[0]["transitions"]), ("2", "64"));
    assert_eq!((rows[1]["updates"], rows[1]["transitions"]), ("4", "128"));
    assert!(rows.iter().all(|row| row["VO_episodes"] == "2" && row["state"] == "done"), "{csv}");
    let table = fs::read_to_string(out.join("results.md")).unwrap();
    // Both variants with two seeds, the second with its difference from the first.
    assert!(
        table.contains("| m1 | 2 | ") && table.contains("| m2 | 2 | ") && table.contains(" (0.33) |"),
        "{table}"
    );
    let summary = fs::read_to_string(out.join("summary.md")).unwrap();
    assert!(
        summary.contains("| m2 | 0.0 M | 2 | ") && summary.contains("| straight (not learned) | "),
        "{summary}"
    );
    let figure = fs::read_to_string(out.join("results.svg")).unwrap();
    let titles = ["Success among VO", "Success of training episodes", "m2 (2 seeds", "dotted: straight"];
    assert!(titles.iter().all(|title| figure.contains(title)), "{figure}");
    let elsewhere = folder.path().join("elsewhere");
    accepted(&["sweep", "collect", text(&plan), "--store", text(&elsewhere)]);
    assert_eq!(fs::read_to_string(elsewhere.join("results.md")).unwrap(), table);
    let before = policies(&out);
    let again = jostle(&["sweep", text(&plan)]);
    let message = String::from_utf8(again.stderr).unwrap();
    assert!(again.status.success() && message.contains("4 runs, 4 of them done"), "{message}");
    assert!(!message.contains("begins"), "{message}");
    assert!(before == policies(&out));
    assert_eq!(accepted(&["sweep", text(&plan), "--print"]), "");
    let status = accepted(&["sweep", "status", text(&plan)]);
    assert!(status.contains("4 runs: 4 done"), "{status}");
    // More episodes are more work, and the training is not.
    let more = fs::read_to_string(&plan).unwrap().replace("episodes = 2", "episodes = 3");
    fs::write(&plan, more).unwrap();
    let status = accepted(&["sweep", "status", text(&plan)]);
    assert!(status.contains("4 runs: 4 trained"), "{status}");
}

#[test]
fn a_folder_of_results_keeps_what_it_holds_of_runs_that_are_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let tests = "[evaluate]\ncrowds = [\"VO\"]\nepisodes = 2\nagents = 3\nmilestones = true\n";
    let plan = plan(folder.path(), "milestones = [40]", tests);
    let (out, kept) = (folder.path().join("runs"), folder.path().join("kept"));
    let table = || fs::read_to_string(kept.join("results.csv")).unwrap();
    let rows = || -> Vec<String> { table().lines().skip(1).map(str::to_owned).collect() };
    let collect = ["sweep", "collect", text(&plan), "--store", text(&kept)];
    accepted(&["sweep", "task", text(&plan), "m1-seed1"]);
    accepted(&collect);
    let before = rows();
    assert_eq!(before.len(), 2 + 3, "two policies of one run, three runs that have not begun");
    // Another machine trains another run.
    fs::rename(out.join("m1-seed1"), folder.path().join("away")).unwrap();
    accepted(&["sweep", "task", text(&plan), "m2-seed1"]);
    accepted(&collect);
    let after = rows();
    assert_eq!(after.len(), 2 + 2 + 2, "{after:?}");
    for (row, then) in after.iter().zip(&before[..2]) {
        assert_eq!(row, &then.replace(",done,", ",stored,"));
    }
    let m2 = after.iter().filter(|row| row.starts_with("m2-seed1,m2,1,") && row.contains(",done,"));
    assert_eq!(m2.count(), 2, "{after:?}");
    let summary = fs::read_to_string(kept.join("summary.md")).unwrap();
    assert!(summary.contains("| m1 | 1 | ") && summary.contains("| m2 | 1 | "), "{summary}");
    // The run comes back.
    fs::rename(folder.path().join("away"), out.join("m1-seed1")).unwrap();
    accepted(&collect);
    assert_eq!(rows()[..2], before[..2]);
    // What does not belong together is refused, and the folder stays as it is.
    fs::rename(&out, folder.path().join("gone")).unwrap();
    let written = table();
    let source = fs::read_to_string(&plan).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(source.contains(from), "{from}");
        fs::write(&plan, source.replace(from, to)).unwrap();
    };
    changed("episodes = 2", "episodes = 3");
    refused(&collect, &["asked.txt: found ", "episodes=2", "expected ", "episodes=3"]);
    changed("seeds = [1, 2]", "seeds = [3]");
    refused(&collect, &["results.csv: line 2", "found run \"m1-seed1\"", "expected a run of the plan"]);
    changed("n_behaviours=1", "n_behaviours=3");
    refused(&collect, &["results.csv: line 2", "config: found ", "expected "]);
    fs::write(&plan, &source).unwrap();
    assert_eq!(table(), written);
    fs::write(kept.join("results.csv"), written.replacen(",done,2,", ",done,two,", 1)).unwrap();
    refused(&collect, &["results.csv: line 2", "updates: found \"two\", expected a number"]);
    assert_eq!(table().matches(",two,").count(), 1, "nothing was overwritten");
}

#[test]
fn unfinished_runs_are_tested_and_compared_where_all_have_come() {
    let folder = tempfile::tempdir().unwrap();
    let tests = "[evaluate]\ncrowds = [\"VO\"]\nepisodes = 2\nagents = 3\nmilestones = true\n";
    // One variant is trained to its end, the other to the milestone of 64 transitions; an update is
    // 32.
    let short = plan(folder.path(), "milestones = [64]\nupdates = 3", "");
    accepted(&["sweep", "task", text(&short), "m1-seed1"]);
    refused(&["sweep", "task", text(&short), "m1-seed1", "--only-tests"], &["no [evaluate]"]);
    let long = plan(folder.path(), "milestones = [64]\nupdates = 6", tests);
    accepted(&["sweep", "task", text(&long), "m2-seed1"]);
    refused(&["sweep", "task", text(&long), "m1-seed2", "--only-tests"], &["no run in"]);
    accepted(&["sweep", "task", text(&long), "m1-seed1", "--only-tests"]);
    let run = folder.path().join("runs/m1-seed1");
    assert!(run.join("checkpoints/000003.safetensors").is_file());
    assert!(!run.join("checkpoints/000006.safetensors").exists(), "nothing is trained");
    let printed = accepted(&["sweep", "collect", text(&long)]);
    assert!(printed.contains("after 0.0 million transitions, the furthest"), "{printed}");
    let summary = fs::read_to_string(folder.path().join("runs/summary.md")).unwrap();
    let compared = summary.split_once("| variant | seeds |").unwrap().1;
    assert!(compared.contains("| m1 | 1 | ") && compared.contains("| m2 | 1 | "), "{summary}");
    accepted(&["sweep", "task", text(&long), "m1-seed1"]);
    let printed = accepted(&["sweep", "collect", text(&long)]);
    assert!(printed.contains("at the end of training"), "{printed}");
}

#[test]
fn a_milestone_is_the_policy_of_its_update() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), "milestones = [64, 65, 128]\nset = [\"updates=8\"]", "");
    accepted(&["sweep", "task", text(&plan), "m2-seed1"]);
    let run = folder.path().join("runs/m2-seed1");
    let policy = |path: &str| jostle_policy::PolicyFile::load(run.join(path)).unwrap();
    // A checkpoint of a quarter is kept, too.
    let (kept, checkpoint) =
        (policy("milestones/000000064.safetensors"), policy("checkpoints/000002.safetensors"));
    assert_eq!((kept.actor, kept.provenance), (checkpoint.actor, checkpoint.provenance));
    assert_eq!(policy("milestones/000000065.safetensors").provenance.update, 3);
    assert_eq!(policy("milestones/000000128.safetensors").provenance.transitions, 128);
    assert!(!run.join("checkpoints/000003.safetensors").exists());
}

#[test]
fn each_printed_line_does_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), "threads = 1", "");
    let lines = accepted(&["sweep", text(&plan), "--print"]);
    assert_eq!(lines.lines().count(), 4, "{lines}");
    let done = Command::new("sh").args(["-c", lines.lines().nth(1).unwrap()]).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(folder.path().join("runs/m2-seed1/checkpoints/000004.safetensors").is_file());
    let left = accepted(&["sweep", text(&plan), "--print"]);
    assert!(left.lines().count() == 3 && !left.contains("m2-seed1"), "{left}");
}

#[test]
fn a_killed_sweep_takes_its_runs_along_and_the_next_call_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    // Long enough to be caught in the middle; a checkpoint whenever the clock allows.
    let more = "updates = 120\ncheckpoint_minutes = 0.0001\nmilestones = [100, 1000]";
    for place in [&whole, &killed] {
        fs::create_dir(place).unwrap();
    }
    accepted(&["sweep", text(&plan(&whole, more, ""))]);
    let plan = plan(&killed, more, "");
    let runs = killed.join("runs");
    let mut sweep = Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(["sweep", text(&plan), "--jobs", "2"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let newest = |run: &str| fs::read_to_string(runs.join(run).join("latest")).unwrap_or_default();
    let deadline = Instant::now() + Duration::from_mins(2);
    while newest("m1-seed1").as_str() < "000010" {
        assert!(Instant::now() < deadline, "no checkpoint came");
        assert!(sweep.try_wait().unwrap().is_none(), "the sweep ended before it could be killed");
        std::thread::sleep(Duration::from_millis(2));
    }
    // SIGKILL: the sweep itself can do nothing about it.
    sweep.kill().unwrap();
    sweep.wait().unwrap();
    let running = || accepted(&["sweep", "status", text(&plan)]).contains("running");
    while running() {
        assert!(Instant::now() < deadline, "the runs went on without their sweep");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(newest("m2-seed2").is_empty(), "it was killed after its work");
    accepted(&["sweep", text(&plan), "--jobs", "3"]);
    let (expected, found) = (policies(&whole.join("runs")), policies(&runs));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&expected), names(&found));
    for (name, bytes) in &expected {
        assert!(found[name] == *bytes, "{name} differs");
    }
}

#[test]
fn a_sweep_that_is_asked_to_stop_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let more = "updates = 100000\ncheckpoint_minutes = 0";
    let plan = plan(folder.path(), more, "");
    let runs = folder.path().join("runs");
    let sweep = Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(["sweep", text(&plan), "--jobs", "2"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let made =
        |run: &str| fs::read_to_string(runs.join(run).join("log.ndjson")).unwrap_or_default().lines().count();
    let deadline = Instant::now() + Duration::from_mins(2);
    // The plan's order is that of its seeds.
    while made("m1-seed1") < 5 || made("m2-seed1") < 5 {
        assert!(Instant::now() < deadline, "training did not start");
        std::thread::sleep(Duration::from_millis(10));
    }
    // To the sweep alone, as a scheduler does; a terminal sends it to the runs, too.
    assert!(Command::new("kill").args(["-INT", &sweep.id().to_string()]).status().unwrap().success());
    let output = sweep.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(75), "{message}");
    assert!(message.contains("stopped with 0 of 4 runs done") && !message.contains("failed"), "{message}");
    for run in ["m1-seed1", "m2-seed1"] {
        assert!(message.contains(&format!("{run}: stopped at update {} of 100000", made(run))), "{message}");
        let newest = fs::read_to_string(runs.join(run).join("latest")).unwrap();
        assert_eq!(newest, format!("{:06}.safetensors\n", made(run)));
    }
    assert!(!runs.join("m2-seed2").exists(), "a run was begun afterwards");
}

#[test]
fn a_failed_run_does_not_stop_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), "", "");
    let run = folder.path().join("runs/m1-seed1");
    fs::create_dir_all(&run).unwrap();
    fs::write(run.join("thesis.tex"), "x").unwrap();
    let output = jostle(&["sweep", text(&plan), "--jobs", "2"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success());
    assert!(message.contains("m1-seed1 failed: error:") && message.contains("no run"), "{message}");
    assert!(folder.path().join("runs/m2-seed2/checkpoints/000004.safetensors").is_file());
}

#[test]
fn a_plan_is_checked_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    let path = plan(folder.path(), "", "");
    accepted(&["sweep", "task", text(&path), "m2-seed2"]);
    let out = folder.path().join("runs");
    let made = policies(&out);
    let changed =
        fs::read_to_string(&path).unwrap().replace("name = \"m2\"", "name = \"m2\"\nset = [\"gamma=0.5\"]");
    fs::write(&path, changed).unwrap();
    refused(&["sweep", text(&path)], &["m2-seed2: found another run there", "choose another"]);
    refused(&["sweep", "status", text(&folder.path().join("no.toml"))], &["no.toml", "cannot read the plan"]);
    let path = plan(folder.path(), "thread = 1", "");
    refused(&["sweep", text(&path)], &["plan.toml: thread: found an unknown key, expected threads"]);
    let path = plan(folder.path(), "", "");
    refused(&["sweep", "task", text(&path), "m3-seed1"], &["found no run called m3-seed1, expected m"]);
    assert!(made == policies(&out));
    assert!(!out.join("logs").exists() && !out.join("m1-seed1").exists());
}

#[test]
fn who_works_in_a_run_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), "updates = 100000", "");
    let mut run = Command::new(env!("CARGO_BIN_EXE_jostle"))
        .args(["sweep", "task", text(&plan), "m2-seed1"])
        .env("SLURMD_NODENAME", "node-of-a-test")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let log = folder.path().join("runs/m2-seed1/log.ndjson");
    let deadline = Instant::now() + Duration::from_mins(2);
    while fs::read_to_string(&log).unwrap_or_default().lines().count() < 3 {
        assert!(Instant::now() < deadline, "training did not start");
        std::thread::sleep(Duration::from_millis(10));
    }
    let status = accepted(&["sweep", "status", text(&plan)]);
    let runs = accepted(&["runs", text(folder.path())]);
    let process = run.id();
    let second = jostle(&["sweep", "task", text(&plan), "m2-seed1"]);
    run.kill().unwrap();
    run.wait().unwrap();
    for listed in [status, runs] {
        let line = listed.lines().find(|line| line.contains("m2-seed1")).unwrap();
        assert!(line.contains("running") && line.contains("node-of-a-test"), "{listed}");
        assert!(line.contains(" h ") || line.contains(" min") || line.contains(" s"), "no time left: {line}");
    }
    let message = String::from_utf8(second.stderr).unwrap();
    assert!(
        message.contains("another process is working in")
            && message.contains(&format!("(node-of-a-test, process {process})")),
        "{message}"
    );
    let after = accepted(&["runs", text(folder.path())]);
    assert!(after.contains("stopped") && !after.contains("node-of-a-test"), "{after}");
}

#[test]
fn every_shipped_plan_is_valid() {
    let folder = tempfile::tempdir().unwrap();
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut plans = Vec::new();
    for to in ["configs", "configs/plans", "checkpoints"] {
        fs::create_dir_all(folder.path().join(to)).unwrap();
        for entry in fs::read_dir(workspace.join(to)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                let to = Path::new(to).join(path.file_name().unwrap());
                fs::copy(&path, folder.path().join(&to)).unwrap();
                plans.extend((to.parent() == Some(Path::new("configs/plans"))).then_some(to));
            }
        }
    }
    assert!(plans.len() >= 2, "{plans:?}");
    for plan in plans {
        let mut command = Command::new(env!("CARGO_BIN_EXE_jostle"));
        let output =
            command.args(["sweep", text(&plan), "--print"]).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(!output.stdout.is_empty(), "{}: nothing to do", plan.display());
    }
}
