//! Poses and shapes. Positions in metres, headings in radians, counter-clockwise positive, x
//! forward.

use crate::error::SimError;
use crate::trig::{sin_cos, wrap_angle};
use glam::Vec2;
use serde::{Deserialize, Serialize};

/// A place and a heading in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position in the world, m.
    pub position: Vec2,
    /// Heading, rad; kept within (−π, π] by whatever moves a body.
    pub heading: f32,
}

impl Pose {
    /// A pose from its parts; the heading is wrapped.
    pub fn new(position: Vec2, heading: f32) -> Self {
        Self { position, heading: wrap_angle(f64::from(heading)) }
    }

    /// The unit vector along the heading.
    pub fn direction(&self) -> Vec2 {
        let (sin, cos) = sin_cos(self.heading);
        Vec2::new(cos, sin)
    }

    /// A world point in the frame of this pose: x forward, y left.
    pub fn point_in_frame(&self, point_in_world: Vec2) -> Vec2 {
        let (offset, along) = (point_in_world - self.position, self.direction());
        Vec2::new(along.dot(offset), along.perp_dot(offset))
    }

    /// A point in the frame of this pose (x forward, y left) in the world.
    pub fn point_in_world(&self, point_in_frame: Vec2) -> Vec2 {
        self.position + self.direction().rotate(point_in_frame)
    }

    /// True if all three numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.heading.is_finite()
    }
}

/// The outline of a body or an obstacle, around its own pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A disc centred on the pose.
    Circle {
        /// Radius, m.
        radius: f32,
    },
    /// A rectangle centred on the pose, `length` along the heading and `width` across.
    Box {
        /// Extent along the heading, m.
        length: f32,
        /// Extent across the heading, m.
        width: f32,
    },
    /// A straight, infinitely thin wall, seen and solid from both sides.
    Segment {
        /// One end, in the frame of the pose.
        a: Vec2,
        /// The other end.
        b: Vec2,
    },
    /// A convex polygon, vertices counter-clockwise in the frame of the pose.
    Polygon {
        /// At least three vertices.
        vertices: Vec<Vec2>,
    },
}

/// Largest coordinate a shape may have in its own frame, m: beyond it f32 no longer resolves a
/// millimetre.
const EXTENT_MAX: f32 = 10_000.0;
/// Least extent of a shape and least length of an edge, m. What is thinner has no direction in f32,
/// and the geometry library makes no shape of it.
const EXTENT_MIN: f32 = 1e-3;

impl Shape {
    /// A square body of the given side.
    pub fn square(side: f32) -> Self {
        Self::Box { length: side, width: side }
    }

    /// Refuses what the world could not simulate.
    ///
    /// # Errors
    ///
    /// Names `field` when an extent is below 1 mm, above 10 km or not finite, or when a polygon is
    /// not convex, not counter-clockwise, crosses itself, has a spike, a repeated vertex, no area
    /// or fewer than three vertices.
    pub fn validate(&self, field: &str) -> Result<(), SimError> {
        let positive = |name: &str, value: f32| {
            if (EXTENT_MIN..=EXTENT_MAX).contains(&value) {
                return Ok(());
            }
            let expected = format!("a length in [{EXTENT_MIN}, {EXTENT_MAX}] m");
            Err(SimError::field(format!("{field}.{name}"), value, expected))
        };
        match self {
            Self::Circle { radius } => positive("radius", *radius),
            Self::Box { length, width } => positive("length", *length).and(positive("width", *width)),
            Self::Segment { a, b } => {
                if within(*a) && within(*b) && a.distance(*b) >= EXTENT_MIN {
                    return Ok(());
                }
                let expected = format!("a segment between two points at least {EXTENT_MIN} m apart");
                Err(SimError::field(field, format!("{a}–{b}"), expected))
            }
            Self::Polygon { vertices } => validate_polygon(field, vertices),
        }
    }

    /// The vertices of the outline in order, counter-clockwise; a segment has two, a circle none.
    pub(crate) fn vertices(&self) -> Vec<Vec2> {
        match self {
            Self::Circle { .. } => Vec::new(),
            Self::Box { length, width } => {
                let half = Vec2::new(length / 2.0, width / 2.0);
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|s| Vec2::from(s) * half).to_vec()
            }
            Self::Segment { a, b } => vec![*a, *b],
            Self::Polygon { vertices } => vertices.clone(),
        }
    }

    /// Distance from the pose to the farthest point of the shape, m.
    pub fn circumradius(&self) -> f32 {
        match self {
            Self::Circle { radius } => *radius,
            _ => self.vertices().iter().map(|v| v.length()).fold(0.0, f32::max),
        }
    }

    /// Half of the shape's least width, m: the sub-step below which a body cannot jump over
    /// anything.
    pub fn least_half_width(&self) -> f32 {
        let vertices = self.vertices();
        let width_across = |i: usize| {
            let a = vertices[i];
            let edge = (vertices[(i + 1) % vertices.len()] - a).normalize_or_zero();
            vertices.iter().map(|v| edge.perp_dot(*v - a).abs()).fold(0.0, f32::max)
        };
        match self {
            Self::Circle { radius } => *radius,
            _ => (0..vertices.len()).map(width_across).fold(f32::INFINITY, f32::min) / 2.0,
        }
    }
}

fn within(point: Vec2) -> bool {
    point.is_finite() && point.abs().max_element() <= EXTENT_MAX
}

fn validate_polygon(field: &str, vertices: &[Vec2]) -> Result<(), SimError> {
    let n = vertices.len();
    let refuse = |found: String, expected: &str| Err(SimError::field(field, found, expected));
    if n < 3 {
        return refuse(format!("{n} vertices"), "at least 3");
    }
    if let Some(bad) = vertices.iter().find(|v| !within(**v)) {
        return refuse(bad.to_string(), &format!("finite coordinates within ±{EXTENT_MAX} m"));
    }
    let edge = |i: usize| vertices[(i + 1) % n].as_dvec2() - vertices[i % n].as_dvec2();
    if let Some(i) = (0..n).find(|i| edge(*i).length() < f64::from(EXTENT_MIN)) {
        let (found, next) = (edge(i).length() as f32, (i + 1) % n);
        let expected = format!("at least {EXTENT_MIN} m from one vertex to the next");
        return refuse(format!("{found} m from vertex {i} to vertex {next}"), &expected);
    }
    // The sine of a turn may fall below zero by what rounding a short edge's ends to f32 can do.
    let sine = |i: usize| edge(i).perp_dot(edge(i + 1)) / (edge(i).length() * edge(i + 1).length());
    let convex = "a convex polygon, counter-clockwise";
    if let Some(i) = (0..n).find(|i| sine(*i) < -1e-3) {
        return refuse(format!("a turn to the right after vertex {i}"), convex);
    }
    if let Some(i) = (0..n).find(|i| sine(*i) < 1e-3 && edge(*i).dot(edge(i + 1)) < 0.0) {
        return refuse(format!("an outline that goes back on itself at vertex {}", (i + 1) % n), convex);
    }
    // Left turns only make a star, too; the turning angles of a simple outline add up to one turn.
    let angle = |i: usize| libm::atan2(edge(i).perp_dot(edge(i + 1)), edge(i).dot(edge(i + 1)));
    let total: f64 = (0..n).map(angle).sum();
    if (total - std::f64::consts::TAU).abs() > 1e-6 {
        return refuse("an outline that crosses itself".into(), convex);
    }
    let width = 2.0 * Shape::Polygon { vertices: vertices.to_vec() }.least_half_width();
    if width < EXTENT_MIN {
        return refuse(
            format!("an outline {width} m wide"),
            &format!("an area at least {EXTENT_MIN} m wide"),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_in_frame_has_x_forward_and_y_left() {
        let pose = Pose::new(Vec2::new(1.0, 2.0), std::f32::consts::FRAC_PI_2);
        let point = pose.point_in_frame(Vec2::new(0.0, 5.0));
        assert!((point - Vec2::new(3.0, 1.0)).length() < 1e-6);
    }

    #[test]
    fn clockwise_star_and_flat_polygons_are_refused() {
        let polygon = |points: &[(f32, f32)]| Shape::Polygon {
            vertices: points.iter().map(|p| Vec2::from(*p)).collect(),
        };
        assert!(polygon(&[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]).validate("p").is_ok());
        assert!(polygon(&[(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)]).validate("p").is_err());
        assert!(polygon(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]).validate("p").is_err());
        let star: Vec<(f32, f32)> = (0..5)
            .map(|i| sin_cos(i as f32 * 2.0 * std::f32::consts::TAU / 5.0))
            .map(|(sin, cos)| (cos, sin))
            .collect();
        assert!(polygon(&star).validate("p").is_err());
    }

    #[test]
    fn polygons_without_an_area_or_with_a_spike_are_refused_in_words() {
        let check = |points: &[(f32, f32)], found: &str| {
            let shape = Shape::Polygon { vertices: points.iter().map(|p| Vec2::from(*p)).collect() };
            let message = shape.validate("p").expect_err("degenerate").to_string();
            assert!(message.starts_with(&format!("p: found {found}")), "{message}");
        };
        let doubled = [(0.0, 0.0), (1.0, 0.0), (1.0, 5e-17), (1.0, 1.0), (0.0, 1.0)];
        check(&doubled, "0.00000000000000005");
        check(&[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)], "0 m from vertex 3 to vertex 0");
        check(&[(0.0, 0.0), (1.0, 0.0), (2.0, 1e-17)], "an outline that goes back on itself at vertex 2");
        check(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], "an outline that goes back on itself at vertex 2");
        check(&[(0.0, 0.0), (4.0, 0.0), (2.0, 0.000_5)], "an outline that goes back on itself at vertex 1");
        check(&[(0.0, 0.0), (0.1, 0.0), (0.1, 0.000_9), (0.0, 0.000_9)], "0.0009 m from vertex 1");
        check(&[(0.0, 0.0), (0.1, 0.0), (0.05, 0.000_9)], "an outline 0.0009 m wide");
        // A spike out of a square, there and back along one line.
        let spike = [(0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        check(&spike, "a turn to the right after vertex 2");
        let bow = [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)];
        check(&bow, "a turn to the right after vertex 0");
        let twice: Vec<(f32, f32)> = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].repeat(2);
        check(&twice, "an outline that crosses itself");
        // A vertex amid a straight edge harms nothing.
        let straight = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 1.0)].map(Vec2::from).to_vec();
        assert_eq!(Shape::Polygon { vertices: straight }.validate("p"), Ok(()));
    }

    #[test]
    fn extents_of_a_box() {
        let shape = Shape::Box { length: 3.0, width: 4.0 };
        assert_eq!(shape.circumradius(), 2.5);
        assert_eq!(shape.least_half_width(), 1.5);
        assert_eq!(shape.validate("robot").err(), None);
        assert!(Shape::square(0.0).validate("robot").is_err());
        assert!(Shape::square(f32::NAN).validate("robot").is_err());
    }
}
