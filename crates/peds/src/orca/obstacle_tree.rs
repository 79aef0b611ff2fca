//! A binary space partition of the obstacle edges: finds those within range that face the agent, nearer side first.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust from the RVO2 Library
//! (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg, Stephen J. Guy, Jamie Snape, Ming C. Lin and
//! Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use super::{
    EPSILON,
    line::{det, left_of},
    obstacle::Vertex,
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
    /// Partitions the edges by the lines through the most balancing ones; edges that cross a line are cut there,
    /// which appends vertices.
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

    /// Collects, sorted by distance, the edges nearer than `range_sq` on whose right (outer) side `position` lies.
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

/// Position in `edges` of the edge whose line leaves the smallest larger side (then the smallest smaller side).
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
    vertices.push(Vertex {
        point: c + t * (d - c),
        next: first.next,
        previous: edge,
        is_convex: true,
        ..first
    });
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
