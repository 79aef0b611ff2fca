//! What a folder of results remembers of runs that are not here: trained on another machine, or
//! cleared away. `sweep collect --store DIR` reads `DIR/results.csv` before it writes it, so that
//! results of several machines grow into one table.
//!
//! Rows belong to the same plan where run and configuration are the same; the tests, where they
//! were asked for in the same words (`DIR/asked.txt`).

use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context as _, Result, bail};
use jostle_ppo::report::EpisodeCounts;

use super::collect::{MEASURES, NOT_LEARNED};
use super::evaluation::EvaluationPlan;
use super::plan::Plan;
use super::spec::Task;
use super::tally::{Tally, Tests};
use jostle_runs::folder::read_optional;

/// What the tests of the stored rows were asked for.
pub(super) const ASKED: &str = "asked.txt";

/// A row of `results.csv`: a policy of a run.
#[derive(Debug)]
pub(super) struct Stored {
    pub(super) updates: u64,
    pub(super) transitions: u64,
    pub(super) episodes: EpisodeCounts,
    /// As [`MEASURES`].
    pub(super) measures: [f64; MEASURES.len()],
    pub(super) seconds: f64,
    /// `None` where it was not tested.
    pub(super) tests: Option<Tests>,
}

/// The rows of a folder by the names of their runs; none where there is no table.
///
/// # Errors
/// A table that is none, that holds runs of another configuration, or whose tests were asked for in
/// other words.
pub(super) fn read(folder: &Path, plan: &Plan) -> Result<BTreeMap<String, Vec<Stored>>> {
    let path = folder.join("results.csv");
    let Some(text) = read_optional(&path)? else { return Ok(BTreeMap::new()) };
    let asked = read_optional(&folder.join(ASKED))?;
    let expected = plan.evaluation.as_ref().map(EvaluationPlan::asked);
    if let (Some(asked), Some(expected)) = (&asked, &expected)
        && asked != expected
    {
        bail!(
            "{}: found {:?}, expected {:?}, as the plan asks: choose another folder for other tests",
            folder.join(ASKED).display(),
            asked.trim_end(),
            expected.trim_end()
        );
    }
    let mut lines = text.lines();
    let heads: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut found: BTreeMap<String, Vec<Stored>> = BTreeMap::new();
    for (index, line) in lines.enumerate() {
        let place = || format!("{}: line {}", path.display(), index + 2);
        let fields: Vec<&str> = line.split(',').collect();
        if fields.len() != heads.len() {
            bail!("{}: found {} fields, expected {}", place(), fields.len(), heads.len());
        }
        let row: BTreeMap<&str, &str> = heads.iter().copied().zip(fields).collect();
        if row.get("variant") == Some(&NOT_LEARNED) {
            continue;
        }
        let run = field(&row, "run").with_context(place)?;
        let Some(task) = plan.tasks.iter().find(|task| task.name == run) else {
            bail!("{}: found run {run:?}, expected a run of the plan: choose another folder", place());
        };
        if let Some(stored) = stored(&row, &heads, task).with_context(place)? {
            found.entry(run.to_owned()).or_default().push(stored);
        }
    }
    Ok(found)
}

/// A row; `None` where its run had not begun.
fn stored(row: &BTreeMap<&str, &str>, heads: &[&str], task: &Task) -> Result<Option<Stored>> {
    let (config, expected) = (field(row, "config")?, task.config.hash());
    if config != expected {
        bail!("config: found {config:?}, expected {expected:?}, as the plan has it: choose another folder");
    }
    let updates = number(row, "updates")?;
    if updates == 0 {
        return Ok(None);
    }
    let mut measures = [0.0; MEASURES.len()];
    for (to, (name, ..)) in measures.iter_mut().zip(MEASURES) {
        *to = number(row, name)?;
    }
    let mut tests = Vec::new();
    for crowd in heads.iter().filter_map(|head| head.strip_suffix("_episodes")) {
        if !field(row, &format!("{crowd}_episodes"))?.is_empty() {
            let of = |what: &str| number(row, &format!("{crowd}_{what}"));
            tests.push((crowd.to_owned(), Tally { episodes: of("episodes")?, success: of("success")? }));
        }
    }
    let episodes = EpisodeCounts {
        ended: number(row, "episodes")?,
        success: number(row, "success")?,
        collision_wall: number(row, "collision_wall")?,
        collision_agent: number(row, "collision_agent")?,
        timeout: number(row, "timeout")?,
    };
    Ok(Some(Stored {
        updates,
        transitions: number(row, "transitions")?,
        episodes,
        measures,
        seconds: number(row, "seconds")?,
        tests: (!tests.is_empty()).then_some(Tests(tests)),
    }))
}

fn field<'r>(row: &BTreeMap<&str, &'r str>, name: &str) -> Result<&'r str> {
    row.get(name).copied().with_context(|| format!("found no column {name:?}"))
}

fn number<T: FromStr>(row: &BTreeMap<&str, &str>, name: &str) -> Result<T> {
    let text = field(row, name)?;
    text.parse().ok().with_context(|| format!("{name}: found {text:?}, expected a number"))
}
