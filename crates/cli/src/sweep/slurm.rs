//! A plan's runs as one job array of Slurm (<https://slurm.schedmd.com/job_array.html>).
//!
//! A submission takes a copy of everything that the runs read: this program
//! (`OUT/slurm/program-HASH`), the plan and the variants' configurations (`OUT/slurm/N/`), so that
//! neither a new build nor an edited file reaches jobs that still wait. Each element of the array
//! does one run of the plan, as `sweep task` does anywhere. It may be killed, requeued, or started
//! twice: it goes on from its run folder's last checkpoint, and waits where another process still
//! holds the folder. Two minutes before the time limit it lets go and queues itself again.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use jostle_arena::identity::hex_sha256;
use serde::{Deserialize, Serialize};

use super::local::quote;
use super::plan::Plan;
use super::spec::Task;
use super::task::{Stage, log_path};
use jostle_runs::folder::read_optional;
use jostle_runs::output::note;
use jostle_runs::run_folder::write_atomically;
use jostle_runs::tools::on_path;

/// Folder of submissions below the plan's output folder.
const FOLDER: &str = "slurm";
/// File with the job that a submission became.
const JOB: &str = "job.json";
/// Seconds before the time limit at which a run lets go.
const GRACE: u32 = 120;

/// A submission that Slurm has taken.
#[derive(Serialize, Deserialize)]
struct Job {
    /// Slurm's number of the array.
    job: u64,
    /// Names of the runs, by their index in the array.
    runs: Vec<String>,
}

/// Submits what is neither done nor queued nor being made.
///
/// # Errors
/// Where there is no Slurm, or it refuses the array.
pub(super) fn submit(plan: &Plan) -> Result<String> {
    ensure!(
        on_path(&["sbatch"]).is_some(),
        "sbatch is not on the path: there is no Slurm here; `sweep --print` gives a line a run for anything else"
    );
    let queued = queued(plan)?;
    let mut tasks = Vec::new();
    for task in &plan.tasks {
        let stage = Stage::read(plan, task)?;
        if queued.contains_key(&task.name) || stage == Stage::Running {
            note(&format!("sweep: {} is queued or being made already", task.name));
        } else if stage != Stage::Done {
            tasks.push(task);
        }
    }
    if tasks.is_empty() {
        return Ok(format!(
            "nothing to submit: all {} runs are done, queued or being made\n",
            plan.tasks.len()
        ));
    }
    let folder = new_folder(plan)?;
    let program = keep_program(plan)?;
    let copy = store_plan(plan, &folder)?;
    let script = folder.join("array.sh");
    write_atomically(&script, &array_script(plan, &tasks, &program, &copy))?;
    let logs = log_path(plan, "x");
    let logs = logs.parent().unwrap_or(&plan.out);
    std::fs::create_dir_all(logs).with_context(|| format!("cannot create {}", logs.display()))?;
    let here = std::env::current_dir().context("cannot find the working folder")?;
    let answer = Command::new("sbatch")
        .arg("--parsable")
        .arg(format!("--chdir={}", here.display()))
        .arg(format!("--output={}", folder.join("slurm-%a.txt").display()))
        .arg(&script)
        .output()
        .context("cannot start sbatch")?;
    let said = String::from_utf8_lossy(&answer.stdout).trim().to_owned();
    // `JOB` or `JOB;CLUSTER`.
    let job = said.split(';').next().and_then(|number| number.parse().ok());
    let Some(job) = job.filter(|_| answer.status.success()) else {
        let reason = String::from_utf8_lossy(&answer.stderr).trim().replace('\n', " ");
        bail!("sbatch refuses {}: {reason}{said}", script.display());
    };
    let runs: Vec<String> = tasks.iter().map(|task| task.name.clone()).collect();
    let record = serde_json::to_string(&Job { job, runs }).context("a job that is no JSON")?;
    write_atomically(&folder.join(JOB), &(record + "\n"))?;
    Ok(format!(
        "submitted job {job}: {} runs, script {}; `{} sweep status {}` tells how far they are\n",
        tasks.len(),
        script.display(),
        jostle_runs::output::program(),
        plan.path.display()
    ))
}

/// The runs of a plan that Slurm has queued or started, each with its job and Slurm's word for its
/// state.
pub(super) fn queued(plan: &Plan) -> Result<BTreeMap<String, String>> {
    let jobs = jobs(plan)?;
    if jobs.is_empty() || on_path(&["squeue"]).is_none() {
        return Ok(BTreeMap::new());
    }
    let answer = Command::new("squeue")
        .args(["--noheader", "--array", "--me", "--format=%F %K %T"])
        .output()
        .context("cannot start squeue")?;
    if !answer.status.success() {
        let reason = String::from_utf8_lossy(&answer.stderr).trim().replace('\n', " ");
        bail!("squeue does not answer: {reason}");
    }
    let mut found = BTreeMap::new();
    for line in String::from_utf8_lossy(&answer.stdout).lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [job, index, state] = words[..] else { continue };
        let run = jobs.iter().find(|known| job.parse() == Ok(known.job));
        let name = run.zip(index.parse().ok()).and_then(|(run, index): (&Job, usize)| run.runs.get(index));
        if let Some(name) = name {
            found.insert(name.clone(), format!("{} ({job}_{index})", state.to_lowercase()));
        }
    }
    Ok(found)
}

/// Every submission of the plan.
fn jobs(plan: &Plan) -> Result<Vec<Job>> {
    let mut jobs = Vec::new();
    for number in 1.. {
        let folder = plan.out.join(FOLDER).join(number.to_string());
        if !folder.is_dir() {
            break;
        }
        let path = folder.join(JOB);
        // A submission that was refused has none.
        if let Some(text) = read_optional(&path)? {
            let job = serde_json::from_str(&text);
            jobs.push(job.with_context(|| format!("{} is no submission", path.display()))?);
        }
    }
    Ok(jobs)
}

/// A folder for the next submission.
fn new_folder(plan: &Plan) -> Result<PathBuf> {
    let all = plan.out.join(FOLDER);
    std::fs::create_dir_all(&all).with_context(|| format!("cannot create {}", all.display()))?;
    for number in 1_u32.. {
        let folder = all.join(number.to_string());
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error).with_context(|| format!("cannot create {}", folder.display())),
        }
    }
    bail!("{} holds too many submissions", all.display())
}

/// A copy of this program that no build replaces.
fn keep_program(plan: &Plan) -> Result<PathBuf> {
    let own = super::local::this_program()?;
    let bytes = std::fs::read(&own).context("cannot read this program")?;
    let path = plan.out.join(FOLDER).join(format!("program-{}", &hex_sha256(&bytes)[..12]));
    if !path.exists() {
        let partial = path.with_extension(format!("{}.partial", std::process::id()));
        // `copy` keeps the permission to execute.
        std::fs::copy(&own, &partial)
            .and_then(|_| std::fs::rename(&partial, &path))
            .with_context(|| format!("cannot copy this program to {}", path.display()))?;
    }
    absolute(&path)
}

/// Writes the plan with all its configurations into a folder; returns its path.
pub(super) fn store_plan(plan: &Plan, folder: &Path) -> Result<PathBuf> {
    let folder = absolute(folder)?;
    let mut table = toml::Table::new();
    table.insert("out".to_owned(), plan.out.to_string_lossy().into_owned().into());
    table.insert("threads".to_owned(), (threads(plan) as i64).into());
    table.insert("checkpoint_minutes".to_owned(), plan.checkpoint_minutes.into());
    table.insert("window".to_owned(), (plan.window as i64).into());
    let mut variants: Vec<(&Task, Vec<u64>)> = Vec::new();
    for task in &plan.tasks {
        match variants.iter_mut().find(|(first, _)| first.variant == task.variant) {
            Some((_, seeds)) => seeds.push(task.config.seed),
            None => variants.push((task, vec![task.config.seed])),
        }
    }
    let integers =
        |list: &[u64]| list.iter().map(|&number| (number as i64).into()).collect::<Vec<toml::Value>>();
    let mut sections = Vec::new();
    for (task, seeds) in &variants {
        let base = folder.join(format!("{}.toml", task.variant));
        let config = task.config.as_named_in(&folder);
        let text = toml::to_string(&config).context("a configuration that is no TOML")?;
        write_atomically(&base, &text)?;
        let mut section = toml::Table::new();
        section.insert("name".to_owned(), task.variant.clone().into());
        section.insert("base".to_owned(), base.to_string_lossy().into_owned().into());
        section.insert("seeds".to_owned(), integers(seeds).into());
        section.insert("milestones".to_owned(), integers(&task.milestones).into());
        sections.push(toml::Value::Table(section));
    }
    table.insert("variant".to_owned(), sections.into());
    table.extend(plan.evaluation.as_ref().map(|of| ("evaluate".to_owned(), of.source.clone().into())));
    table.insert("slurm".to_owned(), plan.slurm.table().into());
    let path = folder.join("plan.toml");
    write_atomically(&path, &toml::to_string(&table).context("a plan that is no TOML")?)?;
    Ok(path)
}

/// Threads, and so processors, of a run.
fn threads(plan: &Plan) -> usize {
    plan.threads.unwrap_or(1)
}

/// The script of an array that does these runs.
fn array_script(plan: &Plan, tasks: &[&Task], program: &Path, copy: &Path) -> String {
    let slurm = &plan.slurm;
    let name = plan.path.file_stem().unwrap_or_default().to_string_lossy().replace(char::is_whitespace, "-");
    let mut text = "#!/bin/bash\n".to_owned();
    let mut option = |line: &str| {
        let _ = writeln!(text, "#SBATCH {line}");
    };
    option(&format!("--job-name={name}"));
    let most = slurm.at_a_time.map_or_else(String::new, |most| format!("%{most}"));
    option(&format!("--array=0-{}{most}", tasks.len() - 1));
    option("--nodes=1");
    option("--ntasks=1");
    option(&format!("--cpus-per-task={}", threads(plan)));
    // A node that dies, and whoever takes the node away, costs what came after the last checkpoint.
    option("--requeue");
    option("--open-mode=append");
    let values = [
        ("partition", &slurm.partition),
        ("time", &slurm.time),
        ("mem", &slurm.memory),
        ("account", &slurm.account),
    ];
    for (key, value) in values {
        if let Some(value) = value {
            option(&format!("--{key}={value}"));
        }
    }
    if slurm.time.is_some() {
        option(&format!("--signal=B:USR1@{GRACE}"));
    }
    for line in &slurm.options {
        option(line);
    }
    let runs: Vec<String> = tasks.iter().map(|task| quote(&task.name)).collect();
    let logs = log_path(plan, "x");
    let logs = quote(&logs.parent().unwrap_or(&plan.out).to_string_lossy());
    let _ = write!(
        text,
        "\nruns=({})\nrun=${{runs[$SLURM_ARRAY_TASK_ID]}}\nexec >>{logs}/\"$run\".txt 2>&1\n",
        runs.join(" ")
    );
    for module in &slurm.modules {
        let _ = writeln!(text, "module load {} || exit 1", quote(module));
    }
    let _ = write!(
        text,
        "# Shortly before the time limit: stop at a checkpoint, and queue again.\n\
         again() {{\n  kill \"$process\"\n  wait \"$process\"\n  \
         exec scontrol requeue \"${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}\"\n}}\n\
         trap again USR1\n\
         {} sweep task --wait --threads {} {} \"$run\" &\nprocess=$!\nwait \"$process\"\n",
        quote(&program.to_string_lossy()),
        threads(plan),
        quote(&copy.to_string_lossy()),
    );
    text
}

fn absolute(path: &Path) -> Result<PathBuf> {
    path.canonicalize().with_context(|| format!("cannot find {}", path.display()))
}
