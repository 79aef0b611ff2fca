//! One run in two processes beside one in one: how much of the second processor arrives, and what
//! the measured times make of many machines.
//!
//! Weak scaling: two ranks have twice the rooms and twice the minibatch of one, so that each has as
//! much to compute, and the best is that an update takes as long. Beside them stand two runs of one
//! rank each at the same time, which exchange nothing: what two processes lose by sharing a
//! processor's memory is theirs, too.

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::median;
use crate::mpi::{Program, Running};
use anyhow::{Context as _, Result, bail};
use clap::Args;
use jostle_diversity::DiscriminatorShape;
use jostle_eval::report::grid::Grid;
use jostle_policy::Layout;
use jostle_ppo::Config;
use jostle_view::curves::{Axis, Curve, Panel, Panels};
use jostle_view::draw::panels::curves;

use super::chosen;
use super::machine::Conditions;
use super::table::{count, duration, percent};
use jostle_runs::log::RunLog;
use jostle_runs::output::{self, note};
use jostle_runs::run_folder::write_atomically;
use jostle_runs::tools::process_folder;

/// A setting, with what one rank has of it.
struct Setting {
    name: &'static str,
    what: &'static str,
    rooms: usize,
    minibatch: usize,
    set: &'static [&'static str],
}

/// The paper's network with five behaviours, and the two compact ones of large updates, each with
/// 10,000 transitions of a rank or more.
const SETTINGS: [Setting; 3] = [
    Setting {
        name: "paper",
        what: "the paper's network, M = 5",
        rooms: 20,
        minibatch: 1000,
        set: &["horizon=100"],
    },
    Setting {
        name: "pooled",
        what: "128 pooled beams, M = 1",
        rooms: 32,
        minibatch: 512,
        set: &[
            "horizon=64",
            "epochs_policy=1",
            "epochs_value=1",
            "network.scan_pool=4",
            "n_behaviours=1",
            "intrinsic_reward=none",
            "alpha=0",
        ],
    },
    Setting {
        name: "motion",
        what: "bodies with their velocities, M = 1",
        rooms: 64,
        minibatch: 1024,
        set: &[
            "horizon=64",
            "epochs_policy=2",
            "epochs_value=2",
            "network.inputs=motion",
            "network.laser_feature=128",
            "n_behaviours=1",
            "intrinsic_reward=none",
            "alpha=0",
        ],
    },
];

/// Links of the model, in bits per second.
const LINKS: [(&str, f64); 3] = [("1 Gb/s", 1e9), ("10 Gb/s", 1e10), ("100 Gb/s", 1e11)];
/// Ranks of the model.
const RANKS: std::ops::RangeInclusive<u32> = 1..=10;
/// Small gathers and sums of an update: outcomes, counts, advantages, D, losses.
const SMALL_MESSAGES: f64 = 12.0;
/// Bytes of a small message and of a large one.
const MESSAGES: [usize; 2] = [8, 1 << 22];

/// Arguments of `bench ranks`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask bench ranks --plot docs/images/ranks.svg")]
pub(super) struct RanksArgs {
    /// Rounds, in each of which all sides take turns.
    #[arg(long, value_name = "N", default_value_t = 5)]
    rounds: usize,
    /// Updates of each side in a round; one more, before them, is not counted.
    #[arg(long, value_name = "N", default_value_t = 1)]
    updates: usize,
    /// Settings, separated by commas (default: all): paper, pooled, motion.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Draw the model's efficiency against ranks as SVG.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

pub(super) fn run(args: &RanksArgs) -> Result<()> {
    let chosen = chosen(&SETTINGS, |setting| setting.name, &args.only)?;
    let conditions = Conditions::now();
    let folder = process_folder("bench-ranks")?;
    let bench = Bench { program: Program::build(&folder)?, folder, updates: args.updates };
    let outcome = measure(&bench, &chosen, args, conditions.markdown());
    std::fs::remove_dir_all(&bench.folder)
        .with_context(|| format!("cannot remove {}", bench.folder.display()))?;
    outcome
}

fn measure(bench: &Bench, chosen: &[&'static Setting], args: &RanksArgs, conditions: &str) -> Result<()> {
    let mut times: Vec<Times> = chosen.iter().map(|_| Times::default()).collect();
    for round in 0..args.rounds {
        for (setting, times) in chosen.iter().zip(&mut times) {
            bench.round(setting, times)?;
            note(&format!("bench ranks: round {} of {}: {}", round + 1, args.rounds, setting.name));
        }
    }
    let [shared, tcp] = [None, Some("tcp,self")].map(|transport| bench.messages(transport));
    let (shared, tcp) = (shared?, tcp?);
    let costs: Vec<Costs> = chosen
        .iter()
        .zip(&times)
        .map(|(setting, times)| Costs::new(setting, median(&times.alone)))
        .collect::<Result<_>>()?;
    let mut text = conditions.to_owned();
    let _ = writeln!(text, "Medians of {} alternating rounds, by the wall clock.\n", args.rounds);
    text += &measured(chosen, &times, &costs);
    let _ = writeln!(
        text,
        "\nAn exchange of two ranks of this machine: {} and {:.1} Gb/s each way through shared memory, {} and {:.1} Gb/s \
         over TCP.\n",
        duration(shared.latency),
        shared.bits_per_second / 1e9,
        duration(tcp.latency),
        tcp.bits_per_second / 1e9,
    );
    text += &modelled(chosen, &costs, tcp.latency);
    if let Some(path) = &args.plot {
        write_atomically(path, &curves(&picture(chosen, &costs, tcp.latency))?)?;
    }
    output::result(&text)
}

/// Seconds of updates of each side.
#[derive(Default)]
struct Times {
    /// One rank, by itself.
    alone: Vec<f64>,
    /// Runs of one rank each, two at a time.
    side_by_side: Vec<f64>,
    /// Two ranks of one run.
    two: Vec<f64>,
}

/// What jobs need.
struct Bench {
    program: Program,
    folder: PathBuf,
    updates: usize,
}

impl Bench {
    fn round(&self, setting: &Setting, times: &mut Times) -> Result<()> {
        times.alone.extend(self.seconds(setting, &[("alone", 1)])?);
        times.side_by_side.extend(self.seconds(setting, &[("left", 1), ("right", 1)])?);
        times.two.extend(self.seconds(setting, &[("two", 2)])?);
        Ok(())
    }

    /// Runs jobs of so many ranks at the same time; the seconds of their updates but for each one's
    /// first.
    fn seconds(&self, setting: &Setting, jobs: &[(&str, usize)]) -> Result<Vec<f64>> {
        let started = jobs.iter().map(|(name, ranks)| self.start(setting, name, *ranks));
        let started = started.collect::<Result<Vec<_>>>()?;
        let mut seconds = Vec::new();
        for (out, running) in started {
            running.good_end()?;
            seconds.extend(RunLog::read(&out)?.reports.iter().skip(1).map(|report| report.clock.total));
        }
        Ok(seconds)
    }

    /// Starts a run in so many ranks.
    fn start(&self, setting: &Setting, name: &str, ranks: usize) -> Result<(PathBuf, Running)> {
        let out = self.folder.join(name);
        if out.exists() {
            std::fs::remove_dir_all(&out).with_context(|| format!("cannot remove {}", out.display()))?;
        }
        let config = self.folder.join("empty.toml");
        std::fs::write(&config, "").with_context(|| format!("cannot write {}", config.display()))?;
        let mut job = self.program.job(Some(ranks));
        job.add(&["train", "--threads", "1", "--checkpoint-minutes", "0", "--config"]);
        job.add(&[&config]).add(&["--out"]).add(&[&out]);
        for key in setting.keys(ranks).iter().chain([&format!("updates={}", self.updates + 1)]) {
            job.add(&["--set", key]);
        }
        Ok((out, job.start()?))
    }

    /// What an exchange of two ranks costs, by the transport of that name (default: the best).
    fn messages(&self, transport: Option<&str>) -> Result<Link> {
        let options: Vec<&str> = transport.into_iter().flat_map(|name| ["--mca", "btl", name]).collect();
        // Another layer would take the transport out of our hands.
        let plain = ["--mca", "pml", "ob1"];
        let mut job = self.program.job_with(Some(2), &[&plain[..], &options].concat());
        job.add(&["messages", "--bytes", &MESSAGES.map(|bytes| bytes.to_string()).join(",")]);
        let mut times = Vec::new();
        for line in job.run_to_end()?.lines().filter(|line| line.starts_with('[')) {
            let (_, seconds): (usize, Vec<f64>) = serde_json::from_str(line)?;
            times.push(median(&seconds));
        }
        let [small, large] = times[..] else { bail!("found {} sizes of messages, expected 2", times.len()) };
        let bits_per_second = 8.0 * (MESSAGES[1] - MESSAGES[0]) as f64 / (large - small);
        Ok(Link { latency: small, bits_per_second })
    }
}

/// What an exchange costs: `latency` and the bits of what each side gives.
#[derive(Clone, Copy)]
struct Link {
    latency: f64,
    bits_per_second: f64,
}

impl Setting {
    /// The keys of a run in so many ranks.
    fn keys(&self, ranks: usize) -> Vec<String> {
        let own = [
            format!("n_rooms={}", self.rooms * ranks),
            format!("minibatch={}", self.minibatch * ranks),
            format!("shards={ranks}"),
        ];
        self.set.iter().map(|key| (*key).to_owned()).chain(own).collect()
    }

    fn config(&self) -> Result<Config> {
        Config::parse("", self.name, &self.keys(1)).with_context(|| format!("the setting {}", self.name))
    }
}

/// What an update of a setting costs a rank.
struct Costs {
    transitions: usize,
    /// Seconds of what it computes.
    compute: f64,
    /// Sums over the ranks in an update, and the numbers in all of them, as f32.
    sums: f64,
    numbers: f64,
}

impl Costs {
    fn new(setting: &Setting, compute: f64) -> Result<Self> {
        let config = setting.config()?;
        let minibatches = config.rollout_len().div_ceil(config.minibatch);
        let network = config.network_config();
        let (hidden, n_behaviours) = (config.discriminator.hidden, config.n_behaviours);
        let q = |n_inputs: usize| DiscriminatorShape { n_inputs, hidden, n_behaviours }.layout().len();
        let width = network.input_len();
        let mut sums = vec![
            (config.epochs_policy, Layout::actor(&network).len()),
            (config.epochs_value, Layout::critic(&network).len()),
        ];
        // With one behaviour no discriminator learns.
        if n_behaviours > 1 {
            sums.extend([width, width + 2].map(|inputs| (config.epochs_discriminator, q(inputs))));
        }
        let count: usize = sums.iter().map(|(epochs, _)| epochs * minibatches).sum();
        let numbers: usize = sums.iter().map(|(epochs, len)| epochs * minibatches * len).sum();
        Ok(Self { transitions: config.rollout_len(), compute, sums: count as f64, numbers: numbers as f64 })
    }

    /// Seconds that an update of `ranks` ranks exchanges.
    fn exchange(&self, ranks: f64, link: Link) -> f64 {
        let steps = ranks.log2();
        let bits = 2.0 * (1.0 - 1.0 / ranks) * 32.0 * self.numbers;
        (2.0 * self.sums + SMALL_MESSAGES) * steps * link.latency + bits / link.bits_per_second
    }

    /// Share of the ranks' time that is spent computing.
    fn efficiency(&self, ranks: f64, link: Link) -> f64 {
        self.compute / (self.compute + self.exchange(ranks, link))
    }
}

/// The table of what was measured.
fn measured(chosen: &[&'static Setting], times: &[Times], costs: &[Costs]) -> String {
    let mut grid = Grid::new([
        "setting",
        "transitions of a rank",
        "one rank, an update",
        "two runs at once",
        "two ranks",
        "two ranks, transitions/s",
        "efficiency",
        "of two runs at once",
    ]);
    for ((setting, times), costs) in chosen.iter().zip(times).zip(costs) {
        let [alone, beside, two] = [&times.alone, &times.side_by_side, &times.two].map(|times| median(times));
        grid.push(
            false,
            vec![
                format!("`{}`: {}", setting.name, setting.what),
                count(costs.transitions as f64),
                duration(alone),
                duration(beside),
                duration(two),
                count(2.0 * costs.transitions as f64 / two),
                format!("{:.2}", alone / two),
                format!("{:.2}", beside / two),
            ],
        );
    }
    grid.markdown()
}

/// The table of what the model says.
fn modelled(chosen: &[&'static Setting], costs: &[Costs], latency: f64) -> String {
    let mut text = String::new();
    for (setting, costs) in chosen.iter().zip(costs) {
        let _ = writeln!(
            text,
            "`{}`: {} of computing, {} sums of {:.1} MB in all:\n",
            setting.name,
            duration(costs.compute),
            count(costs.sums),
            4e-6 * costs.numbers
        );
        let heads = ["ranks".to_owned(), "transitions an update".to_owned()];
        let mut grid = Grid::new(heads.into_iter().chain(LINKS.map(|(name, _)| name.to_owned())));
        for ranks in RANKS.map(|k| f64::from(1_u32 << k)) {
            let share =
                |(_, bits_per_second)| percent(costs.efficiency(ranks, Link { latency, bits_per_second }));
            let cells = [count(ranks), count(ranks * costs.transitions as f64)];
            grid.push(false, cells.into_iter().chain(LINKS.map(share)).collect());
        }
        text += &grid.markdown();
        text.push('\n');
    }
    text
}

/// The model's efficiency against ranks, a panel for each setting.
fn picture(chosen: &[&'static Setting], costs: &[Costs], latency: f64) -> Panels {
    let ends = (f64::from(1_u32 << RANKS.start()), f64::from(1_u32 << RANKS.end()));
    let panel = |(setting, costs): (&&Setting, &Costs)| {
        let curve = |(group, (_, bits_per_second)): (usize, (&str, f64))| {
            let link = Link { latency, bits_per_second };
            let point = |k| {
                let ranks = f64::from(1_u32 << k);
                [ranks, costs.efficiency(ranks, link), 0.0, 0.0]
            };
            Curve { group, dashed: false, points: RANKS.map(point).collect() }
        };
        Panel {
            title: format!("Efficiency, {}", setting.what),
            range: Some((0.0, 1.0)),
            levels: vec![0.9],
            curves: LINKS.into_iter().enumerate().map(curve).collect(),
            empty: "no link",
        }
    };
    Panels {
        labels: LINKS.map(|(name, _)| name.to_owned()).to_vec(),
        panels: chosen.iter().zip(costs).map(panel).collect(),
        axis: Axis::Ranks(ends.0, ends.1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rank_has_ten_thousand_transitions_and_as_many_minibatches() {
        for setting in &SETTINGS {
            let [one, two] =
                [1, 2].map(|ranks| Config::parse("", "a setting", &setting.keys(ranks)).unwrap());
            assert!(one.rollout_len() >= 10_000, "{}", setting.name);
            assert_eq!((2 * one.rollout_len(), 2 * one.minibatch), (two.rollout_len(), two.minibatch));
        }
        assert!(chosen(&SETTINGS, |setting| setting.name, &["nothing".to_owned()]).is_err());
    }

    #[test]
    fn the_model_by_hand() {
        let costs = Costs { transitions: 1, compute: 1.0, sums: 4.0, numbers: 1e6 };
        let link = Link { latency: 1e-3, bits_per_second: 32e6 };
        // Two ranks: 2·4 + 12 messages of 1 ms, and each number once: 1 s.
        assert!((costs.exchange(2.0, link) - 1.02).abs() < 1e-12);
        // Four: twice as many messages, and 1.5 times the numbers.
        assert!((costs.exchange(4.0, link) - 1.54).abs() < 1e-12);
        assert!((costs.efficiency(2.0, link) - 1.0 / 2.02).abs() < 1e-12);
        // The paper's actor and critic three times, its discriminators once, ten minibatches each.
        let paper = Costs::new(&SETTINGS[0], 1.0).unwrap();
        assert_eq!(paper.sums, 80.0);
        assert!((60e6..80e6).contains(&paper.numbers), "{}", paper.numbers);
    }
}
