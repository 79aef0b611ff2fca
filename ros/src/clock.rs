//! When a command is due: once in each period of the policy, by a steady clock, and if possible
//! right after a scan.
//!
//! Beats are one period apart. A scan that has come since the last command is answered at the beat;
//! a beat without one waits for it until the window's end. Where scans come at the policy's own
//! rate, commands follow them: one that arrives within the window before or after the beat is
//! answered at once and beats count from there on; one that came earlier is answered at the
//! window's start, so that after some beats it comes within the window. Missed beats are not made
//! up for.

/// The beat of commands. Times are seconds of one steady clock.
#[derive(Clone, Debug)]
pub struct Clock {
    period: f64,
    window: f64,
    next: Option<f64>,
    /// When the newest scan arrived that no command has answered yet.
    scan: Option<f64>,
    /// When the newest scan arrived, and the time since the one before it.
    last_scan: f64,
    interval: f64,
}

impl Clock {
    /// A clock of this period, s; `window` is a share of it.
    pub fn new(period: f64, window: f64) -> Self {
        Self {
            period,
            window: window * period,
            next: None,
            scan: None,
            last_scan: f64::NEG_INFINITY,
            interval: 0.0,
        }
    }

    /// The period, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// A scan has arrived.
    pub fn scan(&mut self, now: f64) {
        self.scan = Some(now);
        (self.interval, self.last_scan) = (now - self.last_scan, now);
    }

    /// When a command is due if no scan arrives before; the first one is due at once.
    pub fn deadline(&self) -> f64 {
        let Some(next) = self.next else { return f64::NEG_INFINITY };
        match self.scan {
            Some(arrived) if self.follows() => arrived.max(next - self.window),
            Some(arrived) => arrived.max(next),
            None => next + self.window,
        }
    }

    /// True if scans come at the policy's own rate.
    fn follows(&self) -> bool {
        (self.interval - self.period).abs() < self.window
    }

    /// True if a command is due. If so, the next one is awaited from then on.
    pub fn tick(&mut self, now: f64) -> bool {
        if now < self.deadline() {
            return false;
        }
        let followed = self.scan.take().is_some() && self.follows();
        self.next = Some(match self.next {
            Some(next) if !followed && now - next < self.period => next + self.period,
            _ => now + self.period,
        });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks within ten seconds, when scans arrive at these times; the loop wakes up at scans and
    /// deadlines.
    fn ticks(clock: &mut Clock, scans: &[f64]) -> Vec<f64> {
        let (mut now, mut scans, mut found) = (0.0, scans.iter().copied().peekable(), Vec::new());
        while now < 10.0 {
            if scans.next_if(|at| *at <= now).is_some() {
                clock.scan(now);
            }
            if clock.tick(now) {
                found.push(now);
            }
            let next_scan = scans.peek().copied().unwrap_or(f64::INFINITY);
            now = clock.deadline().min(next_scan).max(now);
        }
        found
    }

    fn every(period: f64, from: f64) -> Vec<f64> {
        (0..2000).map(|k| from + f64::from(k) * period).take_while(|at| *at < 10.0).collect()
    }

    #[track_caller]
    fn check_steps(found: &[f64], low: f64, high: f64) {
        for pair in found.windows(2) {
            let step = pair[1] - pair[0];
            assert!((low - 1e-9..=high + 1e-9).contains(&step), "{step} at {}", pair[0]);
        }
    }

    #[test]
    fn a_scanner_of_the_policys_rate_is_followed_at_once() {
        let scans = every(0.1, 0.037);
        let found = ticks(&mut Clock::new(0.1, 0.1), &scans);
        check_steps(&found, 0.09, 0.11);
        // After the first beats each command follows a scan.
        for at in &found[found.len() / 2..] {
            assert!(scans.iter().any(|scan| (scan - at).abs() < 1e-9), "{at}");
        }
    }

    #[test]
    fn the_mean_period_holds_for_scanners_of_any_rate() {
        for rate in [5.0, 7.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 100.0] {
            let found = ticks(&mut Clock::new(0.1, 0.1), &every(1.0 / rate, 0.0));
            check_steps(&found, 0.08, 0.12);
            assert!((98..=103).contains(&found.len()), "{rate} Hz: {} commands", found.len());
        }
    }

    #[test]
    fn without_a_window_or_without_scans_the_beat_is_steady() {
        let found = ticks(&mut Clock::new(0.1, 0.0), &every(1.0 / 30.0, 0.013));
        check_steps(&found[1..], 0.1, 0.1);
        let found = ticks(&mut Clock::new(0.1, 0.1), &[]);
        check_steps(&found[1..], 0.1, 0.1);
        assert!((99..=101).contains(&found.len()), "{}", found.len());
    }

    #[test]
    fn missed_beats_are_not_made_up_for() {
        let mut clock = Clock::new(0.1, 0.0);
        assert!(clock.tick(0.0));
        assert!(!clock.tick(0.05));
        // The machine slept.
        assert!(clock.tick(3.0));
        assert!(!clock.tick(3.0) && !clock.tick(3.09));
        assert!(clock.tick(3.1));
    }
}
