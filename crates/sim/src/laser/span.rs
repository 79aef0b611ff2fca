//! The beams that a shape can cover, as runs of whole chunks.
//!
//! A shape's first and last direction are approximate, so each run is widened: a beam that is left
//! out meets nothing.

use super::LANES;
use crate::config::LaserConfig;

/// By how much a sector's runs are widened on either side, in turns: more than a direction of
/// [`approximate_turn`](crate::trig::approximate_turn) and the rounding of what is made of it are
/// off.
const MARGIN: f32 = 1e-5;

/// A run of chunks, counter-clockwise, that may go over the end of the circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Span {
    pub(crate) first: u32,
    pub(crate) last: u32,
}

impl Span {
    /// The chunks of the beams between two directions given in turns, counter-clockwise, with a
    /// margin of a beam. Beam 0 is straight ahead and the beams go all round.
    fn between(from: f32, to: f32, beams: usize) -> Self {
        let (n, beams) = (beams.div_ceil(LANES), beams as f32);
        // Turns are not negative, so that a cast rounds down; 2 is rounding up and the margin.
        let (first, last) = ((from * beams) as i32 - 1, (to * beams) as i32 + 2);
        let wrap = |beam: i32| beam.rem_euclid(beams as i32) as u32 / LANES as u32;
        // A full circle that starts and ends within one chunk must not shrink to that chunk.
        let length = if to >= from { to - from } else { to - from + 1.0 };
        if (length * beams) as usize + 2 * LANES + 4 >= beams as usize {
            return Self { first: 0, last: n as u32 - 1 };
        }
        Self { first: wrap(first), last: wrap(last) }
    }

    /// All chunks of a scan.
    fn all(beams: usize) -> Self {
        Self { first: 0, last: beams.div_ceil(LANES) as u32 - 1 }
    }

    /// The chunks of a run of beams, `first` ≤ `last`.
    fn of_beams(first: usize, last: usize) -> Self {
        Self { first: (first / LANES) as u32, last: (last / LANES) as u32 }
    }

    /// True if the run contains a chunk.
    pub(crate) fn holds(self, chunk: usize) -> bool {
        let (first, last, chunk) = (self.first, self.last, chunk as u32);
        if first <= last { first <= chunk && chunk <= last } else { first <= chunk || chunk <= last }
    }
}

/// The directions of the beams, as far as culling needs them.
#[derive(Clone, Copy)]
pub(crate) struct View {
    beams: usize,
    sector: Option<Sector>,
}

/// Beams that do not go all round from straight ahead.
#[derive(Clone, Copy)]
struct Sector {
    /// Direction of beam 0, in turns.
    start: f32,
    /// From a beam to the next, in turns.
    increment: f32,
}

impl View {
    /// The view of a laser.
    pub(crate) fn new(laser: &LaserConfig) -> Self {
        let is_default = laser.is_full_circle() && laser.angle_min == 0.0;
        let turns = |angle: f64| (angle / std::f64::consts::TAU) as f32;
        let sector = (!is_default).then(|| Sector {
            start: turns(laser.beam_angle(0)),
            increment: turns(laser.beam_angle(1) - laser.beam_angle(0)),
        });
        Self { beams: laser.beams, sector }
    }

    /// The chunks of the beams between two directions given in turns, counter-clockwise; none where
    /// no beam points.
    pub(crate) fn span(&self, from: f32, to: f32) -> Option<Span> {
        if self.beams < 8 * LANES {
            return Some(Span::all(self.beams));
        }
        match self.sector {
            None => Some(Span::between(from, to, self.beams)),
            Some(sector) => sector.span(from, to, self.beams),
        }
    }
}

impl Sector {
    fn span(self, from: f32, to: f32, beams: usize) -> Option<Span> {
        let length = if to >= from { to - from } else { to - from + 1.0 };
        if length >= 1.0 - 4.0 * MARGIN {
            return Some(Span::all(beams));
        }
        // Turns from beam 0 on, counter-clockwise.
        let from = (from - self.start - MARGIN).rem_euclid(1.0);
        let to = (to - self.start + MARGIN).rem_euclid(1.0);
        let (first, last) = ((from / self.increment) as usize, (to / self.increment).ceil() as usize);
        let last = last.min(beams - 1);
        if from <= to {
            return (first < beams).then(|| Span::of_beams(first, last));
        }
        // From the end of the sector over the gap, if there is one, to its start.
        if first >= beams {
            return Some(Span::of_beams(0, last));
        }
        let (first, last) = ((first / LANES) as u32, (last / LANES) as u32);
        Some(if first <= last { Span::all(beams) } else { Span { first, last } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_wrap_and_widen() {
        let span = Span::between(0.99, 0.01, 512);
        assert!(span.holds(63) && span.holds(0) && !span.holds(30));
        let span = Span::between(0.25, 0.26, 512);
        assert!(span.holds(15) && span.holds(16) && !span.holds(14) && !span.holds(18));
        let span = Span::between(0.001, 0.999, 512);
        assert!((0..64).all(|chunk| span.holds(chunk)));
    }

    /// Every beam between two directions is in their span, and beams far from them are not.
    #[test]
    fn a_span_of_any_view_holds_the_beams_between_its_directions() {
        let turn = |angle: f64| (angle / std::f64::consts::TAU).rem_euclid(1.0);
        for (beams, fov, angle_min) in [
            (64, 3.0, -1.5),
            (541, 4.712_389, -2.356_194_5),
            (512, 6.27, 0.0),
            (512, std::f32::consts::TAU, -3.0),
            (100, 0.3, 6.2),
            (8192, 1e-3, -6.0),
            (72, std::f32::consts::TAU, 0.0),
        ] {
            let laser = LaserConfig { beams, fov, angle_min, ..LaserConfig::default() };
            assert_eq!(laser.validate(), Ok(()));
            let view = View::new(&laser);
            let (mut n_none, mut n_part) = (0, 0);
            for i in 0..2000_u32 {
                let from = f64::from(i.wrapping_mul(2_654_435_761)) / f64::from(u32::MAX);
                let length = [0.0, 1e-6, 0.01, 0.2, 0.6, 0.99][i as usize % 6];
                let to = (from + length).rem_euclid(1.0);
                let span = view.span(from as f32, to as f32);
                for beam in 0..beams {
                    let along = (turn(laser.beam_angle(beam)) - from).rem_euclid(1.0);
                    let held = span.is_some_and(|span| span.holds(beam / LANES));
                    assert!(held || along > length, "{laser:?}: beam {beam} for {from} to {to}: {span:?}");
                }
                n_none += u32::from(span.is_none());
                n_part += u32::from(span.is_some_and(|span| span != Span::all(beams)));
            }
            let sector = !laser.is_full_circle();
            // A circle has no directions without beams, and 1e-3 rad are within a chunk of any
            // direction's margin.
            assert!(!sector || beams == 8192 || n_part > 100, "{laser:?}: {n_part} parts of the circle");
            assert!(!sector || fov > 6.0 || n_none > 100, "{laser:?}: {n_none} directions without beams");
        }
    }
}
