//! The contests: workload, contestants, number of threads, and the ratio asked for.

use crate::PeerWork;
use crate::large_updates::Shape;
use anyhow::{Result, bail};

/// Other software.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Peer {
    /// Eager, on the CPU.
    PyTorch,
    /// A Python simulator of lightweight robots.
    IrSim,
    /// A vectorised simulator on PyTorch.
    Vmas,
    /// The reference implementation of ORCA.
    Rvo2,
    /// The simulator of the paper.
    Stage,
}

impl Peer {
    pub(super) const ALL: [Self; 5] = [Self::PyTorch, Self::IrSim, Self::Vmas, Self::Rvo2, Self::Stage];

    /// As its makers write it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::PyTorch => "PyTorch",
            Self::IrSim => "IR-SIM",
            Self::Vmas => "VMAS",
            Self::Rvo2 => "RVO2",
            Self::Stage => "Stage",
        }
    }
}

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contest {
    pub(super) work: PeerWork,
    pub(super) peer: Peer,
    pub(super) threads: usize,
    /// Largest ratio of our time to theirs that is asked for.
    pub(super) asked: Option<f64>,
}

/// Every contest, in the order of the table.
fn all() -> Vec<Contest> {
    let mut all = Vec::new();
    let mut push = |work, peer, threads: &[usize], asked| {
        all.extend(threads.iter().map(|&threads| Contest { work, peer, threads, asked }));
    };
    push(PeerWork::Update, Peer::PyTorch, &[1, 2], Some(0.40));
    for (batch, asked) in [(1, None), (5, Some(0.30)), (20, None), (80, Some(0.45)), (320, Some(0.45))] {
        push(PeerWork::Forward { batch }, Peer::PyTorch, &[1, 2], asked);
    }
    for shape in Shape::ALL {
        push(PeerWork::Learner { shape }, Peer::PyTorch, &[1, 2], None);
    }
    // One room has no work for a second thread.
    for peer in [Peer::IrSim, Peer::Vmas, Peer::Stage] {
        push(PeerWork::Simulator { rooms: 1 }, peer, &[1], None);
    }
    push(PeerWork::Simulator { rooms: 256 }, Peer::Vmas, &[1, 2], None);
    for agents in [5, 100, 1_000, 10_000] {
        push(PeerWork::Orca { agents }, Peer::Rvo2, &[1], Some(1.0));
    }
    all
}

/// The contests whose workload or peer is named; all of them where nothing is named.
///
/// # Errors
/// A name that is neither.
pub(super) fn chosen(names: &[String]) -> Result<Vec<Contest>> {
    let is_named = |contest: &Contest, name: &String| {
        contest.work.to_string() == *name || contest.peer.name().eq_ignore_ascii_case(name)
    };
    let all = all();
    if let Some(unknown) = names.iter().find(|name| !all.iter().any(|contest| is_named(contest, name))) {
        let peers = Peer::ALL.map(Peer::name).join(", ");
        let mut works: Vec<String> = all.iter().map(|contest| contest.work.to_string()).collect();
        works.dedup();
        bail!("--only: found `{unknown}`, expected one of {peers}, {}", works.join(", "));
    }
    let wanted = |contest: &Contest| names.is_empty() || names.iter().any(|name| is_named(contest, name));
    Ok(all.into_iter().filter(wanted).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(texts: &[&str]) -> Vec<String> {
        texts.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn workloads_and_peers_can_be_named() {
        assert_eq!(chosen(&[]).expect("all").len(), 12 + 6 + 3 + 2 + 4);
        assert_eq!(chosen(&names(&["orca-100", "vmas"])).expect("both").len(), 1 + 3);
        assert!(chosen(&names(&["orca"])).expect_err("no such name").to_string().contains("`orca`"));
    }
}
