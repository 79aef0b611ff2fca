//! Static polygons: rings of directed edges with the convexity of each vertex.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use super::{
    line::{left_of, normalise},
    obstacle_tree::ObstacleTree,
    vertex::Vertex,
};
use crate::{PedsError, error::checked};

/// Least length of an edge, m.
const EDGE_MIN: f32 = 1e-3;

/// The obstacles of a room, with the tree that finds the visible edges. Immutable: many simulators
/// share one by `Arc`.
#[derive(Debug, Clone, Default)]
pub struct Obstacles {
    pub(super) vertices: Vec<Vertex>,
    pub(super) tree: ObstacleTree,
}

impl Obstacles {
    /// Most edges accepted; building the tree takes up to cubic time in their number.
    pub const MAX_EDGES: usize = 4096;

    /// Polygons in RVO2's convention: counter-clockwise = solid, clockwise = a room that encloses,
    /// two vertices = a segment.
    ///
    /// # Errors
    /// Fewer than two vertices, an edge shorter than 1 mm, non-finite coordinates, more than
    /// [`Self::MAX_EDGES`] edges.
    pub fn new<P: AsRef<[Vec2]>>(polygons: &[P]) -> Result<Self, PedsError> {
        let mut vertices = Vec::new();
        for (obstacle, polygon) in polygons.iter().enumerate() {
            let polygon = polygon.as_ref();
            validate(obstacle, polygon, vertices.len())?;
            push_ring(&mut vertices, polygon);
        }
        let tree = ObstacleTree::build(&mut vertices);
        Ok(Self { vertices, tree })
    }

    /// Number of edges after the tree has split those that cross its lines.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// True if there is no obstacle.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }
}

fn validate(obstacle: usize, polygon: &[Vec2], n_before: usize) -> Result<(), PedsError> {
    let n = polygon.len();
    if n < 2 {
        return Err(PedsError::ObstacleVertices { obstacle, found: n });
    }
    if n_before + n > Obstacles::MAX_EDGES {
        return Err(PedsError::TooManyEdges { obstacle, found: n_before + n, most: Obstacles::MAX_EDGES });
    }
    for (edge, &point) in polygon.iter().enumerate() {
        checked("obstacle vertex", point)?;
        let length = point.distance(polygon[(edge + 1) % n]);
        if length < EDGE_MIN {
            return Err(PedsError::ObstacleEdge { obstacle, edge, length, least: EDGE_MIN });
        }
    }
    Ok(())
}

fn push_ring(vertices: &mut Vec<Vertex>, polygon: &[Vec2]) {
    let first = vertices.len();
    let n = polygon.len();
    for (i, &point) in polygon.iter().enumerate() {
        let next = (i + 1) % n;
        let previous = (i + n - 1) % n;
        vertices.push(Vertex {
            point,
            direction: normalise(polygon[next] - point),
            next: (first + next) as u32,
            previous: (first + previous) as u32,
            is_convex: n == 2 || left_of(polygon[previous], point, polygon[next]) >= 0.0,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Vec<Vec2> {
        vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]
    }

    #[test]
    fn counter_clockwise_corners_are_convex_and_clockwise_ones_are_not() {
        assert!(Obstacles::new(&[square()]).unwrap().vertices.iter().all(|v| v.is_convex));
        let mut room = square();
        room.reverse();
        assert!(Obstacles::new(&[room]).unwrap().vertices.iter().all(|v| !v.is_convex));
        assert!(Obstacles::new(&[[Vec2::ZERO, Vec2::X]]).unwrap().vertices.iter().all(|v| v.is_convex));
    }

    #[test]
    fn a_cut_edge_keeps_the_ring_closed() {
        // A pinwheel: the line through each segment crosses the next one.
        let arm = |turn: usize| {
            let rotation = [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y][turn];
            [rotation.rotate(Vec2::new(0.2, 1.0)), rotation.rotate(Vec2::new(3.0, 1.0))]
        };
        let obstacles = Obstacles::new(&[arm(0), arm(1), arm(2), arm(3)]).unwrap();
        assert!(obstacles.len() > 8, "some segment must be cut");
        for (i, vertex) in obstacles.vertices.iter().enumerate() {
            assert_eq!(obstacles.vertices[vertex.next as usize].previous as usize, i);
            assert_eq!(obstacles.vertices[vertex.previous as usize].next as usize, i);
        }
    }

    #[test]
    fn unusable_polygons_are_refused() {
        assert!(Obstacles::new(&[vec![Vec2::ZERO]]).is_err());
        assert!(Obstacles::new(&[vec![Vec2::ZERO, Vec2::X, Vec2::X]]).is_err());
        assert!(Obstacles::new(&[vec![Vec2::ZERO, Vec2::NAN]]).is_err());
        assert!(Obstacles::new(&[vec![Vec2::ZERO, Vec2::new(2e6, 0.0)]]).is_err());
        let comb: Vec<Vec2> = (0..5000).map(|i| Vec2::new(i as f32, (i % 2) as f32)).collect();
        assert!(Obstacles::new(&[comb]).is_err());
    }
    #[test]
    fn limits_hold_over_all_polygons_together() {
        // Polygons of a thousand edges.
        let ring = |n: usize| -> Vec<Vec2> {
            (0..n).map(|i| 50.0 * Vec2::from_angle(i as f32 * std::f32::consts::TAU / n as f32)).collect()
        };
        assert!(validate(0, &ring(96), 4000).is_ok());
        assert!(validate(0, &ring(97), 4000).is_err());
        // 1 mm is long enough, a little less is not; the edge that closes the ring counts, too.
        assert!(validate(0, &[Vec2::ZERO, Vec2::new(1e-3, 0.0)], 0).is_ok());
        assert!(validate(0, &[Vec2::ZERO, Vec2::new(0.9e-3, 0.0)], 0).is_err());
        assert!(validate(0, &[Vec2::ZERO, Vec2::X, Vec2::new(1e-4, 0.0)], 0).is_err());
    }

    #[test]
    fn rings_are_joined_one_after_another() {
        let obstacles = Obstacles::new(&[square(), vec![3.0 * Vec2::X, 4.0 * Vec2::X]]).unwrap();
        assert_eq!((obstacles.len(), obstacles.is_empty()), (6, false));
        assert!(Obstacles::default().is_empty());
        let links: Vec<(u32, u32)> = obstacles.vertices.iter().map(|v| (v.previous, v.next)).collect();
        assert_eq!(links, [(3, 1), (0, 2), (1, 3), (2, 0), (5, 5), (4, 4)]);
        let directions: Vec<Vec2> = obstacles.vertices.iter().map(|v| v.direction).collect();
        assert_eq!(directions, [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y, Vec2::X, -Vec2::X]);
        // A vertex amid a straight wall is convex.
        let straight = [Vec2::ZERO, Vec2::X, 2.0 * Vec2::X, Vec2::new(1.0, 2.0)];
        assert!(Obstacles::new(&[straight]).unwrap().vertices.iter().all(|v| v.is_convex));
    }
}
