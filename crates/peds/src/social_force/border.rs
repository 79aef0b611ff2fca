//! Borders, which repel like walls: connected line segments with one nearest point.
//!
//! The rule: **a wall repels once, from its nearest point**, and what a wall is depends only on the
//! area, not on the pieces that it was drawn in.
//! - A solid with free space all round it is one wall, whatever its form.
//! - A line that surrounds free space is cut into walls at its corners: where, half a metre before
//!   and behind, the line has turned into the free space by at least 40°. A rectangular room so has
//!   four walls and a round one has one; a bump, a niche or a step of less than that is part of its
//!   wall, and a column in front of a wall is a wall of its own.
//! - Of a line that surrounds free space only the part repels which faces the pedestrian: the far
//!   side of a thin wall, seen from the next room, is no second wall.

use glam::{DVec2, Vec2};

use crate::{PedsError, error::checked};

/// Distance before and behind a corner at which its turn is measured, m: a body's side. Of corners
/// nearer to each other than this along the line, the sharpest counts.
const ARM: f64 = 0.5;
/// Least turn of a corner between two walls, rad.
const TURN: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// Connected segments that repel once, from their nearest point.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    segments: Vec<[DVec2; 2]>,
    /// Only segments that have the pedestrian on their right repel.
    one_sided: bool,
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
        Ok(Self { segments: segments.to_vec(), one_sided: false })
    }

    /// Borders of polygons in the convention of [`crate::orca::Obstacles::new`], free space on the
    /// right of every edge: a counter-clockwise (solid) polygon or a segment is one border; a
    /// clockwise one, which surrounds free space, has one for each of its walls (see the module).
    ///
    /// # Errors
    /// Fewer than two vertices, or a coordinate that is not finite.
    pub fn from_polygons<P: AsRef<[Vec2]>>(polygons: &[P]) -> Result<Vec<Self>, PedsError> {
        let mut borders = Vec::new();
        for (obstacle, polygon) in polygons.iter().enumerate() {
            let vertices: Vec<DVec2> = polygon.as_ref().iter().map(|v| v.as_dvec2()).collect();
            if vertices.len() < 2 {
                return Err(PedsError::ObstacleVertices { obstacle, found: vertices.len() });
            }
            let edges = ring(&vertices);
            let twice_area: f64 = edges.iter().map(|[a, b]| a.perp_dot(*b)).sum();
            if vertices.len() > 2 && twice_area < 0.0 {
                for wall in walls(&edges) {
                    borders.push(Self { one_sided: true, ..Self::new(&wall)? });
                }
            } else {
                borders.push(Self::new(&edges)?);
            }
        }
        Ok(borders)
    }

    /// The border's nearest point; of equally near ones the first. `None` for a pedestrian behind a
    /// wall of a room.
    pub fn nearest(&self, position: DVec2) -> Option<DVec2> {
        let faces = |[a, b]: &&[DVec2; 2]| !self.one_sided || (*b - *a).perp_dot(position - *a) <= 0.0;
        let candidates = self.segments.iter().filter(faces).map(|s| nearest_on_segment(*s, position));
        candidates
            .map(|point| (point.distance_squared(position), point))
            .reduce(|best, other| if other.0 < best.0 { other } else { best })
            .map(|(_, point)| point)
    }
}

/// The walls of a line around free space, each from one corner to the next.
fn walls(edges: &[[DVec2; 2]]) -> Vec<Vec<[DVec2; 2]>> {
    let mut cuts = corners(edges);
    cuts.sort_unstable();
    let n = edges.len();
    match cuts.first() {
        None => vec![edges.to_vec()],
        Some(&first) => cuts
            .iter()
            .zip(cuts.iter().skip(1).chain([&(first + n)]))
            .map(|(&from, &to)| (from..to).map(|i| edges[i % n]).collect())
            .collect(),
    }
}

/// The edges that begin at a corner.
fn corners(edges: &[[DVec2; 2]]) -> Vec<usize> {
    let n = edges.len();
    let mut along: Vec<f64> = vec![0.0];
    along.extend(edges.iter().scan(0.0, |sum, [a, b]| {
        *sum += a.distance(*b);
        Some(*sum)
    }));
    let length = along[n];
    let arm = ARM.min(length / 4.0);
    let turn = |i: usize| {
        let (from, to) = (walk(edges, i, -arm), walk(edges, i, arm));
        let corner = edges[i][0];
        let (before, behind) = (corner - from, to - corner);
        // To the right is into the free space.
        -before.perp_dot(behind).atan2(before.dot(behind))
    };
    let mut sharp: Vec<(usize, f64)> =
        (0..n).map(|i| (i, turn(i))).filter(|(_, turn)| *turn >= TURN).collect();
    // A nanoradian more is no sharper: of corners that are alike the first counts.
    sharp.sort_by(|a, b| {
        let whole = |turn: f64| (turn * 1e9).round();
        whole(b.1).total_cmp(&whole(a.1)).then(a.0.cmp(&b.0))
    });
    let mut found: Vec<usize> = Vec::new();
    for (i, _) in sharp {
        let apart = |j: &usize| {
            let between = (along[i] - along[*j]).abs();
            between.min(length - between) >= arm
        };
        if found.iter().all(apart) {
            found.push(i);
        }
    }
    found
}

/// The point `by` metres along the line from the start of edge `i`, or back where that is negative.
fn walk(edges: &[[DVec2; 2]], i: usize, by: f64) -> DVec2 {
    let n = edges.len();
    let mut left = by.abs();
    for k in 0..n {
        let [from, to] = if by < 0.0 {
            let [a, b] = edges[(i + 2 * n - 1 - k) % n];
            [b, a]
        } else {
            edges[(i + k) % n]
        };
        let length = from.distance(to);
        if left <= length && length > 0.0 {
            return from + (to - from) * (left / length);
        }
        left -= length;
    }
    edges[i][0]
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
        assert_eq!(border.nearest(DVec2::new(0.3, -2.0)), Some(DVec2::new(0.3, 0.0)));
        assert_eq!(border.nearest(DVec2::new(-1.0, 1.0)), Some(DVec2::ZERO));
        assert_eq!(border.nearest(DVec2::new(3.0, 0.5)), Some(DVec2::new(1.0, 0.5)));
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
        let nearest = |xs: [f64; 2]| Border::new(&xs.map(at)).unwrap().nearest(DVec2::ZERO);
        assert_eq!(nearest([-1.0, 1.0]), Some(DVec2::new(-1.0, 0.0)));
        assert_eq!(nearest([1.0, -1.0]), Some(DVec2::new(1.0, 0.0)));
    }

    #[test]
    fn degenerate_borders_by_hand() {
        let point = Border::new(&[[DVec2::ONE, DVec2::ONE]]).unwrap();
        assert_eq!(point.nearest(DVec2::new(5.0, -2.0)), Some(DVec2::ONE));
        // Three vertices on a line enclose nothing, so they are no room.
        let flat = [Vec2::ZERO, 2.0 * Vec2::X, Vec2::X];
        assert_eq!(Border::from_polygons(&[flat]).unwrap().len(), 1);
        assert!(Border::new(&[]).is_err());
    }

    #[test]
    fn a_ring_is_closed() {
        let triangle = Border::from_polygons(&[[Vec2::ZERO, 4.0 * Vec2::X, 4.0 * Vec2::Y]]).unwrap();
        // Beside the last edge, which leads back to the first vertex.
        assert_eq!(triangle[0].nearest(DVec2::new(-1.0, 1.0)), Some(DVec2::Y));
        assert_eq!(triangle[0].nearest(DVec2::new(1.0, -1.0)), Some(DVec2::X));
        assert_eq!(triangle[0].nearest(DVec2::new(3.0, 3.0)), Some(DVec2::new(2.0, 2.0)));
    }

    /// A clockwise line around free space.
    fn room(points: &[(f32, f32)]) -> Vec<Border> {
        Border::from_polygons(&[points.iter().map(|p| Vec2::from(*p)).collect::<Vec<_>>()]).unwrap()
    }

    fn lengths(borders: &[Border]) -> Vec<usize> {
        borders.iter().map(|border| border.segments.len()).collect()
    }

    #[test]
    fn a_wall_is_one_with_its_bumps_and_steps_and_a_column_is_a_wall_of_its_own() {
        let with = |depth: f32| {
            room(&[
                (0.0, 0.0),
                (0.0, 8.0),
                (8.0, 8.0),
                (8.0, 0.0),
                (5.0, 0.0),
                (5.0, depth),
                (3.0, depth),
                (3.0, 0.0),
            ])
        };
        assert_eq!(lengths(&with(0.2)), [1, 1, 1, 5]);
        assert_eq!(lengths(&with(-0.2)), [1, 1, 1, 5]);
        assert_eq!(lengths(&with(0.8)), [1, 1, 1, 1, 3, 1]);
    }

    #[test]
    fn a_round_room_has_one_wall_however_many_edges_it_is_drawn_with() {
        for n in [16_u8, 40, 200] {
            let corner = |i: u8| Vec2::from_angle(-std::f32::consts::TAU * f32::from(i) / f32::from(n));
            let ring: Vec<Vec2> = (0..n).map(|i| 4.0 * corner(i)).collect();
            let borders = Border::from_polygons(&[ring]).unwrap();
            assert_eq!(lengths(&borders), [usize::from(n)]);
        }
        let octagon: Vec<Vec2> =
            (0..8_u8).map(|i| 4.0 * Vec2::from_angle(-f32::from(i) * std::f32::consts::FRAC_PI_4)).collect();
        assert_eq!(Border::from_polygons(&[octagon]).unwrap().len(), 8);
    }

    #[test]
    fn a_chamfered_corner_is_one_corner() {
        let chamfered = [(0.0, 0.0), (0.0, 7.9), (0.1, 8.0), (8.0, 8.0), (8.0, 0.0)];
        assert_eq!(room(&chamfered).len(), 4);
    }

    #[test]
    fn a_wall_does_not_repel_through_itself() {
        let square = [(0.0, 0.0), (0.0, 4.0), (4.0, 4.0), (4.0, 0.0)];
        let left = &room(&square)[0];
        assert_eq!(left.nearest(DVec2::new(1.0, 2.0)), Some(DVec2::new(0.0, 2.0)));
        assert_eq!(left.nearest(DVec2::new(-0.1, 2.0)), None);
        // A solid with free space all round repels from all sides.
        let island =
            Border::from_polygons(&[square.map(Vec2::from).iter().rev().copied().collect::<Vec<_>>()]);
        assert_eq!(island.unwrap()[0].nearest(DVec2::new(-0.1, 2.0)), Some(DVec2::new(0.0, 2.0)));
    }
}
