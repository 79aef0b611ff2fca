//! The velocity nearest to the preferred one that the half-planes and the speed limit allow: RVO2's
//! three linear programs.
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
    line::{Line, det, normalise},
};

/// The aim of an optimisation.
#[derive(Clone, Copy, PartialEq)]
enum Aim {
    /// The point nearest to the velocity.
    Closest(Vec2),
    /// The point farthest along the unit vector.
    Farthest(Vec2),
}

/// The velocity that the lines leave, at most `max_speed` fast and as near to `preferred` as
/// possible. The first `n_obstacle_lines` are hard; when no velocity meets all, the agent lines are
/// violated as little as possible.
///
/// All lines must be determined. `projected` is scratch memory.
pub(super) fn solve(
    lines: &[Line],
    n_obstacle_lines: usize,
    max_speed: f32,
    preferred: Vec2,
    projected: &mut Vec<Line>,
) -> Vec2 {
    match linear_program_2(lines, max_speed, Aim::Closest(preferred)) {
        Ok(velocity) => velocity,
        Err((failed, velocity)) => {
            linear_program_3(lines, n_obstacle_lines, failed, max_speed, velocity, projected)
        }
    }
}

/// Optimum on the last line of `lines` subject to the ones before it and to the circle; none if
/// infeasible.
#[inline]
fn linear_program_1(line: Line, before: &[Line], radius: f32, aim: Aim) -> Option<Vec2> {
    let dot = line.point.dot(line.direction);
    let discriminant = dot * dot + radius * radius - line.point.length_squared();
    if discriminant < 0.0 {
        // The circle of the speed limit lies wholly on the forbidden side.
        return None;
    }

    let root = discriminant.sqrt();
    let mut t_left = -dot - root;
    let mut t_right = -dot + root;

    for other in before {
        let denominator = det(line.direction, other.direction);
        let numerator = det(other.direction, line.point - other.point);

        if denominator.abs() <= EPSILON {
            // Almost parallel.
            if numerator < 0.0 {
                return None;
            }
            continue;
        }

        let t = numerator / denominator;
        if denominator >= 0.0 {
            t_right = t_right.min(t);
        } else {
            t_left = t_left.max(t);
        }
        if t_left > t_right {
            return None;
        }
    }

    let t = match aim {
        Aim::Farthest(direction) => {
            if direction.dot(line.direction) > 0.0 {
                t_right
            } else {
                t_left
            }
        }
        Aim::Closest(velocity) => {
            let t = line.direction.dot(velocity - line.point);
            if t < t_left {
                t_left
            } else if t > t_right {
                t_right
            } else {
                t
            }
        }
    };
    Some(line.point + t * line.direction)
}

/// Optimum subject to all lines and the circle; else the first line that cannot be met, and the
/// optimum before it.
#[inline]
fn linear_program_2(lines: &[Line], radius: f32, aim: Aim) -> Result<Vec2, (usize, Vec2)> {
    let mut result = match aim {
        Aim::Farthest(direction) => direction * radius,
        Aim::Closest(velocity) if velocity.length_squared() > radius * radius => normalise(velocity) * radius,
        Aim::Closest(velocity) => velocity,
    };
    for (i, line) in lines.iter().enumerate() {
        if line.violation(result) > 0.0 {
            result = linear_program_1(*line, &lines[..i], radius, aim).ok_or((i, result))?;
        }
    }
    Ok(result)
}

/// The velocity that violates the agent lines from `begin` on least, obstacle lines kept.
#[cold]
fn linear_program_3(
    lines: &[Line],
    n_obstacle_lines: usize,
    begin: usize,
    radius: f32,
    mut result: Vec2,
    projected: &mut Vec<Line>,
) -> Vec2 {
    let mut distance = 0.0;
    for (i, line) in lines.iter().enumerate().skip(begin) {
        if line.violation(result) <= distance {
            continue;
        }
        projected.clear();
        projected.extend_from_slice(&lines[..n_obstacle_lines]);
        projected.extend(lines[n_obstacle_lines.min(i)..i].iter().filter_map(|other| bisector(line, other)));

        let upwards = Vec2::new(-line.direction.y, line.direction.x);
        // A failure here can only be a rounding error, since the present result is feasible by
        // construction: it is kept.
        if let Ok(better) = linear_program_2(projected, radius, Aim::Farthest(upwards)) {
            result = better;
        }
        distance = line.violation(result);
    }
    result
}

/// Line of equal violation of `line` and `other`; none when they point the same way.
#[inline]
fn bisector(line: &Line, other: &Line) -> Option<Line> {
    let determinant = det(line.direction, other.direction);
    let point = if determinant.abs() <= EPSILON {
        if line.direction.dot(other.direction) > 0.0 {
            return None;
        }
        0.5 * (line.point + other.point)
    } else {
        line.point + (det(other.direction, line.point - other.point) / determinant) * line.direction
    };
    Some(Line { point, direction: normalise(other.direction - line.direction) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(lines: &[Line], n_obstacle_lines: usize, preferred: Vec2, expected: Vec2) {
        let got = solve(lines, n_obstacle_lines, 1.0, preferred, &mut Vec::new());
        assert!(got.distance(expected) < 1e-6, "{got} is not {expected}");
    }

    /// Allows velocities with x at most the given.
    fn x_at_most(x: f32) -> Line {
        Line { point: Vec2::new(x, 0.0), direction: Vec2::Y }
    }

    /// Allows velocities with x at least the given.
    fn x_at_least(x: f32) -> Line {
        Line { point: Vec2::new(x, 0.0), direction: -Vec2::Y }
    }

    #[test]
    fn without_lines_the_preferred_velocity_is_clipped_to_the_circle() {
        check(&[], 0, Vec2::new(0.3, 0.4), Vec2::new(0.3, 0.4));
        check(&[], 0, Vec2::new(3.0, 4.0), Vec2::new(0.6, 0.8));
    }

    #[test]
    fn the_nearest_allowed_velocity_is_taken() {
        check(&[x_at_most(0.2)], 0, Vec2::new(0.5, 0.1), Vec2::new(0.2, 0.1));
        let floor = Line { point: Vec2::new(0.0, 0.3), direction: Vec2::X };
        check(&[x_at_most(0.2), floor], 0, Vec2::new(0.5, 0.1), Vec2::new(0.2, 0.3));
    }

    #[test]
    fn contradicting_agent_lines_are_violated_equally() {
        let got = solve(&[x_at_most(0.2), x_at_least(0.6)], 0, 1.0, Vec2::new(0.0, 0.1), &mut Vec::new());
        assert!((got.x - 0.4).abs() < 1e-6, "{got}");
    }

    #[test]
    fn an_obstacle_line_is_kept_when_agent_lines_contradict_it() {
        let got = solve(&[x_at_most(0.2), x_at_least(0.6)], 1, 1.0, Vec2::new(0.0, 0.1), &mut Vec::new());
        assert!((got.x - 0.2).abs() < 1e-6, "{got}");
    }

    /// Powers of two scale without rounding.
    #[test]
    fn velocities_scale_with_lines_and_speed_limit() {
        let floor = Line { point: Vec2::new(0.0, 0.3), direction: Vec2::X };
        let best =
            |lines: &[Line], max_speed, preferred| solve(lines, 0, max_speed, preferred, &mut Vec::new());
        for lines in
            [&[][..], &[x_at_most(0.2)], &[x_at_most(0.2), floor], &[x_at_most(0.2), x_at_least(0.6)]]
        {
            for preferred in [Vec2::new(0.5, 0.1), Vec2::new(0.6, 3.0), Vec2::new(-0.1, -0.9)] {
                let of_one = best(lines, 1.0, preferred);
                for scale in [0.25, 4.0] {
                    let scaled: Vec<Line> =
                        lines.iter().map(|line| Line { point: scale * line.point, ..*line }).collect();
                    let got = best(&scaled, scale, scale * preferred);
                    assert_eq!(got, scale * of_one, "{lines:?}, {preferred}, times {scale}");
                }
            }
        }
    }

    #[test]
    fn almost_the_same_line_twice_contradicts_nothing() {
        let turned = Line { point: Vec2::new(0.2, 0.0), direction: Vec2::new(-1e-6, 1.0) };
        check(&[x_at_most(0.2), turned], 0, Vec2::new(0.6, 0.5), Vec2::new(0.2, 0.5));
    }
}
