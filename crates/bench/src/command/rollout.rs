//! Agent-steps per second of a rollout, inference and simulation in turn or overlapped.

use std::fmt::Write as _;

use crate::rollouts::{Acting, Order};
use crate::{Round, median};
use anyhow::{Context as _, Result, bail};
use clap::Args;
use jostle_eval::report::grid::Grid;

use super::machine::Conditions;
use super::table::count;
use jostle_runs::output;

/// Arguments of `bench rollout`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask bench rollout --rooms 4,16 --threads 2")]
pub(super) struct RolloutArgs {
    /// Rounds; both orders take turns in each.
    #[arg(long, value_name = "N", default_value_t = 9)]
    rounds: usize,
    /// Numbers of rooms of five robots, each 2 or more.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "2,4,8,16,32,64")]
    rooms: Vec<usize>,
    /// Worker threads.
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
}

pub(super) fn run(args: &RolloutArgs) -> Result<()> {
    if let Some(rooms) = args.rooms.iter().find(|&&rooms| rooms < 2) {
        bail!("--rooms: found {rooms}, expected 2 or more: one room has no halves");
    }
    let conditions = Conditions::now();
    let mut grid = Grid::new(["rooms", "agents", "in turn", "overlapped", "ratio", "least–most of a round"]);
    let pool = super::pool(args.threads)?;
    for &n_rooms in &args.rooms {
        let mut rates = [Vec::new(), Vec::new()];
        let mut ratios = Vec::new();
        let mut agents = 0;
        pool.install(|| -> Result<()> {
            let mut acting = Acting::new(n_rooms).with_context(|| format!("{n_rooms} rooms"))?;
            for _ in 0..args.rounds {
                for (order, rates) in [Order::InTurn, Order::Overlapped].into_iter().zip(&mut rates) {
                    // By the wall clock, whatever the number of threads.
                    let round = Round::repeat(2, || {
                        agents = acting.step(order);
                        agents as f64
                    });
                    rates.push(round.units / round.seconds);
                }
                ratios.push(rates[1][rates[1].len() - 1] / rates[0][rates[0].len() - 1]);
            }
            Ok(())
        })?;
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        let most = ratios.iter().copied().fold(0.0, f64::max);
        grid.push(
            false,
            vec![
                n_rooms.to_string(),
                agents.to_string(),
                count(median(&rates[0])),
                count(median(&rates[1])),
                format!("{:.2}", median(&ratios)),
                format!("{least:.2}–{most:.2}"),
            ],
        );
    }
    let mut text = conditions.markdown().to_owned();
    let _ = writeln!(
        text,
        "{} threads; agent-steps/s by the wall clock, medians of {} alternating rounds; a ratio above 1 says that overlapping is faster.\n",
        args.threads, args.rounds
    );
    output::result(&(text + &grid.markdown()))
}
