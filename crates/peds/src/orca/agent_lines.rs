//! The half-plane that another agent induces: each of the two takes half of the change that avoids the collision.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust from the RVO2 Library
//! (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg, Stephen J. Guy, Jamie Snape, Ming C. Lin and
//! Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use super::{
    agent::{Agent, Body},
    line::{Line, det, over},
};

/// Half-plane of velocities of `agent` that leave it free of a collision with `other` for the time horizon,
/// if `other` does the same; for overlapping discs, that separate them within one time step.
///
/// Undetermined (NaN) when the discs overlap and the relative velocity is exactly the cut-off circle's centre.
#[inline]
pub(super) fn agent_line(agent: &Agent, other: &Body, inv_time_horizon: f32, inv_time_step: f32) -> Line {
    let relative_position = other.position - agent.position;
    let relative_velocity = agent.velocity - other.velocity;
    let distance_sq = relative_position.length_squared();
    let combined_radius = agent.parameters.radius + other.radius;
    let combined_radius_sq = combined_radius * combined_radius;

    let (direction, u) = if distance_sq > combined_radius_sq {
        // Vector from the centre of the cut-off circle to the relative velocity.
        let w = relative_velocity - inv_time_horizon * relative_position;
        let w_length_sq = w.length_squared();
        let along = w.dot(relative_position);

        if along < 0.0 && along * along > combined_radius_sq * w_length_sq {
            project_on_circle(w, w_length_sq.sqrt(), combined_radius * inv_time_horizon)
        } else {
            let direction =
                leg_direction(relative_position, w, distance_sq, combined_radius, combined_radius_sq);
            let u = relative_velocity.dot(direction) * direction - relative_velocity;
            (direction, u)
        }
    } else {
        let w = relative_velocity - inv_time_step * relative_position;
        project_on_circle(w, w.length_squared().sqrt(), combined_radius * inv_time_step)
    };
    Line { point: agent.velocity + 0.5 * u, direction }
}

/// Direction of the line and smallest change of velocity that leaves the circle; `w` points from its centre.
#[inline]
fn project_on_circle(w: Vec2, w_length: f32, radius: f32) -> (Vec2, Vec2) {
    let unit_w = over(w, w_length);
    (Vec2::new(unit_w.y, -unit_w.x), (radius - w_length) * unit_w)
}

/// Direction of the cone's leg on whose side `w` lies.
#[inline]
fn leg_direction(p: Vec2, w: Vec2, distance_sq: f32, radius: f32, radius_sq: f32) -> Vec2 {
    let leg = (distance_sq - radius_sq).sqrt();
    if det(p, w) > 0.0 {
        over(Vec2::new(p.x * leg - p.y * radius, p.x * radius + p.y * leg), distance_sq)
    } else {
        over(-Vec2::new(p.x * leg + p.y * radius, -p.x * radius + p.y * leg), distance_sq)
    }
}
