//! A GPU beside the processor of the same machine: whether one update has the same losses, and how
//! many transitions a second training makes.
//!
//! The networks are the reference back end's on the device; rooms are simulated on the processor,
//! which is compared as it is used, with the fast back end on all threads.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use crate::{median, parity};
use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_policy::{Device, NetworkConfig};
use jostle_ppo::{Config, Trainer, UpdateReport};

use super::chosen;
use super::machine::Conditions;
use super::table::{count, duration, percent};
use jostle_runs::output::{self, note};

/// Largest relative difference of a loss that is accepted.
const PARITY: f64 = 1e-4;
/// Rows and minibatch of the update whose losses are compared.
const ROWS: usize = 2048;
const MINIBATCH: usize = 512;

/// A setting that is timed.
struct Setting {
    name: &'static str,
    set: &'static [&'static str],
}

impl Setting {
    fn config(&self, backend: &str, device: Device) -> Result<Config> {
        let engine = [format!("backend={backend}"), format!("device={device}")];
        let set: Vec<String> = self.set.iter().map(|key| (*key).to_owned()).chain(engine).collect();
        Config::parse("", self.name, &set).with_context(|| self.name)
    }
}

/// The paper's network at two sizes of an update, and the compact one.
const SETTINGS: [Setting; 3] = [
    Setting { name: "paper-8000", set: &["n_rooms=16", "horizon=100", "minibatch=1000"] },
    Setting { name: "paper-64000", set: &["n_rooms=128", "horizon=100", "minibatch=8000"] },
    Setting {
        name: "pooled-64000",
        set: &["n_rooms=128", "horizon=100", "minibatch=8000", "network.scan_pool=4"],
    },
];

/// Arguments of `bench gpu`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask bench gpu --device cuda:0")]
pub(super) struct GpuArgs {
    /// The device: `cuda:N` or `metal:N`, in a build with that feature; `cpu` tries the command.
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Cuda(0))]
    device: Device,
    /// Rounds; all sides take turns in each. The first is not counted.
    #[arg(long, value_name = "N", default_value_t = 5)]
    rounds: usize,
    /// No further round is begun after this many minutes.
    #[arg(long, value_name = "MINUTES", default_value_t = 8.0)]
    minutes: f64,
    /// Settings, separated by commas (default: all): paper-8000, paper-64000, pooled-64000.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
}

pub(super) fn run(args: &GpuArgs) -> Result<()> {
    let engines = parity::engines(args.device).context("no GPU to measure")?;
    let until = Instant::now() + Duration::from_secs_f64((60.0 * args.minutes).clamp(0.0, 86_400.0));
    let chosen = chosen(&SETTINGS, |setting| setting.name, &args.only)?;
    let conditions = Conditions::now();
    let mut grid = Grid::new(["network", "minibatches", "largest relative difference of a loss"]);
    let mut worst = 0.0_f64;
    let config = NetworkConfig { n_behaviours: 5, ..NetworkConfig::default() };
    for parity in parity::one_update(&config, ROWS, MINIBATCH, engines)? {
        worst = worst.max(parity.worst);
        let cells =
            [parity.network.to_owned(), parity.minibatches.to_string(), format!("{:.1e}", parity.worst)];
        grid.push(false, cells.to_vec());
    }
    let mut text = conditions.markdown().to_owned();
    let _ = writeln!(text, "One update on `{}` and on the processor, both by candle:\n", args.device);
    text += &grid.markdown();
    output::result(&text)?;
    ensure!(worst <= PARITY, "the losses are {worst:.1e} apart, expected at most {PARITY:.0e}");
    output::result(&rates(&chosen, args, until)?)
}

/// One side of a setting with what it has made.
struct Side {
    engine: String,
    trainer: Trainer,
    reports: Vec<UpdateReport>,
}

impl Side {
    fn new(setting: &Setting, backend: &str, device: Device) -> Result<Self> {
        let trainer = Trainer::new(setting.config(backend, device)?)?;
        Ok(Self { engine: format!("`{backend}` on `{device}`"), trainer, reports: Vec::new() })
    }
}

/// Transitions per second of each setting on the device and on the processor.
fn rates(chosen: &[&'static Setting], args: &GpuArgs, until: Instant) -> Result<String> {
    let sides = |setting: &&'static Setting| -> Result<[Side; 2]> {
        Ok([Side::new(setting, "reference", args.device)?, Side::new(setting, "fast", Device::Cpu)?])
    };
    let mut pairs = chosen.iter().map(sides).collect::<Result<Vec<_>>>()?;
    for round in 0..=args.rounds {
        if round > 1 && Instant::now() >= until {
            note(&format!("bench gpu: the time is up after {} of {} rounds", round - 1, args.rounds));
            break;
        }
        for side in pairs.iter_mut().flatten() {
            let report = side.trainer.update()?;
            if round > 0 {
                side.reports.push(report);
            }
        }
    }
    let mut grid = Grid::new([
        "setting",
        "networks",
        "transitions an update",
        "rounds",
        "an update",
        "transitions/s",
        "rollout",
        "values, rewards, D",
        "learning",
    ]);
    for (setting, pair) in chosen.iter().zip(&pairs) {
        for side in pair {
            let of =
                |part: fn(&UpdateReport) -> f64| median(&side.reports.iter().map(part).collect::<Vec<_>>());
            let (total, transitions) = (of(|report| report.clock.total), side.trainer.config().rollout_len());
            grid.push(
                false,
                vec![
                    setting.name.to_owned(),
                    side.engine.clone(),
                    count(transitions as f64),
                    side.reports.len().to_string(),
                    duration(total),
                    count(transitions as f64 / total),
                    percent(of(|report| report.clock.rollout) / total),
                    percent(of(|report| report.clock.evaluation) / total),
                    percent(of(|report| report.clock.learning) / total),
                ],
            );
        }
    }
    Ok(format!(
        "\nWhole updates of training, medians of alternating rounds, by the wall clock:\n\n{}",
        grid.markdown()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_a_configuration_of_the_size_in_its_name() {
        for setting in &SETTINGS {
            let config = setting.config("reference", Device::Cuda(0)).unwrap();
            assert!(setting.name.ends_with(&config.rollout_len().to_string()), "{}", setting.name);
        }
        assert!(chosen(&SETTINGS, |setting| setting.name, &["nothing".to_owned()]).is_err());
    }

    #[test]
    #[cfg(not(feature = "cuda"))]
    fn without_a_gpu_one_line_says_so() {
        let args =
            GpuArgs { device: Device::Cuda(0), rounds: 1, minutes: 1.0, only: vec!["paper-8000".to_owned()] };
        let line = output::one_line(&run(&args).unwrap_err());
        assert!(line.starts_with("no GPU to measure: ") && line.contains("device: found cuda:0"), "{line}");
    }
}
