//! When to kill.

use std::time::Duration;

use jostle_sim::StreamRng;
use rand::RngExt as _;

/// The moment at which a process is caught.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moment {
    /// Anything.
    Any,
    /// A checkpoint that is being written: its partial file is there.
    Checkpoint,
    /// The log or the record file has just grown.
    Append,
}

/// A time to wait, and what to wait for then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trigger {
    /// Time from the start of the process.
    pub(super) delay: Duration,
    /// The moment after that.
    pub(super) moment: Moment,
    /// A little later, so that every part of a write is met.
    pub(super) pause: Duration,
}

impl Trigger {
    /// A random one for a process that takes `span` when it is left alone.
    pub(super) fn draw(rng: &mut StreamRng, span: Duration) -> Self {
        let moment = [Moment::Any, Moment::Checkpoint, Moment::Append][rng.random_range(0..3_usize)];
        let delay = span.mul_f64(rng.random_range(0.0..0.7));
        let pause = Duration::from_micros(if moment == Moment::Any { 0 } else { rng.random_range(0..3000) });
        Self { delay, moment, pause }
    }
}
