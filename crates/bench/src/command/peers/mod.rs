//! `cargo xtask bench peers`: ours and other software on the same work with the same threads,
//! taking turns.
//!
//! Reading order: [`contest`] (who does what), [`install`] (how the others get here), [`side`] (a
//! process that answers with rounds), [`report`] (the table). The others' drivers are ours:
//! `crates/bench/peers/`.

mod contest;
mod install;
mod report;
mod side;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use clap::Args;

use super::machine::Conditions;
use contest::{Contest, Peer};
use install::Installed;
use jostle_runs::output;
use jostle_runs::provenance;
use report::Measured;
use side::Side;

/// Arguments of `bench peers`.
#[derive(Args)]
#[command(after_help = "Example:\n  cargo xtask bench peers --rvo2 ../RVO2 --only update,forward-5,orca-100")]
pub(super) struct PeersArgs {
    /// Folder for what is installed, built and written (default: target/peers).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Checkout of RVO2's C++ sources, built here with `c++` (or $CXX).
    #[arg(long, value_name = "DIR")]
    rvo2: Option<PathBuf>,
    /// Binary of the Stage simulator.
    #[arg(long, value_name = "BIN")]
    stage: Option<PathBuf>,
    /// Rounds of each side.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(5..))]
    rounds: u32,
    /// Only these workloads or peers, such as `update`, `forward-5`, `learner-motion`,
    /// `simulator-1`, `orca-100`, `pytorch`, `vmas`.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Use this Python as it is, and install nothing.
    #[arg(long, value_name = "BIN")]
    python: Option<PathBuf>,
    /// Package index that PyTorch is taken from, such as that of its CPU wheels.
    #[arg(long, value_name = "URL", conflicts_with = "python")]
    torch_index: Option<String>,
}

pub(super) fn run(args: &PeersArgs) -> Result<()> {
    let conditions = Conditions::now();
    let out = args.out.clone().unwrap_or_else(|| provenance::workspace().join("target/peers"));
    fs::create_dir_all(&out).with_context(|| format!("cannot make {}", out.display()))?;
    let contests = contest::chosen(&args.only)?;
    let mut installed = Installed::new(args, &out);
    let mut unavailable = BTreeMap::new();
    let mut all = Vec::new();
    for contest in contests {
        // A peer that cannot be had or fails costs its rows, not those of the others.
        match installed.install(contest.peer).and_then(|()| measure(contest, args.rounds, &installed)) {
            Ok(measured) => {
                output::note(&measured.line());
                all.push(measured);
            }
            Err(error) => {
                let reason = output::one_line(&error);
                if unavailable.get(&contest.peer) != Some(&reason) {
                    output::note(&format!("{}: not measured: {reason}", contest.peer.name()));
                    unavailable.insert(contest.peer, reason);
                }
            }
        }
    }
    if all.is_empty() {
        bail!("nothing was measured");
    }
    report::write_rounds(&all, &out.join("rounds.ndjson"))?;
    let markdown = conditions.markdown().to_owned() + &report::markdown(&all, args.rounds, &unavailable);
    let path = out.join("peers.md");
    fs::write(&path, &markdown).with_context(|| format!("cannot write {}", path.display()))?;
    output::result(&markdown)
}

/// Alternating rounds; who begins changes from round to round.
fn measure(contest: Contest, rounds: u32, installed: &Installed<'_>) -> Result<Measured> {
    let mut ours = Side::ours(contest)?;
    let mut theirs = installed.side(contest)?;
    let mut measured = Measured::new(contest, ours.version().to_owned(), theirs.version().to_owned());
    for round in 0..rounds {
        if round % 2 == 0 {
            measured.ours.push(ours.round()?);
            measured.theirs.push(theirs.round()?);
        } else {
            measured.theirs.push(theirs.round()?);
            measured.ours.push(ours.round()?);
        }
    }
    Ok(measured)
}

/// Folder of our drivers of other software.
fn peers_folder() -> PathBuf {
    provenance::workspace().join("crates/bench/peers")
}

/// The Python packages that a peer must have; empty if it needs no Python.
fn packages(peer: Peer) -> &'static [&'static str] {
    match peer {
        Peer::PyTorch => &["torch"],
        Peer::IrSim => &["ir-sim"],
        Peer::Vmas => &["torch", "vmas"],
        Peer::Rvo2 | Peer::Stage => &[],
    }
}
