//! Progress of a long job: a bar with rate and remaining time on a terminal, a plain line every few
//! seconds otherwise. Everything here goes to standard error; nothing here touches a result.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::output::note;

/// Time between two plain lines where standard error is no terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// One job of known length.
pub struct Progress {
    name: String,
    total: u64,
    /// Work that was done before this process started; it is left out of the rate.
    already: u64,
    position: u64,
    started: Instant,
    last_line: Instant,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Starts at `already` of `total` units of the job called `name`.
    pub fn new(name: &str, total: u64, already: u64) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| terminal_bar(name, total, already));
        let now = Instant::now();
        Self { name: name.to_owned(), total, already, position: already, started: now, last_line: now, bar }
    }

    /// The job stands at `position`; `detail` says what a reader wants to see beside it.
    pub fn set(&mut self, position: u64, detail: &str) {
        self.position = position;
        if let Some(bar) = &self.bar {
            bar.set_position(position);
            bar.set_message(detail.to_owned());
        } else if self.last_line.elapsed() >= PLAIN_INTERVAL {
            self.last_line = Instant::now();
            note(&self.plain_line(detail));
        }
    }

    /// Takes the bar away and leaves one closing line.
    pub fn finish(self, detail: &str) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        let seconds = self.started.elapsed().as_secs_f64();
        note(
            format!("{}: {}/{} in {} {detail}", self.name, self.position, self.total, clock(seconds))
                .trim_end(),
        );
    }

    fn plain_line(&self, detail: &str) -> String {
        let seconds = self.started.elapsed().as_secs_f64();
        let rate = (self.position - self.already) as f64 / seconds.max(1e-9);
        let left = (self.total.saturating_sub(self.position)) as f64 / rate;
        let left = if left.is_finite() { clock(left) } else { "?".to_owned() };
        format!("{}: {}/{} ({rate:.2}/s, {left} left) {detail}", self.name, self.position, self.total)
    }
}

fn terminal_bar(name: &str, total: u64, already: u64) -> ProgressBar {
    let bar = ProgressBar::new(total).with_position(already).with_prefix(name.to_owned());
    let template = "{prefix} {wide_bar} {pos}/{len} {per_sec} {eta} left {msg}";
    // The template is a constant; should indicatif ever refuse it, its default style serves.
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.reset_eta();
    bar
}

/// Seconds as `45 s`, `3 min 20 s` or `2 h 05 min`.
pub fn clock(seconds: f64) -> String {
    let whole = seconds.round().max(0.0) as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::clock;

    #[test]
    fn the_clock_names_its_units() {
        assert_eq!(clock(45.4), "45 s");
        assert_eq!(clock(200.0), "3 min 20 s");
        assert_eq!(clock(7500.0), "2 h 05 min");
    }
}
