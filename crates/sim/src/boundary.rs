//! The boundary of a room's free area: all walls and obstacles as one area, whatever pieces it was
//! given in.
//!
//! Crowd models that know walls count what they are given: two boxes that make one wall would repel
//! twice, and a rasterised wall has a box for every row of cells. So they are given lines between
//! free and solid, in which no trace of the pieces is left. Two pieces nearer to each other than
//! twice [`GAP`] touch: only rounding parts what was drawn in one.
//!
//! The world and its laser keep the pieces: nothing of this changes what a body meets or a beam
//! sees.

use crate::geometry::{Pose, Shape};
use crate::scenario::Scenario;
use glam::{DVec2, Vec2};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::single::SingleFloatOverlay;

/// Corners of the polygon that replaces a disc.
const DISC_CORNERS: u32 = 16;
/// Width by which pieces grow before they are united, m; the lines go back by as much.
const GAP: f64 = 1e-4;
/// Half of the thickness of a segment that touches something, m; one that touches nothing has none.
const HALF_THICKNESS: f64 = 1e-3;
/// Free areas below this, m², are left out: nobody fits in.
const POCKET: f64 = 0.04;
/// Shortest edge of a line, m; ORCA takes 1 mm.
const SHORTEST: f64 = 1.1e-3;

type Ring = Vec<DVec2>;

impl Scenario {
    /// The lines between free and solid: clockwise around each free area, counter-clockwise around
    /// what stands in it. Free space is always on the right. A segment that touches nothing is a
    /// line of two points.
    ///
    /// A room without obstacles gives its four walls, from the least corner on.
    pub fn boundary(&self) -> Vec<Vec<Vec2>> {
        let (min, max) = self.walls;
        let walls = vec![min, Vec2::new(min.x, max.y), max, Vec2::new(max.x, min.y)];
        if self.obstacles.is_empty() && self.traced.is_none() {
            return vec![walls];
        }
        let (free, own) = match &self.traced {
            Some(traced) => (traced.rings.clone(), traced.n_obstacles),
            None => (vec![walls.iter().map(|v| v.as_dvec2()).collect()], 0),
        };
        let pieces: Vec<Ring> =
            self.obstacles[own.min(self.obstacles.len())..].iter().map(|(s, p)| in_world(s, *p)).collect();
        let (alone, solid) = part(pieces, &free);
        let mut lines: Vec<Vec<Vec2>> = difference(&free, &solid).iter().filter_map(|r| line(r)).collect();
        lines.extend(alone.iter().map(|segment| segment.iter().map(|v| v.as_vec2()).collect()));
        lines
    }
}

/// A shape's vertices around its own pose, counter-clockwise; of a disc the regular polygon around
/// it; two of a segment.
pub fn outline(shape: &Shape) -> Vec<Vec2> {
    match shape {
        Shape::Circle { radius } => {
            let step = std::f64::consts::TAU / f64::from(DISC_CORNERS);
            let reach = f64::from(*radius) / libm::cos(step / 2.0);
            let corner = |k: u32| {
                let angle = step * f64::from(k);
                Vec2::new((reach * libm::cos(angle)) as f32, (reach * libm::sin(angle)) as f32)
            };
            (0..DISC_CORNERS).map(corner).collect()
        }
        _ => shape.vertices(),
    }
}

fn in_world(shape: &Shape, pose: Pose) -> Ring {
    let (sin, cos) = (libm::sin(f64::from(pose.heading)), libm::cos(f64::from(pose.heading)));
    let (position, rotation) = (pose.position.as_dvec2(), DVec2::new(cos, sin));
    outline(shape).into_iter().map(|v| position + rotation.rotate(v.as_dvec2())).collect()
}

/// Segments that touch nothing, and everything else as areas.
fn part(pieces: Vec<Ring>, free: &[Ring]) -> (Vec<Ring>, Vec<Ring>) {
    let touches = |i: usize| {
        let others = pieces.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, piece)| piece);
        others.chain(free).any(|other| gap_below(&pieces[i], other, 2.0 * GAP))
    };
    let is_alone: Vec<bool> = (0..pieces.len()).map(|i| pieces[i].len() == 2 && !touches(i)).collect();
    let (mut alone, mut solid) = (Vec::new(), Vec::new());
    for (piece, is_alone) in pieces.into_iter().zip(is_alone) {
        match (is_alone, piece.as_slice()) {
            (true, _) => alone.push(piece),
            (false, [a, b]) => solid.push(thick(*a, *b)),
            (false, _) => solid.push(piece),
        }
    }
    (alone, solid)
}

/// A segment as a thin rectangle, counter-clockwise.
fn thick(a: DVec2, b: DVec2) -> Ring {
    let along = (b - a).normalize() * HALF_THICKNESS;
    let across = along.perp();
    vec![a - along - across, b + along - across, b + along + across, a - along + across]
}

/// True if the edges of two outlines come nearer to each other than `limit`, m.
fn gap_below(a: &Ring, b: &Ring, limit: f64) -> bool {
    let bounds = |ring: &Ring| {
        ring.iter()
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(*at), high.max(*at)))
    };
    let ((low, high), (other_low, other_high)) = (bounds(a), bounds(b));
    if (low - limit).cmpgt(other_high).any() || (other_low - limit).cmpgt(high).any() {
        return false;
    }
    let edges = |ring: &Ring| -> Vec<[DVec2; 2]> {
        (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]).collect()
    };
    let others = edges(b);
    edges(a).iter().any(|a| others.iter().any(|b| distance(*a, *b) < limit))
}

/// Distance of two segments.
fn distance([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> f64 {
    let side = |a: DVec2, b: DVec2, p: DVec2| (b - a).perp_dot(p - a);
    let cross = side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0;
    let to = |p: DVec2, a: DVec2, b: DVec2| {
        let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + t * (b - a))
    };
    if cross { 0.0 } else { to(a, c, d).min(to(b, c, d)).min(to(c, a, b)).min(to(d, a, b)) }
}

/// The free area without the solid ones: lines with free space on their right, as the arguments
/// are.
fn difference(free: &[Ring], solid: &[Ring]) -> Vec<Ring> {
    let points = |ring: &Ring| shifted(ring, GAP).iter().map(DVec2::to_array).collect::<Vec<_>>();
    let free: Vec<Vec<[f64; 2]>> = free.iter().map(points).collect();
    // Wound as the free areas are, since one rule of winding holds for both.
    let solid: Vec<Vec<[f64; 2]>> =
        solid.iter().map(|ring| points(ring).into_iter().rev().collect()).collect();
    let areas = free.overlay_as::<i64>(&solid, OverlayRule::Difference, FillRule::Negative);
    let mut lines = Vec::new();
    for area in areas {
        let rings: Vec<Ring> =
            area.iter().map(|ring| ring.iter().map(|v| DVec2::from(*v)).collect()).collect();
        let areas: Vec<f64> = rings.iter().map(|ring| signed_area(ring)).collect();
        // The first is the outer one, the others are holes in it.
        let free = areas[0].abs() - areas[1..].iter().map(|area| area.abs()).sum::<f64>();
        if free < POCKET {
            continue;
        }
        for (i, (mut ring, area)) in rings.into_iter().zip(areas).enumerate() {
            if (area < 0.0) != (i == 0) {
                ring.reverse();
            }
            lines.push(shifted(&straight(ring), -GAP));
        }
    }
    lines
}

fn signed_area(ring: &[DVec2]) -> f64 {
    (0..ring.len()).map(|i| ring[i].perp_dot(ring[(i + 1) % ring.len()])).sum::<f64>() / 2.0
}

/// Every edge shifted to its right.
fn shifted(ring: &[DVec2], by: f64) -> Ring {
    let n = ring.len();
    let normal = |i: usize| -(ring[(i + 1) % n] - ring[i]).normalize_or_zero().perp();
    (0..n)
        .map(|i| {
            let (before, behind) = (normal((i + n - 1) % n), normal(i));
            // A spike is not made longer than four times the shift.
            ring[i] + (before + behind) * (by / (1.0 + before.dot(behind)).max(0.125))
        })
        .collect()
}

/// Without the vertices that lie within half a gap of the line past them: where two pieces met.
fn straight(mut ring: Ring) -> Ring {
    loop {
        let n = ring.len();
        let off = |i: usize| {
            let (a, b) = (ring[(i + n - 1) % n], ring[(i + 1) % n]);
            let t = (ring[i] - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE);
            ring[i].distance(a + t.clamp(0.0, 1.0) * (b - a))
        };
        // Every other vertex at most, so that none is judged by one that goes with it.
        let mut kept: Vec<bool> = vec![true; n];
        for i in 0..n {
            let neighbours = kept[(i + n - 1) % n] && kept[(i + 1) % n];
            kept[i] = !(neighbours && off(i) <= GAP / 2.0);
        }
        let count = kept.iter().filter(|kept| **kept).count();
        if count == n || count < 3 {
            return ring;
        }
        let mut kept = kept.iter();
        ring.retain(|_| *kept.next().expect("one for each vertex"));
    }
}

/// A line in single precision, without edges that are too short; `None` where nothing is left.
fn line(ring: &[DVec2]) -> Option<Vec<Vec2>> {
    let mut line: Vec<Vec2> = Vec::with_capacity(ring.len());
    for vertex in ring.iter().map(|v| v.as_vec2()) {
        if line.last().is_none_or(|last| f64::from(last.distance(vertex)) >= SHORTEST) {
            line.push(vertex);
        }
    }
    while line.len() > 2 && f64::from(line[0].distance(line[line.len() - 1])) < SHORTEST {
        line.pop();
    }
    (line.len() > 2).then_some(line)
}
