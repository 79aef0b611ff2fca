//! From any `LaserScan` to the ranges of the policy's beams, seen from the robot's centre.
//!
//! # Formula
//!
//! Each beam of the scan is a cone, half the angle to the next beam wide on either side. A return
//! in it blocks every beam of the policy whose direction lies in the cone, and the policy's beam
//! nearest to it in any case; a beam of the policy reads the nearest return that blocks it. So no
//! return is hidden, whichever scan has more beams. Without a return:
//!
//! | the scan says | the policy reads |
//! |---|---|
//! | `+inf`, or a finite reading above `range_max` | nothing there: the policy's range |
//! | a return beyond the policy's range | the policy's range |
//! | `-inf` (too near to be measured) | a return at the scanner itself |
//! | a finite reading below `range_min` | by `scan.below_min`: a return, no measurement, or nothing |
//! | NaN (no measurement), or in the shadow of something for a scanner off the centre | the nearer of the two neighbours that are known |
//! | outside the scanner's field of view | by `scan.unseen`: the scan is refused, or the policy's range |
//!
//! # References
//!
//! REP 117, "Informational Distance Measurements" (<https://ros.org/reps/rep-0117.html>), and the
//! definition of `sensor_msgs/msg/LaserScan`.

use std::f64::consts::{PI, TAU};

use jostle_sim::LaserConfig;

use crate::messages::LaserScan;
use crate::params::{BelowMin, ScanParams, Unseen};

/// Most beams of a scan.
const BEAMS_MAX: usize = 65_536;
/// Distance beyond a cone's edge at which a beam still lies in it, as a share of the angle between
/// the policy's beams: angles of scans are in single precision.
const EDGE: f64 = 1e-3;

/// Makes the policy's ranges out of scans.
#[derive(Clone, Debug)]
pub struct Resampler {
    params: ScanParams,
    beams: usize,
    /// Angle of the policy's beam 0, and between two of them, rad.
    start: f64,
    step: f64,
    full_circle: bool,
    limit: f64,
    /// Directions that the scanner sees.
    in_view: Vec<bool>,
    /// Directions of which the scan says something.
    known: Vec<bool>,
}

/// A return in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Direction, rad, within (−π, π].
    pub angle: f64,
    /// Half of the angle that it takes up, rad.
    pub half_width: f64,
    /// Distance from the robot's centre, m.
    pub range: f64,
}

/// The directions, in steps of the policy's beams, of a cone in the robot's frame.
#[derive(Clone, Copy)]
struct Cone {
    low: f64,
    middle: f64,
    high: f64,
}

enum Reading {
    Return(f64),
    Nothing,
    Invalid,
}

impl Resampler {
    /// A resampler to the beams of a policy's laser, whose settings must be valid.
    pub fn new(laser: &LaserConfig, params: &ScanParams) -> Self {
        let (start, beams) = (laser.beam_angle(0), laser.beams);
        let step = if beams > 1 { laser.beam_angle(1) - start } else { TAU };
        Self {
            params: params.clone(),
            beams,
            start,
            step,
            full_circle: laser.is_full_circle(),
            limit: f64::from(laser.range),
            in_view: vec![false; beams],
            known: vec![false; beams],
        }
    }

    /// Writes the policy's ranges, m, at most its laser's range, and all returns in the robot's
    /// frame.
    ///
    /// # Errors
    ///
    /// The fault of the scan, in words: sizes or angles that are none, too many invalid readings,
    /// directions that the policy looks into and the scanner does not.
    pub fn resample(
        &mut self,
        scan: &LaserScan,
        ranges: &mut Vec<f32>,
        returns: &mut Vec<Return>,
    ) -> Result<(), String> {
        check(scan)?;
        returns.clear();
        ranges.clear();
        ranges.resize(self.beams, f32::INFINITY);
        self.in_view.fill(false);
        self.known.fill(false);
        let mut invalid = 0;
        for (beam, reading) in scan.ranges.iter().enumerate() {
            let angle = f64::from(scan.angle_min) + beam as f64 * f64::from(scan.angle_increment);
            let half = f64::from(scan.angle_increment.abs()) / 2.0;
            let (far, _) = self.cone(angle, half, self.limit);
            self.mark(far, |this, beam| this.in_view[beam] = true);
            match self.read(*reading, scan) {
                Reading::Return(range) => {
                    let (cone, seen) = self.cone(angle, half, range);
                    returns.push(seen);
                    let near = seen.range.min(self.limit) as f32;
                    self.mark(cone, |this, beam| {
                        this.known[beam] = true;
                        ranges[beam] = ranges[beam].min(near);
                    });
                }
                Reading::Nothing => self.mark(far, |this, beam| this.known[beam] = true),
                Reading::Invalid => invalid += 1,
            }
        }
        let share = f64::from(invalid) / scan.ranges.len() as f64;
        if share > self.params.invalid_max {
            let most = self.params.invalid_max;
            return Err(format!("found a share of {share:.2} invalid readings, expected at most {most}"));
        }
        self.fill(ranges)
    }

    /// The meaning of one reading.
    fn read(&self, reading: f32, scan: &LaserScan) -> Reading {
        if reading.is_nan() {
            Reading::Invalid
        } else if reading == f32::NEG_INFINITY {
            Reading::Return(0.0)
        } else if reading > scan.range_max {
            Reading::Nothing
        } else if reading < scan.range_min {
            match self.params.below_min {
                BelowMin::Near => Reading::Return(f64::from(reading.max(0.0))),
                BelowMin::Invalid => Reading::Invalid,
                BelowMin::Nothing => Reading::Nothing,
            }
        } else {
            Reading::Return(f64::from(reading))
        }
    }

    /// The place of something at a distance in a beam of the scanner, seen from the robot's centre.
    fn cone(&self, angle: f64, half: f64, range: f64) -> (Cone, Return) {
        let angle = if self.params.inverted { -angle } else { angle } + self.params.yaw;
        let (x, y) = (self.params.x, self.params.y);
        let (middle, below, above, range) = if x == 0.0 && y == 0.0 {
            (angle, half, half, range)
        } else {
            let point = |angle: f64| (x + range * angle.cos(), y + range * angle.sin());
            let (at, low, high) = (point(angle), point(angle - half), point(angle + half));
            let middle = at.1.atan2(at.0);
            let off = |(x, y): (f64, f64)| wrapped(y.atan2(x) - middle);
            let (a, b) = (off(low), off(high));
            let nearest = [at, low, high].iter().map(|(x, y)| x.hypot(*y)).fold(f64::INFINITY, f64::min);
            (middle, -a.min(b).min(0.0), a.max(b).max(0.0), nearest)
        };
        let steps = |angle: f64| angle / self.step;
        let middle_in_steps = steps(middle - self.start);
        let cone = Cone {
            low: middle_in_steps - steps(below),
            middle: middle_in_steps,
            high: middle_in_steps + steps(above),
        };
        (cone, Return { angle: wrapped(middle), half_width: below.max(above), range })
    }

    /// Calls `with` for each of the policy's beams in a cone, and for the one nearest to its
    /// middle.
    fn mark(&mut self, cone: Cone, mut with: impl FnMut(&mut Self, usize)) {
        let first = ((cone.low - EDGE).ceil() as i64).min(cone.middle.round() as i64);
        let last = ((cone.high + EDGE).floor() as i64).max(cone.middle.round() as i64);
        let (n, turn) = (self.beams as i64, TAU / self.step);
        if self.full_circle {
            for beam in first..=last.min(first + n - 1) {
                with(self, beam.rem_euclid(n) as usize);
            }
            return;
        }
        // A sector: the same direction may be written one turn off.
        for turns in -2..=2 {
            let shift = (f64::from(turns) * turn).round() as i64;
            for beam in (first + shift).max(0)..=(last + shift).min(n - 1) {
                with(self, beam as usize);
            }
        }
    }

    /// Gives a range to the beams that no return blocks.
    fn fill(&self, ranges: &mut [f32]) -> Result<(), String> {
        let limit = self.limit as f32;
        for (range, known) in ranges.iter_mut().zip(&self.known) {
            if *known && range.is_infinite() {
                *range = limit;
            }
        }
        let unseen = self.in_view.iter().zip(&self.known).filter(|(seen, known)| !**seen && !**known).count();
        if unseen > 0 && self.params.unseen == Unseen::Stop {
            return Err(format!(
                "{unseen} of the policy's {} beams point where the scanner does not look, expected none \
                 (parameter scan.unseen = \"free\" takes those directions for free)",
                self.beams
            ));
        }
        if !self.known.contains(&true) {
            return Err("no beam of the policy has a reading".to_owned());
        }
        for beam in 0..self.beams {
            if !self.known[beam] {
                let beside =
                    || self.neighbour(ranges, beam, 1).min(self.neighbour(ranges, beam, self.beams - 1));
                ranges[beam] = if self.in_view[beam] { beside() } else { limit };
            }
        }
        Ok(())
    }

    /// The range of the next beam that is known, `stride` beams further each time.
    fn neighbour(&self, ranges: &[f32], beam: usize, stride: usize) -> f32 {
        let others = (1..self.beams).map(|k| (beam + k * stride) % self.beams);
        others.into_iter().find(|at| self.known[*at]).map_or(self.limit as f32, |at| ranges[at])
    }
}

/// Refuses what is no scan.
fn check(scan: &LaserScan) -> Result<(), String> {
    let n = scan.ranges.len();
    if n == 0 || n > BEAMS_MAX {
        return Err(format!("found {n} ranges, expected 1 to {BEAMS_MAX}"));
    }
    let increment = scan.angle_increment;
    if !scan.angle_min.is_finite() || scan.angle_min.abs() > 100.0 {
        return Err(format!("found angle_min {}, expected radians", scan.angle_min));
    }
    if !increment.is_finite() || (increment == 0.0 && n > 1) {
        return Err(format!("found angle_increment {increment}, expected radians, not 0"));
    }
    let view = f64::from(increment.abs()) * (n - 1) as f64;
    if view > TAU + 2.0 * f64::from(increment.abs()) {
        return Err(format!("found {n} ranges {increment} rad apart, expected at most one turn"));
    }
    if !scan.angle_max.is_finite() {
        return Err(format!("found angle_max {}, expected radians", scan.angle_max));
    }
    let intervals = f64::from(scan.angle_max - scan.angle_min) / f64::from(increment);
    if n > 1 && (intervals + 1.0 - n as f64).abs() > 1.5 {
        return Err(format!("found {n} ranges, expected {:.0} by its angles", intervals + 1.0));
    }
    let (low, high) = (scan.range_min, scan.range_max);
    if !(low >= 0.0 && high > low && low.is_finite()) {
        return Err(format!(
            "found range_min {low} and range_max {high}, expected 0 <= range_min < range_max"
        ));
    }
    Ok(())
}

/// An angle within (−π, π].
pub fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::messages::Header;

    const N: usize = 512;

    /// A scan all round from `angle_min`.
    fn scan(angle_min: f64, ranges: &[f32]) -> LaserScan {
        sector(angle_min, TAU / ranges.len() as f64, ranges)
    }

    fn sector(angle_min: f64, increment: f64, ranges: &[f32]) -> LaserScan {
        LaserScan {
            header: Header::default(),
            angle_min: angle_min as f32,
            angle_max: (angle_min + increment * (ranges.len() - 1) as f64) as f32,
            angle_increment: increment as f32,
            range_min: 0.1,
            range_max: 30.0,
            ranges: ranges.to_vec(),
            ..LaserScan::default()
        }
    }

    fn try_with(params: &ScanParams, scan: &LaserScan) -> Result<(Vec<f32>, Vec<Return>), String> {
        let (mut ranges, mut returns) = (Vec::new(), Vec::new());
        Resampler::new(&LaserConfig::default(), params).resample(scan, &mut ranges, &mut returns)?;
        Ok((ranges, returns))
    }

    fn with(params: &ScanParams, scan: &LaserScan) -> Vec<f32> {
        try_with(params, scan).expect("a scan").0
    }

    fn ranges(scan: &LaserScan) -> Vec<f32> {
        with(&ScanParams::default(), scan)
    }

    fn free() -> ScanParams {
        ScanParams { unseen: Unseen::Free, ..ScanParams::default() }
    }

    #[test]
    fn the_policys_own_scan_keeps_its_bits() {
        let own: Vec<f32> = (0..N).map(|k| 0.5 + k as f32 * 0.0185).collect();
        assert_eq!(ranges(&scan(0.0, &own)), own);
        // From −π on, and clockwise: the same room.
        let behind: Vec<f32> = (0..N).map(|k| own[(k + N / 2) % N]).collect();
        assert_eq!(ranges(&scan(-PI, &behind)), own);
        let clockwise: Vec<f32> = (0..N).map(|k| own[(N - k) % N]).collect();
        assert_eq!(ranges(&sector(0.0, -TAU / N as f64, &clockwise)), own);
        let upside_down = ScanParams { inverted: true, ..ScanParams::default() };
        assert_eq!(with(&upside_down, &scan(0.0, &clockwise)), own);
        let turned = ScanParams { yaw: PI, ..ScanParams::default() };
        assert_eq!(with(&turned, &scan(0.0, &behind)), own);
    }

    #[test]
    fn what_is_no_return_is_read_by_rep_117() {
        let mut readings = vec![5.0; N];
        (readings[10], readings[20], readings[30]) = (f32::INFINITY, 31.0, 12.0);
        (readings[40], readings[50], readings[60]) = (f32::NEG_INFINITY, f32::NAN, 0.05);
        (readings[49], readings[51]) = (2.0, 3.0);
        let read = ranges(&scan(0.0, &readings));
        assert_eq!([read[10], read[20], read[30]], [10.0; 3]);
        assert_eq!([read[40], read[50], read[60]], [0.0, 2.0, 0.05]);
        let below =
            |below_min| with(&ScanParams { below_min, ..ScanParams::default() }, &scan(0.0, &readings))[60];
        assert_eq!(below(BelowMin::Nothing), 10.0);
        assert_eq!(below(BelowMin::Invalid), 5.0);
    }

    #[test]
    fn many_nans_in_a_row_take_the_nearer_neighbour_and_too_many_refuse_the_scan() {
        let mut readings = vec![4.0; N];
        readings[100..200].fill(f32::NAN);
        readings[99] = 1.5;
        let read = ranges(&scan(0.0, &readings));
        assert!(read[100..200].iter().all(|range| *range == 1.5));
        readings.fill(f32::NAN);
        readings[..200].fill(4.0);
        let refusal = try_with(&ScanParams::default(), &scan(0.0, &readings)).expect_err("refused");
        assert_eq!(refusal, "found a share of 0.61 invalid readings, expected at most 0.5");
        let lenient = ScanParams { invalid_max: 1.0, ..ScanParams::default() };
        let refusal = try_with(&lenient, &scan(0.0, &[f32::NAN; N])).expect_err("refused");
        assert_eq!(refusal, "no beam of the policy has a reading");
    }

    #[test]
    fn a_coarse_scan_is_as_wide_as_its_cones() {
        // Eight beams, one of them to the left at 2 m: 64 of 512 beams, and one more on the other
        // edge.
        let mut readings = [f32::INFINITY; 8];
        readings[2] = 2.0;
        let read = ranges(&scan(0.0, &readings));
        let blocked: Vec<usize> = (0..N).filter(|k| read[*k] == 2.0).collect();
        assert_eq!(blocked, (96..=160).collect::<Vec<_>>());
        assert_eq!(read.iter().filter(|range| **range == 10.0).count(), N - 65);
    }

    #[test]
    fn directions_that_the_scanner_does_not_see_stop_or_are_free() {
        // 270° ahead.
        let view = sector(-0.75 * PI, 1.5 * PI / 540.0, &[3.0; 541]);
        let refusal = try_with(&ScanParams::default(), &view).expect_err("refused");
        assert!(refusal.starts_with("127 of the policy's 512 beams point where"), "{refusal}");
        let read = with(&free(), &view);
        assert_eq!(read.iter().filter(|range| **range == 10.0).count(), 127);
        assert_eq!((read[0], read[256]), (3.0, 10.0));
    }

    #[test]
    fn a_policy_that_sees_a_sector_needs_that_sector_alone() {
        let laser =
            LaserConfig { beams: 181, fov: PI as f32, angle_min: -PI as f32 / 2.0, ..LaserConfig::default() };
        let mut own: Vec<f32> = (0..360).map(|k| 1.0 + k as f32 * 0.01).collect();
        let (mut ranges, mut returns) = (Vec::new(), Vec::new());
        let mut resampler = Resampler::new(&laser, &ScanParams::default());
        resampler.resample(&scan(0.0, &own), &mut ranges, &mut returns).expect("a scan");
        let expected: Vec<f32> = (-90_i32..=90).map(|k| own[k.rem_euclid(360) as usize]).collect();
        assert_eq!(ranges, expected);
        // Written from −2π on, it is the same.
        resampler.resample(&scan(-TAU, &own), &mut ranges, &mut returns).expect("a scan");
        assert_eq!(ranges, expected);
        own.truncate(60);
        assert!(resampler.resample(&sector(0.0, TAU / 360.0, &own), &mut ranges, &mut returns).is_err());
    }

    #[test]
    fn a_scanner_off_the_centre_is_seen_from_the_centre() {
        let params = ScanParams { x: 0.3, ..ScanParams::default() };
        // A wall 2 m ahead of the robot's centre, seen from 0.3 m ahead of it.
        let readings: Vec<f32> = (0..N)
            .map(|k| {
                let cos = (TAU * k as f64 / N as f64).cos();
                if cos > 0.02 { (1.7 / cos) as f32 } else { f32::INFINITY }
            })
            .collect();
        let read = with(&params, &scan(0.0, &readings));
        for k in 0..60 {
            let expected = 2.0 / (TAU * f64::from(k) / N as f64).cos();
            let found = f64::from(read[k as usize]);
            // The nearest beam points at most half a beam beside, and a cone is one beam wide.
            assert!(found <= expected * 1.01 && found > expected * 0.97, "{k}: {found}, {expected}");
        }
        // What is too near to be measured is at the scanner.
        let mut readings = [f32::INFINITY; N];
        readings[N / 2] = f32::NEG_INFINITY;
        assert!((with(&params, &scan(0.0, &readings))[0] - 0.3).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_scan_is_refused() {
        let good = scan(0.0, &[1.0; 8]);
        let refused = |scan: &LaserScan| try_with(&free(), scan).expect_err("refused");
        assert_eq!(
            refused(&LaserScan { ranges: vec![], ..good.clone() }),
            "found 0 ranges, expected 1 to 65536"
        );
        let seven = refused(&LaserScan { ranges: vec![1.0; 5], ..good.clone() });
        assert_eq!(seven, "found 5 ranges, expected 8 by its angles");
        for broken in [
            LaserScan { angle_min: f32::NAN, ..good.clone() },
            LaserScan { angle_max: f32::INFINITY, ..good.clone() },
            LaserScan { angle_increment: 0.0, ..good.clone() },
            LaserScan { angle_increment: f32::NAN, ..good.clone() },
            LaserScan { angle_increment: 3.0, ..good.clone() },
            LaserScan { range_min: f32::NAN, ..good.clone() },
            LaserScan { range_max: 0.05, ..good.clone() },
            LaserScan { range_max: f32::NAN, ..good },
        ] {
            refused(&broken);
        }
    }

    #[test]
    fn angles_wrap() {
        assert_eq!((wrapped(PI), wrapped(-PI), wrapped(0.5 - TAU)), (PI, PI, 0.5));
    }

    fn any_reading() -> impl Strategy<Value = f32> {
        prop_oneof![6 => 0.0_f32..12.0, 1 => Just(f32::INFINITY), 1 => Just(f32::NEG_INFINITY), 1 => Just(f32::NAN)]
    }

    proptest! {
        /// Whatever the scanner, a return is at least as near in the policy's beam that points to
        /// it.
        #[test]
        fn no_return_is_hidden(
            readings in prop::collection::vec(any_reading(), 3..1500),
            fov in 0.1_f64..TAU,
            angle_min in -TAU..TAU,
            clockwise in any::<bool>(),
            inverted in any::<bool>(),
            (x, y, yaw) in (-0.5_f64..0.5, -0.5_f64..0.5, -PI..PI),
            centred in any::<bool>(),
        ) {
            let sign = if clockwise { -1.0 } else { 1.0 };
            let scan = sector(angle_min, sign * fov / (readings.len() - 1) as f64, &readings);
            let (x, y) = if centred { (0.0, 0.0) } else { (x, y) };
            let params = ScanParams { x, y, yaw, inverted, invalid_max: 1.0, ..free() };
            let Ok((ranges, returns)) = try_with(&params, &scan) else {
                // Only without a single reading.
                prop_assert!(readings.iter().all(|reading| reading.is_nan()));
                return Ok(());
            };
            let n_returns = readings.iter().filter(|r| !r.is_nan() && **r != f32::INFINITY).count();
            prop_assert_eq!(returns.len(), n_returns);
            for (beam, reading) in readings.iter().enumerate() {
                if reading.is_nan() || *reading == f32::INFINITY {
                    continue;
                }
                let angle = f64::from(scan.angle_min) + beam as f64 * f64::from(scan.angle_increment);
                let angle = if inverted { -angle } else { angle } + yaw;
                let range = f64::from(reading.max(0.0));
                let (px, py) = (x + range * angle.cos(), y + range * angle.sin());
                // What is at the centre itself has the direction of its beam.
                let direction = if px.hypot(py) < 1e-9 { angle } else { py.atan2(px) };
                let towards = (direction.rem_euclid(TAU) / TAU * N as f64).round() as usize % N;
                prop_assert!(
                    f64::from(ranges[towards]) <= px.hypot(py).min(10.0) + 1e-5,
                    "beam {beam} reads {reading}, the policy's beam {towards} {}", ranges[towards]
                );
            }
            prop_assert!(ranges.iter().all(|range| (0.0..=10.0).contains(range)));
        }

        /// With as many beams or more all round, nothing is nearer than it is: no return is moved
        /// by more than half a beam.
        #[test]
        fn nothing_is_nearer_than_the_nearest_return_beside_it(
            readings in prop::collection::vec(0.2_f32..9.0, N..1500),
        ) {
            let read = ranges(&scan(0.0, &readings));
            let n = readings.len();
            for (k, range) in read.iter().enumerate() {
                let at = k as f64 * n as f64 / N as f64;
                let reach = n as f64 / N as f64 / 2.0 + 1.0;
                let beside = (0..n).filter(|b| {
                    let off = (*b as f64 - at).abs();
                    off.min(n as f64 - off) <= reach
                });
                let nearest = beside.map(|b| readings[b]).fold(f32::INFINITY, f32::min);
                prop_assert!(*range >= nearest);
            }
        }
    }
}
