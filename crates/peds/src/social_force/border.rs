//! What repels like a wall: connected line segments with one nearest point.

use glam::{DVec2, Vec2};

use crate::{PedsError, error::checked};

/// Connected segments that repel once, from their nearest point.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    segments: Vec<[DVec2; 2]>,
}

impl Border {
    /// A border of the given segments.
    ///
    /// # Errors
    /// No segment, or a coordinate that is not finite.
    pub fn new(segments: &[[DVec2; 2]]) -> Result<Self, PedsError> {
        if segments.is_empty() {
            return Err(PedsError::Length { what: "segments of a border", found: 0, expected: 1 });
        }
        for point in segments.iter().flatten() {
            checked("border", point.as_vec2())?;
        }
        Ok(Self { segments: segments.to_vec() })
    }

    /// Borders of polygons in the convention of [`crate::orca::Obstacles::new`]: a counter-clockwise (solid) polygon or a segment is one
    /// border; of a clockwise room each wall is one, since its walls surround the pedestrian and repel from all sides.
    ///
    /// # Errors
    /// Fewer than two vertices, or a coordinate that is not finite.
    pub fn from_polygons<P: AsRef<[Vec2]>>(polygons: &[P]) -> Result<Vec<Self>, PedsError> {
        let mut borders = Vec::new();
        for (obstacle, polygon) in polygons.iter().enumerate() {
            let vertices: Vec<DVec2> = polygon.as_ref().iter().map(|v| v.as_dvec2()).collect();
            if vertices.len() < 2 {
                let found = format!("{} vertices", vertices.len());
                return Err(PedsError::Obstacle { obstacle, found, expected: "at least 2" });
            }
            let edges = ring(&vertices);
            let twice_area: f64 = edges.iter().map(|[a, b]| a.perp_dot(*b)).sum();
            if vertices.len() > 2 && twice_area < 0.0 {
                for edge in edges {
                    borders.push(Self::new(&[edge])?);
                }
            } else {
                borders.push(Self::new(&edges)?);
            }
        }
        Ok(borders)
    }

    /// The border's nearest point; of equally near ones the first.
    pub fn nearest(&self, position: DVec2) -> DVec2 {
        let candidates = self.segments.iter().map(|segment| nearest_on_segment(*segment, position));
        candidates
            .map(|point| (point.distance_squared(position), point))
            .reduce(|best, other| if other.0 < best.0 { other } else { best })
            .map_or(position, |(_, point)| point)
    }
}

fn ring(vertices: &[DVec2]) -> Vec<[DVec2; 2]> {
    if let [a, b] = vertices {
        return vec![[*a, *b]];
    }
    (0..vertices.len()).map(|i| [vertices[i], vertices[(i + 1) % vertices.len()]]).collect()
}

fn nearest_on_segment([a, b]: [DVec2; 2], position: DVec2) -> DVec2 {
    let along = b - a;
    let length_sq = along.length_squared();
    if length_sq == 0.0 {
        return a;
    }
    a + along * ((position - a).dot(along) / length_sq).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_lies_on_the_segment_or_at_its_ends() {
        let border = Border::new(&[[DVec2::ZERO, DVec2::X], [DVec2::X, DVec2::ONE]]).unwrap();
        assert_eq!(border.nearest(DVec2::new(0.3, -2.0)), DVec2::new(0.3, 0.0));
        assert_eq!(border.nearest(DVec2::new(-1.0, 1.0)), DVec2::ZERO);
        assert_eq!(border.nearest(DVec2::new(3.0, 0.5)), DVec2::new(1.0, 0.5));
    }

    #[test]
    fn a_solid_polygon_is_one_border_and_a_room_has_four() {
        let solid = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let room: Vec<Vec2> = solid.iter().rev().copied().collect();
        assert_eq!(Border::from_polygons(&[solid]).unwrap().len(), 1);
        assert_eq!(Border::from_polygons(&[room]).unwrap().len(), 4);
        assert_eq!(Border::from_polygons(&[[Vec2::ZERO, Vec2::X]]).unwrap()[0].segments.len(), 1);
        assert!(Border::from_polygons(&[[Vec2::ZERO]]).is_err());
        assert!(Border::from_polygons(&[[Vec2::ZERO, Vec2::NAN]]).is_err());
    }
    #[test]
    fn of_equally_near_points_the_first_counts() {
        let at = |x: f64| [DVec2::new(x, -1.0), DVec2::new(x, 1.0)];
        assert_eq!(Border::new(&[at(-1.0), at(1.0)]).unwrap().nearest(DVec2::ZERO), DVec2::new(-1.0, 0.0));
        assert_eq!(Border::new(&[at(1.0), at(-1.0)]).unwrap().nearest(DVec2::ZERO), DVec2::new(1.0, 0.0));
    }

    #[test]
    fn degenerate_borders_by_hand() {
        let point = Border::new(&[[DVec2::ONE, DVec2::ONE]]).unwrap();
        assert_eq!(point.nearest(DVec2::new(5.0, -2.0)), DVec2::ONE);
        // Three vertices on a line enclose nothing, so they are no room.
        let flat = [Vec2::ZERO, 2.0 * Vec2::X, Vec2::X];
        assert_eq!(Border::from_polygons(&[flat]).unwrap().len(), 1);
        assert!(Border::new(&[]).is_err());
    }

    #[test]
    fn a_ring_is_closed() {
        let triangle = Border::from_polygons(&[[Vec2::ZERO, 4.0 * Vec2::X, 4.0 * Vec2::Y]]).unwrap();
        // Beside the last edge, which leads back to the first vertex.
        assert_eq!(triangle[0].nearest(DVec2::new(-1.0, 1.0)), DVec2::Y);
        assert_eq!(triangle[0].nearest(DVec2::new(1.0, -1.0)), DVec2::X);
        assert_eq!(triangle[0].nearest(DVec2::new(3.0, 3.0)), DVec2::new(2.0, 2.0));
    }
}
