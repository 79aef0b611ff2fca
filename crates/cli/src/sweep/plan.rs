//! The plan of a sweep: a file of variants × seeds, read and checked as a whole before anything
//! starts.
//!
//! ```toml
//! base = "configs/headline.toml"     # what the variants change
//! out = "runs/search"                # a run folder for each variant and seed: runs/search/m5-seed1
//! seeds = [1, 2, 3]
//! transitions = 20_000_000           # or `updates`; default: the base's
//! milestones = [1_000_000, 3_000_000, 10_000_000]   # policies that are kept
//! threads = 1                        # of each run
//! set = ["n_rooms=32", "horizon=64"] # of all variants
//!
//! [[variant]]
//! name = "m1"
//! set = ["n_behaviours=1", "alpha=0"]
//!
//! [[variant]]
//! name = "m5"
//! seeds = [1]                        # each of base, seeds, updates, transitions, milestones can be a variant's own
//!
//! [evaluate]                         # afterwards; keys are the options of `evaluate`
//! crowds = ["VO", "SF"]
//! episodes = 200
//! milestones = true                  # the kept policies, too
//!
//! [slurm]                            # of `sweep --slurm`
//! partition = "main"
//! time = "12:00:00"
//! memory = "4G"
//! ```
//!
//! Paths are taken from the working folder, as on the command line.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use jostle_ppo::Config;

use super::evaluation::EvaluationPlan;
use super::section::Section;
use super::slurm_options::SlurmPlan;
use super::spec::Task;
use crate::train::CHECKPOINT_MINUTES;
use crate::train::Care;
use jostle_runs::folder::read_optional;
use jostle_runs::log::short;

/// Largest plan that is read, in bytes.
const TEXT_MAX: u64 = 1 << 20;
/// Most runs of a plan.
const RUNS_MAX: usize = 10_000;
/// Updates over which measures are taken, where nothing else is said.
const WINDOW: usize = 50;

/// A checked plan.
#[derive(Debug)]
pub(super) struct Plan {
    /// The plan's file.
    pub(super) path: PathBuf,
    /// Folder of the run folders.
    pub(super) out: PathBuf,
    /// Every run: all variants with their first seed, then all with their second, and so on.
    pub(super) tasks: Vec<Task>,
    /// Threads of a run.
    pub(super) threads: Option<usize>,
    /// Minutes between checkpoints.
    pub(super) checkpoint_minutes: f64,
    /// Updates over which the table's measures are taken.
    pub(super) window: usize,
    /// The test of a trained run.
    pub(super) evaluation: Option<EvaluationPlan>,
    /// Slurm's options for a run.
    pub(super) slurm: SlurmPlan,
}

impl Plan {
    /// Reads a plan and checks all of it: keys, configurations, crowds, and that no run folder
    /// holds another run.
    ///
    /// # Errors
    /// The first mistake, in one line.
    pub(super) fn load(path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let about = std::fs::metadata(path).with_context(|| format!("cannot read the plan {place}"))?;
        ensure!(
            about.is_file() && about.len() <= TEXT_MAX,
            "{place}: found no file of at most {TEXT_MAX} bytes, expected a plan"
        );
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the plan {place}"))?;
        Self::parse(&text, path)
    }

    fn parse(text: &str, path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let mut section = Section::of_text(&place, text)?;
        let out: PathBuf = section.required("out", "a folder")?;
        let common = Common {
            base: section.optional("base", "a configuration file")?,
            set: section.optional("set", SETTINGS)?.unwrap_or_default(),
            seeds: section.optional("seeds", SEEDS)?,
            length: Length::read(&mut section)?,
            milestones: section.optional("milestones", MILESTONES)?.unwrap_or_default(),
        };
        let threads: Option<usize> = section.optional("threads", THREADS)?;
        if let Some(found) = threads.filter(|threads| !(1..=1024).contains(threads)) {
            bail!(section.refusal("threads", &found.to_string(), THREADS));
        }
        let minutes = section.optional("checkpoint_minutes", "a number of minutes")?;
        let checkpoint_minutes = minutes.unwrap_or(CHECKPOINT_MINUTES);
        Care::new(checkpoint_minutes, &[]).map_err(|_| {
            let expected = "a number of minutes from 0";
            anyhow::anyhow!(section.refusal("checkpoint_minutes", &checkpoint_minutes.to_string(), expected))
        })?;
        let window = section.optional("window", "a number of updates")?.unwrap_or(WINDOW);
        ensure!(window > 0, section.refusal("window", "0", "at least 1 update"));
        let mut variants = Vec::new();
        for of_variant in section.sections("variant")? {
            variants.push(variant(of_variant, &common)?);
        }
        ensure!(!variants.is_empty(), section.refusal("variant", "none", "at least one section [[variant]]"));
        let evaluation = section.section("evaluate")?.map(EvaluationPlan::read).transpose()?;
        let slurm = section.section("slurm")?.map(SlurmPlan::read).transpose()?.unwrap_or_default();
        section.finish()?;
        let plan = Self {
            path: path.to_owned(),
            tasks: tasks(&variants, &out, &place)?,
            out,
            threads,
            checkpoint_minutes,
            window,
            evaluation,
            slurm,
        };
        plan.check(&place)?;
        Ok(plan)
    }

    /// Runs that no file names, each with its variant's name.
    pub(super) fn of_runs(out: &Path, runs: Vec<(String, Config)>, slurm: SlurmPlan) -> Self {
        let task = |(variant, config): (String, Config)| {
            let name = run_name(&variant, config.seed);
            Task { folder: out.join(&name), name, variant, config, milestones: Vec::new() }
        };
        Self {
            path: out.to_owned(),
            out: out.to_owned(),
            threads: runs.first().map(|(_, config)| config.threads).filter(|&threads| threads > 0),
            tasks: runs.into_iter().map(task).collect(),
            checkpoint_minutes: CHECKPOINT_MINUTES,
            window: WINDOW,
            evaluation: None,
            slurm,
        }
    }

    /// The files kept of a run on the way.
    pub(super) fn care(&self, task: &Task) -> Result<Care> {
        Care::new(self.checkpoint_minutes, &task.milestones)
    }

    /// The run of that name.
    pub(super) fn task(&self, name: &str) -> Result<&Task> {
        let known: Vec<&str> = self.tasks.iter().map(|task| task.name.as_str()).collect();
        self.tasks.iter().find(|task| task.name == name).with_context(|| {
            let expected = super::section::nearest(name, &known);
            format!("{}: found no run called {name}, expected {expected}", self.path.display())
        })
    }

    /// Checks of what depends on more than one key, or on the files on the disk.
    fn check(&self, place: &str) -> Result<()> {
        for (index, task) in self.tasks.iter().enumerate() {
            let hash = task.config.hash();
            if let Some(twin) = self.tasks[..index].iter().find(|other| other.config.hash() == hash) {
                bail!(
                    "{place}: {} is the same run as {} (config {}); one of them is too many",
                    task.name,
                    twin.name,
                    short(&hash)
                );
            }
            let stored = task.folder.join("config.toml");
            if let Some(text) = read_optional(&stored)? {
                let none: &[&str] = &[];
                let mut found = Config::parse(&text, &stored.display().to_string(), none)?;
                found.stored_in(&task.folder);
                let found = found.hash();
                ensure!(
                    found == hash,
                    "{place}: {}: found another run there (config {}), expected {}; choose another `out` or name",
                    task.folder.display(),
                    short(&found),
                    short(&hash)
                );
            }
            if let Some(evaluation) = &self.evaluation {
                evaluation
                    .check(&task.config)
                    .with_context(|| format!("{place}: evaluate: {}", task.name))?;
            }
        }
        Ok(())
    }
}

const SETTINGS: &str = "a list of \"key=value\"";
const SEEDS: &str = "a list of integers from 0";
const MILESTONES: &str = "a list of numbers of transitions";
const THREADS: &str = "an integer from 1 to 1024";

/// The keys that all variants share unless they say otherwise.
struct Common {
    base: Option<PathBuf>,
    set: Vec<String>,
    seeds: Option<Vec<u64>>,
    length: Option<Length>,
    milestones: Vec<u64>,
}

/// The length of a run.
#[derive(Clone, Copy)]
enum Length {
    Updates(u64),
    Transitions(u64),
}

impl Length {
    fn read(section: &mut Section) -> Result<Option<Self>> {
        let expected = "an integer from 1";
        let updates: Option<u64> = section.optional("updates", expected)?;
        let transitions: Option<u64> = section.optional("transitions", expected)?;
        for (key, found) in [("updates", updates), ("transitions", transitions)] {
            ensure!(found != Some(0), section.refusal(key, "0", expected));
        }
        match (updates, transitions) {
            (Some(_), Some(found)) => {
                bail!(section.refusal("transitions", &found.to_string(), "it or `updates`, not both"))
            }
            (Some(updates), None) => Ok(Some(Self::Updates(updates))),
            (None, transitions) => Ok(transitions.map(Self::Transitions)),
        }
    }

    /// As updates of `rollout` transitions, rounded up.
    fn updates(self, rollout: u64) -> u64 {
        match self {
            Self::Updates(updates) => updates,
            Self::Transitions(transitions) => transitions.div_ceil(rollout),
        }
    }
}

/// A variant with a configuration for each of its seeds.
struct Variant {
    name: String,
    configs: Vec<Config>,
    milestones: Vec<u64>,
}

fn variant(mut section: Section, common: &Common) -> Result<Variant> {
    let expected = "a name of letters, digits, `-`, `_` and `.`";
    let name: String = section.required("name", expected)?;
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(fits) {
        bail!(section.refusal("name", &format!("{name:?}"), expected));
    }
    let place = section.place().rsplit_once(": ").map_or("", |(file, _)| file).to_owned();
    section.call(format!("{place}: variant {name}"));
    let base = section.optional("base", "a configuration file")?.or_else(|| common.base.clone());
    let Some(base) = base else {
        bail!(section.refusal("base", "nothing", "a configuration file, here or for all variants"))
    };
    let own: Vec<String> = section.optional("set", SETTINGS)?.unwrap_or_default();
    let seeds = section.optional("seeds", SEEDS)?.or_else(|| common.seeds.clone());
    let seeds: Vec<u64> = seeds.unwrap_or_default();
    ensure!(!seeds.is_empty(), section.refusal("seeds", "none", "at least one, here or for all variants"));
    if let Some(twice) = seeds.iter().enumerate().find(|(index, seed)| seeds[..*index].contains(seed)) {
        bail!(section.refusal("seeds", &format!("{} twice", twice.1), "seeds that differ"));
    }
    let length = Length::read(&mut section)?.or(common.length);
    let milestones: Vec<u64> =
        section.optional("milestones", MILESTONES)?.unwrap_or_else(|| common.milestones.clone());
    let mut configs = Vec::new();
    for seed in seeds {
        let seed = format!("seed={seed}");
        let overrides: Vec<&String> = common.set.iter().chain(&own).chain([&seed]).collect();
        let loaded = Config::load(&base, &overrides).with_context(|| section.place().to_owned())?;
        let updates = length.map_or(loaded.updates, |length| length.updates(loaded.rollout_len() as u64));
        configs.push(Config { updates, ..loaded });
    }
    for config in &configs {
        config.validate().with_context(|| section.place().to_owned())?;
        let last = config.updates * config.rollout_len() as u64;
        if let Some(beyond) = milestones.iter().find(|&&at| at == 0 || at > last) {
            let expected = format!("numbers from 1 to {last}, the transitions of the run");
            bail!(section.refusal("milestones", &beyond.to_string(), &expected));
        }
    }
    section.finish()?;
    Ok(Variant { name, configs, milestones })
}

fn run_name(variant: &str, seed: u64) -> String {
    format!("{variant}-seed{seed}")
}

/// All runs, every variant's first seed first.
fn tasks(variants: &[Variant], out: &Path, place: &str) -> Result<Vec<Task>> {
    for (index, variant) in variants.iter().enumerate() {
        if variants[..index].iter().any(|other| other.name == variant.name) {
            bail!("{place}: variant: found {} twice, expected names that differ", variant.name);
        }
    }
    let most = variants.iter().map(|variant| variant.configs.len()).max().unwrap_or(0);
    let mut tasks = Vec::new();
    for index in 0..most {
        for variant in variants {
            let Some(config) = variant.configs.get(index) else { continue };
            let name = run_name(&variant.name, config.seed);
            tasks.push(Task {
                folder: out.join(&name),
                name,
                variant: variant.name.clone(),
                config: config.clone(),
                milestones: variant.milestones.clone(),
            });
        }
    }
    ensure!(
        tasks.len() <= RUNS_MAX,
        "{place}: found {} runs, expected variants times seeds of at most {RUNS_MAX}",
        tasks.len()
    );
    Ok(tasks)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: &str = "base = \"configs/small_m5.toml\"\nout = \"nowhere\"\n";

    fn parse(text: &str) -> Result<Plan> {
        let base = jostle_runs::provenance::workspace().join("configs/small_m5.toml");
        let text = text.replace("configs/small_m5.toml", base.to_str().unwrap());
        Plan::parse(&text, Path::new("plan.toml"))
    }

    #[track_caller]
    fn check(text: &str, expected: &str) {
        let error = jostle_runs::output::one_line(&parse(&format!("{NONE}{text}")).unwrap_err());
        assert!(error.starts_with(expected), "found    {error}\nexpected {expected}");
        assert_eq!(error.lines().count(), 1);
    }

    #[test]
    fn variants_times_seeds_each_seed_of_all_variants_first() {
        let text = format!(
            "{NONE}seeds = [1, 2]\ntransitions = 10_000\nset = [\"n_rooms=1\"]\nmilestones = [640, 9_000]\n\
             [[variant]]\nname = \"a\"\n[[variant]]\nname = \"b\"\nset = [\"alpha=0\", \"R=2\"]\nseeds = [7, 8, 9]\n\
             milestones = []\n[[variant]]\nname = \"c\"\nupdates = 3\nset = [\"gamma=0.9\"]\nmilestones = [1]\n"
        );
        let plan = parse(&text).unwrap();
        let names: Vec<&str> = plan.tasks.iter().map(|task| task.name.as_str()).collect();
        assert_eq!(names, ["a-seed1", "b-seed7", "c-seed1", "a-seed2", "b-seed8", "c-seed2", "b-seed9"]);
        let updates = |name: &str| plan.task(name).unwrap().config.updates;
        // 128 steps of 5 agents are 640 transitions, in two rooms 1,280.
        assert_eq!((updates("a-seed1"), updates("b-seed8"), updates("c-seed2")), (16, 8, 3));
        assert_eq!(plan.task("a-seed2").unwrap().milestones, [640, 9000]);
        assert!(plan.task("b-seed7").unwrap().milestones.is_empty());
        assert_eq!(plan.task("b-seed7").unwrap().config.alpha, 0.0);
        let error = plan.task("a-seed3").unwrap_err().to_string();
        assert!(error.starts_with("plan.toml: found no run called a-seed3, expected "), "{error}");
    }

    #[test]
    fn mistakes_are_one_line_with_their_place() {
        let variant = "[[variant]]\nname = \"a\"\n";
        check(
            "sedes = [1]\n[[variant]]\nname = \"a\"\nseeds = [1]\n",
            "plan.toml: sedes: found an unknown key, expected seeds",
        );
        check(
            &format!("seeds = \"1\"\n{variant}"),
            "plan.toml: seeds: found \"1\", expected a list of integers",
        );
        check("seeds = [1]\n", "plan.toml: variant: found none, expected at least one section");
        check(variant, "plan.toml: variant a: seeds: found none, expected at least one");
        check(&format!("seeds = [1, 1]\n{variant}"), "plan.toml: variant a: seeds: found 1 twice");
        check(&format!("seeds = [1]\n{variant}{variant}"), "plan.toml: variant: found a twice");
        check(
            &format!("seeds = [1]\n{variant}[[variant]]\nname = \"b\"\n"),
            "plan.toml: b-seed1 is the same run as a-seed1 (config ",
        );
        check(
            "seeds = [1]\n[[variant]]\nname = \"../a\"\n",
            "plan.toml: variant 1: name: found \"../a\", expected a name",
        );
        check(
            &format!("seeds = [1]\nupdates = 3\ntransitions = 9\n{variant}"),
            "plan.toml: transitions: found 9, expected it or `updates`, not both",
        );
        check(
            &format!("seeds = [1]\nupdates = 1\nmilestones = [100, 2000]\n{variant}"),
            "plan.toml: variant a: milestones: found 2000, expected numbers from 1 to 1280",
        );
        check(
            &format!("seeds = [1]\nthreads = 0\n{variant}"),
            "plan.toml: threads: found 0, expected an integer",
        );
        check(&format!("seeds = [1\n{variant}"), "plan.toml:4: ");
        check(
            &format!("seeds = [1]\n{variant}set = [\"gama=1\"]\n"),
            "plan.toml: variant a: --set gama=1: gama: found an unknown key, expected gamma",
        );
        check(
            &format!("seeds = [1]\n{variant}base = \"missing.toml\"\n"),
            "plan.toml: variant a: missing.toml: cannot read",
        );
        check(
            &format!("seeds = [1]\n{variant}[evaluate]\nepisode = 3\n"),
            "plan.toml: evaluate: episode: found an unknown key, expected episodes",
        );
        check(
            &format!("seeds = [1]\n{variant}[evaluate]\nepisodes = \"x\"\n"),
            "plan.toml: evaluate: episodes: found \"x\"",
        );
        check(
            &format!("seeds = [1]\n{variant}[evaluate]\ncrowds = [\"VO\", \"XX\"]\n"),
            "plan.toml: evaluate: a-seed1: ",
        );
        check(
            &format!("seeds = [1]\n{variant}[evaluate]\ncrowds = [\"NH\"]\n"),
            "plan.toml: evaluate: a-seed1: ",
        );
    }
}
