//! The examples that users copy: the launch file, the unit, the parameters and the commands of the
//! page.

use std::path::Path;
use std::process::{Command, Output};

use jostle_ros::Params;

fn read(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn jostle_ros(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jostle-ros")).args(arguments).output().expect("jostle-ros")
}

/// The long options that a text gives to the program.
fn options(text: &str) -> Vec<String> {
    let words = text.split(|c: char| c.is_whitespace() || "\"',`]".contains(c));
    let mut found: Vec<String> =
        words.filter(|word| word.starts_with("--") && word.len() > 2).map(str::to_owned).collect();
    found.sort();
    found.dedup();
    found
}

#[test]
fn options_of_examples_exist() {
    let help = String::from_utf8(jostle_ros(&["--help"]).stdout).expect("UTF-8");
    let known = options(&help);
    assert!(known.contains(&"--policy".to_owned()), "{known:?}");
    let unit = read("launch/jostle-ros.service");
    let unit = unit.lines().find(|line| line.starts_with("ExecStart=")).expect("a command").to_owned();
    let page = read("../docs/how-to-ros2.md");
    let commands: Vec<&str> = page.lines().filter(|line| line.starts_with("jostle-ros ")).collect();
    for text in [unit, commands.join("\n")] {
        let used = options(&text);
        assert!(!used.is_empty());
        assert!(used.iter().all(|option| known.contains(option)), "{used:?}");
    }
    // The launch file puts `--` before the names of its list.
    let launch = read("launch/jostle.launch.py");
    let passed = launch.split("passed = [").nth(1).and_then(|rest| rest.split(']').next()).expect("a list");
    let names: Vec<String> = passed.split('"').skip(1).step_by(2).map(|name| format!("--{name}")).collect();
    assert!(names.len() == 6 && names.iter().all(|option| known.contains(option)), "{names:?}");
}

#[test]
fn parameters_of_the_page_are_valid() {
    let page = read("../docs/how-to-ros2.md");
    let blocks: Vec<&str> =
        page.split("```text\n").skip(1).filter(|text| text.starts_with("# robot.toml")).collect();
    assert!(!blocks.is_empty());
    for block in blocks {
        let text = block.split("```").next().expect("a block");
        Params::parse(text, "docs/how-to-ros2.md").unwrap();
    }
}

#[test]
fn the_page_names_every_parameter() {
    let page = read("../docs/how-to-ros2.md");
    for line in jostle_ros::params::DEFAULTS.lines() {
        let line = line.strip_prefix("# ").unwrap_or(line);
        let mut words = line.split(' ');
        if let (Some(key), Some("=")) = (words.next(), words.next()) {
            assert!(page.contains(key), "{key} is not on the page");
        }
    }
}

#[test]
fn mistakes_are_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, "[scan]\ntimout = 0.5\n").expect("written");
    let path = file.to_str().expect("UTF-8");
    for (arguments, expected) in [
        (vec!["--policy", "dwa", "--params", path], "did you mean timeout?"),
        (vec!["--policy", "dwb"], "did you mean dwa?"),
        (vec!["--policy", "orca"], "expected everyone's position"),
        (vec!["--policy", "dwa", "--token", "3"], "token: found 3, expected 0"),
        (vec!["--policy", "dwa", "--params", "no/such.toml"], "no/such.toml: cannot read"),
    ] {
        let output = jostle_ros(&arguments);
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(!output.status.success());
        assert!(said.starts_with("error: ") && said.contains(expected), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

#[test]
fn the_printed_parameters_are_the_defaults() {
    let output = jostle_ros(&["--print-params"]);
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert_eq!(Params::parse(&text, "params").unwrap(), Params::default());
}
