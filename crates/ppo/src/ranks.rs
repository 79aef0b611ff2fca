//! One run in several processes: who computes which rooms, and how their sums become one.
//!
//! The rooms of a run are dealt to `shards` *shards*, a power of two that the configuration fixes.
//! Whatever is summed over a rollout is summed over each shard first and then over the shards, by
//! pairs, pairs of pairs and so on. Each *rank* (a process of the run) has a run of neighbouring
//! shards, whose number is a power of two, too, so that its sum is a knot of the same tree, and the
//! ranks add up the rest. Which sums are formed, and from what, is then the same whether one rank
//! computes all shards or each has one: no bit depends on the number of ranks.
//!
//! ```text
//!     shards  0   1   2   3   4   5   6   7
//!              \ /     \ /     \ /     \ /
//!               +       +       +       +      one rank: all of it
//!                \     /         \     /       two ranks: the two halves; then one exchange
//!                   +               +          four ranks: the four pairs; then two
//!                    \             /
//!                           +
//! ```
//!
//! A sum of long vectors over P ranks is formed in halves (Rabenseifner 2004): in log₂ P exchanges
//! each rank gives away the half of what it holds, in as many more it gets the finished parts
//! back, so that it sends 2·(P − 1)/P vectors, however many ranks there are.
//!
//! [`Communicator`] is all that is asked of a network. [`Alone`] is the run of one process,
//! [`group`] makes ranks that are threads of one process; MPI's is behind the feature `mpi` of
//! `jostle-cli`.

use std::ops::{Add, Range};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

use bytemuck::Pod;

use crate::PpoError;

/// The ranks of a run, as one of them sees them.
///
/// All ranks make the same calls in the same order. What comes back is the same bytes on every
/// machine: ranks share an order of bytes.
pub trait Communicator: Send + Sync {
    /// This rank's number, from 0.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn size(&self) -> usize;

    /// Gives every rank what each of them has, in the order of the ranks.
    ///
    /// # Errors
    ///
    /// [`PpoError::Ranks`] when another rank is gone.
    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError>;

    /// Gives `partner` the bytes `own` and takes its bytes, of a known length.
    ///
    /// # Errors
    ///
    /// [`PpoError::Ranks`] when the partner is gone.
    fn exchange(&self, partner: usize, own: &[u8], theirs: &mut [u8]) -> Result<(), PpoError>;

    /// What rank 0 has, for every rank.
    ///
    /// # Errors
    ///
    /// As [`Self::gather`].
    fn broadcast(&self, own: &[u8]) -> Result<Vec<u8>, PpoError> {
        let of_root = if self.rank() == 0 { own } else { &[] };
        Ok(self.gather(of_root)?.swap_remove(0))
    }
}

/// The ranks of a run of one process.
#[derive(Debug, Clone, Copy, Default)]
pub struct Alone;

impl Communicator for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError> {
        Ok(vec![own.to_vec()])
    }

    fn exchange(&self, partner: usize, _own: &[u8], _theirs: &mut [u8]) -> Result<(), PpoError> {
        Err(gone(partner))
    }
}

/// A rank that is a thread of this process ([`group`]).
#[derive(Debug)]
pub struct Member {
    rank: usize,
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Mutex<Receiver<Vec<u8>>>>,
}

/// As many ranks, each for a thread of its own: what a test needs.
pub fn group(size: usize) -> Vec<Member> {
    let mut members: Vec<Member> =
        (0..size).map(|rank| Member { rank, to: Vec::new(), from: Vec::new() }).collect();
    for sender in 0..size {
        for receiver in 0..size {
            let (to, from) = channel();
            members[sender].to.push(to);
            members[receiver].from.push(Mutex::new(from));
        }
    }
    members
}

impl Member {
    fn send(&self, to: usize, bytes: &[u8]) -> Result<(), PpoError> {
        self.to[to].send(bytes.to_vec()).map_err(|_| gone(to))
    }

    fn receive(&self, from: usize) -> Result<Vec<u8>, PpoError> {
        let receiver = self.from[from].lock().map_err(|_| gone(from))?;
        receiver.recv().map_err(|_| gone(from))
    }
}

impl Communicator for Member {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.to.len()
    }

    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError> {
        (0..self.size()).try_for_each(|rank| self.send(rank, own))?;
        (0..self.size()).map(|rank| self.receive(rank)).collect()
    }

    fn exchange(&self, partner: usize, own: &[u8], theirs: &mut [u8]) -> Result<(), PpoError> {
        self.send(partner, own)?;
        let found = self.receive(partner)?;
        if found.len() != theirs.len() {
            let (found, expected) = (found.len(), theirs.len());
            let reason = format!("rank {partner} sent {found} bytes, expected {expected}");
            return Err(PpoError::Ranks { reason });
        }
        theirs.copy_from_slice(&found);
        Ok(())
    }
}

fn gone(rank: usize) -> PpoError {
    PpoError::Ranks { reason: format!("rank {rank} is gone") }
}

/// The ranks of a run with its shards: what the trainer asks.
#[derive(Clone)]
pub(crate) struct Ranks {
    communicator: Arc<dyn Communicator>,
    shards: usize,
}

impl Ranks {
    /// # Errors
    ///
    /// [`PpoError::Ranks`] when the shards cannot be dealt to the ranks.
    pub(crate) fn new(communicator: Arc<dyn Communicator>, shards: usize) -> Result<Self, PpoError> {
        let size = communicator.size();
        if size.is_power_of_two() && size <= shards {
            return Ok(Self { communicator, shards });
        }
        let reason = format!("found {size} ranks, expected a power of two of at most {shards} (shards)");
        Err(PpoError::Ranks { reason })
    }

    pub(crate) fn are_several(&self) -> bool {
        self.communicator.size() > 1
    }

    pub(crate) fn is_first(&self) -> bool {
        self.communicator.rank() == 0
    }

    /// The shards of this rank.
    pub(crate) fn own_shards(&self) -> Range<usize> {
        let n = self.shards / self.communicator.size();
        self.communicator.rank() * n..(self.communicator.rank() + 1) * n
    }

    pub(crate) fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError> {
        self.communicator.gather(own)
    }

    /// Numbers of all shards in their order, from those of this rank's shards.
    pub(crate) fn gather_values<T: Pod>(&self, own: &[T]) -> Result<Vec<T>, PpoError> {
        let all = self.gather(bytemuck::cast_slice(own))?;
        let values = all.iter().flat_map(|bytes| bytes.chunks_exact(size_of::<T>()));
        Ok(values.map(bytemuck::pod_read_unaligned).collect())
    }

    /// What each rank has, on the first one; nothing on the others.
    pub(crate) fn collect(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError> {
        let lens = self.gather_values(&[own.len() as u64])?;
        if !self.is_first() {
            self.communicator.exchange(0, own, &mut [])?;
            return Ok(Vec::new());
        }
        let mut all = vec![own.to_vec()];
        for (rank, len) in lens.into_iter().enumerate().skip(1) {
            let mut theirs = vec![0; len as usize];
            self.communicator.exchange(rank, &[], &mut theirs)?;
            all.push(theirs);
        }
        Ok(all)
    }

    /// The outcome of all ranks: that of this one if all went well, else the error of the first
    /// that failed, on every rank.
    pub(crate) fn agree<T>(&self, own: Result<T, PpoError>) -> Result<T, PpoError> {
        if !self.are_several() {
            return own;
        }
        let told = match &own {
            Ok(_) => Vec::new(),
            // A network that fails does not carry the news of it.
            Err(PpoError::Ranks { .. }) => return own,
            Err(error) => serde_json::to_vec(&Told::new(error)).expect("an error is plain data"),
        };
        match self.gather(&told)?.iter().enumerate().find(|(_, told)| !told.is_empty()) {
            None => own,
            Some((rank, _)) if rank == self.communicator.rank() => own,
            Some((_, told)) => {
                let told: Told = serde_json::from_slice(told)
                    .map_err(|error| PpoError::Ranks { reason: format!("another rank failed: {error}") })?;
                Err(told.into())
            }
        }
    }

    /// Sums over all shards, from the parts of this rank's shards in their order.
    pub(crate) fn sum<T: Number>(&self, parts: impl IntoIterator<Item = Vec<T>>) -> Result<Vec<T>, PpoError> {
        let mut tree = Tree::default();
        parts.into_iter().for_each(|part| tree.push(part));
        let mut sum = tree.take();
        self.sum_over_ranks(&mut sum)?;
        Ok(sum)
    }

    /// Adds up the ranks' sums, in place.
    pub(crate) fn sum_over_ranks<T: Number>(&self, values: &mut [T]) -> Result<(), PpoError> {
        let (rank, size) = (self.communicator.rank(), self.communicator.size());
        let mut theirs = vec![T::zeroed(); if size > 1 { values.len().div_ceil(2) } else { 0 }];
        let mut range = 0..values.len();
        let mut halves = Vec::new();
        for step in (0..size.trailing_zeros()).map(|level| 1 << level) {
            let [lower, upper] = halve(&range);
            let (kept, given) = if rank & step == 0 { (lower, upper) } else { (upper, lower) };
            let own = bytemuck::cast_slice(&values[given.clone()]);
            let received = &mut theirs[..kept.len()];
            self.communicator.exchange(rank ^ step, own, bytemuck::cast_slice_mut(received))?;
            values[kept.clone()].iter_mut().zip(&*received).for_each(|(sum, &value)| *sum = *sum + value);
            halves.push((step, given));
            range = kept;
        }
        for (step, missing) in halves.into_iter().rev() {
            let received = &mut theirs[..missing.len()];
            let own = bytemuck::cast_slice(&values[range.clone()]);
            self.communicator.exchange(rank ^ step, own, bytemuck::cast_slice_mut(received))?;
            values[missing.clone()].copy_from_slice(received);
            range = range.start.min(missing.start)..range.end.max(missing.end);
        }
        Ok(())
    }
}

/// Values that are summed.
pub(crate) trait Number: Pod + Add<Output = Self> {}
impl Number for f32 {}
impl Number for f64 {}

fn halve(range: &Range<usize>) -> [Range<usize>; 2] {
    let middle = range.start + range.len() / 2;
    [range.start..middle, middle..range.end]
}

/// A sum by pairs, pairs of pairs and so on, of parts that come one by one. It holds as many
/// vectors as the tree is high.
#[derive(Debug)]
pub(crate) struct Tree<T> {
    /// Sums of 2^k parts that wait for their neighbour.
    waiting: Vec<Option<Vec<T>>>,
}

impl<T> Default for Tree<T> {
    fn default() -> Self {
        Self { waiting: Vec::new() }
    }
}

impl<T: Number> Tree<T> {
    /// Adds the next part.
    pub(crate) fn push(&mut self, part: Vec<T>) {
        let mut sum = part;
        for place in &mut self.waiting {
            let Some(mut left) = place.take() else {
                *place = Some(sum);
                return;
            };
            left.iter_mut().zip(&sum).for_each(|(left, &right)| *left = *left + right);
            sum = left;
        }
        self.waiting.push(Some(sum));
    }

    /// The sum of all parts, whose number is a power of two; the tree is empty after that.
    pub(crate) fn take(&mut self) -> Vec<T> {
        let sum = self.waiting.pop().flatten().expect("at least one part");
        assert!(self.waiting.iter().all(Option::is_none), "the number of parts is a power of two");
        self.waiting.clear();
        sum
    }
}

/// An error as it goes from rank to rank.
#[derive(serde::Serialize, serde::Deserialize)]
enum Told {
    NotFinite { update: u64, tensor: String, agent: Option<usize> },
    Other(String),
}

impl Told {
    fn new(error: &PpoError) -> Self {
        match error {
            PpoError::NotFinite { update, tensor, agent } => {
                Self::NotFinite { update: *update, tensor: tensor.clone(), agent: *agent }
            }
            error => Self::Other(error.to_string()),
        }
    }
}

impl From<Told> for PpoError {
    fn from(told: Told) -> Self {
        match told {
            Told::NotFinite { update, tensor, agent } => Self::NotFinite { update, tensor, agent },
            Told::Other(reason) => Self::Ranks { reason },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `work` on every rank of a group; results in the order of the ranks.
    fn on_ranks<T: Send>(size: usize, shards: usize, work: impl Fn(&Ranks) -> T + Sync) -> Vec<T> {
        let members = group(size);
        std::thread::scope(|scope| {
            let work = &work;
            let started: Vec<_> = members
                .into_iter()
                .map(|member| scope.spawn(move || work(&Ranks::new(Arc::new(member), shards).unwrap())))
                .collect();
            started.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        })
    }

    /// Values of a shard whose sum depends on the order.
    fn part(shard: usize, len: usize) -> Vec<f32> {
        let value = |i: usize| (shard * 31 + i * 17) as f32;
        (0..len).map(|i| value(i).sin() * 10_f32.powi((shard * 7 + i) as i32 % 9)).collect()
    }

    #[test]
    fn a_sum_has_the_same_bits_on_any_number_of_ranks() {
        for len in [0, 1, 2, 5, 64] {
            let bits = |size| {
                let sums = on_ranks(size, 8, |ranks| {
                    ranks.sum(ranks.own_shards().map(|shard| part(shard, len))).unwrap()
                });
                let mut all: Vec<Vec<u32>> =
                    sums.iter().map(|sum| sum.iter().map(|x| x.to_bits()).collect()).collect();
                all.dedup();
                assert_eq!(all.len(), 1, "all {size} ranks have the same sum of {len} values");
                all.remove(0)
            };
            let alone = bits(1);
            for size in [2, 4, 8] {
                assert_eq!(bits(size), alone, "{size} ranks, {len} values");
            }
        }
    }

    #[test]
    fn the_tree_adds_neighbours_first() {
        // 1e8 + 1 is 1e8 in f32; only (1e8 − 1e8) + (1 + 1) is 2.
        let tree = |parts: [f32; 4]| {
            let mut tree = Tree::default();
            for part in parts {
                tree.push(vec![part]);
            }
            tree.take()
        };
        assert_eq!((tree([1e8, -1e8, 1.0, 1.0]), tree([1e8, 1.0, -1e8, 1.0])), (vec![2.0], vec![0.0]));
    }

    #[test]
    fn what_is_gathered_is_in_the_order_of_the_shards() {
        let found = on_ranks(4, 8, |ranks| {
            let own: Vec<u64> = ranks.own_shards().map(|shard| shard as u64).collect();
            ranks.gather_values(&own).unwrap()
        });
        assert!(found.iter().all(|all| *all == (0..8).collect::<Vec<u64>>()), "{found:?}");
        let told = on_ranks(4, 4, |ranks| {
            let own = [ranks.communicator.rank() as u8; 3];
            ranks.communicator.broadcast(&own).unwrap()
        });
        assert!(told.iter().all(|told| *told == [0; 3]), "{told:?}");
    }

    #[test]
    fn the_first_error_is_every_ranks_error() {
        let found = on_ranks(4, 4, |ranks| {
            let rank = ranks.communicator.rank();
            let error = |agent| PpoError::NotFinite { update: 3, tensor: "action".to_owned(), agent };
            let own = if rank % 2 == 1 { Err(error(Some(rank))) } else { Ok(rank) };
            ranks.agree(own).map_err(|error| error.to_string())
        });
        assert!(
            found.iter().all(|told| *told == Err("update 3: action of agent 1 is not finite".to_owned()))
        );
        let other = || PpoError::Threads { threads: 7, reason: "no".to_owned() };
        let found = on_ranks(2, 2, |ranks| {
            ranks
                .agree(if ranks.is_first() { Ok(()) } else { Err(other()) })
                .map_err(|error| error.to_string())
        });
        assert_eq!(found[0], Err(other().to_string()));
        assert_eq!(found[0], found[1]);
    }

    #[test]
    fn a_rank_that_is_gone_is_an_error_and_no_endless_wait() {
        let found = on_ranks(2, 2, |ranks| {
            if !ranks.is_first() {
                return None;
            }
            Some(ranks.sum_over_ranks(&mut [1.0_f32, 2.0]).unwrap_err().to_string())
        });
        assert_eq!(found[0].as_deref(), Some("rank 1 is gone"));
        assert!(Alone.exchange(1, &[], &mut []).is_err());
    }

    #[test]
    fn ranks_without_a_shard_are_refused() {
        for (size, shards) in [(2, 1), (3, 4), (8, 4)] {
            let member = group(size).remove(0);
            let refusal = Ranks::new(Arc::new(member), shards).err().expect("refused").to_string();
            let expected =
                format!("found {size} ranks, expected a power of two of at most {shards} (shards)");
            assert_eq!(refusal, expected);
        }
    }
}
