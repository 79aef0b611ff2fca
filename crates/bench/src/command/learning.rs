//! Transitions per second of training, rollout to checkpoint-ready, and the time that learning
//! takes to a share of successes among its own kind.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::time::Instant;

use crate::median;
use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_ppo::{Config, Trainer, UpdateReport};

use super::chosen;
use super::machine::Conditions;
use super::table::{count, duration, percent};
use jostle_runs::output;

/// A setting that is timed.
struct Setting {
    name: &'static str,
    overrides: &'static [&'static str],
}

/// Keys that all settings have in common but the tables' own.
const LARGE: &[&str] = &[
    "n_behaviours=1",
    "intrinsic_reward=none",
    "alpha=0",
    "gamma=0.997",
    "learning_rate=5e-4",
    "clip_coef=0.2",
    "ent_coef=0.002",
    "max_grad_norm=0.5",
    "bootstrap_truncation=true",
    "network.log_std_init=-0.7",
];

/// All settings: the tables', the lineage's size of an update, the pooled network, and bodies with
/// their velocities.
const SETTINGS: [Setting; 5] = [
    Setting {
        name: "paper-640",
        overrides: &["n_rooms=4", "horizon=32", "minibatch=128", "epochs_discriminator=3"],
    },
    Setting { name: "paper-8000", overrides: &["n_rooms=16", "horizon=100", "minibatch=1000"] },
    Setting {
        name: "paper-8000-m1",
        overrides: &[
            "n_rooms=16",
            "horizon=100",
            "minibatch=1000",
            "n_behaviours=1",
            "intrinsic_reward=none",
            "alpha=0",
        ],
    },
    Setting {
        name: POOLED,
        overrides: &[
            "n_rooms=32",
            "horizon=64",
            "minibatch=512",
            "epochs_policy=1",
            "epochs_value=1",
            "network.scan_pool=4",
        ],
    },
    Setting {
        name: MOTION,
        overrides: &[
            "n_rooms=64",
            "horizon=64",
            "minibatch=1024",
            "epochs_policy=2",
            "epochs_value=2",
            "network.inputs=motion",
            "network.laser_feature=128",
        ],
    },
];
const POOLED: &str = "pooled";
const MOTION: &str = "motion";

/// Ended episodes over which a share of successes is taken.
const WINDOW: usize = 2000;

/// Arguments of `bench learning`.
#[derive(Args)]
#[command(after_help = "Examples:\n  cargo xtask bench learning --threads 2\n  \
    cargo xtask bench learning --threads 1 --only motion --success 0.9")]
pub(super) struct LearningArgs {
    /// Rounds; all settings take turns in each. The first is not counted.
    #[arg(long, value_name = "N", default_value_t = 5)]
    rounds: usize,
    /// Worker threads.
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
    /// Settings, separated by commas (default: all): paper-640, paper-8000, paper-8000-m1, pooled,
    /// motion.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Train the settings `pooled` and `motion` until this share of 2,000 episodes succeeds, and
    /// say how long that took.
    #[arg(long, value_name = "SHARE")]
    success: Option<f64>,
    /// Give such a training up after this many minutes.
    #[arg(long, value_name = "MINUTES", default_value_t = 30.0)]
    patience: f64,
}

pub(super) fn run(args: &LearningArgs) -> Result<()> {
    let chosen = chosen(&SETTINGS, |setting| setting.name, &args.only)?;
    let conditions = Conditions::now();
    let mut text = conditions.markdown().to_owned();
    text += &rates(&chosen, args)?;
    if let Some(success) = args.success {
        ensure!(
            success > 0.0 && success < 1.0,
            "--success: found {success}, expected a share between 0 and 1"
        );
        text += "\n";
        text += &times_to(success, &chosen, args)?;
    }
    output::result(&text)
}

fn config(setting: &Setting, threads: usize) -> Result<Config> {
    let mut overrides: Vec<String> = Vec::new();
    if [POOLED, MOTION].contains(&setting.name) {
        overrides.extend(LARGE.iter().map(|key| (*key).to_owned()));
    }
    overrides.extend(setting.overrides.iter().map(|key| (*key).to_owned()));
    overrides.push(format!("threads={threads}"));
    Config::parse("", setting.name, &overrides).with_context(|| format!("the setting {}", setting.name))
}

/// Transitions per second of each setting.
fn rates(chosen: &[&'static Setting], args: &LearningArgs) -> Result<String> {
    let trainer =
        |setting: &&'static Setting| -> Result<Trainer> { Ok(Trainer::new(config(setting, args.threads)?)?) };
    let mut trainers = chosen.iter().map(trainer).collect::<Result<Vec<_>>>()?;
    let mut reports: Vec<Vec<UpdateReport>> = vec![Vec::new(); trainers.len()];
    for round in 0..=args.rounds {
        for (trainer, reports) in trainers.iter_mut().zip(&mut reports) {
            let report = trainer.update()?;
            if round > 0 {
                reports.push(report);
            }
        }
    }
    let mut grid = Grid::new([
        "setting",
        "transitions an update",
        "an update",
        "transitions/s",
        "rollout",
        "values, rewards, D",
        "learning",
        "input rows of a rollout",
    ]);
    for ((setting, trainer), reports) in chosen.iter().zip(&trainers).zip(&reports) {
        let of = |part: fn(&UpdateReport) -> f64| median(&reports.iter().map(part).collect::<Vec<_>>());
        let total = of(|report| report.clock.total);
        let (transitions, width) =
            (trainer.config().rollout_len(), trainer.config().network_config().input_len());
        grid.push(
            false,
            vec![
                setting.name.to_owned(),
                count(transitions as f64),
                duration(total),
                count(transitions as f64 / total),
                percent(of(|report| report.clock.rollout) / total),
                percent(of(|report| report.clock.evaluation) / total),
                percent(of(|report| report.clock.learning) / total),
                format!("{:.1} MB", (transitions * width * 4) as f64 / 1e6),
            ],
        );
    }
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{} threads; medians of {} alternating rounds of fresh policies, by the wall clock.\n",
        args.threads, args.rounds
    );
    Ok(text + &grid.markdown())
}

/// Time that the large settings train until a share of the learners' episodes succeeds.
fn times_to(success: f64, chosen: &[&'static Setting], args: &LearningArgs) -> Result<String> {
    let mut grid = Grid::new(["setting", "success among its own", "transitions", "time"]);
    for setting in chosen.iter().filter(|setting| [POOLED, MOTION].contains(&setting.name)) {
        let mut trainer = Trainer::new(config(setting, args.threads)?)?;
        let (start, mut window) = (Instant::now(), Window::default());
        while window.share().is_none_or(|share| share < success)
            && start.elapsed().as_secs_f64() < 60.0 * args.patience
        {
            let report = trainer.update()?;
            window.add(report.episodes.success, report.episodes.ended);
        }
        grid.push(
            false,
            vec![
                setting.name.to_owned(),
                window.share().map_or_else(|| "–".to_owned(), |share| format!("{share:.3}")),
                count(trainer.transitions() as f64),
                duration(start.elapsed().as_secs_f64()),
            ],
        );
    }
    Ok(format!("Until {success} of the last {WINDOW} episodes or more succeed.\n\n{}", grid.markdown()))
}

/// Successes of the last updates that hold at least [`WINDOW`] ended episodes.
#[derive(Default)]
struct Window {
    updates: VecDeque<[u64; 2]>,
    sums: [u64; 2],
}

impl Window {
    fn add(&mut self, successes: u64, ended: u64) {
        self.updates.push_back([successes, ended]);
        self.sums = [self.sums[0] + successes, self.sums[1] + ended];
        while let Some(&[successes, ended]) = self.updates.front() {
            if self.sums[1] - ended < WINDOW as u64 {
                break;
            }
            self.sums = [self.sums[0] - successes, self.sums[1] - ended];
            self.updates.pop_front();
        }
    }

    /// The share, once the window is full.
    fn share(&self) -> Option<f64> {
        (self.sums[1] >= WINDOW as u64).then(|| self.sums[0] as f64 / self.sums[1] as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_a_configuration() {
        for setting in &SETTINGS {
            let config = config(setting, 2).unwrap();
            let expected = match setting.name {
                "paper-640" => 640,
                "paper-8000" | "paper-8000-m1" => 8000,
                POOLED => 10_240,
                _ => 20_480,
            };
            assert_eq!(config.rollout_len(), expected, "{}", setting.name);
        }
        assert!(chosen(&SETTINGS, |setting| setting.name, &["nothing".to_owned()]).is_err());
    }

    #[test]
    fn the_window_forgets_what_is_older() {
        let mut window = Window::default();
        window.add(0, 1500);
        assert_eq!(window.share(), None);
        window.add(1000, 1000);
        assert_eq!(window.share(), Some(0.4));
        window.add(1000, 1000);
        // Without the first update 2,000 episodes are left.
        assert_eq!(window.share(), Some(1.0));
    }
}
