//! The nearest surface all round a point: ground truth for a sensor that sees a sector only.

use super::{Hit, ScanSummary};
use crate::solid::{Outline, Solid};
use crate::world::World;
use glam::Vec2;

/// The nearest wall, obstacle or visible body within `range`; the first of those that are equally
/// near. A point inside of something, or beyond a wall, has distance 0.
pub(super) fn around(world: &World, point: Vec2, sees: &impl Fn(usize) -> bool, range: f32) -> ScanSummary {
    let mut summary = ScanSummary { min_range: range, nearest: Hit::None };
    let mut offer = |distance: f32, hit: Hit| {
        if distance < summary.min_range {
            summary = ScanSummary { min_range: distance, nearest: hit };
        }
        summary.min_range
    };
    let mut least = range;
    if let Some(walls) = world.walls_box() {
        let inwards = (point - walls.min).min(walls.max - point).min_element();
        least = offer(inwards.max(0.0), Hit::Wall(0));
    }
    let obstacles = world.obstacles().iter().enumerate().map(|(i, solid)| (solid, Hit::Obstacle(i)));
    let bodies = world.bodies().iter().enumerate().filter(|(i, _)| sees(*i));
    for (solid, hit) in obstacles.chain(bodies.map(|(i, solid)| (solid, Hit::Body(i)))) {
        let reach = least + solid.circumradius;
        if solid.pose.position.distance_squared(point) <= reach * reach {
            least = offer(distance(solid, point), hit);
        }
    }
    summary
}

/// Distance from a point to a solid's surface, m; 0 inside.
fn distance(solid: &Solid, point: Vec2) -> f32 {
    let offset = point - solid.pose.position;
    let local = Vec2::new(solid.rotation.dot(offset), solid.rotation.perp_dot(offset));
    match &solid.outline {
        Outline::Circle(radius) => (local.length() - radius).max(0.0),
        Outline::Segment { a, b } => to_side(local, *a, *b),
        Outline::Closed(vertices) => {
            let sides = || vertices.iter().zip(vertices.iter().cycle().skip(1));
            if sides().all(|(a, b)| (*b - *a).perp_dot(local - *a) >= 0.0) {
                return 0.0;
            }
            sides().map(|(a, b)| to_side(local, *a, *b)).fold(f32::INFINITY, f32::min)
        }
    }
}

/// Distance from a point to the straight line between two points, ends included.
fn to_side(point: Vec2, a: Vec2, b: Vec2) -> f32 {
    let (along, to_point) = (b - a, point - a);
    let part = (to_point.dot(along) / along.length_squared()).clamp(0.0, 1.0);
    to_point.distance(along * part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Pose, Shape};

    #[track_caller]
    fn check(world: &World, x: f32, y: f32, expected: (f32, Hit)) {
        let found = around(world, Vec2::new(x, y), &|_| true, 10.0);
        assert!((found.min_range - expected.0).abs() < 1e-6 && found.nearest == expected.1, "{found:?}");
    }

    #[test]
    fn distances_to_each_kind_of_shape_by_hand() {
        let mut world = World::new();
        check(&world, 0.0, 0.0, (10.0, Hit::None));
        world.set_walls(Vec2::splat(-9.0), Vec2::splat(9.0)).expect("walls");
        let triangle = vec![Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(0.0, 2.0)];
        for (shape, x) in [
            (Shape::Circle { radius: 0.5 }, -5.0),
            (Shape::Segment { a: Vec2::new(0.0, -1.0), b: Vec2::new(0.0, 1.0) }, 0.0),
            (Shape::Polygon { vertices: triangle }, 4.0),
        ] {
            world.add_obstacle(&shape, Pose::new(Vec2::new(x, 0.0), 0.0)).expect("obstacle");
        }
        let turned = Pose::new(Vec2::new(0.0, -5.0), std::f32::consts::FRAC_PI_4);
        world.add_body(&Shape::square(2.0), turned).expect("body");
        check(&world, -4.0, 0.0, (0.5, Hit::Obstacle(0)));
        check(&world, -5.0, 0.1, (0.0, Hit::Obstacle(0)));
        check(&world, 0.3, 0.0, (0.3, Hit::Obstacle(1)));
        // Beyond the segment's end: from the end itself.
        check(&world, 0.3, 1.4, (0.5, Hit::Obstacle(1)));
        // From the slanted side, and from inside.
        check(&world, 6.0, 2.0, (2.0_f32.sqrt(), Hit::Obstacle(2)));
        check(&world, 4.5, 0.5, (0.0, Hit::Obstacle(2)));
        // A square on its corner.
        check(&world, 0.0, -3.0, (2.0 - 2.0_f32.sqrt(), Hit::Body(0)));
        check(&world, -8.7, 8.0, (0.3, Hit::Wall(0)));
        check(&world, -20.0, 8.0, (0.0, Hit::Wall(0)));
        let blind = around(&world, Vec2::new(0.0, -4.0), &|_| false, 10.0);
        assert_eq!((blind.min_range, blind.nearest), (3.0, Hit::Obstacle(1)));
    }
}
