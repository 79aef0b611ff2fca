//! An update's time by its parts: the trainer phase by phase, the learners one by one, the largest
//! layer by itself.

use std::fmt::Write as _;

use crate::learners::{EPOCHS, EpochSeconds, WorkU};
use crate::products::Fc1;
use crate::{Stopwatch, median, rates};
use anyhow::Result;
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_ppo::{Clock, Config, Trainer};

use super::machine::Conditions;
use super::table::{duration, percent, significant};
use jostle_runs::output;

/// Arguments of `bench update`.
#[derive(Args)]
pub(super) struct UpdateArgs {
    /// Rounds; everything is measured once in each.
    #[arg(long, value_name = "N", default_value_t = 9)]
    rounds: usize,
    /// Numbers of worker threads.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,2")]
    threads: Vec<usize>,
    /// Instruction set of the networks' kernels: avx512, avx2 or plain; by default the widest that
    /// the processor has.
    #[arg(long, value_name = "SET")]
    instructions: Option<String>,
}

/// Measurements at one number of threads, round by round.
#[derive(Default)]
struct Measured {
    trainer: Vec<Clock>,
    work: Vec<f64>,
    epochs: [Vec<EpochSeconds>; 4],
    /// Forward, input gradient, weight gradient.
    fc1: [Vec<f64>; 3],
    sgemm: Vec<f64>,
    in_cache: Vec<f64>,
}

pub(super) fn run(args: &UpdateArgs) -> Result<()> {
    if let Some(name) = &args.instructions {
        rates::choose_instruction_set(name)?;
    }
    let conditions = Conditions::now();
    let mut text = conditions.markdown().to_owned();
    let _ = writeln!(
        text,
        "Medians of {} rounds. The trainer's phases are by the wall clock; the rest on one thread by its CPU time, on \
         more by the wall clock.\n",
        args.rounds
    );
    for &threads in &args.threads {
        let mut work = WorkU::new()?;
        let measured = measure(threads, args.rounds, &mut work)?;
        let _ = writeln!(text, "### {threads} thread{}\n", if threads == 1 { "" } else { "s" });
        text += &trainer(&measured.trainer);
        text += &learners(threads, &mut work, &measured);
    }
    output::result(&text)
}

fn measure(threads: usize, rounds: usize, work: &mut WorkU) -> Result<Measured> {
    let mut measured = Measured::default();
    let mut trainer = Trainer::new(Config { threads, ..Config::default() })?;
    let pool = super::pool(threads)?;
    let mut fc1 = Fc1::new();
    trainer.update()?;
    for _ in 0..rounds {
        measured.trainer.push(trainer.update()?.clock);
        pool.install(|| -> Result<()> {
            measured.sgemm.push(rates::sgemm(threads)?);
            measured.in_cache.push(rates::in_cache());
            let watch = Stopwatch::start(threads);
            work.run(threads);
            measured.work.push(watch.seconds());
            for (learner, epochs) in work.each().into_iter().zip(&mut measured.epochs) {
                epochs.extend((0..EPOCHS).map(|_| learner.epoch(threads)));
            }
            if threads == 1 {
                let products = [fc1.forward(), fc1.input_gradient(), fc1.weight_gradient()];
                measured.fc1.iter_mut().zip(products).for_each(|(all, seconds)| all.push(seconds));
            }
            Ok(())
        })?;
    }
    Ok(measured)
}

/// The phases of a whole update of the trainer.
fn trainer(clocks: &[Clock]) -> String {
    let of = |phase: fn(&Clock) -> f64| median(&clocks.iter().map(phase).collect::<Vec<_>>());
    let (total, learning) = (of(|clock| clock.total), of(|clock| clock.learning));
    let mut grid = Grid::new(["the trainer at its defaults", "time", "share of the update"]);
    for (name, seconds) in [
        ("rollout: inference", of(|clock| clock.inference)),
        ("rollout: simulation", of(|clock| clock.simulation)),
        ("values, intrinsic reward, advantages, D", of(|clock| clock.evaluation)),
        ("learning", learning),
        ("**whole update**", total),
    ] {
        grid.push(false, vec![name.to_owned(), duration(seconds), percent(seconds / total)]);
    }
    format!(
        "{}\nThe whole update takes {} times the learning alone (asked: at most 1.5).\n\n",
        grid.markdown(),
        significant(total / learning)
    )
}

/// Work U: whole, by network and phase, and fc1's products, beside the machine's rates.
fn learners(threads: usize, work: &mut WorkU, measured: &Measured) -> String {
    let (sgemm, in_cache) = (median(&measured.sgemm), median(&measured.in_cache));
    let mut grid =
        Grid::new(["work U", "time", "GFLOP/s", "share of sgemm", "share of the in-cache product"]);
    let mut row = |name: String, seconds: f64, flop: Option<f64>| {
        let rate = flop.map(|flop| flop / seconds);
        let cell = |show: &dyn Fn(f64) -> String| rate.map_or_else(|| "–".to_owned(), show);
        grid.push(
            false,
            vec![
                name,
                duration(seconds),
                cell(&|rate| significant(1e-9 * rate)),
                cell(&|rate| percent(rate / sgemm)),
                cell(&|rate| percent(rate / (in_cache * threads as f64))),
            ],
        );
    };
    row("**whole**, networks side by side".to_owned(), median(&measured.work), Some(work.flop()));
    for (learner, epochs) in work.each().into_iter().zip(&measured.epochs) {
        let of = |phase: fn(&EpochSeconds) -> f64| median(&epochs.iter().map(phase).collect::<Vec<_>>());
        let [forward, backward] = learner.flop();
        row(format!("{}: forward, an epoch", learner.name()), of(|epoch| epoch.forward), Some(forward));
        row(format!("{}: backward", learner.name()), of(|epoch| epoch.backward), Some(backward));
        row(format!("{}: Adam", learner.name()), of(|epoch| epoch.step), None);
    }
    let flop = Fc1::new().flop();
    for (name, seconds) in ["forward", "input gradient", "weight gradient"].into_iter().zip(&measured.fc1) {
        if !seconds.is_empty() {
            row(format!("of these, fc1 (4096 → 256): {name}"), median(seconds), Some(flop));
        }
    }
    format!(
        "{}\nThe machine, in the same rounds: sgemm of 1024 × 1024 matrices {} GFLOP/s on {threads} thread{}; the kernels' \
         product on operands in the first-level cache {} GFLOP/s on one ({}).\n\n",
        grid.markdown(),
        significant(1e-9 * sgemm),
        if threads == 1 { "" } else { "s" },
        significant(1e-9 * in_cache),
        rates::instruction_set(),
    )
}
