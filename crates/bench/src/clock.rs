//! Taking of seconds, and the median of rounds.
//!
//! Work on one thread is timed by what that thread has computed, so that a machine that is busy
//! with other work does not distort it; work on several threads by the wall clock. The drivers in
//! `peers/` do the same.

use std::time::Instant;

use cpu_time::ThreadTime;
use serde::{Deserialize, Serialize};

/// A round lasts at least this long, s.
pub const ROUND_SECONDS: f64 = 0.4;

/// One measured round.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Duration, s.
    pub seconds: f64,
    /// Amount of work done: updates, calls or agent-steps.
    pub units: f64,
    /// A number that both sides should agree on, where the work has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check: Option<f64>,
}

impl Round {
    /// Seconds for one unit.
    pub fn seconds_per_unit(&self) -> f64 {
        self.seconds / self.units
    }

    /// Repeats `work`, which answers how many units it did, until the round is long enough.
    pub fn repeat(threads: usize, mut work: impl FnMut() -> f64) -> Self {
        let (watch, mut units) = (Stopwatch::start(threads), 0.0);
        loop {
            units += work();
            let seconds = watch.seconds();
            if seconds >= ROUND_SECONDS {
                return Self { seconds, units, check: None };
            }
        }
    }
}

/// A running clock. It must be read on the thread that started it.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    /// The thread's time at the start; `None` for the wall clock.
    cpu: Option<ThreadTime>,
}

impl Stopwatch {
    /// Starts a clock for work on so many threads. Where the system does not tell a thread's own
    /// time, it is the wall clock. (Linux's `/proc/thread-self/schedstat` would need no dependency,
    /// but moves in ticks of 4 ms.)
    pub fn start(threads: usize) -> Self {
        let cpu = if threads == 1 { ThreadTime::try_now().ok() } else { None };
        Self { wall: Instant::now(), cpu }
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        let cpu = self.cpu.and_then(|start| start.try_elapsed().ok());
        cpu.unwrap_or_else(|| self.wall.elapsed()).as_secs_f64()
    }
}

/// The middle value; of an even number of values, the mean of the two in the middle; NaN of none.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[middle],
        _ => f64::midpoint(sorted[middle - 1], sorted[middle]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn a_round_counts_every_unit_of_its_work() {
        let mut calls = 0_u32;
        let round = Round::repeat(2, || {
            calls += 1;
            std::thread::sleep(std::time::Duration::from_millis(90));
            2.0
        });
        assert!(round.seconds >= ROUND_SECONDS);
        assert_eq!(round.units, 2.0 * f64::from(calls));
    }
}
