//! The targets of a scan: the faces of all visible shapes in the sensor's frame, each with the
//! beams that it can cover.
//!
//! Culling is by whole chunks of beams and never decides about a hit: the kernel's own exact test
//! does.

use super::span::{Span, View};
use super::{Hit, rotation};
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

/// The hit with a code.
pub(crate) fn decode(code: u32) -> Hit {
    let index = (code.saturating_sub(OBSTACLE) / 2) as usize;
    match code {
        NOTHING => Hit::None,
        WALL => Hit::Wall(0),
        _ if code.is_multiple_of(2) => Hit::Obstacle(index),
        _ => Hit::Body(index),
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

/// The room's walls from the sensor: distances to the inner faces, and the room's x axis in the
/// sensor's frame.
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
        let (rotation, view) = (rotation(sensor.heading), View::new(config));
        let frame = Frame { origin: sensor.position, rotation, range: config.range, view };
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

    fn add(&mut self, frame: &Frame, solid: &Solid, code: u32) {
        let offset = solid.pose.position - frame.origin;
        let reach = frame.range + solid.circumradius;
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
                let span = frame.view.span(turn(right), turn(left));
                self.edges.extend(span.map(|span| Edge { right, left, span, code }));
            }
        }
    }

    fn add_disc(&mut self, frame: &Frame, centre: Vec2, radius: f32, code: u32) {
        let distance = centre.length();
        if distance <= radius {
            self.around.get_or_insert(code);
            return;
        }
        // asin x ≤ x + 0.571 x³ on [0, 1] (equality at both ends), in turns.
        let sine = radius / distance;
        let half = (sine + 0.571 * sine * sine * sine) * std::f32::consts::FRAC_1_PI * 0.5;
        let middle = turn(centre);
        let span = frame.view.span((middle - half).rem_euclid(1.0), (middle + half).rem_euclid(1.0));
        self.discs.extend(span.map(|span| Disc { centre, radius, span, code }));
    }

    /// Adds the faces of a counter-clockwise outline that look at the sensor.
    fn add_polygon(&mut self, frame: &Frame, vertices: &[Vec2], place: impl Fn(Vec2) -> Vec2, code: u32) {
        let mut is_inside = true;
        let mut a = place(vertices[vertices.len() - 1]);
        let mut turn_a = None;
        for vertex in vertices {
            let b = place(*vertex);
            let mut turn_b = None;
            // Along a face that looks at the sensor, the outline runs clockwise around the sensor.
            if a.perp_dot(b) < 0.0 {
                let (left, right) = (turn_a.unwrap_or_else(|| turn(a)), turn(b));
                (turn_b, is_inside) = (Some(right), false);
                let span = frame.view.span(right, left);
                self.edges.extend(span.map(|span| Edge { right: b, left: a, span, code }));
            }
            (a, turn_a) = (b, turn_b);
        }
        if is_inside {
            self.around.get_or_insert(code);
        }
    }
}

fn turn(v: Vec2) -> f32 {
    approximate_turn(v.x, v.y)
}

/// The sensor's frame.
struct Frame {
    origin: Vec2,
    rotation: Vec2,
    range: f32,
    view: View,
}

impl Frame {
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
}
