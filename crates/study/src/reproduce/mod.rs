//! `cargo xtask reproduce`: the paper's tables and figures beside its figures, from shipped
//! policies or from nothing.
//!
//! Reading order: this file (what is asked for), `plan` (rows and their training settings),
//! `policies` (where policies come from), `cells` (episodes, each cell run once), `evaluator` (the
//! study), `tables`, `planners`, `deployment` with `mujoco`, `beyond`, `curves`, `paths` (what is
//! printed), `training` and `hours` (`--train`), `page` (docs/reproduction.md, README.md), `cards`
//! (docs/model-cards.md). The small preset, which trains everything within minutes, is a thing of
//! its own: `small`.

mod beyond;
mod cards;
mod cells;
mod curves;
mod deployment;
mod evaluator;
mod hours;
mod mujoco;
mod overview;
mod page;
mod paths;
pub(crate) mod plan;
mod planners;
pub(crate) mod policies;
mod small;
mod tables;
mod training;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::claims::of_paper::claims;
use crate::claims::test_claims;
use crate::verdicts;
use anyhow::{Context as _, Result, ensure};
use clap::{Args, ValueEnum};
use jostle_eval::report::PooledTable;
use jostle_ppo::Config;

use self::evaluator::RowEvaluator;
use self::hours::Rate;
use self::mujoco::Mujoco;
use self::plan::{Plan, ROWS, row_spec};
use self::policies::Policies;
use crate::ship::manifest;
use jostle_runs::output;
use jostle_runs::provenance::workspace;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::threads;

/// The trainer of what a table needs.
pub trait Trainings {
    /// Trains the configuration's updates into `folder`, or as many as are missing there.
    ///
    /// # Errors
    /// What the training or its folder refuses; a stop that was asked for.
    fn train(&self, config: &Config, folder: &Path, name: &str) -> Result<()>;

    /// Submits runs, each a variant's name and its configuration for a seed, to a cluster;
    /// `options` is a file with the keys of a plan's `[slurm]`.
    ///
    /// # Errors
    /// Options that cannot be read; what the cluster refuses.
    fn submit(&self, out: &Path, runs: Vec<(String, Config)>, options: Option<&Path>) -> Result<()>;
}

/// Makes a table of a study.
type Table = fn(&mut RowEvaluator) -> Result<PooledTable>;

/// Arguments of `reproduce`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask reproduce all\n  cargo xtask reproduce table1 --preset small\n  \
    cargo xtask reproduce table1 --train --rows m10\n  cargo xtask reproduce all --fresh\n  \
    cargo xtask reproduce table5 --mujoco\n  \
    cargo xtask reproduce all --train --slurm --slurm-options cluster.toml"
)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub struct ReproduceArgs {
    /// The target to reproduce.
    #[arg(value_enum)]
    target: Target,
    /// `small`: train small policies within minutes (table1 alone). `paper`: the shipped policies,
    /// or `--train`.
    #[arg(long, value_enum, default_value = "paper")]
    preset: Preset,
    /// Train from nothing instead of using what is shipped; says before how many hours it takes,
    /// and can be interrupted.
    #[arg(long)]
    train: bool,
    /// With --train: these settings alone, such as `m10` or `pool`; the others are the shipped
    /// ones.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', requires = "train")]
    rows: Vec<String>,
    /// With --train: submit the trainings to Slurm as one job array and stop; the same command
    /// without it goes on when they are done.
    #[arg(long, requires = "train")]
    slurm: bool,
    /// With --slurm: a file with the keys of a plan's `[slurm]`, such as partition, time, memory,
    /// modules (default: the cluster's own).
    #[arg(long, value_name = "FILE", requires = "slurm")]
    slurm_options: Option<PathBuf>,
    /// Run also the episodes that are stored, and compare.
    #[arg(long)]
    fresh: bool,
    /// With table5 or all: install MuJoCo below `target/` and run in it the cells that are not
    /// stored (with --fresh: all of its cells).
    #[arg(long)]
    mujoco: bool,
    /// Episodes of a cell.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    episodes: u64,
    /// Folder of shipped policies (default: `checkpoints/` of this repository).
    #[arg(long, value_name = "DIR")]
    checkpoints: Option<PathBuf>,
    /// Folder for cells and reports (default: `results/` of this repository; with --train
    /// `runs/paper/results`; with `--preset small` `runs/table1-small`, runs included).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --train: folder of the training runs.
    #[arg(long, value_name = "DIR", default_value = "runs/paper")]
    runs: PathBuf,
    /// Base setting of all rows (default: configs/headline.toml).
    #[arg(long, value_name = "FILE")]
    base: Option<PathBuf>,
    /// Worker threads (default: all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Preset {
    Small,
    Paper,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Target {
    /// Success rate against the number of behaviours M, among all six crowds.
    Table1,
    /// Success rate against the number of agents N.
    Table2,
    /// Success rate and D against the intrinsic reward.
    Table3,
    /// Success, time, distance and speed of baseline, safety zone and ours.
    Table4,
    /// Success on two realistic maps.
    Table5,
    /// Success of the strong policy, which is not of the paper.
    Strong,
    /// Every behaviour token in every crowd, how episodes end, and how robots drive.
    Beyond,
    /// Verdicts on what the paper's text says of its tables.
    Claims,
    /// Discriminator losses and intrinsic reward against updates.
    FigureLoss,
    /// The behaviours' ways around an obstacle.
    FigurePaths,
    /// All of these.
    All,
    /// Fill docs/reproduction.md and README.md from the results, and write docs/model-cards.md.
    Page,
    /// Bring the configuration of the safety-zone baseline into line with the base setting.
    Configs,
}

impl Target {
    /// The rows that it needs.
    fn rows(self) -> Vec<&'static str> {
        let of_table = |table: &str| {
            let serves = |row: &&plan::RowSpec| row.serves.iter().any(|place| place.starts_with(table));
            ROWS.iter().filter(serves).map(|row| row.name).collect()
        };
        match self {
            Self::Table1 => of_table("Table 1"),
            Self::Table2 => of_table("Table 2"),
            Self::Table3 => of_table("Table 3"),
            Self::Table4 => of_table("Table 4"),
            Self::Table5 => of_table("Table 5"),
            Self::Strong => tables::ROWS_STRONG.to_vec(),
            Self::FigureLoss | Self::FigurePaths => vec!["m5"],
            Self::Beyond | Self::Claims | Self::All => ROWS.iter().map(|row| row.name).collect(),
            Self::Page | Self::Configs => Vec::new(),
        }
    }
}

/// Reproduces what the arguments name.
pub fn run(args: &ReproduceArgs, trainings: &dyn Trainings) -> Result<ExitCode> {
    jostle_runs::shipped::checkout()?;
    threads::set(args.threads)?;
    let n_threads = args.threads.map_or(0, NonZeroUsize::get);
    let has_mujoco = args.preset == Preset::Paper && matches!(args.target, Target::Table5 | Target::All);
    ensure!(!args.mujoco || has_mujoco, "--mujoco: found {:?}, expected table5 or all", args.target);
    if args.preset == Preset::Small {
        ensure!(args.target == Target::Table1, "--preset small: found {:?}, expected table1", args.target);
        let out = args.out.clone().unwrap_or_else(|| PathBuf::from(small::FOLDER));
        small::run(&out, n_threads, trainings)?;
        return Ok(ExitCode::SUCCESS);
    }
    let default_results = if args.train { args.runs.join("results") } else { workspace().join("results") };
    let results = args.out.clone().unwrap_or(default_results);
    match args.target {
        Target::Page => {
            let checkpoints = args.checkpoints.clone().unwrap_or_else(manifest::default_folder);
            page::fill_all(&results, &checkpoints)?;
        }
        Target::Configs => Plan::store_safety_zone_file()?,
        target => study(args, target, &results, n_threads, trainings)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn study(
    args: &ReproduceArgs,
    target: Target,
    results: &Path,
    n_threads: usize,
    trainings: &dyn Trainings,
) -> Result<()> {
    let plan = Plan::new(&args.base.clone().unwrap_or_else(Plan::default_base))?;
    let trained = if args.train { training::chosen(&target.rows(), &args.rows)? } else { BTreeSet::new() };
    if args.slurm {
        let options = args.slurm_options.as_deref();
        return training::submit(&plan, &trained, &args.runs, n_threads, options, trainings);
    }
    if args.train {
        training::run(&plan, &trained, &args.runs, n_threads, trainings)?;
    }
    let checkpoints = args.checkpoints.clone().unwrap_or_else(manifest::default_folder);
    let policies = Policies::new(plan.clone(), &checkpoints, &args.runs, trained)?;
    let mujoco = args.mujoco.then(Mujoco::install).transpose()?;
    let mut evaluator = RowEvaluator::new(policies, results, args.fresh, args.episodes, mujoco)?;
    let is = |one: Target| target == one || target == Target::All;
    let tables: [(Target, Table); 10] = [
        (Target::Table1, tables::table_1),
        (Target::Table2, tables::table_2),
        (Target::Table3, tables::table_3),
        (Target::Table4, tables::table_4),
        (Target::Table5, tables::table_5),
        (Target::Table5, tables::table_dynamics),
        (Target::Strong, tables::table_strong),
        (Target::Beyond, beyond::driving),
        (Target::Beyond, beyond::outcomes),
        (Target::Beyond, beyond::tokens),
    ];
    for (_, table) in tables.into_iter().filter(|(of, _)| is(*of)) {
        let table = table(&mut evaluator)?;
        store_table(results, &table)?;
        output::result(&(table.text() + "\n"))?;
    }
    if is(Target::Claims) {
        verdicts_of(&mut evaluator, results)?;
    }
    if is(Target::FigureLoss) {
        figure_loss(&evaluator, &plan, results)?;
    }
    if is(Target::FigurePaths) {
        figure_paths(&mut evaluator, results)?;
    }
    evaluator.cells.describe();
    not_trained(&evaluator, &plan, n_threads)
}

/// Writes a table in all its forms.
fn store_table(results: &Path, table: &PooledTable) -> Result<()> {
    let path = |extension: &str| results.join(format!("{}.{extension}", table.id));
    write_atomically(&path("md"), &table.markdown())?;
    write_atomically(&path("csv"), &table.csv())?;
    write_atomically(&path("tex"), &table.latex())?;
    write_atomically(&path("json"), &table.json())
}

/// Tests the claims on all rows.
fn verdicts_of(evaluator: &mut RowEvaluator, results: &Path) -> Result<()> {
    for row in &ROWS {
        evaluator.row_with_diversity(row.name)?;
    }
    for row in Target::Table5.rows() {
        evaluator.row_at(row, deployment::run)?;
    }
    let results_of = test_claims(&evaluator.study(), &claims());
    let path = |extension: &str| results.join(format!("claims.{extension}"));
    write_atomically(&path("md"), &verdicts::markdown(&results_of))?;
    write_atomically(&path("csv"), &verdicts::csv(&results_of))?;
    write_atomically(&path("tex"), &verdicts::latex_table(&results_of))?;
    write_atomically(&path("json"), &verdicts::json(&results_of))?;
    output::result(&(verdicts::text(&results_of) + "\n"))
}

/// A figure: its numbers and its picture.
struct Figure {
    csv: String,
    svg: String,
}

fn figure_loss(evaluator: &RowEvaluator, plan: &Plan, results: &Path) -> Result<()> {
    let n_behaviours = plan.run(curves::VARIANT, 1).n_behaviours;
    match curves::figure(&evaluator.policies.curves(curves::VARIANT)?, n_behaviours)? {
        Some(figure) => store_figure(results, "figure-loss", &figure),
        None => output::result("figure-loss: no run of the row m5 has been trained yet\n"),
    }
}

fn figure_paths(evaluator: &mut RowEvaluator, results: &Path) -> Result<()> {
    let found = evaluator.policies.of("m5", row_spec("m5").updates)?;
    match found.first() {
        Some(first) => store_figure(results, "figure-paths", &paths::figure(first)?),
        None => output::result("figure-paths: no policy of the row m5 has been trained yet\n"),
    }
}

fn store_figure(results: &Path, name: &str, figure: &Figure) -> Result<()> {
    for (extension, text) in [("csv", &figure.csv), ("svg", &figure.svg)] {
        let path = results.join(format!("{name}.{extension}"));
        write_atomically(&path, text)?;
        output::result(&format!("{}\n", path.display()))?;
    }
    Ok(())
}

/// Names the rows without a policy, with the command and the hours that they take here.
fn not_trained(evaluator: &RowEvaluator, plan: &Plan, n_threads: usize) -> Result<()> {
    let missing: BTreeSet<&str> = evaluator.missing().into_iter().map(|row| row_spec(row).variant).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let rate = Rate::measure(plan, n_threads).context("cannot measure the time of an update")?;
    let mut text = String::from("Not trained yet, with the time that training takes on this machine:\n");
    for name in missing {
        let variant = plan.variant(name);
        let config = plan.run(name, variant.seeds[0]);
        let hours = rate.hours(&config, variant.length()) * variant.seeds.len() as f64;
        let seeds = if variant.seeds.len() == 1 { "seed" } else { "seeds" };
        writeln!(
            text,
            "  {name}: {} updates, {} {seeds}, about {hours:.1} h: {} reproduce all --train --rows {name}",
            variant.length(),
            variant.seeds.len(),
            output::program()
        )?;
    }
    output::result(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_has_the_rows_of_the_paper() {
        let counts = [Target::Table1, Target::Table2, Target::Table3, Target::Table4, Target::Table5]
            .map(|target| target.rows().len());
        assert_eq!(counts, [6, 6, 4, 3, 2]);
        assert_eq!(
            training::chosen(&Target::Table5.rows(), &[]).unwrap(),
            BTreeSet::from(["m1", "m5", "pool"])
        );
        let error = training::chosen(&[], &["m7".to_owned()]).unwrap_err().to_string();
        assert!(error.contains("--rows: found m7") && error.contains("m10"), "{error}");
    }
}
