//! Speed: the workloads that the criterion benches and `cargo xtask bench` time, so that both time
//! the same, and that command.
//!
//! Reading order: [`clock`] (how seconds are taken), the workloads [`learners`] ("work U"),
//! [`large_updates`], [`scenes`] (the simulator), [`rollouts`] (simulator and actor together),
//! [`crowds`] (ORCA, social force), [`evaluation`] and [`planners`]; [`products`] (the largest
//! layer by itself), [`rates`] (what the machine can do); [`peer_work`] (the workloads that other
//! software does, too); [`parity`] (two engines on the same rows); [`mpi`] (jobs of the program
//! under `mpirun`). The other software's drivers are in `peers/`. [`command`] measures them and
//! prints the tables of `docs/performance.md`.
//!
//! Architecture invariant: nothing here is needed for a result; the clock is read here and nowhere
//! below.

#![forbid(unsafe_code)]

pub mod clock;
pub mod command;
pub mod crowds;
#[cfg(doctest)]
mod documents;
mod error;
pub mod evaluation;
pub mod large_updates;
pub mod learners;
pub mod mpi;
pub mod parity;
pub mod peer_work;
pub mod planners;
pub mod products;
pub mod rates;
pub mod rollouts;
pub mod scenes;

pub use clock::{Round, Stopwatch, median};
pub use error::BenchError;
pub use peer_work::PeerWork;
