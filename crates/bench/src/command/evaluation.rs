//! Time of a table's cell: episodes in lock step, all networks paid for.

use std::fmt::Write as _;

use crate::evaluation::Cells;
use crate::rates::once;
use anyhow::Result;
use clap::Args;
use jostle_eval::report::grid::Grid;
use jostle_peds::CrowdKind;

use super::machine::Conditions;
use super::table::{count, duration};
use jostle_runs::output;

/// Arguments of `bench evaluation`.
#[derive(Args)]
pub(super) struct EvaluationArgs {
    /// Episodes of a cell.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    episodes: u64,
    /// Crowds.
    #[arg(long, value_name = "CROWD,…", value_delimiter = ',', default_value = "NH,IN,VA,SO,VO,SF")]
    crowds: Vec<CrowdKind>,
    /// Worker threads.
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
}

pub(super) fn run(args: &EvaluationArgs) -> Result<()> {
    let conditions = Conditions::now();
    let pool = super::pool(args.threads)?;
    let cells = Cells::new()?;
    let mut grid =
        Grid::new(["crowd", "episodes", "steps", "time", "room-steps/s", "asked for 1000 episodes"]);
    for &crowd in &args.crowds {
        let (steps, seconds) = pool.install(|| once(args.threads, || cells.run(crowd, args.episodes)));
        let steps = steps? as f64;
        grid.push(
            false,
            vec![
                crowd.to_string(),
                args.episodes.to_string(),
                count(steps),
                duration(seconds),
                count(steps / seconds),
                if crowd.is_learned() { "60 s" } else { "30 s" }.to_owned(),
            ],
        );
    }
    let mut text = conditions.markdown().to_owned();
    let _ = writeln!(
        text,
        "{} threads. The networks are fresh; the robot seeks its goal whatever its network answers, so that episodes have \
         the lengths of a trained policy's.\n",
        args.threads
    );
    output::result(&(text + &grid.markdown()))
}
