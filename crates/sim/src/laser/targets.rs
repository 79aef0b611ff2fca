//! What a scan is cast against: the faces of all visible shapes in the sensor's frame, each with the beams it can cover.
//!
//! Culling is by whole chunks of beams. A face's first and last beam come from an approximate angle and are widened by
//! one beam, so that culling never decides about a hit: the kernel's own exact test does.

use super::{Hit, LANES, rotation};
use crate::config::LaserConfig;
use crate::geometry::Pose;
use crate::solid::{Outline, Solid};
use crate::trig::approximate_turn;
use crate::world::{Walls, World};
use glam::Vec2;

/// Code of a beam that meets nothing.
pub(crate) const NOTHING: u32 = 0;
/// Code of the walls.
pub(crate) const WALL: u32 = 1;
const OBSTACLE: u32 = 2;
/// Obstacle and body indices share the codes from 2 on: even ones are obstacles, odd ones bodies.
fn code(index: usize, is_body: bool) -> u32 {
    OBSTACLE + 2 * index as u32 + u32::from(is_body)
}

/// The hit that a code stands for.
pub(crate) fn decode(code: u32) -> Hit {
    let index = (code.saturating_sub(OBSTACLE) / 2) as usize;
    match code {
        NOTHING => Hit::None,
        WALL => Hit::Wall(0),
        _ if code.is_multiple_of(2) => Hit::Obstacle(index),
        _ => Hit::Body(index),
    }
}

/// A run of chunks, counter-clockwise, that may go over the end of the circle.
#[derive(Clone, Copy)]
pub(crate) struct Span {
    pub(crate) first: u32,
    pub(crate) last: u32,
}

impl Span {
    /// The chunks of the beams between two directions given in turns, counter-clockwise, with a margin.
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

    /// All chunks of a circle.
    fn all(beams: usize) -> Self {
        Self { first: 0, last: beams.div_ceil(LANES) as u32 - 1 }
    }

    /// Whether the run holds a chunk.
    pub(crate) fn holds(self, chunk: usize) -> bool {
        let (first, last, chunk) = (self.first, self.last, chunk as u32);
        if first <= last { first <= chunk && chunk <= last } else { first <= chunk || chunk <= last }
    }
}

/// A straight face seen from its front: `right` and `left` ends as the sensor sees them.
pub(crate) struct Edge {
    pub(crate) right: Vec2,
    pub(crate) left: Vec2,
    pub(crate) span: Span,
    pub(crate) code: u32,
}

/// A disc.
pub(crate) struct Disc {
    pub(crate) centre: Vec2,
    pub(crate) radius: f32,
    pub(crate) span: Span,
    pub(crate) code: u32,
}

/// The room's walls from the sensor: distances to the inner faces, and the room's x axis in the sensor's frame.
#[derive(Clone, Copy)]
pub(crate) struct WallsInFrame {
    /// Distances to the faces at least x, least y.
    pub(crate) to_min: Vec2,
    /// Distances to the faces at largest x, largest y.
    pub(crate) to_max: Vec2,
    /// (cos, sin) of the sensor's heading.
    pub(crate) rotation: Vec2,
}

/// Everything one scan is cast against.
#[derive(Default)]
pub(crate) struct Targets {
    pub(crate) walls: Option<WallsInFrame>,
    pub(crate) edges: Vec<Edge>,
    pub(crate) discs: Vec<Disc>,
    /// Code of a shape that the sensor is inside of: every range is 0.
    pub(crate) around: Option<u32>,
    pub(crate) range: f32,
}

impl Targets {
    /// Gathers what the sensor may see.
    pub(crate) fn collect(
        &mut self,
        world: &World,
        sensor: Pose,
        sees: impl Fn(usize) -> bool,
        config: &LaserConfig,
    ) {
        self.edges.clear();
        self.discs.clear();
        self.around = None;
        self.range = config.range;
        let frame = Frame { origin: sensor.position, rotation: rotation(sensor.heading), config };
        self.walls = world.walls_box().map(|walls| frame.walls(walls));
        for (i, obstacle) in world.obstacles().iter().enumerate() {
            self.add(&frame, obstacle, code(i, false));
        }
        for (i, body) in world.bodies().iter().enumerate() {
            if sees(i) {
                self.add(&frame, body, code(i, true));
            }
        }
    }

    fn add(&mut self, frame: &Frame<'_>, solid: &Solid, code: u32) {
        let offset = solid.pose.position - frame.origin;
        let reach = frame.config.range + solid.circumradius;
        if offset.length_squared() > reach * reach {
            return;
        }
        let centre = frame.turned(offset);
        // (cos, sin) of the solid's heading in the sensor's frame.
        let rotation = frame.turned(solid.rotation);
        let place = |v: Vec2| centre + rotation.rotate(v);
        match &solid.outline {
            Outline::Circle(radius) => self.add_disc(frame, centre, *radius, code),
            Outline::Closed(vertices) => self.add_polygon(frame, vertices, place, code),
            Outline::Segment { a, b } => {
                let (a, b) = (place(*a), place(*b));
                let (right, left) = if a.perp_dot(b) >= 0.0 { (a, b) } else { (b, a) };
                let span = frame.span(turn(right), turn(left));
                self.edges.push(Edge { right, left, span, code });
            }
        }
    }

    fn add_disc(&mut self, frame: &Frame<'_>, centre: Vec2, radius: f32, code: u32) {
        let distance = centre.length();
        if distance <= radius {
            self.around.get_or_insert(code);
            return;
        }
        // asin x ≤ x + 0.571 x³ on [0, 1] (equality at both ends), in turns.
        let sine = radius / distance;
        let half = (sine + 0.571 * sine * sine * sine) * std::f32::consts::FRAC_1_PI * 0.5;
        let middle = turn(centre);
        let span = frame.span((middle - half).rem_euclid(1.0), (middle + half).rem_euclid(1.0));
        self.discs.push(Disc { centre, radius, span, code });
    }

    /// Adds the faces of a counter-clockwise outline that look at the sensor.
    fn add_polygon(&mut self, frame: &Frame<'_>, vertices: &[Vec2], place: impl Fn(Vec2) -> Vec2, code: u32) {
        let n_before = self.edges.len();
        let mut a = place(vertices[vertices.len() - 1]);
        let mut turn_a = None;
        for vertex in vertices {
            let b = place(*vertex);
            let mut turn_b = None;
            // Along a face that looks at the sensor, the outline runs clockwise around the sensor.
            if a.perp_dot(b) < 0.0 {
                let (left, right) = (turn_a.unwrap_or_else(|| turn(a)), turn(b));
                turn_b = Some(right);
                self.edges.push(Edge { right: b, left: a, span: frame.span(right, left), code });
            }
            (a, turn_a) = (b, turn_b);
        }
        if self.edges.len() == n_before {
            self.around.get_or_insert(code);
        }
    }
}

fn turn(v: Vec2) -> f32 {
    approximate_turn(v.x, v.y)
}

/// The sensor's frame.
struct Frame<'a> {
    origin: Vec2,
    rotation: Vec2,
    config: &'a LaserConfig,
}

impl Frame<'_> {
    /// A world vector as seen from the sensor: x forward, y left.
    fn turned(&self, v: Vec2) -> Vec2 {
        Vec2::new(self.rotation.dot(v), self.rotation.perp_dot(v))
    }

    fn walls(&self, walls: Walls) -> WallsInFrame {
        WallsInFrame {
            to_min: (self.origin - walls.min).max(Vec2::ZERO),
            to_max: (walls.max - self.origin).max(Vec2::ZERO),
            rotation: self.rotation,
        }
    }

    fn span(&self, from: f32, to: f32) -> Span {
        if self.config.beams < 8 * LANES {
            return Span::all(self.config.beams);
        }
        Span::between(from, to, self.config.beams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive() {
        for (code, hit) in [(NOTHING, Hit::None), (WALL, Hit::Wall(0))] {
            assert_eq!(decode(code), hit);
        }
        assert_eq!(decode(code(7, false)), Hit::Obstacle(7));
        assert_eq!(decode(code(0, true)), Hit::Body(0));
    }

    #[test]
    fn spans_wrap_and_widen() {
        let span = Span::between(0.99, 0.01, 512);
        assert!(span.holds(63) && span.holds(0) && !span.holds(30));
        let span = Span::between(0.25, 0.26, 512);
        assert!(span.holds(15) && span.holds(16) && !span.holds(14) && !span.holds(18));
        let span = Span::between(0.001, 0.999, 512);
        assert!((0..64).all(|chunk| span.holds(chunk)));
    }
}
