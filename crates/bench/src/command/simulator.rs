//! Agent-steps per second: whole steps with motion, 512 noisy beams and observation writing.

use std::fmt::Write as _;

use crate::scenes::{SCENES, Stepping};
use crate::{Round, median};
use anyhow::Result;
use clap::Args;
use jostle_eval::report::grid::Grid;

use super::machine::Conditions;
use super::table::count;
use jostle_runs::output;

/// Agent-steps per second and core that are asked for, scene by scene; `None` where nothing is.
const ASKED: [Option<f64>; SCENES.len()] = [Some(150_000.0), Some(100_000.0), Some(60_000.0), None];
/// Rooms side by side.
const ROOMS: usize = 16;

/// Arguments of `bench simulator`.
#[derive(Args)]
pub(super) struct SimulatorArgs {
    /// Rounds; scenes take turns in each.
    #[arg(long, value_name = "N", default_value_t = 7)]
    rounds: usize,
    /// Numbers of worker threads.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,2")]
    threads: Vec<usize>,
}

pub(super) fn run(args: &SimulatorArgs) -> Result<()> {
    let conditions = Conditions::now();
    let mut grid =
        Grid::new(["scene", "threads", "agent-steps/s", "least–most", "per core", "asked per core"]);
    for &threads in &args.threads {
        let pool = super::pool(threads)?;
        let mut rates = vec![Vec::new(); SCENES.len()];
        pool.install(|| -> Result<()> {
            let mut steppings = SCENES
                .iter()
                .map(|(_, scene)| Stepping::new(*scene, ROOMS))
                .collect::<Result<Vec<_>, _>>()?;
            for _ in 0..args.rounds {
                for (stepping, rates) in steppings.iter_mut().zip(&mut rates) {
                    let steps = |stepping: &mut Stepping| (0..10).map(|_| stepping.step()).sum::<usize>();
                    let round = Round::repeat(threads, || steps(stepping) as f64);
                    rates.push(round.units / round.seconds);
                }
            }
            Ok(())
        })?;
        for (((name, _), rates), asked) in SCENES.iter().zip(&rates).zip(ASKED) {
            let least = rates.iter().copied().fold(f64::INFINITY, f64::min);
            let most = rates.iter().copied().fold(0.0, f64::max);
            let rate = median(rates);
            grid.push(
                false,
                vec![
                    (*name).to_owned(),
                    threads.to_string(),
                    count(rate),
                    format!("{}–{}", count(least), count(most)),
                    count(rate / threads as f64),
                    asked.map_or_else(|| "–".to_owned(), count),
                ],
            );
        }
    }
    let mut text = conditions.markdown().to_owned();
    let _ = writeln!(
        text,
        "{ROOMS} rooms side by side, medians of {} rounds. One thread: its CPU time; more: the wall clock.\n",
        args.rounds
    );
    output::result(&(text + &grid.markdown()))
}
