//! A room from above as an image: what `render_mode="rgb_array"` gives. No drawing library: every
//! pixel is asked whether its centre lies in a shape.

use glam::Vec2;
use jostle_sim::{Pose, Scenario, Shape};

/// Pixels along the room's longer side.
const SIDE: f32 = 480.0;
/// Width of the walls, in pixels.
const WALL: usize = 4;
/// Half of the width of a line, in pixels.
const HALF_LINE: f32 = 1.0;

/// Red, green, blue.
pub type Colour = [u8; 3];

const FLOOR: Colour = [250, 250, 250];
const SOLID: Colour = [70, 70, 70];
const NOSE: Colour = [20, 20, 20];
/// The robot of a room among a crowd.
pub const ROBOT: Colour = [204, 51, 51];
/// Its pedestrians.
pub const PEDESTRIAN: Colour = [68, 119, 170];
/// Robots of a room of robots, one after the other.
pub const ROBOTS: [Colour; 6] =
    [ROBOT, [34, 136, 51], PEDESTRIAN, [204, 153, 34], [170, 51, 119], [51, 170, 187]];

/// An image, row by row from the top, three bytes a pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `[height, width, 3]`.
    pub rgb: Vec<u8>,
}

/// A picture that is being drawn: the room's upper left corner and the scale.
pub struct Painter {
    picture: Picture,
    corner: Vec2,
    pixels_per_metre: f32,
}

impl Painter {
    /// Draws floor, walls and obstacles; y points up.
    pub fn new(scenario: &Scenario) -> Self {
        let (min, max) = scenario.walls;
        let size = max - min;
        let pixels_per_metre = SIDE / size.max_element();
        // A corridor a thousand times longer than it is wide still has a row.
        let pixels = |length: f32| ((length * pixels_per_metre).round() as usize).max(1) + 2 * WALL;
        let (width, height) = (pixels(size.x), pixels(size.y));
        let mut rgb = SOLID.repeat(width * height);
        for row in rgb.chunks_exact_mut(3 * width).skip(WALL).take(height - 2 * WALL) {
            for pixel in row[3 * WALL..3 * (width - WALL)].as_chunks_mut().0 {
                *pixel = FLOOR;
            }
        }
        let picture = Picture { width, height, rgb };
        let mut painter = Self { picture, corner: Vec2::new(min.x, max.y), pixels_per_metre };
        for (shape, pose) in &scenario.obstacles {
            painter.solid(shape, *pose, SOLID);
        }
        painter
    }

    /// The picture.
    pub fn finish(self) -> Picture {
        self.picture
    }

    /// A shape, filled; a segment is a line.
    pub fn solid(&mut self, shape: &Shape, pose: Pose, colour: Colour) {
        let line = HALF_LINE / self.pixels_per_metre;
        let inside = |p: Vec2| match shape {
            Shape::Circle { radius } => p.length() <= *radius,
            Shape::Box { length, width } => p.x.abs() <= length / 2.0 && p.y.abs() <= width / 2.0,
            Shape::Segment { a, b } => to_segment(p, *a, *b) <= line,
            Shape::Polygon { vertices } => {
                let next = vertices.iter().cycle().skip(1);
                vertices.iter().zip(next).all(|(a, b)| (b - a).perp_dot(p - a) >= 0.0)
            }
        };
        let reach = shape.circumradius() + line;
        self.fill(pose.position, reach, colour, |point| inside(pose.point_in_frame(point)));
    }

    /// A body with its nose.
    pub fn body(&mut self, shape: &Shape, pose: Pose, colour: Colour) {
        self.solid(shape, pose, colour);
        let nose = Shape::Segment { a: Vec2::ZERO, b: Vec2::new(shape.circumradius(), 0.0) };
        self.solid(&nose, pose, NOSE);
    }

    /// A goal: a ring of its radius and a point.
    pub fn goal(&mut self, position: Vec2, radius: f32, colour: Colour) {
        let line = HALF_LINE / self.pixels_per_metre;
        self.fill(position, radius + line, colour, |point| {
            let distance = point.distance(position);
            (distance - radius).abs() <= line || distance <= 2.0 * line
        });
    }

    /// Colours the pixels within `reach` of a point whose centres pass the test.
    fn fill(&mut self, middle: Vec2, reach: f32, colour: Colour, inside: impl Fn(Vec2) -> bool) {
        let scale = self.pixels_per_metre;
        let place = (middle - self.corner) * Vec2::new(scale, -scale) + WALL as f32;
        // A cast of a negative number or of one that is not finite gives 0 or the largest: an empty
        // range, or the edge.
        let range = |at: f32, most: usize| {
            ((at - reach * scale).floor() as usize).min(most)
                ..((at + reach * scale).ceil() as usize).min(most)
        };
        for row in range(place.y, self.picture.height) {
            for column in range(place.x, self.picture.width) {
                let pixel = Vec2::new(column as f32, row as f32) + 0.5 - WALL as f32;
                if inside(self.corner + pixel * Vec2::new(1.0 / scale, -1.0 / scale)) {
                    let at = 3 * (row * self.picture.width + column);
                    self.picture.rgb[at..at + 3].copy_from_slice(&colour);
                }
            }
        }
    }
}

fn to_segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a + (b - a) * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(picture: &Picture, x: f32, y: f32, scenario: &Scenario) -> Colour {
        let (min, max) = scenario.walls;
        let scale = SIDE / (max - min).max_element();
        let column = ((x - min.x) * scale) as usize + WALL;
        let row = ((max.y - y) * scale) as usize + WALL;
        picture.rgb[3 * (row * picture.width + column)..][..3].try_into().unwrap()
    }

    #[test]
    fn shapes_lie_where_they_are_in_the_world() {
        let polygon = vec![Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(0.0, 1.0)];
        let obstacles = vec![
            (Shape::Circle { radius: 1.0 }, Pose::new(Vec2::new(-5.0, 2.0), 0.0)),
            (Shape::Polygon { vertices: polygon }, Pose::new(Vec2::new(5.0, 2.0), 0.0)),
            (
                Shape::Segment { a: Vec2::new(-2.0, 0.0), b: Vec2::new(2.0, 0.0) },
                Pose::new(Vec2::new(0.0, -4.0), 0.0),
            ),
        ];
        let scenario =
            Scenario { walls: (Vec2::new(-10.0, -5.0), Vec2::new(10.0, 5.0)), obstacles, traced: None };
        let mut painter = Painter::new(&scenario);
        let body = Shape::Box { length: 2.0, width: 0.5 };
        painter.body(&body, Pose::new(Vec2::ZERO, std::f32::consts::FRAC_PI_2), ROBOT);
        painter.goal(Vec2::new(8.0, -3.0), 1.0, PEDESTRIAN);
        let picture = painter.finish();
        assert_eq!((picture.width, picture.height), (480 + 2 * WALL, 240 + 2 * WALL));
        assert_eq!(picture.rgb.len(), 3 * picture.width * picture.height);
        let colour = |x, y| at(&picture, x, y, &scenario);
        assert_eq!((colour(-5.0, 2.9), colour(-5.9, 2.9), colour(-5.0, -2.0)), (SOLID, FLOOR, FLOOR));
        // The triangle points up.
        assert_eq!((colour(5.8, 1.1), colour(5.8, 2.8), colour(5.0, 2.8)), (SOLID, FLOOR, SOLID));
        assert_eq!((colour(1.9, -4.0), colour(1.9, -3.8)), (SOLID, FLOOR));
        // The body lies along y, its nose up.
        assert_eq!(
            (colour(0.2, 0.9), colour(0.4, 0.0), colour(0.0, 0.8), colour(0.0, -0.8)),
            (ROBOT, FLOOR, NOSE, ROBOT)
        );
        assert_eq!(
            (colour(8.0, -2.02), colour(8.0, -2.5), colour(8.0, -3.0)),
            (PEDESTRIAN, FLOOR, PEDESTRIAN)
        );
        assert_eq!(picture.rgb[..3], SOLID);
    }

    #[test]
    fn what_lies_outside_is_cut_off() {
        let scenario =
            Scenario { walls: (Vec2::ZERO, Vec2::new(4.0, 4.0)), obstacles: Vec::new(), traced: None };
        let mut painter = Painter::new(&scenario);
        let empty = painter.picture.clone();
        for position in
            [Vec2::splat(-90.0), Vec2::splat(90.0), Vec2::new(f32::NAN, 1.0), Vec2::splat(f32::INFINITY)]
        {
            painter.goal(position, 0.5, ROBOT);
            painter.solid(&Shape::square(1.0), Pose { position, heading: 0.0 }, ROBOT);
        }
        assert_eq!(painter.finish(), empty);
    }
}
