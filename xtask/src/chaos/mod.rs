//! `cargo xtask chaos`: kills training and evaluation at random moments and looks for anything that
//! was lost.
//!
//! A small run is trained once without interruption. Then the same run is trained again and again
//! in new folders, each killed with `kill -9` at moments drawn from a seeded stream (after a random
//! time, while a checkpoint is being written, when the log grows) and resumed with another number
//! of threads, until it is finished; sometimes half a line is left at the end of the log, as a torn
//! write would. Its folder must then be that of the uninterrupted run: the same files with the same
//! bytes, but for the clock in the log. Evaluations of the finished run are treated alike.
//!
//! With `--gently` training is asked to stop, by SIGTERM: it must then say so by its exit status,
//! and its newest checkpoint must hold every update that its log has.
//!
//! Reading order: this file; [`victim`] (what is killed); [`trigger`] (when); [`compare`] (what
//! must be equal).

pub(crate) mod compare;
mod trigger;
mod victim;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::Args;
use jostle_sim::{StreamRng, Streams};
use rand::RngExt as _;

use compare::differences;
use jostle_runs::output;
use trigger::{Moment, Trigger};
use victim::{Ending, Victim};

/// One kill in this many is of `evaluate`, the others of `train`.
const EVALUATIONS: u64 = 3;
/// One resumed log in this many gets a torn line.
const TORN: u32 = 4;

/// Arguments of `chaos`.
#[derive(Args)]
#[command(
    after_help = "Example:\n  cargo xtask chaos --kills 50 --seed 1\n  cargo xtask chaos --kills 20 --gently"
)]
pub(crate) struct ChaosArgs {
    /// Number of times that a process is killed.
    #[arg(long, value_name = "N", default_value_t = 50)]
    kills: u64,
    /// Only train, and stop it by SIGTERM instead: nothing at all may be made again then.
    #[arg(long)]
    gently: bool,
    /// Seed of the moments.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Working folder (default: a new one among the system's temporary ones, removed when nothing
    /// was lost).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Kills as often as the arguments say; the exit status tells whether anything was lost.
pub(crate) fn run(args: &ChaosArgs) -> Result<ExitCode> {
    let name = format!("jostle-chaos-{}", std::process::id());
    let folder = args.out.clone().unwrap_or_else(|| std::env::temp_dir().join(name));
    anyhow::ensure!(!folder.exists(), "{} is there already; choose a new folder", folder.display());
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let mut tally = Tally::default();
    let evaluations = if args.gently { 0 } else { args.kills / EVALUATIONS };
    let train = Victim::train(&folder, args.gently)?;
    torment(&train, args.kills - evaluations, args.seed, &mut tally)?;
    if tally.lost.is_empty() && evaluations > 0 {
        let evaluate = Victim::evaluate(&folder, &train.reference())?;
        torment(&evaluate, evaluations, args.seed, &mut tally)?;
    }
    for loss in &tally.lost {
        output::note(loss);
    }
    output::result(&tally.line(args.seed))?;
    if !tally.lost.is_empty() {
        output::note(&format!("kept for inspection: {}", folder.display()));
        return Ok(ExitCode::FAILURE);
    }
    std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// Counts of what was done and what was lost.
#[derive(Default)]
struct Tally {
    kills: u64,
    runs: u64,
    during_checkpoint: u64,
    during_append: u64,
    torn: u64,
    lost: Vec<String>,
}

impl Tally {
    fn line(&self, seed: u64) -> String {
        format!(
            "chaos: {} kills ({} while a checkpoint was written, {} as a log or record file grew), {} torn lines, \
             {} runs finished after them, {} lost or different, seed {seed}\n",
            self.kills,
            self.during_checkpoint,
            self.during_append,
            self.torn,
            self.runs,
            self.lost.len(),
        )
    }
}

/// Kills a victim `kills` times, over as many runs as that takes, and compares every finished run.
fn torment(victim: &Victim, kills: u64, seed: u64, tally: &mut Tally) -> Result<()> {
    let span = victim.uninterrupted()?;
    let mut rng = Streams::new(seed).stream(victim.name(), &[]);
    let last = tally.kills + kills;
    for round in 0_u64.. {
        let folder = victim.folder(&format!("{}-{round}", victim.name()));
        loop {
            let threads = rng.random_range(1..=3_u32);
            if tally.kills == last {
                victim.finish(&folder, threads)?;
                break;
            }
            let trigger = Trigger::draw(&mut rng, span);
            match victim.start_and_kill(&folder, threads, &trigger)? {
                Ending::Finished => break,
                Ending::Killed(moment) => {
                    tally.kills += 1;
                    tally.during_checkpoint += u64::from(moment == Moment::Checkpoint);
                    tally.during_append += u64::from(moment == Moment::Append);
                    tally.lost.extend(Victim::lost_checkpoint(&folder));
                    if victim.gently() {
                        tally.lost.extend(victim.lost_updates(&folder)?);
                    } else {
                        tally.torn += u64::from(tear(victim, &folder, &mut rng)?);
                    }
                }
            }
        }
        tally.runs += 1;
        let found = differences(&victim.reference(), &folder)?;
        tally.lost.extend(found.iter().map(|what| format!("{}: {what}", folder.display())));
        if tally.kills == last || !tally.lost.is_empty() {
            return Ok(());
        }
    }
    Ok(())
}

/// Sometimes leaves half a line behind a growing file, as a write that was cut short would.
fn tear(victim: &Victim, folder: &Path, rng: &mut StreamRng) -> Result<bool> {
    const LINE: &str = r#"{"update":9,"episode":9,"transitions":"#;
    let (chosen, length) = (rng.random_ratio(1, TORN), rng.random_range(1..LINE.len()));
    let Some(file) = victim.growing_file(folder).filter(|_| chosen) else { return Ok(false) };
    std::fs::OpenOptions::new()
        .append(true)
        .open(&file)
        .and_then(|mut open| open.write_all(&LINE.as_bytes()[..length]))
        .with_context(|| format!("cannot tear {}", file.display()))?;
    Ok(true)
}
