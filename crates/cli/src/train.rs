//! `cargo xtask train`: one run of Algorithm 1 into a run folder, resumable to the bit.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use jostle_policy::{Device, PolicyFile, Precision};
use jostle_ppo::report::EpisodeCounts;
use jostle_ppo::{Config, PpoError, Trainer, UpdateReport};

use jostle_runs::folder::checkpoint_path;
use jostle_runs::log::short;
use jostle_runs::maps;
use jostle_runs::ndjson::{Log, truncate_log};
use jostle_runs::output;
use jostle_runs::progress::{Progress, clock};
use jostle_runs::provenance;
use jostle_runs::run_folder::RunFolder;
use jostle_runs::stop::{self, Stopped};

use crate::crew::Crew;

/// A run keeps a checkpoint for each of this many equal parts: 31 MB each at the paper's sizes. The
/// half serves crowd SO, the quarter a row of Table 1.
const PARTS: u64 = 4;
/// Newest checkpoints that are kept whatever happens: the last one and, should it be damaged, the
/// one before.
const NEWEST: usize = 2;
/// Updates over which the shown success is taken.
const RECENT: usize = 50;
/// Minutes between checkpoints that are written whatever the number of updates, where nothing else
/// is said.
pub(crate) const CHECKPOINT_MINUTES: f64 = 5.0;
/// Most minutes between two of them: a year.
const CHECKPOINT_MINUTES_MAX: f64 = 525_600.0;

/// Arguments of `train`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  cargo xtask train --config configs/diversity_m5.toml --out runs/ours\n  \
    cargo xtask train --config configs/diversity_m5.toml --set seed=7 --set updates=1500 --out runs/ours-7 --resume"
)]
pub struct TrainArgs {
    /// TOML file, or the name of a shipped one, such as `strong`; keys that it leaves out have the
    /// paper's values.
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
    /// Worker threads (default: the configuration's, else all cores). The result does not depend on
    /// it.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Device of the networks, such as `cuda:0`: the key `device`, and `backend=reference` for a
    /// GPU. Each device has its own bits, and is another run.
    #[arg(long, value_name = "DEVICE")]
    device: Option<Device>,
    /// Minutes after which a checkpoint is written between those of `checkpoint_every`; it is
    /// removed when the run is finished. What a kill can cost. 0: none.
    #[arg(long, value_name = "M", default_value_t = CHECKPOINT_MINUTES)]
    checkpoint_minutes: f64,
    /// Transitions after which the policy is kept as `milestones/N.safetensors`, separated by
    /// commas; the first update that reaches a number counts.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    milestones: Vec<u64>,
}

/// Trains as the arguments say, together with the other processes of an MPI job if this is one.
pub(crate) fn run(args: &TrainArgs) -> Result<ExitCode> {
    let crew = Crew::muster()?;
    let outcome = run_in(&crew, args);
    crew.report(outcome)
}

fn run_in(crew: &Crew, args: &TrainArgs) -> Result<ExitCode> {
    let (config, care) = crew.agree(prepare(args))?;
    crew.at_first(|| {
        maps::tell(&config.sim.room)?;
        maps::tell_all(&config.training_crowd.map_files())
    })?;
    let outcome = train(&config, &args.out, args.resume, "train", &care, crew)?;
    if crew.is_first() {
        output::result(&format!(
            "{}: {} updates, {} transitions, config {}, seed {}, {}\n",
            args.out.display(),
            config.updates,
            config.updates * config.rollout_len() as u64,
            short(&config.hash()),
            config.seed,
            outcome.describe(),
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn prepare(args: &TrainArgs) -> Result<(Config, Care)> {
    let mut overrides = args.overrides.clone();
    if let Some(device) = args.device {
        // The back end first: each override must leave a configuration that can be.
        let backend = (device != Device::Cpu).then(|| "backend=reference".to_owned());
        overrides.extend(backend.into_iter().chain([format!("device={device}")]));
    }
    let mut config = Config::load(&jostle_runs::shipped::config(&args.config)?, &overrides)?;
    if let Some(threads) = args.threads {
        config.threads = threads;
    }
    stop::on_signals()?;
    Ok((config, Care::new(args.checkpoint_minutes, &args.milestones)?))
}

/// Files kept of a run beside the checkpoints that its configuration asks for. None of it changes
/// the curve.
#[derive(Clone, Debug)]
pub(crate) struct Care {
    /// Time after which a checkpoint is written between two of the configuration's.
    every: Option<Duration>,
    /// Transitions after which the policy is kept, ascending.
    milestones: Vec<u64>,
    /// True to wait where another process works in the folder, instead of failing.
    pub(crate) wait: bool,
}

impl Default for Care {
    /// A checkpoint every [`CHECKPOINT_MINUTES`], no milestones.
    fn default() -> Self {
        Self {
            every: Some(Duration::from_secs_f64(60.0 * CHECKPOINT_MINUTES)),
            milestones: Vec::new(),
            wait: false,
        }
    }
}

impl Care {
    /// Checkpoints every so many minutes (0: none) and policies at these numbers of transitions.
    ///
    /// # Errors
    /// Minutes that are no time; a number of transitions that is 0.
    pub(crate) fn new(minutes: f64, milestones: &[u64]) -> Result<Self> {
        if !(0.0..=CHECKPOINT_MINUTES_MAX).contains(&minutes) {
            bail!(
                "--checkpoint-minutes: found {minutes}, expected a number from 0 to {CHECKPOINT_MINUTES_MAX}"
            );
        }
        if milestones.contains(&0) {
            bail!("--milestones: found 0, expected numbers of transitions of at least 1");
        }
        let mut milestones = milestones.to_vec();
        milestones.sort_unstable();
        milestones.dedup();
        let every = (minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes));
        Ok(Self { every, milestones, wait: false })
    }

    /// The milestones with the updates that reach them, as far as the run gets there.
    fn updates<'a>(&'a self, config: &'a Config) -> impl Iterator<Item = (u64, u64)> + 'a {
        let at = |transitions: u64| (transitions, transitions.div_ceil(config.rollout_len() as u64));
        self.milestones
            .iter()
            .map(move |&transitions| at(transitions))
            .filter(|(_, at)| *at <= config.updates)
    }
}

/// The result of a call to [`train`].
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

/// Trains the configuration's updates into `folder`, or as many as are missing when `resume` is
/// set. The processes of a crew all call this; the first one writes.
///
/// # Errors
/// When the folder holds another run, or this one and `resume` is not set; when it cannot be
/// written; when training stops at a number that is not finite, or, with [`Stopped`], where a
/// signal asked for it. Complete checkpoints stay as they are in all cases.
pub(crate) fn train(
    config: &Config,
    folder: &Path,
    resume: bool,
    name: &str,
    care: &Care,
    crew: &Crew,
) -> Result<Trained> {
    let claimed = crew.at_first(|| {
        let run = RunFolder::open(folder, care.wait)?;
        claim(&run, config, folder, resume)?;
        Ok(run)
    })?;
    let mut trainer = newest_trainer(claimed.as_ref(), config, folder, crew)?;
    let found = updates(&trainer);
    // Only now: what cannot be trained leaves no trace in the folder.
    let mut desk = crew.at_first(|| Desk::begin(of_first(claimed), name, (config, care), folder, found))?;
    if crew.decide(|| Ok(desk.as_ref().is_some_and(|desk| desk.is_new(found))))? {
        trainer.save(&checkpoint(desk.as_ref(), found))?;
    }
    crew.at_first(|| of_first(desk.as_ref()).catch_up(found))?;
    let started = Instant::now();
    let mut saved = started;
    while updates(&trainer) < config.updates {
        let report = trainer.update()?;
        let done = updates(&trainer);
        crew.at_first(|| of_first(desk.as_mut()).log(&report))?;
        if let Some(desk) = &mut desk {
            let rate = (done - found) as f64 * config.rollout_len() as f64 / started.elapsed().as_secs_f64();
            desk.show(done, rate);
        }
        let milestone = care.updates(config).any(|(_, at)| at == done);
        let stopped = crew.any(stop::asked())? && done < config.updates;
        let due = crew.decide(|| Ok(care.every.is_some_and(|every| saved.elapsed() >= every)))?;
        if is_planned(done, config) || milestone || stopped || due {
            crew.at_first(|| of_first(desk.as_mut()).log.sync())?;
            trainer.save(&checkpoint(desk.as_ref(), done))?;
            crew.at_first(|| of_first(desk.as_ref()).settle(done))?;
            saved = Instant::now();
        }
        if stopped {
            let again = "nothing is lost, and the same command with --resume goes on there";
            return Err(
                Stopped(format!("{name}: stopped at update {done} of {}; {again}", config.updates)).into()
            );
        }
    }
    let made = config.updates.saturating_sub(found);
    if let Some(desk) = desk
        && made > 0
    {
        desk.progress.finish(&desk.recent.describe());
    }
    Ok(Trained { found, made, seconds: started.elapsed().as_secs_f64() })
}

/// What the first process alone has.
fn of_first<T>(of_first: Option<T>) -> T {
    of_first.expect("asked in the first process alone")
}

/// Path of a checkpoint, where this process writes.
fn checkpoint(desk: Option<&Desk<'_>>, update: u64) -> PathBuf {
    desk.map_or_else(PathBuf::new, |desk| desk.run.checkpoint(update))
}

/// What writes and prints: the first process's.
struct Desk<'a> {
    run: RunFolder,
    name: &'a str,
    config: &'a Config,
    care: &'a Care,
    log: Log,
    progress: Progress,
    recent: Recent,
}

impl<'a> Desk<'a> {
    /// Of a run that has come to `found` updates.
    fn begin(
        run: RunFolder,
        name: &'a str,
        (config, care): (&'a Config, &'a Care),
        folder: &Path,
        found: u64,
    ) -> Result<Self> {
        let stored = config.as_named_in(folder);
        run.store_config(&toml::to_string(&stored).context("a configuration that is no TOML")?)?;
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
        let log = Log::append_to(&run.log())?;
        let progress = Progress::new(name, config.updates, found);
        Ok(Self { run, name, config, care, log, progress, recent: Recent::default() })
    }

    /// True if not even the checkpoint of the beginning is there.
    fn is_new(&self, found: u64) -> bool {
        found == 0 && !self.run.checkpoint(0).exists()
    }

    /// Does what a process that was killed after its last checkpoint may have left undone.
    fn catch_up(&self, found: u64) -> Result<()> {
        let Self { run, name, config, care, .. } = self;
        if found <= config.updates {
            // A kill between a checkpoint and what follows it leaves an old `latest` and a
            // checkpoint too many.
            self.settle(found)?;
            if found > 0 && found < config.updates {
                output::note(&format!("{name}: resumed at update {found}"));
            }
        }
        for (transitions, _) in care.updates(config).filter(|(_, at)| *at < found) {
            if !run.milestone(transitions).exists() {
                output::note(&format!(
                    "{name}: no policy at {transitions} transitions: the run was past them when they were first asked for"
                ));
            }
        }
        Ok(())
    }

    /// Makes a checkpoint that was written count.
    fn settle(&self, update: u64) -> Result<()> {
        // Before the checkpoint counts: a run that goes on from a later one has every policy before
        // it.
        keep_policies(&self.run, update, self.config, self.care)?;
        settle(&self.run, update, self.config)
    }

    fn log(&mut self, report: &UpdateReport) -> Result<()> {
        self.recent.push(report.episodes);
        self.log.append(report)
    }

    /// Shows how far the run is, and how fast, in transitions per second.
    fn show(&mut self, done: u64, rate: f64) {
        self.progress.set(done, &format!("{rate:.0} transitions/s {}", self.recent.describe()));
    }
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
        let mut stored = Config::parse(&text, &format!("{shown}/config.toml"), none)?;
        stored.stored_in(folder);
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

/// The trainer at the newest checkpoint that can be read, or a fresh one: the first process looks
/// for it, and the others take the same.
fn newest_trainer(run: Option<&RunFolder>, config: &Config, folder: &Path, crew: &Crew) -> Result<Trainer> {
    let first = crew.at_first(|| first_trainer(of_first(run), config, crew))?;
    let told = first.as_ref().and_then(|(update, _)| update.map(u64::to_le_bytes));
    let told = crew.tell(told.as_ref().map_or(&[], |update| &update[..]))?;
    let own = match (first, <[u8; 8]>::try_from(told)) {
        (Some((_, trainer)), _) => Ok(trainer),
        (None, Ok(update)) => {
            let path = checkpoint_path(folder, u64::from_le_bytes(update));
            Trainer::resume_among(&path, config.clone(), crew.ranks())
        }
        (None, Err(_)) => Trainer::among(config.clone(), crew.ranks()),
    };
    crew.agree(own.map_err(Into::into))
}

/// In the first process, the trainer with the update whose checkpoint it goes on from.
fn first_trainer(run: &RunFolder, config: &Config, crew: &Crew) -> Result<(Option<u64>, Trainer)> {
    let mut damaged = Vec::new();
    for (update, path) in run.checkpoints()? {
        match Trainer::resume_among(&path, config.clone(), crew.ranks()) {
            Ok(trainer) => {
                for message in damaged {
                    output::note(&format!("passed over a damaged checkpoint: {message}"));
                }
                return Ok((Some(update), trainer));
            }
            // Not the file's fault: another would not fare better.
            Err(error @ PpoError::Ranks { .. }) => return Err(error.into()),
            Err(error) => damaged.push(error.to_string()),
        }
    }
    // Starting from nothing over damaged checkpoints would throw work away without a word.
    if let Some(message) = damaged.into_iter().next() {
        bail!("no checkpoint can be read: {message}");
    }
    let mut trainer = Trainer::among(config.clone(), crew.ranks())?;
    trainer.set_commit(provenance::commit());
    Ok((None, trainer))
}

/// True at the end of one of a run's equal parts.
fn is_part(update: u64, config: &Config) -> bool {
    let part = (config.updates / PARTS).max(1);
    update > 0 && (update.is_multiple_of(part) || update == config.updates / 2 || update == config.updates)
}

/// True where the configuration asks for a checkpoint, whatever the clock says.
fn is_planned(update: u64, config: &Config) -> bool {
    update.is_multiple_of(config.checkpoint_every) || is_part(update, config)
}

/// Keeps the policies of the milestones that `update` reaches, out of the checkpoint that was
/// written there.
fn keep_policies(run: &RunFolder, update: u64, config: &Config, care: &Care) -> Result<()> {
    for (transitions, _) in care.updates(config).filter(|(_, at)| *at == update) {
        let path = run.milestone(transitions);
        if !path.exists() {
            let policy = PolicyFile::load(run.checkpoint(update))?;
            run.create_milestones()?;
            policy.write(&path, Precision::F32)?;
        }
    }
    Ok(())
}

/// Names the checkpoint after `update` updates as the newest and drops older ones.
///
/// Kept are the run's parts and the newest checkpoints; while it runs the newest of those that the
/// clock asked for, too. A finished run holds the same files whatever the clock said.
fn settle(run: &RunFolder, update: u64, config: &Config) -> Result<()> {
    run.set_latest(update)?;
    let all = run.checkpoints()?;
    let planned = all.iter().map(|(update, _)| *update).filter(|&update| is_planned(update, config));
    let newest_planned: Vec<u64> = planned.take(NEWEST).collect();
    let newest = if update < config.updates { NEWEST } else { 0 };
    for (index, (update, path)) in all.iter().enumerate() {
        let kept = index < newest || newest_planned.contains(update) || is_part(*update, config);
        if !kept {
            std::fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
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
