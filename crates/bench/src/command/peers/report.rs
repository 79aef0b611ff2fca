//! Medians and ratios as a Markdown table, and every round as a line of JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::{Round, median};
use anyhow::{Context as _, Result};
use jostle_eval::report::grid::Grid;
use serde_json::json;

use super::super::table::{duration, significant};
use super::contest::{Contest, Peer};

/// All rounds of a contest.
pub(super) struct Measured {
    contest: Contest,
    our_version: String,
    their_version: String,
    pub(super) ours: Vec<Round>,
    pub(super) theirs: Vec<Round>,
}

impl Measured {
    pub(super) fn new(contest: Contest, our_version: String, their_version: String) -> Self {
        Self { contest, our_version, their_version, ours: Vec::new(), theirs: Vec::new() }
    }

    /// Our median time for a unit over theirs.
    fn ratio(&self) -> f64 {
        per_unit(&self.ours) / per_unit(&self.theirs)
    }

    /// The least and the largest ratio of a round.
    fn spread(&self) -> (f64, f64) {
        let ratios =
            self.ours.iter().zip(&self.theirs).map(|(a, b)| a.seconds_per_unit() / b.seconds_per_unit());
        ratios.fold((f64::INFINITY, 0.0), |(least, most), ratio| (ratio.min(least), ratio.max(most)))
    }

    /// For whoever waits.
    pub(super) fn line(&self) -> String {
        let Contest { work, peer, threads, .. } = self.contest;
        let (ours, theirs) = (duration(per_unit(&self.ours)), duration(per_unit(&self.theirs)));
        format!("{work}, {threads} threads: {ours}, {} {theirs}: {:.3}", peer.name(), self.ratio())
    }

    fn row(&self) -> Vec<String> {
        let Contest { work, peer, threads, asked } = self.contest;
        let (least, most) = self.spread();
        vec![
            work.to_string(),
            threads.to_string(),
            format!("{} {}", peer.name(), self.their_version),
            format!("{} / {}", duration(per_unit(&self.ours)), work.unit()),
            duration(per_unit(&self.theirs)),
            format!("**{}**", ratio(self.ratio())),
            format!("{}–{}", ratio(least), ratio(most)),
            asked.map_or_else(|| "–".to_owned(), |asked| format!("{asked:.2}")),
        ]
    }

    /// Relative difference of the two sides' results; `None` where the work has none.
    fn disagreement(&self) -> Option<f64> {
        let (ours, theirs) = (self.ours.first()?.check?, self.theirs.first()?.check?);
        Some((ours - theirs).abs() / theirs.abs().max(f64::MIN_POSITIVE))
    }
}

fn per_unit(rounds: &[Round]) -> f64 {
    median(&rounds.iter().map(Round::seconds_per_unit).collect::<Vec<_>>())
}

/// Small ratios need more decimals than large ones.
fn ratio(value: f64) -> String {
    if value < 0.1 { format!("{value:.4}") } else { significant(value) }
}

/// The table, what its columns mean, and who is missing from it.
pub(super) fn markdown(all: &[Measured], rounds: u32, unavailable: &BTreeMap<Peer, String>) -> String {
    let mut grid = Grid::new([
        "work",
        "threads",
        "peer",
        "jostle",
        "peer's time",
        "ratio",
        "least–most of a round",
        "asked",
    ]);
    let mut last = None;
    for measured in all {
        grid.push(last != Some(measured.contest.peer), measured.row());
        last = Some(measured.contest.peer);
    }
    let mut text = grid.markdown();
    let _ = write!(
        text,
        "\nTimes are medians of {rounds} alternating rounds for one unit of work; the ratio is ours over theirs, so that below \
         1 is faster. One thread: CPU time of the process (Stage: the wall clock, start-up included); more: the wall \
         clock. jostle is at {}.\n",
        all[0].our_version
    );
    if let Some(most) = all.iter().filter_map(Measured::disagreement).reduce(f64::max) {
        let _ = writeln!(
            text,
            "ORCA's positions after 20 steps, summed, differ from RVO2's by at most {most:.1e}, relative."
        );
    }
    for (peer, reason) in unavailable {
        let _ = writeln!(text, "Not measured: {} ({reason}).", peer.name());
    }
    text
}

/// Every round of every contest, one line each.
pub(super) fn write_rounds(all: &[Measured], path: &Path) -> Result<()> {
    let mut text = String::new();
    for measured in all {
        let Contest { work, peer, threads, .. } = measured.contest;
        for (round, (ours, theirs)) in measured.ours.iter().zip(&measured.theirs).enumerate() {
            let line = json!({
                "work": work.to_string(), "peer": peer.name(), "version": measured.their_version, "threads": threads,
                "round": round, "ours": ours, "theirs": theirs,
            });
            let _ = writeln!(text, "{line}");
        }
    }
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use crate::PeerWork;

    use super::*;

    fn round(seconds: f64, units: f64) -> Round {
        Round { seconds, units, check: Some(units) }
    }

    #[test]
    fn the_ratio_is_that_of_the_medians() {
        let contest = Contest { work: PeerWork::Update, peer: Peer::PyTorch, threads: 2, asked: Some(0.4) };
        let mut measured = Measured::new(contest, "abc".to_owned(), "2.8".to_owned());
        measured.ours = vec![round(1.0, 4.0), round(3.0, 4.0), round(2.0, 4.0)];
        measured.theirs = vec![round(2.0, 1.0), round(2.0, 1.0), round(8.0, 1.0)];
        assert_eq!(measured.ratio(), 0.25);
        assert_eq!(measured.spread(), (0.0625, 0.375));
        let text = markdown(&[measured], 3, &BTreeMap::from([(Peer::Stage, "no binary".to_owned())]));
        assert!(
            text.contains(
                "| update | 2 | PyTorch 2.8 | 500 ms / update | 2.00 s | **0.25** | 0.0625–0.38 | 0.40 |"
            ),
            "{text}"
        );
        assert!(text.contains("Not measured: Stage (no binary)."));
    }
}
