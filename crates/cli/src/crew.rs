//! The processes that make one training run together: the first one alone writes and prints, and
//! they end together.
//!
//! Whatever can fail on one of them is agreed on before the next step, so that none waits for one
//! that has given up. The error is told once, by the first process.

use std::sync::Arc;

use anyhow::{Result, anyhow};
use jostle_ppo::ranks::{Alone, Communicator};
use jostle_runs::output::one_line;

/// The outcome of a process that another one tells.
#[derive(Debug)]
pub(crate) struct ToldByTheFirst;

impl std::fmt::Display for ToldByTheFirst {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the first process tells why")
    }
}

impl std::error::Error for ToldByTheFirst {}

/// The processes of a run, as one of them sees them.
pub(crate) struct Crew {
    ranks: Arc<dyn Communicator>,
    /// Ends MPI when it is dropped.
    #[cfg(feature = "mpi")]
    _mpi: Option<crate::mpi::Session>,
}

impl Crew {
    /// A crew of one.
    pub(crate) fn alone() -> Self {
        Self::of(Arc::new(Alone))
    }

    /// The crew of these ranks.
    pub(crate) fn of(ranks: Arc<dyn Communicator>) -> Self {
        Self {
            ranks,
            #[cfg(feature = "mpi")]
            _mpi: None,
        }
    }

    /// The processes that `mpirun` or a scheduler has started together with this one.
    ///
    /// # Errors
    /// When there are others and this program is built without MPI; when MPI cannot be used.
    #[cfg(not(feature = "mpi"))]
    pub(crate) fn muster() -> Result<Self> {
        match launched() {
            Some(size) if size > 1 => Err(anyhow!(
                "found {size} processes of one MPI job, expected one: this program is built without the feature `mpi` \
                 (docs/how-to-scale.md)"
            )),
            _ => Ok(Self::alone()),
        }
    }

    /// As above.
    #[cfg(feature = "mpi")]
    pub(crate) fn muster() -> Result<Self> {
        if launched().is_none() {
            return Ok(Self::alone());
        }
        let session = crate::mpi::Session::begin()?;
        Ok(Self { ranks: session.ranks(), _mpi: Some(session) })
    }

    /// What the trainer asks.
    pub(crate) fn ranks(&self) -> Arc<dyn Communicator> {
        Arc::clone(&self.ranks)
    }

    /// True in the process that writes and prints.
    pub(crate) fn is_first(&self) -> bool {
        self.ranks.rank() == 0
    }

    fn is_alone(&self) -> bool {
        self.ranks.size() == 1
    }

    /// Does work in the first process; every process learns whether it failed.
    pub(crate) fn at_first<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
        self.agree(if self.is_first() { work().map(Some) } else { Ok(None) })
    }

    /// The first process's answer, in every process.
    pub(crate) fn decide(&self, answer: impl FnOnce() -> Result<bool>) -> Result<bool> {
        let own = self.at_first(answer)?;
        Ok(self.tell(&[u8::from(own == Some(true))])? == [1])
    }

    /// What the first process says, in every process.
    pub(crate) fn tell(&self, own: &[u8]) -> Result<Vec<u8>> {
        Ok(self.ranks.broadcast(own)?)
    }

    /// True if it is true in any process.
    pub(crate) fn any(&self, own: bool) -> Result<bool> {
        Ok(self.ranks.gather(&[u8::from(own)])?.concat().contains(&1))
    }

    /// This process's outcome where all went well, else a failure: the first one to fail is told by
    /// the first process.
    pub(crate) fn agree<T>(&self, own: Result<T>) -> Result<T> {
        if self.is_alone() {
            return own;
        }
        let message = own.as_ref().err().map(one_line).unwrap_or_default();
        let told = self.ranks.gather(message.as_bytes())?;
        match told.iter().position(|message| !message.is_empty()) {
            None => own,
            Some(0) if self.is_first() => own,
            Some(rank) if self.is_first() => {
                Err(anyhow!("rank {rank}: {}", String::from_utf8_lossy(&told[rank])))
            }
            Some(_) => Err(ToldByTheFirst.into()),
        }
    }

    /// The outcome as this process is to report it: but for the first, silently.
    pub(crate) fn report<T>(&self, outcome: Result<T>) -> Result<T> {
        if self.is_first() { outcome } else { outcome.map_err(|_| ToldByTheFirst.into()) }
    }
}

/// Number of processes that `mpirun` or a scheduler has started as one MPI job; 0 where it does not
/// say; `None` where this is no such process.
fn launched() -> Option<usize> {
    let number = |name| std::env::var(name).ok()?.parse().ok();
    // Open MPI's mpirun; MPICH's mpiexec and Slurm's PMI; PMIx, which does not tell how many.
    let sizes = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"].into_iter().find_map(number);
    sizes.or_else(|| std::env::var_os("PMIX_RANK").map(|_| 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use jostle_ppo::ranks::group;

    /// What each of `size` processes makes of `work`.
    fn crews<T: Send>(size: usize, work: impl Fn(&Crew) -> Result<T> + Sync) -> Vec<Result<T>> {
        std::thread::scope(|scope| {
            let work = &work;
            let started: Vec<_> = group(size)
                .into_iter()
                .map(|member| scope.spawn(move || work(&Crew::of(Arc::new(member)))))
                .collect();
            started.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        })
    }

    #[test]
    fn an_error_of_one_process_ends_all_and_is_told_once() {
        for failing in [0, 2] {
            let outcomes = crews(4, |crew| {
                let rank = crew.ranks().rank();
                let own = if rank == failing { Err(anyhow!("no disk")) } else { Ok(rank) };
                let agreed = crew.agree(own);
                crew.report(agreed)
            });
            let lines: Vec<String> =
                outcomes.iter().map(|outcome| one_line(outcome.as_ref().unwrap_err())).collect();
            assert_eq!(lines[0], if failing == 0 { "no disk" } else { "rank 2: no disk" });
            let silent =
                |outcome: &Result<usize>| outcome.as_ref().is_err_and(anyhow::Error::is::<ToldByTheFirst>);
            assert!(outcomes[1..].iter().all(silent), "{lines:?}");
        }
    }

    #[test]
    fn the_first_process_decides_and_anyone_may_ask() {
        let outcomes = crews(4, |crew| {
            let rank = crew.ranks().rank();
            let yes = crew.decide(|| Ok(crew.is_first()))?;
            let no = crew.decide(|| Ok(rank > 0))?;
            let (any, none) = (crew.any(rank == 3)?, crew.any(false)?);
            let told = crew.tell(&[rank as u8 + 7])?;
            Ok((yes, no, any, none, told))
        });
        for outcome in outcomes {
            assert_eq!(outcome.unwrap(), (true, false, true, false, vec![7]));
        }
    }
}
