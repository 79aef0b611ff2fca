//! A shape placed in the world: its outline for the laser's closed forms and its parry shape for
//! overlaps and casts.

use crate::geometry::{Pose, Shape};
use crate::trig::sin_cos;
use glam::Vec2;
use rapier2d::math::{Pose as ParryPose, Rotation};
use rapier2d::parry::query::{distance, intersection_test};
use rapier2d::prelude::{ColliderHandle, RigidBodyHandle, SharedShape};

/// The outline of a shape in its own frame, as the laser's closed forms use it.
#[derive(Clone)]
pub(crate) enum Outline {
    /// A disc.
    Circle(f32),
    /// The vertices of a convex outline, counter-clockwise.
    Closed(Vec<Vec2>),
    /// One edge, seen from both sides.
    Segment { a: Vec2, b: Vec2 },
}

/// A body or an obstacle at its pose, with the sine and cosine of its heading at hand.
#[derive(Clone)]
pub(crate) struct Solid {
    pub(crate) shape: Shape,
    pub(crate) outline: Outline,
    pub(crate) pose: Pose,
    /// (cos, sin) of the heading.
    pub(crate) rotation: Vec2,
    pub(crate) circumradius: f32,
    /// Half of the least width.
    pub(crate) half_width: f32,
    pub(crate) parry: SharedShape,
    pub(crate) collider: ColliderHandle,
    pub(crate) body: Option<RigidBodyHandle>,
}

impl Solid {
    /// A valid shape at a pose, not yet in rapier's sets.
    pub(crate) fn new(shape: &Shape, pose: Pose) -> Self {
        let mut solid = Self {
            outline: outline(shape),
            pose,
            rotation: Vec2::X,
            circumradius: shape.circumradius(),
            half_width: shape.least_half_width(),
            parry: parry_shape(shape),
            shape: shape.clone(),
            collider: ColliderHandle::invalid(),
            body: None,
        };
        solid.place(pose);
        solid
    }

    /// Moves the solid; its rapier collider is moved by the world.
    pub(crate) fn place(&mut self, pose: Pose) {
        let (sin, cos) = sin_cos(pose.heading);
        self.pose = pose;
        self.rotation = Vec2::new(cos, sin);
    }

    /// The pose in parry's terms.
    pub(crate) fn parry_pose(&self) -> ParryPose {
        let rotation = Rotation::from_cos_sin_unchecked(self.rotation.x, self.rotation.y);
        ParryPose::from_parts(self.pose.position, rotation)
    }

    /// Distance from a point to the solid, m; 0 inside.
    pub(crate) fn distance_to(&self, point: Vec2) -> f32 {
        let offset = point - self.pose.position;
        match &self.shape {
            Shape::Circle { radius } => (offset.length() - radius).max(0.0),
            Shape::Box { length, width } => {
                let local = Vec2::new(self.rotation.dot(offset), self.rotation.perp_dot(offset));
                (local.abs() - Vec2::new(*length, *width) / 2.0).max(Vec2::ZERO).length()
            }
            Shape::Segment { .. } | Shape::Polygon { .. } => {
                self.parry.distance_to_point(&self.parry_pose(), point, true)
            }
        }
    }

    /// True if two solids share a point; touching counts.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let reach = self.circumradius + other.circumradius;
        if self.pose.position.distance_squared(other.pose.position) > reach * reach {
            return false;
        }
        intersection_test(&self.parry_pose(), &*self.parry, &other.parry_pose(), &*other.parry)
            .expect("parry tests every pair of balls, cuboids, segments and convex polygons")
            .intersecting
    }

    /// Distance between the outlines of two solids, or `most` if they are farther apart: 0 where
    /// they share a point.
    pub(crate) fn distance(&self, other: &Self, most: f32) -> f32 {
        let reach = self.circumradius + other.circumradius;
        if self.pose.position.distance(other.pose.position) - reach >= most {
            return most;
        }
        distance(&self.parry_pose(), &*self.parry, &other.parry_pose(), &*other.parry)
            .expect("parry measures every pair of balls, cuboids, segments and convex polygons")
            .distance
            .min(most)
    }
}

fn outline(shape: &Shape) -> Outline {
    match shape {
        Shape::Circle { radius } => Outline::Circle(*radius),
        Shape::Segment { a, b } => Outline::Segment { a: *a, b: *b },
        Shape::Box { .. } | Shape::Polygon { .. } => Outline::Closed(shape.vertices()),
    }
}

fn parry_shape(shape: &Shape) -> SharedShape {
    match shape {
        Shape::Circle { radius } => SharedShape::ball(*radius),
        Shape::Box { length, width } => SharedShape::cuboid(length / 2.0, width / 2.0),
        Shape::Segment { a, b } => SharedShape::segment(*a, *b),
        Shape::Polygon { vertices } => SharedShape::convex_polyline_unmodified(vertices.clone())
            .expect("a validated polygon has an area and more than two vertices"),
    }
}
