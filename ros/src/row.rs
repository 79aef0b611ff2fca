//! The observation row that the policy was trained with: three scans one period apart, the goal in
//! the robot's frame, the velocity.
//!
//! Scanners have rates of their own. Of the scans that have come, the row takes the newest, and
//! those measured nearest to one and two periods before it (the older of two that are equally
//! near). At the start the first scan fills all three, as in the simulator.

use std::collections::VecDeque;

use jostle_sim::{EXTRAS, FRAMES};

/// Scans of less than this share of a period after the one before the last take the last one's
/// place.
const SPACING: f64 = 0.125;

/// The scans that a row may need, oldest first.
#[derive(Clone, Debug)]
pub struct History {
    scans: VecDeque<(f64, Vec<f32>)>,
    period: f64,
    limit: f32,
}

impl History {
    /// An empty history for rows whose scans are `period` seconds apart, of a laser with the range
    /// `limit`, m.
    pub fn new(period: f64, limit: f32) -> Self {
        Self { scans: VecDeque::new(), period, limit }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.scans.clear();
    }

    /// Adds a scan, m, that was measured at `time`, s, later than those before.
    pub fn push(&mut self, time: f64, ranges: &[f32]) {
        // In single precision and in this order, as the simulator does it: the same range gives the
        // same bits.
        let scaled = ranges.iter().map(|range| range / self.limit - 0.5).collect();
        let n = self.scans.len();
        if n >= FRAMES && time - self.scans[n - 2].0 < SPACING * self.period {
            self.scans.pop_back();
        }
        self.scans.push_back((time, scaled));
        // The last but one that is older than any frame can be wanted is kept: it may be the
        // nearest.
        let oldest = time - (FRAMES - 1) as f64 * self.period;
        while self.scans.len() > FRAMES && self.scans[1].0 <= oldest {
            self.scans.pop_front();
        }
    }

    /// Writes the row.
    ///
    /// # Shapes
    ///
    /// `row` becomes `[scan oldest … newest (3·beams) | goal x, goal y | v, ω]`, as
    /// `jostle_sim::Observer` writes it.
    ///
    /// # Panics
    ///
    /// Without a scan.
    pub fn write(&self, goal_in_robot: [f64; 2], velocity: [f64; 2], row: &mut Vec<f32>) {
        let newest = self.scans.back().expect("a scan has come").0;
        row.clear();
        row.reserve(FRAMES * self.scans[0].1.len() + EXTRAS);
        for age in (0..FRAMES).rev() {
            let wanted = newest - age as f64 * self.period;
            let off = |time: f64| (time - wanted).abs();
            // From the oldest on, so that of two the older is kept.
            let nearest = self.scans.iter().reduce(|a, b| if off(b.0) + 1e-9 < off(a.0) { b } else { a });
            row.extend_from_slice(&nearest.expect("a scan has come").1);
        }
        let [x, y] = goal_in_robot;
        let [v, w] = velocity;
        row.extend([x, y, v, w].map(|number| number as f32));
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use jostle_sim::{Observer, Pose, SimConfig, Streams};

    use super::*;

    /// The first beam of each of the row's scans, in metres.
    fn frames(history: &History) -> Vec<f32> {
        let mut row = Vec::new();
        history.write([0.0; 2], [0.0; 2], &mut row);
        (0..FRAMES).map(|k| ((row[k] + 0.5) * 10.0).round()).collect()
    }

    #[test]
    fn the_row_is_the_simulators_bit_for_bit() {
        let mut config = SimConfig::default();
        config.laser.noise_std = 0.0;
        let mut observer = Observer::new(&config, Streams::new(0).stream("noise", &[]));
        let mut expected = vec![0.0; config.observation_len()];
        let scan = |step: u32| -> Vec<f32> {
            (0..512).map(|k| 0.3 + (k as f32 * 0.37 + step as f32).sin().abs() * 9.7).collect()
        };
        let mut history = History::new(0.1, 10.0);
        let mut row = Vec::new();
        for step in 0..6_u32 {
            if step == 0 {
                observer.begin(&scan(0), &mut expected);
            } else {
                observer.push(&scan(step), &mut expected);
            }
            let pose = Pose::new(Vec2::new(1.0, -2.0), 0.75);
            observer.write_motion(pose, Vec2::new(4.0, 3.0), [0.5, -0.25], &mut expected);
            history.push(f64::from(step) * 0.1, &scan(step));
            let goal = crate::frames::in_robot([4.0, 3.0], [1.0, -2.0, f64::from(0.75_f32)]);
            history.write(goal, [0.5, -0.25], &mut row);
            assert_eq!(row[..1536], expected[..1536], "step {step}");
            let tail = row[1536..].iter().zip(&expected[1536..]);
            assert!(tail.into_iter().all(|(a, b)| (a - b).abs() < 1e-5), "step {step}");
        }
    }

    #[test]
    fn scans_are_a_period_apart_whatever_the_scanners_rate() {
        for (rate, expected) in
            [(40.0, [12.0, 16.0, 20.0]), (10.0, [18.0, 19.0, 20.0]), (12.5, [17.0, 19.0, 20.0])]
        {
            let mut history = History::new(0.1, 100.0);
            for k in 0..=20_u32 {
                history.push(f64::from(k) / rate, &[k as f32 * 10.0]);
            }
            assert_eq!(frames(&history), expected, "{rate} Hz");
        }
        // One scan was lost: the one before it is nearer to the wish than any other, and of two the
        // older is taken.
        let mut history = History::new(0.1, 100.0);
        for k in [0_u32, 1, 2, 4] {
            history.push(f64::from(k) * 0.1, &[k as f32 * 10.0]);
        }
        assert_eq!(frames(&history), [2.0, 2.0, 4.0]);
    }

    #[test]
    fn the_first_scan_fills_all_three() {
        let mut history = History::new(0.1, 100.0);
        history.push(5.0, &[70.0]);
        assert_eq!(frames(&history), [7.0; 3]);
        history.push(5.1, &[80.0]);
        assert_eq!(frames(&history), [7.0, 7.0, 8.0]);
    }

    #[test]
    fn a_fast_scanner_does_not_fill_the_memory() {
        let mut history = History::new(0.1, 100.0);
        for k in 0..10_000_u32 {
            history.push(f64::from(k) * 0.001, &[k as f32 % 1000.0]);
        }
        assert!(history.scans.len() < 60, "{}", history.scans.len());
        let mut row = Vec::new();
        history.write([0.0; 2], [0.0; 2], &mut row);
        let times: Vec<f32> = row[..3].iter().map(|value| (value + 0.5) * 100.0).collect();
        assert!(
            (times[2] - times[1] - 100.0).abs() < 13.0 && (times[1] - times[0] - 100.0).abs() < 13.0,
            "{times:?}"
        );
    }
}
