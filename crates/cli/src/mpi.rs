//! MPI as the network of a run's ranks, with the feature `mpi`.
//!
//! All calls come from one thread at a time, but not from the one that began: that is what MPI
//! calls "serialized".

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use jostle_ppo::PpoError;
use jostle_ppo::ranks::Communicator;
use jostle_runs::output;
use mpi::Threading;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::point_to_point::send_receive_into;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, CommunicatorCollectives as _};

/// Exit status of a job one of whose processes panicked: Rust's own.
const PANICKED: i32 = 101;

/// MPI between its beginning and its end, which waits for all processes.
pub(crate) struct Session {
    _universe: Universe,
}

impl Session {
    /// Joins the other processes.
    ///
    /// # Errors
    /// When MPI has begun already or cannot be called from other threads.
    pub(crate) fn begin() -> Result<Self> {
        let (universe, threading) =
            mpi::initialize_with_threading(Threading::Serialized).context("MPI has begun already")?;
        ensure!(
            threading >= Threading::Serialized,
            "this MPI library can be called from one thread only, expected MPI_THREAD_SERIALIZED"
        );
        if SimpleCommunicator::world().size() > 1 {
            end_all_with_a_panic();
        }
        Ok(Self { _universe: universe })
    }

    /// The processes.
    pub(crate) fn ranks(&self) -> Arc<dyn Communicator> {
        let world = SimpleCommunicator::world();
        Arc::new(Ranks { rank: world.rank() as usize, size: world.size() as usize })
    }
}

/// A process that panics would wait at the end of MPI for the others, and they for it.
fn end_all_with_a_panic() {
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        tell(info);
        SimpleCommunicator::world().abort(PANICKED);
    }));
}

/// The processes of an MPI job. A call that fails ends the job: that is MPI's default.
struct Ranks {
    rank: usize,
    size: usize,
}

impl Communicator for Ranks {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, PpoError> {
        let world = SimpleCommunicator::world();
        let len = fitting(own.len())?;
        let mut lens = vec![0_i32; self.size];
        world.all_gather_into(&len, &mut lens[..]);
        let mut ends = 0_usize;
        let starts: Vec<i32> = lens
            .iter()
            .map(|len| {
                let start = fitting(ends);
                ends += *len as usize;
                start
            })
            .collect::<Result<_, _>>()?;
        // Open MPI refuses a gather of nothing at all.
        if ends == 0 {
            return Ok(vec![Vec::new(); self.size]);
        }
        let mut all = vec![0_u8; ends];
        {
            let mut parts = PartitionMut::new(&mut all[..], &lens[..], &starts[..]);
            world.all_gather_varcount_into(own, &mut parts);
        }
        let part = |(start, len): (&i32, &i32)| all[*start as usize..(*start + *len) as usize].to_vec();
        Ok(starts.iter().zip(&lens).map(part).collect())
    }

    fn exchange(&self, partner: usize, own: &[u8], theirs: &mut [u8]) -> Result<(), PpoError> {
        fitting(own.len())?;
        fitting(theirs.len())?;
        let world = SimpleCommunicator::world();
        let partner = world.process_at_rank(partner as i32);
        send_receive_into(own, &partner, theirs, &partner);
        Ok(())
    }
}

/// A length as MPI counts it.
fn fitting(len: usize) -> Result<i32, PpoError> {
    i32::try_from(len).map_err(|_| PpoError::Ranks {
        reason: format!("found a message of {len} bytes, expected at most {}", i32::MAX),
    })
}

/// Arguments of `messages`.
#[derive(Args)]
pub struct MessagesArgs {
    /// Bytes that both processes send at once, separated by commas.
    #[arg(long, value_name = "N,…", value_delimiter = ',', required = true)]
    bytes: Vec<usize>,
    /// Exchanges of each size.
    #[arg(long, value_name = "N", default_value_t = 200)]
    rounds: usize,
}

/// Prints, for each number of bytes, the seconds of each exchange of two processes.
pub(crate) fn time_messages(args: &MessagesArgs) -> Result<ExitCode> {
    let session = Session::begin()?;
    let ranks = session.ranks();
    ensure!(ranks.size() == 2, "found {} processes, expected 2 (mpirun -n 2)", ranks.size());
    let partner = 1 - ranks.rank();
    for &bytes in &args.bytes {
        let (own, mut theirs) = (vec![1; bytes], vec![0; bytes]);
        let mut seconds = Vec::with_capacity(args.rounds);
        // The first exchanges make connections.
        for round in 0..args.rounds + 10 {
            let start = Instant::now();
            ranks.exchange(partner, &own, &mut theirs)?;
            if round >= 10 {
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
        if ranks.rank() == 0 {
            output::result(&format!("{}\n", serde_json::to_string(&(bytes, seconds))?))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
