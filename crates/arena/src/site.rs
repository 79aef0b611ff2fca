//! A room's walls and obstacles as polygons, piece by piece, to be drawn. Crowds are given
//! [`Scenario::boundary`].

use glam::Vec2;
use jostle_sim::{Scenario, outline};

/// The polygons of a scenario: first the walls, clockwise (free space lies within), then every
/// obstacle, counter-clockwise (solid); a segment has two vertices. A disc becomes the regular
/// polygon of 16 corners around it.
pub fn polygons(scenario: &Scenario) -> Vec<Vec<Vec2>> {
    let (min, max) = scenario.walls;
    let walls = vec![min, Vec2::new(min.x, max.y), max, Vec2::new(max.x, min.y)];
    let obstacles = scenario
        .obstacles
        .iter()
        .map(|(shape, pose)| outline(shape).into_iter().map(|point| pose.point_in_world(point)).collect());
    std::iter::once(walls).chain(obstacles).collect()
}

#[cfg(test)]
mod tests {
    use jostle_sim::{Pose, Shape};

    use super::*;

    fn twice_area(polygon: &[Vec2]) -> f32 {
        (0..polygon.len()).map(|i| polygon[i].perp_dot(polygon[(i + 1) % polygon.len()])).sum()
    }

    #[test]
    fn walls_enclose_free_space_and_obstacles_are_solid() {
        let quarter_turn = Pose::new(Vec2::new(3.0, 0.0), std::f32::consts::FRAC_PI_2);
        let scenario = Scenario {
            walls: (Vec2::splat(-5.0), Vec2::splat(5.0)),
            obstacles: vec![
                (Shape::Box { length: 2.0, width: 1.0 }, quarter_turn),
                (Shape::Circle { radius: 1.0 }, Pose::default()),
                (Shape::Segment { a: Vec2::ZERO, b: Vec2::X }, Pose::default()),
            ],
            traced: None,
        };
        let polygons = polygons(&scenario);
        assert_eq!(twice_area(&polygons[0]), -200.0);
        assert!((twice_area(&polygons[1]) - 4.0).abs() < 1e-5);
        assert!(polygons[1].iter().all(|p| (p.x - 3.0).abs() < 0.501 && p.y.abs() < 1.001));
        // 16-gon around the unit circle: 32·tan(π/16).
        assert!((twice_area(&polygons[2]) - 32.0 * 0.198_912_37).abs() < 1e-4);
        assert_eq!(polygons[3].len(), 2);
    }
}
