//! The half-plane that another agent induces: each of the two takes half of the change that avoids
//! the collision.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use super::{
    agent::{Agent, Body},
    line::{Line, det, over},
};

/// Half-plane of velocities of `agent` that leave it free of a collision with `other` for the time
/// horizon, if `agent` makes the share `responsibility` of the change and `other` the rest; for
/// overlapping discs, that separate them within one time step.
///
/// Undetermined (NaN) when the discs overlap and the relative velocity is exactly the cut-off
/// circle's centre.
#[inline]
pub(super) fn agent_line(
    agent: &Agent,
    other: &Body,
    inv_time_horizon: f32,
    inv_time_step: f32,
    responsibility: f32,
) -> Line {
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
    Line { point: agent.velocity + responsibility * u, direction }
}

/// Direction of the line and smallest change of velocity that leaves the circle; `w` points from
/// its centre.
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

#[cfg(test)]
mod tests {
    use super::*;

    use crate::orca::AgentParameters;

    fn agent(position: Vec2, velocity: Vec2) -> Agent {
        let parameters = AgentParameters {
            neighbour_distance: 10.0,
            max_neighbours: 10,
            time_horizon: 2.0,
            time_horizon_obstacles: 2.0,
            radius: 0.5,
            max_speed: 1.0,
        };
        Agent { position, velocity, preferred_velocity: Vec2::ZERO, planned_velocity: Vec2::ZERO, parameters }
    }

    fn body(position: Vec2, velocity: Vec2) -> Body {
        Body { position, velocity, radius: 0.5, agent: 1 }
    }

    #[test]
    fn discs_that_touch_separate_within_a_time_step() {
        // Collisions within 0.5 s: a disc of radius 2 around (2, 0). The relative velocity (0.8,
        // 0.9) lies 1.5 from its centre, so the way out is 0.5 along (−0.8, 0.6), of which each
        // takes half.
        let line =
            agent_line(&agent(Vec2::ZERO, Vec2::new(0.8, 0.9)), &body(Vec2::X, Vec2::ZERO), 0.5, 2.0, 0.5);
        assert!(line.direction.distance(Vec2::new(0.6, 0.8)) < 1e-6, "{line:?}");
        assert!(line.point.distance(Vec2::new(0.6, 1.05)) < 1e-6, "{line:?}");
    }

    #[test]
    fn before_the_cut_off_the_way_out_is_to_its_circle() {
        // 4 m apart: a circle of radius 0.5 around (2, 0); relative velocity (1.75, 0) leaves it by
        // −0.25.
        let line =
            agent_line(&agent(Vec2::ZERO, 1.75 * Vec2::X), &body(4.0 * Vec2::X, Vec2::ZERO), 0.5, 10.0, 0.5);
        assert_eq!(line, Line { point: 1.625 * Vec2::X, direction: Vec2::Y });
        // Who takes all of it on itself slows down by twice as much.
        let line =
            agent_line(&agent(Vec2::ZERO, 1.75 * Vec2::X), &body(4.0 * Vec2::X, Vec2::ZERO), 0.5, 10.0, 1.0);
        assert_eq!(line, Line { point: 1.5 * Vec2::X, direction: Vec2::Y });
    }

    #[test]
    fn beyond_the_cut_off_the_way_out_is_to_the_nearer_leg() {
        // 2 m apart with radius 1: legs at ±30° of the way to the other. A relative velocity of (4,
        // ±1) is nearer to the leg of its own side; straight ahead the right one is taken.
        for turn in [0.0, 1.0, -2.5] {
            for (across, side) in [(1.0, 1.0), (-1.0, -1.0), (0.0, -1.0)] {
                let turned = Vec2::from_angle(turn);
                let (at, velocity) = (turned.rotate(2.0 * Vec2::X), turned.rotate(Vec2::new(4.0, across)));
                if across == 0.0 && turn != 0.0 {
                    continue; // Rounding decides.
                }
                let line = agent_line(
                    &agent(Vec2::ONE, velocity),
                    &body(Vec2::ONE + at, Vec2::ZERO),
                    0.5,
                    10.0,
                    0.5,
                );
                let leg = turned.rotate(Vec2::from_angle(side * std::f32::consts::FRAC_PI_6));
                assert!(line.direction.distance(side * leg) < 1e-6, "{line:?}");
                let foot = velocity.dot(leg) * leg;
                assert!(line.point.distance(0.5 * (velocity + foot)) < 2e-6, "{line:?}");
            }
        }
    }
}
