//! A binary space partition of the obstacle edges: finds those within range that face the agent,
//! nearer side first.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use super::{
    EPSILON,
    line::{det, left_of},
    vertex::Vertex,
};

const NONE: u32 = u32::MAX;

#[derive(Debug, Clone, Copy)]
struct Node {
    vertex: u32,
    left: u32,
    right: u32,
}

/// The tree over the edges of a vertex list (an edge has the index of its first vertex).
#[derive(Debug, Clone, Default)]
pub(super) struct ObstacleTree {
    nodes: Vec<Node>,
}

/// An edge near an agent.
#[derive(Debug, Clone, Copy)]
pub(super) struct ObstacleNeighbour {
    pub(super) distance_sq: f32,
    pub(super) vertex: u32,
}

/// On which side of a line an edge lies.
enum Side {
    Left,
    Right,
    Across,
}

impl ObstacleTree {
    /// Partitions the edges by the lines through the most balancing ones; edges that cross a line
    /// are cut there, which appends vertices.
    pub(super) fn build(vertices: &mut Vec<Vertex>) -> Self {
        let mut tree = Self::default();
        let edges: Vec<u32> = (0..vertices.len() as u32).collect();
        if !edges.is_empty() {
            tree.build_node(vertices, &edges);
        }
        tree
    }

    fn build_node(&mut self, vertices: &mut Vec<Vertex>, edges: &[u32]) -> u32 {
        if edges.is_empty() {
            return NONE;
        }
        let split = best_split(vertices, edges);
        let (a, b) = ends(vertices, edges[split]);
        let mut left = Vec::new();
        let mut right = Vec::new();
        for (j, &edge) in edges.iter().enumerate() {
            if j == split {
                continue;
            }
            match side(vertices, a, b, edge) {
                Side::Left => left.push(edge),
                Side::Right => right.push(edge),
                Side::Across => {
                    let starts_left = left_of(a, b, vertices[edge as usize].point) > 0.0;
                    let rest = cut(vertices, a, b, edge);
                    let (on_left, on_right) = if starts_left { (edge, rest) } else { (rest, edge) };
                    left.push(on_left);
                    right.push(on_right);
                }
            }
        }
        let node = self.nodes.len();
        self.nodes.push(Node { vertex: edges[split], left: NONE, right: NONE });
        self.nodes[node].left = self.build_node(vertices, &left);
        self.nodes[node].right = self.build_node(vertices, &right);
        node as u32
    }

    /// Collects, sorted by distance, the edges nearer than `range_sq` on whose right (outer) side
    /// `position` lies.
    pub(super) fn neighbours(
        &self,
        vertices: &[Vertex],
        position: Vec2,
        range_sq: f32,
        found: &mut Vec<ObstacleNeighbour>,
    ) {
        found.clear();
        if !self.nodes.is_empty() {
            self.visit(0, vertices, position, range_sq, found);
        }
    }

    fn visit(
        &self,
        node: u32,
        vertices: &[Vertex],
        position: Vec2,
        range_sq: f32,
        found: &mut Vec<ObstacleNeighbour>,
    ) {
        if node == NONE {
            return;
        }
        let node = self.nodes[node as usize];
        let (a, b) = ends(vertices, node.vertex);
        let left = left_of(a, b, position);
        let (near, far) = if left >= 0.0 { (node.left, node.right) } else { (node.right, node.left) };

        self.visit(near, vertices, position, range_sq, found);
        if left * left / (b - a).length_squared() < range_sq {
            if left < 0.0 {
                insert(found, node.vertex, distance_sq(a, b, position), range_sq);
            }
            self.visit(far, vertices, position, range_sq, found);
        }
    }
}

fn ends(vertices: &[Vertex], edge: u32) -> (Vec2, Vec2) {
    let first = vertices[edge as usize];
    (first.point, vertices[first.next as usize].point)
}

fn side(vertices: &[Vertex], a: Vec2, b: Vec2, edge: u32) -> Side {
    let (c, d) = ends(vertices, edge);
    let c_left = left_of(a, b, c);
    let d_left = left_of(a, b, d);
    if c_left >= -EPSILON && d_left >= -EPSILON {
        Side::Left
    } else if c_left <= EPSILON && d_left <= EPSILON {
        Side::Right
    } else {
        Side::Across
    }
}

/// Position in `edges` of the edge whose line leaves the smallest larger side (then the smallest
/// smaller side).
fn best_split(vertices: &[Vertex], edges: &[u32]) -> usize {
    let ordered = |left: usize, right: usize| (left.max(right), left.min(right));
    let mut best = 0;
    let mut least = ordered(edges.len(), edges.len());
    for (i, &candidate) in edges.iter().enumerate() {
        let (a, b) = ends(vertices, candidate);
        let (mut left, mut right) = (0, 0);
        for (j, &edge) in edges.iter().enumerate() {
            if i == j {
                continue;
            }
            match side(vertices, a, b, edge) {
                Side::Left => left += 1,
                Side::Right => right += 1,
                Side::Across => {
                    left += 1;
                    right += 1;
                }
            }
            if ordered(left, right) >= least {
                break;
            }
        }
        if ordered(left, right) < least {
            least = ordered(left, right);
            best = i;
        }
    }
    best
}

/// Cuts the edge at the line through `a` and `b`; returns the new edge, which follows it.
fn cut(vertices: &mut Vec<Vertex>, a: Vec2, b: Vec2, edge: u32) -> u32 {
    let first = vertices[edge as usize];
    let (c, d) = ends(vertices, edge);
    let t = det(b - a, c - a) / det(b - a, c - d);
    let new = vertices.len() as u32;
    vertices.push(Vertex { point: c + t * (d - c), previous: edge, is_convex: true, ..first });
    vertices[edge as usize].next = new;
    vertices[first.next as usize].previous = new;
    new
}

/// Squared distance from `position` to the segment.
fn distance_sq(a: Vec2, b: Vec2, position: Vec2) -> f32 {
    let r = (position - a).dot(b - a) / (b - a).length_squared();
    let nearest = if r < 0.0 {
        a
    } else if r > 1.0 {
        b
    } else {
        a + r * (b - a)
    };
    (position - nearest).length_squared()
}

/// Inserts behind all that are as near.
fn insert(found: &mut Vec<ObstacleNeighbour>, vertex: u32, distance_sq: f32, range_sq: f32) {
    if distance_sq < range_sq {
        let at = found.iter().rposition(|other| other.distance_sq <= distance_sq).map_or(0, |i| i + 1);
        found.insert(at, ObstacleNeighbour { distance_sq, vertex });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::orca::Obstacles;

    fn edge_ends(obstacles: &Obstacles, edge: usize) -> (Vec2, Vec2) {
        ends(&obstacles.vertices, edge as u32)
    }

    /// Blocks apart from each other, a room around them and a free-standing segment: some lines cut
    /// others' edges.
    fn scene() -> Obstacles {
        let block = |x: f32, y: f32, turn: f32| -> Vec<Vec2> {
            let corner = |i: u8| Vec2::from_angle(turn + f32::from(i) * std::f32::consts::FRAC_PI_2);
            (0..4).map(|i| Vec2::new(x, y) + corner(i)).collect()
        };
        let room = vec![
            Vec2::new(-8.0, -7.0),
            Vec2::new(-8.0, 7.5),
            Vec2::new(9.0, 8.0),
            Vec2::new(9.5, -7.0),
            Vec2::new(1.0, -6.0),
        ];
        let segment = vec![Vec2::new(-6.0, -2.0), Vec2::new(-5.0, 3.0)];
        let polygons = [block(0.0, 0.0, 0.3), block(4.0, 3.0, 1.0), block(-3.0, 4.0, 0.1), room, segment];
        Obstacles::new(&polygons).unwrap()
    }

    #[test]
    fn the_edges_that_face_a_place_are_found_as_by_looking_at_all() {
        let obstacles = scene();
        let mut found = Vec::new();
        let (mut n_found, mut n_cut_off) = (0, 0);
        for i in 0..400_u16 {
            let at = Vec2::new(f32::from(i % 20) * 0.87 - 8.1, f32::from(i / 20) * 0.79 - 7.3);
            for range in [0.5_f32, 2.0, 30.0] {
                obstacles.tree.neighbours(&obstacles.vertices, at, range * range, &mut found);
                assert!(found.is_sorted_by(|a, b| a.distance_sq <= b.distance_sq));
                let mut got: Vec<u32> = found.iter().map(|found| found.vertex).collect();
                got.sort_unstable();
                let near = |edge: &u32| {
                    let (a, b) = edge_ends(&obstacles, *edge as usize);
                    left_of(a, b, at) < 0.0 && distance_sq(a, b, at) < range * range
                };
                let all = 0..obstacles.vertices.len() as u32;
                let expected: Vec<u32> = all.clone().filter(near).collect();
                assert_eq!(got, expected, "within {range} of {at}");
                n_found += got.len();
                n_cut_off += all.len() - got.len();
            }
        }
        assert!(n_found > 1000 && n_cut_off > 1000, "{n_found} {n_cut_off}");
    }

    #[test]
    fn edges_lie_wholly_on_their_side_of_every_node_above() {
        let obstacles = scene();
        assert!(obstacles.vertices.len() > 19, "some edge is cut");
        let nodes = &obstacles.tree.nodes;
        assert_eq!(nodes.len(), obstacles.vertices.len(), "every edge once");
        let below = |start: u32| {
            let (mut pending, mut edges) = (vec![start], Vec::new());
            while let Some(node) = pending.pop() {
                if node != NONE {
                    let Node { vertex, left, right } = nodes[node as usize];
                    edges.push(vertex);
                    pending.extend([left, right]);
                }
            }
            edges
        };
        for node in nodes {
            let (a, b) = edge_ends(&obstacles, node.vertex as usize);
            for (child, sign) in [(node.left, 1.0), (node.right, -1.0)] {
                for edge in below(child) {
                    let (c, d) = edge_ends(&obstacles, edge as usize);
                    assert!([c, d].iter().all(|end| sign * left_of(a, b, *end) >= -1e-4), "{edge}");
                }
            }
        }
    }

    #[test]
    fn a_cut_lies_on_the_line_and_on_the_edge() {
        let segment = [Vec2::new(-1.0, 2.0), Vec2::new(3.0, -2.0)];
        let mut vertices = Obstacles::new(&[segment]).unwrap().vertices;
        let new = cut(&mut vertices, Vec2::ZERO, Vec2::new(5.0, 0.0), 0);
        assert_eq!(new, 2);
        assert_eq!(vertices[2].point, Vec2::X);
        assert_eq!(ends(&vertices, 0), (segment[0], Vec2::X));
        assert_eq!(ends(&vertices, 2), (Vec2::X, segment[1]));
        assert_eq!((vertices[2].previous, vertices[1].previous), (0, 2));
        assert!(vertices[2].is_convex);
    }

    #[test]
    fn the_most_balancing_edge_splits() {
        // Parallel segments one above the other, all pointing the same way: the middle one leaves
        // two on either side.
        let segment = |y: u8| [Vec2::new(0.0, f32::from(y)), Vec2::new(1.0, f32::from(y))];
        let middle_of = |order: &[u8]| {
            let mut vertices = Vec::new();
            for (i, y) in order.iter().enumerate() {
                let own = Obstacles::new(&[segment(*y)]).unwrap().vertices;
                let shift = 2 * i as u32;
                vertices.extend(own.into_iter().map(|vertex| Vertex {
                    next: vertex.next + shift,
                    previous: vertex.previous + shift,
                    ..vertex
                }));
            }
            let edges: Vec<u32> = (0..order.len() as u32).map(|i| 2 * i).collect();
            order[best_split(&vertices, &edges)]
        };
        assert_eq!(middle_of(&[0, 1, 2, 3, 4]), 2);
        assert_eq!(middle_of(&[4, 0, 3, 2, 1]), 2);
        // Of two that balance alike the first.
        assert_eq!((middle_of(&[0, 1, 2, 3]), middle_of(&[3, 2, 1, 0])), (1, 2));
        // Edges that lie on the line count as left of it.
        assert_eq!(middle_of(&[0, 0, 1, 2]), 1);
    }

    #[test]
    fn sides_by_hand() {
        let segments =
            [[0.5, 1.0, 0.5, 2.0], [0.5, -1.0, 0.5, -2.0], [0.5, -1.0, 0.5, 1.0], [0.2, 0.0, 0.7, 0.0]];
        let names = segments.map(|[ax, ay, bx, by]| {
            let vertices = Obstacles::new(&[[Vec2::new(ax, ay), Vec2::new(bx, by)]]).unwrap().vertices;
            match side(&vertices, Vec2::ZERO, Vec2::X, 0) {
                Side::Left => "left",
                Side::Right => "right",
                Side::Across => "across",
            }
        });
        assert_eq!(names, ["left", "right", "across", "left"]);
    }

    #[test]
    fn distances_to_a_segment_by_hand() {
        let from = |x, y| distance_sq(Vec2::X, 3.0 * Vec2::X, Vec2::new(x, y));
        assert_eq!((from(0.0, 1.0), from(2.0, 2.0), from(5.0, 1.0)), (2.0, 4.0, 5.0));
    }

    #[test]
    fn equals_keep_the_order_in_which_they_come_and_the_range_is_open() {
        let mut found = Vec::new();
        for (vertex, distance_sq) in [(0, 4.0), (1, 1.0), (2, 4.0), (3, 1.0), (4, 9.0), (5, 8.0)] {
            insert(&mut found, vertex, distance_sq, 9.0);
        }
        assert_eq!(found.iter().map(|f| f.vertex).collect::<Vec<_>>(), [1, 3, 0, 2, 5]);
    }
}
