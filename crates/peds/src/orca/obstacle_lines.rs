//! The half-planes that obstacle edges induce. The agent takes all of the avoiding on itself.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.
//!
//! Names: the velocity obstacle of an edge is a truncated cone with a left and a right leg and a
//! cut-off, which is a segment with a circle at either end. "Left" and "right" are the edge's first
//! and second vertex as the agent sees them.

use glam::Vec2;

use super::{
    EPSILON,
    agent::Agent,
    line::{Line, det, normalise, over},
    obstacle_tree::ObstacleNeighbour,
    vertex::Vertex,
};

/// The contribution of an edge.
enum Contribution {
    /// A line.
    Line(Line),
    /// Nothing: another edge takes care of it.
    Nothing,
}

/// Appends the half-planes of the edges, nearest first.
pub(super) fn push_obstacle_lines(
    agent: &Agent,
    vertices: &[Vertex],
    neighbours: &[ObstacleNeighbour],
    lines: &mut Vec<Line>,
) {
    let inv_horizon = 1.0 / agent.parameters.time_horizon_obstacles;
    for neighbour in neighbours {
        let left = vertices[neighbour.vertex as usize];
        let right = vertices[left.next as usize];
        let relative_left = left.point - agent.position;
        let relative_right = right.point - agent.position;
        if is_covered(lines, relative_left, relative_right, inv_horizon, agent.parameters.radius) {
            continue;
        }
        let edge = Edge { left, right, relative_left, relative_right };
        if let Contribution::Line(line) = edge_line(agent, vertices, neighbour.vertex, &edge, inv_horizon) {
            lines.push(line);
        }
    }
}

/// True if the edge's velocity obstacle lies wholly in what the lines so far forbid.
fn is_covered(
    lines: &[Line],
    relative_left: Vec2,
    relative_right: Vec2,
    inv_horizon: f32,
    radius: f32,
) -> bool {
    lines.iter().any(|line| {
        let beyond = |relative: Vec2| {
            det(inv_horizon * relative - line.point, line.direction) - inv_horizon * radius >= -EPSILON
        };
        beyond(relative_left) && beyond(relative_right)
    })
}

struct Edge {
    left: Vertex,
    right: Vertex,
    relative_left: Vec2,
    relative_right: Vec2,
}

/// The cone of an edge, after oblique views have been reduced to one vertex.
struct Cone {
    left: Vertex,
    right: Vertex,
    /// Both legs come from one vertex.
    is_point: bool,
    left_leg: Vec2,
    right_leg: Vec2,
}

fn edge_line(agent: &Agent, vertices: &[Vertex], index: u32, edge: &Edge, inv_horizon: f32) -> Contribution {
    let radius_sq = agent.parameters.radius * agent.parameters.radius;
    let along = edge.right.point - edge.left.point;
    // Foot of the agent on the edge's line, in units of the edge.
    let s = (-edge.relative_left).dot(along) / along.length_squared();
    let line_distance_sq = (-edge.relative_left - s * along).length_squared();

    if let Some(outcome) = collision(edge, s, line_distance_sq, radius_sq) {
        return outcome;
    }
    match cone(agent.parameters.radius, edge, s, line_distance_sq, radius_sq) {
        Some(cone) => project(agent, vertices, index, &cone, inv_horizon),
        None => Contribution::Nothing,
    }
}

/// The half-plane of a disc that touches the edge already: it moves away from it at once.
fn collision(edge: &Edge, s: f32, line_distance_sq: f32, radius_sq: f32) -> Option<Contribution> {
    let away_from = |relative: Vec2| {
        Contribution::Line(Line {
            point: Vec2::ZERO,
            direction: normalise(Vec2::new(-relative.y, relative.x)),
        })
    };
    if s < 0.0 && edge.relative_left.length_squared() <= radius_sq {
        // A reflex corner is the neighbouring edge's business.
        return Some(if edge.left.is_convex { away_from(edge.relative_left) } else { Contribution::Nothing });
    }
    if s > 1.0 && edge.relative_right.length_squared() <= radius_sq {
        let is_ours = edge.right.is_convex && det(edge.relative_right, edge.right.direction) >= 0.0;
        return Some(if is_ours { away_from(edge.relative_right) } else { Contribution::Nothing });
    }
    if (0.0..=1.0).contains(&s) && line_distance_sq <= radius_sq {
        return Some(Contribution::Line(Line { point: Vec2::ZERO, direction: -edge.left.direction }));
    }
    None
}

/// Legs of the velocity obstacle; none when a reflex vertex is seen obliquely.
fn cone(radius: f32, edge: &Edge, s: f32, line_distance_sq: f32, radius_sq: f32) -> Option<Cone> {
    let Edge { left, right, relative_left, relative_right } = *edge;
    if s < 0.0 && line_distance_sq <= radius_sq {
        return left.is_convex.then(|| point_cone(left, relative_left, radius, radius_sq));
    }
    if s > 1.0 && line_distance_sq <= radius_sq {
        return right.is_convex.then(|| point_cone(right, relative_right, radius, radius_sq));
    }
    // At a reflex vertex the leg extends the cut-off line.
    let left_leg =
        if left.is_convex { tangent_left(relative_left, radius, radius_sq) } else { -left.direction };
    let right_leg =
        if right.is_convex { tangent_right(relative_right, radius, radius_sq) } else { left.direction };
    Some(Cone { left, right, is_point: false, left_leg, right_leg })
}

fn point_cone(vertex: Vertex, relative: Vec2, radius: f32, radius_sq: f32) -> Cone {
    Cone {
        left: vertex,
        right: vertex,
        is_point: true,
        left_leg: tangent_left(relative, radius, radius_sq),
        right_leg: tangent_right(relative, radius, radius_sq),
    }
}

/// Direction of the left tangent from the origin to the disc around `p`.
fn tangent_left(p: Vec2, radius: f32, radius_sq: f32) -> Vec2 {
    let distance_sq = p.length_squared();
    let leg = (distance_sq - radius_sq).sqrt();
    over(Vec2::new(p.x * leg - p.y * radius, p.x * radius + p.y * leg), distance_sq)
}

/// Direction of the right tangent.
fn tangent_right(p: Vec2, radius: f32, radius_sq: f32) -> Vec2 {
    let distance_sq = p.length_squared();
    let leg = (distance_sq - radius_sq).sqrt();
    over(Vec2::new(p.x * leg + p.y * radius, -p.x * radius + p.y * leg), distance_sq)
}

/// The line through the nearest point of the velocity obstacle's boundary to the present velocity.
fn project(agent: &Agent, vertices: &[Vertex], index: u32, cone: &Cone, inv_horizon: f32) -> Contribution {
    let Cone { left, right, is_point, mut left_leg, mut right_leg } = *cone;
    let velocity = agent.velocity;
    let margin = agent.parameters.radius * inv_horizon;

    // A leg can never point into the neighbouring edge of a convex vertex: that edge's cut-off line
    // takes its place, and a velocity that projects on such a foreign leg adds no constraint.
    let before_left = vertices[left.previous as usize].direction;
    let left_is_foreign = left.is_convex && det(left_leg, -before_left) >= 0.0;
    if left_is_foreign {
        left_leg = -before_left;
    }
    let right_is_foreign = right.is_convex && det(right_leg, right.direction) <= 0.0;
    if right_is_foreign {
        right_leg = right.direction;
    }

    let left_cutoff = inv_horizon * (left.point - agent.position);
    let right_cutoff = inv_horizon * (right.point - agent.position);
    let cutoff = right_cutoff - left_cutoff;

    let t = if is_point { 0.5 } else { (velocity - left_cutoff).dot(cutoff) / cutoff.length_squared() };
    let t_left = (velocity - left_cutoff).dot(left_leg);
    let t_right = (velocity - right_cutoff).dot(right_leg);

    let on_circle = |centre: Vec2| {
        let unit_w = normalise(velocity - centre);
        Contribution::Line(Line {
            point: centre + margin * unit_w,
            direction: Vec2::new(unit_w.y, -unit_w.x),
        })
    };
    if (t < 0.0 && t_left < 0.0) || (is_point && t_left < 0.0 && t_right < 0.0) {
        return on_circle(left_cutoff);
    }
    if t > 1.0 && t_right < 0.0 {
        return on_circle(right_cutoff);
    }

    let distance_sq = |excluded: bool, nearest: Vec2| {
        if excluded { f32::INFINITY } else { (velocity - nearest).length_squared() }
    };
    let cutoff_sq = distance_sq(is_point || !(0.0..=1.0).contains(&t), left_cutoff + t * cutoff);
    let left_sq = distance_sq(t_left < 0.0, left_cutoff + t_left * left_leg);
    let right_sq = distance_sq(t_right < 0.0, right_cutoff + t_right * right_leg);

    let along = |start: Vec2, direction: Vec2| {
        Contribution::Line(Line { point: start + margin * Vec2::new(-direction.y, direction.x), direction })
    };
    if cutoff_sq <= left_sq && cutoff_sq <= right_sq {
        // With both legs from one vertex this is out of reach, so the edge is the neighbour itself.
        return along(left_cutoff, -vertices[index as usize].direction);
    }
    if left_sq <= right_sq {
        return if left_is_foreign { Contribution::Nothing } else { along(left_cutoff, left_leg) };
    }
    if right_is_foreign { Contribution::Nothing } else { along(right_cutoff, -right_leg) }
}
