//! The machine that a run is made on, its rate and its remaining time.

use super::log::RunLog;
use crate::progress::clock;
use crate::run_folder::last_holder;

/// Machine and speed of a run.
pub struct Pace {
    host: Option<String>,
    /// Transitions per second over the last updates; `None` before the first.
    per_second: Option<f64>,
    /// Seconds until the last update at that speed.
    seconds_left: Option<f64>,
}

impl Pace {
    /// Of a run that is to have `updates` updates, by its last `window` ones.
    pub fn new(log: &RunLog, updates: u64, window: usize) -> Self {
        let made = log.reports.len();
        let seconds = log.mean(made, window, |report| Some(report.clock.total)).filter(|&mean| mean > 0.0);
        let missing = updates.saturating_sub(made as u64) as f64;
        Self {
            host: last_holder(&log.folder).map(|(host, _)| host),
            per_second: seconds.map(|seconds| log.config.rollout_len() as f64 / seconds),
            seconds_left: seconds.map(|seconds| missing * seconds),
        }
    }

    /// The machine, where the run is being made.
    pub fn host_if(&self, running: bool) -> String {
        self.host.clone().filter(|_| running).unwrap_or_else(dash)
    }

    /// Transitions per second.
    pub fn rate(&self) -> String {
        self.per_second.map_or_else(dash, |rate| format!("{rate:.0}"))
    }

    /// The time left, where the run is being made.
    pub fn left_if(&self, running: bool) -> String {
        self.seconds_left.filter(|_| running).map_or_else(dash, clock)
    }
}

fn dash() -> String {
    "–".to_owned()
}
