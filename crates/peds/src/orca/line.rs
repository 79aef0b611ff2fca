//! A half-plane of allowed velocities, and the plane vector arithmetic of RVO2 where its rounding
//! differs from glam's.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

/// A directed line in velocity space; velocities to the left of `direction` are allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// A point on the line, m/s.
    pub point: Vec2,
    /// Unit vector; NaN when the line is undetermined (coincident agents), and then it forbids
    /// nothing.
    pub direction: Vec2,
}

impl Line {
    /// True if the line constrains anything: not when two agents coincided and its direction is
    /// 0/0.
    pub fn is_determined(&self) -> bool {
        self.point.is_finite() && self.direction.is_finite()
    }

    /// Distance of `velocity` from the line, m/s: positive on the forbidden side, negative on the
    /// allowed one.
    #[inline]
    pub(super) fn violation(&self, velocity: Vec2) -> f32 {
        det(self.direction, self.point - velocity)
    }
}

/// Determinant of the matrix with columns `a` and `b`.
#[inline]
pub(super) fn det(a: Vec2, b: Vec2) -> f32 {
    a.x * b.y - a.y * b.x
}

/// Positive when `c` lies left of the line from `a` to `b` (twice the triangle's area).
#[inline]
pub(super) fn left_of(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    det(a - c, b - a)
}

/// Division as RVO2 rounds it: by the reciprocal.
#[inline]
pub(super) fn over(vector: Vec2, scalar: f32) -> Vec2 {
    vector * (1.0 / scalar)
}

/// Unit vector; NaN for the zero vector.
#[inline]
pub(super) fn normalise(vector: Vec2) -> Vec2 {
    over(vector, vector.length_squared().sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_is_positive() {
        assert_eq!(left_of(Vec2::ZERO, Vec2::X, Vec2::Y), 1.0);
        assert_eq!(left_of(Vec2::ZERO, Vec2::X, -Vec2::Y), -1.0);
        let line = Line { point: Vec2::ZERO, direction: Vec2::X };
        assert!(line.violation(Vec2::Y) < 0.0 && line.violation(-Vec2::Y) > 0.0);
    }

    #[test]
    fn the_zero_vector_has_no_direction() {
        let line = Line { point: Vec2::ZERO, direction: normalise(Vec2::ZERO) };
        assert!(!line.is_determined());
    }
    #[test]
    fn arithmetic_by_hand() {
        let (a, b) = (Vec2::new(2.0, 3.0), Vec2::new(5.0, 7.0));
        assert_eq!(det(a, b), -1.0);
        assert_eq!(left_of(Vec2::new(1.0, 1.0), a, b), -2.0);
        assert_eq!(over(b, 2.0), Vec2::new(2.5, 3.5));
        assert!(normalise(Vec2::new(3.0, 4.0)).distance(Vec2::new(0.6, 0.8)) < 1e-7);
        let line = Line { point: a, direction: Vec2::Y };
        // The velocity lies 3 to the right.
        assert_eq!(line.violation(b), 3.0);
        assert!(line.is_determined());
        assert!(!Line { point: Vec2::NAN, ..line }.is_determined());
        assert!(!Line { direction: Vec2::NAN, ..line }.is_determined());
    }
}
