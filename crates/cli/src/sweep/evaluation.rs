//! A plan's tests of its trained runs: `[evaluate]`, whose keys are the options of `cargo xtask
//! evaluate`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::{ArgAction, Args as _, Command, FromArgMatches as _};
use jostle_arena::planners::Planner;
use jostle_eval::report::Evaluation;
use jostle_ppo::Config;
use toml::{Table, Value};

use super::section::{Section, nearest, shown};
use super::spec::Task;
use crate::evaluate::{EvaluateArgs, evaluate};
use jostle_runs::folder::{checkpoint_path, read_optional};
use jostle_runs::output::note;
use jostle_runs::run_folder::{milestone_path, write_atomically};

/// Options that the sweep itself gives.
const OURS: [&str; 4] = ["out", "threads", "help", "version"];
/// Folder of evaluations in a run folder.
const FOLDER: &str = "evaluation";
/// The file that says what an evaluation was asked for.
const ASKED: &str = "asked.txt";

/// The test of trained runs.
#[derive(Debug)]
pub(super) struct EvaluationPlan {
    /// The section as it was written.
    pub(super) source: Table,
    /// Words of the command line, without checkpoint and output folder.
    words: Vec<String>,
    /// True if the policies of the milestones are tested, too.
    milestones: bool,
    /// Planners that were not learned, tested in the same episodes to compare with.
    planners: Vec<String>,
}

/// A policy of a run that the plan tests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tested {
    /// Updates that it has seen.
    pub(super) updates: u64,
    policy: PathBuf,
    folder: PathBuf,
}

impl EvaluationPlan {
    /// Reads the section.
    pub(super) fn read(mut section: Section) -> Result<Self> {
        let source = section.table().clone();
        let milestones = section.optional("milestones", "true or false")?.unwrap_or(false);
        let expected = "a list of planners";
        let planners: Vec<String> = section.optional("planners", expected)?.unwrap_or_default();
        if let Some(unknown) = planners.iter().find(|name| name.parse::<Planner>().is_err()) {
            let known = Planner::ALL.map(Planner::name);
            bail!(section.refusal("planners", &format!("{unknown:?}"), &nearest(unknown, &known)));
        }
        let command = command();
        let options: Vec<&str> = command
            .get_arguments()
            .filter_map(clap::Arg::get_long)
            .filter(|long| !OURS.contains(long))
            .collect();
        let mut words = Vec::new();
        for (key, value) in section.rest() {
            let long = key.replace('_', "-");
            let Some(option) = command
                .get_arguments()
                .find(|arg| arg.get_long() == Some(long.as_str()) && options.contains(&long.as_str()))
            else {
                let keys: Vec<String> = options.iter().map(|long| long.replace('-', "_")).collect();
                let mut keys: Vec<&str> = keys.iter().map(String::as_str).collect();
                keys.extend(["milestones", "planners"]);
                bail!(section.refusal(&key, "an unknown key", &nearest(&key, &keys)));
            };
            let before = words.len();
            push_option(&mut words, option, &long, &value);
            // Each key by itself, so that the one at fault is known.
            if let Err(error) = parse(&words[before..], Path::new("."), Path::new(".")) {
                let reason = error.to_string();
                let reason = reason.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
                bail!(section.refusal(&key, &shown(&value), &format!("what `evaluate` takes: {reason}")));
            }
        }
        Ok(Self { source, words, milestones, planners })
    }

    /// Refuses what would stop the test of runs of this configuration.
    pub(super) fn check(&self, config: &Config) -> Result<()> {
        self.arguments(Path::new("."), Path::new("."))?.check(&config.sim, config.n_agents)
    }

    /// The policies of a run that are tested, by the updates that they have seen.
    pub(super) fn tested(&self, task: &Task) -> Vec<Tested> {
        let updates = task.config.updates;
        let folder = task.folder.join(FOLDER);
        let milestones = if self.milestones { task.milestones.as_slice() } else { &[] };
        let mut tested: Vec<Tested> = milestones
            .iter()
            .map(|&transitions| Tested {
                updates: transitions.div_ceil(task.config.rollout_len() as u64),
                policy: milestone_path(&task.folder, transitions),
                folder: folder.join(format!("transitions-{transitions:09}")),
            })
            .filter(|milestone| milestone.updates < updates)
            .collect();
        tested.sort_by_key(|milestone| milestone.updates);
        tested.push(Tested {
            updates,
            policy: checkpoint_path(&task.folder, updates),
            folder: folder.join(format!("updates-{updates:06}")),
        });
        tested
    }

    /// Tests a trained run's policies, those that are tested already left out.
    pub(super) fn run(&self, task: &Task) -> Result<()> {
        for tested in self.tested(task) {
            if !tested.policy.is_file() {
                note(&format!("{}: {} is not there and not tested", task.name, tested.policy.display()));
                continue;
            }
            if self.result(&tested)?.is_some() {
                continue;
            }
            self.test(&tested)?;
        }
        Ok(())
    }

    /// The finished test of a policy, if it is the one that the plan asks for.
    pub(super) fn result(&self, tested: &Tested) -> Result<Option<Evaluation>> {
        if read_optional(&tested.folder.join(ASKED))?.as_deref() != Some(self.asked().as_str()) {
            return Ok(None);
        }
        let path = tested.folder.join("result.json");
        let Some(text) = read_optional(&path)? else { return Ok(None) };
        let shown = || format!("{} is no evaluation", path.display());
        serde_json::from_str(&text).map(Some).with_context(shown)
    }

    /// True if every policy of a trained run that is there has been tested.
    pub(super) fn is_done(&self, task: &Task) -> Result<bool> {
        for tested in self.tested(task) {
            if tested.policy.is_file() && self.result(&tested)?.is_none() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The plan's planners with their results, tested now where they have not been, below `out`.
    pub(super) fn planners(&self, out: &Path) -> Result<Vec<(String, Evaluation)>> {
        self.planners
            .iter()
            .map(|name| {
                let folder = out.join("planners").join(name);
                let tested = Tested { updates: 0, policy: name.into(), folder };
                let result = match self.result(&tested)? {
                    Some(found) => found,
                    None => self.test(&tested)?,
                };
                Ok((name.clone(), result))
            })
            .collect()
    }

    fn test(&self, tested: &Tested) -> Result<Evaluation> {
        let evaluation = evaluate(&self.arguments(&tested.policy, &tested.folder)?)?;
        write_atomically(&tested.folder.join("result.json"), &evaluation.json())?;
        write_atomically(&tested.folder.join(ASKED), &self.asked())?;
        Ok(evaluation)
    }

    /// What the tests are asked for: the options of `evaluate`, a line each.
    pub(super) fn asked(&self) -> String {
        self.words.join("\n") + "\n"
    }

    fn arguments(&self, policy: &Path, out: &Path) -> Result<EvaluateArgs> {
        Ok(parse(&self.words, policy, out)?)
    }
}

fn command() -> Command {
    EvaluateArgs::augment_args(Command::new("evaluate"))
}

fn parse(words: &[String], policy: &Path, out: &Path) -> Result<EvaluateArgs, clap::Error> {
    let own = ["evaluate".into(), policy.as_os_str().to_owned(), "--out".into(), out.as_os_str().to_owned()];
    let matches = command().try_get_matches_from(own.into_iter().chain(words.iter().map(Into::into)))?;
    EvaluateArgs::from_arg_matches(&matches)
}

/// The words that give an option this value; a list gives it several times.
fn push_option(words: &mut Vec<String>, option: &clap::Arg, long: &str, value: &Value) {
    let flag = matches!(option.get_action(), ArgAction::SetTrue);
    match value {
        Value::Boolean(false) if flag => {}
        Value::Boolean(true) if flag => words.push(format!("--{long}")),
        Value::Array(values) => values.iter().for_each(|value| push_option(words, option, long, value)),
        Value::String(text) => words.push(format!("--{long}={text}")),
        value => words.push(format!("--{long}={value}")),
    }
}
