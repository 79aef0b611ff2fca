//! `cargo xtask tensorboard`: the logs of runs as event files that TensorBoard reads.
//!
//! Reading order: this file (which measures), [`events`] (the file's format).

mod events;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_ppo::UpdateReport;

use self::events::EventFile;
use jostle_runs::log::RunLog;
use jostle_runs::log::search;
use jostle_runs::output;

/// Depth to which folders are searched for runs.
const DEPTH: usize = 5;
/// The one name that an event file has, so that a second call replaces the first's. TensorBoard
/// asks for `tfevents` in it.
const FILE: &str = "events.out.tfevents.0000000000.jostle";

/// Arguments of `tensorboard`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask tensorboard runs --out runs/tensorboard\n  \
    tensorboard --logdir runs/tensorboard")]
pub struct TensorboardArgs {
    /// Run folders, or folders of run folders.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Folder for the event files, one folder a run.
    #[arg(long, value_name = "DIR", default_value = "runs/tensorboard")]
    out: PathBuf,
}

/// Writes the event files.
pub(crate) fn run(args: &TensorboardArgs) -> Result<ExitCode> {
    let mut found = Vec::new();
    for folder in &args.runs {
        search(folder, DEPTH, &mut found)?;
    }
    ensure!(!found.is_empty(), "no run in what was named; `{} train` makes one", output::program());
    for (index, folder) in found.iter().enumerate() {
        let log = RunLog::read(folder)?;
        let same_name = found[..index].iter().any(|other| other.file_name() == folder.file_name());
        let name = if same_name { format!("{}-{index}", log.name) } else { log.name.clone() };
        let target = args.out.join(name);
        std::fs::create_dir_all(&target).with_context(|| format!("cannot create {}", target.display()))?;
        let path = target.join(FILE);
        std::fs::write(&path, events_of(&log.reports))
            .with_context(|| format!("cannot write {}", path.display()))?;
        output::result(&format!("{}\n", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// All reports as events. The wall time counts the seconds of training from 0, so that the same log
/// gives the same file.
fn events_of(reports: &[UpdateReport]) -> Vec<u8> {
    let mut file = EventFile::new();
    let mut seconds = 0.0;
    for report in reports {
        seconds += report.clock.total;
        file.add(seconds, report.update, &scalars(report));
    }
    file.into_bytes()
}

/// The scalars that TensorBoard shows; measures that an update does not have are left out.
fn scalars(report: &UpdateReport) -> Vec<(&'static str, f32)> {
    let episodes = report.episodes;
    let success = (episodes.ended > 0).then(|| episodes.success as f64 / episodes.ended as f64);
    let measures = [
        ("episodes/success", success),
        ("episodes/return", report.episode_return),
        ("episodes/length", report.episode_length),
        ("reward/task", Some(report.task_reward)),
        ("reward/intrinsic", Some(report.intrinsic_reward)),
        ("diversity/D", Some(report.diversity)),
        ("discriminator/state_action_loss", Some(report.discriminator_state_action.loss)),
        ("discriminator/state_action_accuracy", Some(report.discriminator_state_action.accuracy)),
        ("discriminator/state_loss", Some(report.discriminator_state.loss)),
        ("discriminator/state_accuracy", Some(report.discriminator_state.accuracy)),
        ("policy/loss", Some(report.policy_loss)),
        ("policy/entropy", Some(report.entropy)),
        ("policy/approx_kl", Some(report.approx_kl)),
        ("policy/clip_fraction", Some(report.clip_fraction)),
        ("value/loss", Some(report.value_loss)),
        ("value/explained_variance", Some(report.explained_variance)),
        ("speed/transitions_per_second", rate(report)),
    ];
    measures.into_iter().filter_map(|(tag, value)| Some((tag, value? as f32))).collect()
}

/// Transitions a second, where the clock ran.
fn rate(report: &UpdateReport) -> Option<f64> {
    let each = report.transitions as f64 / report.update as f64;
    (report.clock.total > 0.0).then(|| each / report.clock.total)
}
