//! `cargo xtask train`: one run of Algorithm 1 into a run folder, resumable to the bit.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use clap::Args;
use jostle_ppo::report::EpisodeCounts;
use jostle_ppo::{Config, Trainer};

use crate::ndjson::{Log, truncate_log};
use crate::output;
use crate::progress::{Progress, clock};
use crate::provenance;
use crate::run_folder::RunFolder;

/// A run keeps a checkpoint for each of this many equal parts: 31 MB each at the paper's sizes. The half serves crowd SO,
/// the quarter a row of Table 1.
const PARTS: u64 = 4;
/// Newest checkpoints that are kept whatever happens: the last one and, should it be damaged, the one before.
const NEWEST: usize = 2;
/// Updates over which the shown success is taken.
const RECENT: usize = 50;

/// Arguments of `train`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask train --config configs/diversity_m5.toml --out runs/ours\n  \
    cargo xtask train --config configs/diversity_m5.toml --set seed=7 --set updates=1500 --out runs/ours-7 --resume"
)]
pub(crate) struct TrainArgs {
    /// TOML file; keys that it leaves out have the paper's values.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Override one key, such as `alpha=0.03` or `sim.laser.noise_std=0`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Run folder; must not hold another run.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Go on from the newest checkpoint; starts from nothing where there is none.
    #[arg(long)]
    resume: bool,
    /// Worker threads (default: the configuration's, else all cores). The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Trains as the arguments say.
pub(crate) fn run(args: &TrainArgs) -> Result<ExitCode> {
    let mut config = Config::load(&args.config, &args.overrides)?;
    if let Some(threads) = args.threads {
        config.threads = threads;
    }
    let outcome = train(&config, &args.out, args.resume, "train")?;
    output::result(&format!(
        "{}: {} updates, {} transitions, config {}, seed {}, {}\n",
        args.out.display(),
        config.updates,
        config.updates * config.rollout_len() as u64,
        short(&config.hash()),
        config.seed,
        outcome.describe(),
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// What a call to [`train`] did.
pub(crate) struct Trained {
    /// Updates that were there before.
    found: u64,
    /// Updates that this process made.
    made: u64,
    seconds: f64,
}

impl Trained {
    fn describe(&self) -> String {
        match self.made {
            0 => "was finished already".to_owned(),
            _ if self.found == 0 => format!("trained in {}", clock(self.seconds)),
            made => format!("{made} of them in {} after a resume at {}", clock(self.seconds), self.found),
        }
    }
}

/// Trains the configuration's updates into `folder`, or as many as are missing when `resume` is set.
///
/// # Errors
/// When the folder holds another run, or this one and `resume` is not set; when it cannot be written; when training stops
/// at a number that is not finite. Complete checkpoints stay as they are in all cases.
pub(crate) fn train(config: &Config, folder: &Path, resume: bool, name: &str) -> Result<Trained> {
    let run = RunFolder::open(folder)?;
    claim(&run, config, folder, resume)?;
    let mut trainer = newest_trainer(&run, config)?;
    // Only now: what cannot be trained leaves no trace in the folder.
    run.store_config(&toml::to_string(config).context("a configuration that is no TOML")?)?;
    let found = updates(&trainer);
    if found > config.updates {
        output::note(&format!(
            "{name}: {} holds {found} updates, more than the {} asked for",
            folder.display(),
            config.updates
        ));
    }
    let repair = truncate_log(&run.log(), found)?;
    if repair.torn {
        output::note(&format!("{name}: repaired the torn last line of {}", run.log().display()));
    }
    if repair.dropped > 0 {
        output::note(&format!(
            "{name}: {} logged updates after the checkpoint are made again",
            repair.dropped
        ));
    }
    if found == 0 && !run.checkpoint(0).exists() {
        save(&run, &mut trainer, config)?;
    } else if found <= config.updates {
        // A kill between a checkpoint and what follows it leaves an old `latest` and a checkpoint too many.
        settle(&run, found, config)?;
        if found > 0 && found < config.updates {
            output::note(&format!("{name}: resumed at update {found}"));
        }
    }
    let started = Instant::now();
    let mut log = Log::append_to(&run.log())?;
    let mut progress = Progress::new(name, config.updates, found);
    let mut recent = Recent::default();
    while updates(&trainer) < config.updates {
        let report = trainer.update()?;
        log.append(&report)?;
        recent.push(report.episodes);
        let done = updates(&trainer);
        progress.set(done, &recent.describe());
        if is_checkpoint(done, config) {
            log.sync()?;
            save(&run, &mut trainer, config)?;
        }
    }
    let made = config.updates.saturating_sub(found);
    if made > 0 {
        progress.finish(&recent.describe());
    }
    Ok(Trained { found, made, seconds: started.elapsed().as_secs_f64() })
}

/// Updates that a trainer has done.
fn updates(trainer: &Trainer) -> u64 {
    trainer.provenance().update
}

/// Checks that the folder may be used for this configuration.
fn claim(run: &RunFolder, config: &Config, folder: &Path, resume: bool) -> Result<()> {
    let shown = folder.display();
    if let Some(text) = run.stored_config()? {
        let none: &[&str] = &[];
        let stored = Config::parse(&text, &format!("{shown}/config.toml"), none)?;
        let (found, wanted) = (stored.hash(), config.hash());
        if found != wanted {
            bail!(
                "{shown} holds another run (config {}, not {}); choose another folder",
                short(&found),
                short(&wanted)
            );
        }
        if !resume {
            bail!("{shown} holds this run already; pass --resume to go on with it");
        }
    }
    Ok(())
}

/// The trainer at the newest checkpoint that can be read, or a fresh one.
fn newest_trainer(run: &RunFolder, config: &Config) -> Result<Trainer> {
    let mut damaged = Vec::new();
    for (_, path) in run.checkpoints()? {
        match Trainer::resume_with(&path, config.clone()) {
            Ok(trainer) => {
                for message in damaged {
                    output::note(&format!("passed over a damaged checkpoint: {message}"));
                }
                return Ok(trainer);
            }
            Err(error) => damaged.push(error.to_string()),
        }
    }
    // Starting from nothing over damaged checkpoints would throw work away without a word.
    if let Some(message) = damaged.into_iter().next() {
        bail!("no checkpoint can be read: {message}");
    }
    let mut trainer = Trainer::new(config.clone())?;
    trainer.set_commit(provenance::commit());
    Ok(trainer)
}

fn is_milestone(update: u64, config: &Config) -> bool {
    let part = (config.updates / PARTS).max(1);
    update > 0 && (update.is_multiple_of(part) || update == config.updates / 2 || update == config.updates)
}

fn is_checkpoint(update: u64, config: &Config) -> bool {
    update.is_multiple_of(config.checkpoint_every) || is_milestone(update, config)
}

/// Saves the trainer and drops older checkpoints that are no milestones.
fn save(run: &RunFolder, trainer: &mut Trainer, config: &Config) -> Result<()> {
    let update = updates(trainer);
    trainer.save(&run.checkpoint(update))?;
    settle(run, update, config)
}

/// Names the checkpoint after `update` updates as the newest and drops older ones that are no milestones.
fn settle(run: &RunFolder, update: u64, config: &Config) -> Result<()> {
    run.set_latest(update)?;
    for (update, path) in run.checkpoints()?.into_iter().skip(NEWEST) {
        if !is_milestone(update, config) {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

/// The training episodes of the last updates: what a person watches.
#[derive(Default)]
struct Recent(VecDeque<EpisodeCounts>);

impl Recent {
    fn push(&mut self, counts: EpisodeCounts) {
        if self.0.len() == RECENT {
            self.0.pop_front();
        }
        self.0.push_back(counts);
    }

    fn describe(&self) -> String {
        let ended: u64 = self.0.iter().map(|counts| counts.ended).sum();
        let success: u64 = self.0.iter().map(|counts| counts.success).sum();
        match ended {
            0 => String::new(),
            _ => format!("success {:.2} over {ended} episodes", success as f64 / ended as f64),
        }
    }
}

/// The start of a hash, enough to tell runs apart.
pub(crate) fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}
