//! Our side of a comparison: the line protocol of `crates/bench/peers/rounds.py`.

use std::io::BufRead as _;

use crate::PeerWork;
use anyhow::{Context as _, Result};
use clap::Args;
use serde_json::json;

use jostle_runs::output;
use jostle_runs::provenance;

/// Arguments of `bench worker`.
#[derive(Args)]
pub(super) struct WorkerArgs {
    /// `update`, `forward-B`, `learner-SHAPE`, `simulator-R` or `orca-N`.
    work: PeerWork,
    /// Worker threads.
    threads: usize,
}

/// Greets when everything is warm; then one round for each line of standard input.
pub(super) fn run(args: &WorkerArgs) -> Result<()> {
    let pool = super::pool(args.threads)?;
    let mut round = pool.install(|| args.work.prepare(args.threads))?;
    output::result(&format!("{}\n", json!({ "name": "jostle", "version": provenance::commit() })))?;
    for line in std::io::stdin().lock().lines() {
        line.context("cannot read standard input")?;
        let measured = pool.install(&mut round);
        output::result(&format!("{}\n", serde_json::to_string(&measured)?))?;
    }
    Ok(())
}
