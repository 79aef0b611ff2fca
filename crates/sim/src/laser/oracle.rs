//! The oracle kernel: one parry ray cast per beam and shape, over the beams that the shape's
//! bounding circle covers.
//!
//! parry's own cast of a segment (and so of a polygon's sides) is off by more than 1e-4 m on some
//! beams, rarely by a metre, and its cast of a small ball far away loses 1e-4 m to cancellation:
//! sides and discs are solved here, in f64. Directions are computed in the world frame: nothing is
//! shared with the closed forms but the table of beam angles.

use super::{Directions, Hit, ScanSummary, nearest, rotation};
use crate::config::LaserConfig;
use crate::geometry::Pose;
use crate::solid::{Outline, Solid};
use crate::world::World;
use glam::{DVec2, Vec2};
use rapier2d::parry::query::{Ray, RayCast};
use rapier2d::parry::shape::HalfSpace;

/// Casts all beams; `hits` may be empty.
pub(super) fn cast(
    world: &World,
    sensor: Pose,
    sees: &impl Fn(usize) -> bool,
    config: &LaserConfig,
    directions: &Directions,
    ranges: &mut [f32],
    hits: &mut [Hit],
) -> ScanSummary {
    let turned = rotation(sensor.heading);
    let (x, y) = (directions.x.as_flattened(), directions.y.as_flattened());
    let mut summary = ScanSummary { min_range: config.range, nearest: Hit::None };
    for (beam, range) in ranges.iter_mut().enumerate() {
        let ray = Ray::new(sensor.position, turned.rotate(Vec2::new(x[beam], y[beam])));
        let (t, hit) = cast_beam(world, &ray, sees, config.range);
        *range = t;
        if let Some(slot) = hits.get_mut(beam) {
            *slot = hit;
        }
        if t < summary.min_range {
            summary = ScanSummary { min_range: t, nearest: hit };
        }
    }
    if !config.is_full_circle() {
        return nearest::around(world, sensor.position, sees, config.range);
    }
    summary
}

/// The nearest hit of one beam.
fn cast_beam(world: &World, ray: &Ray, sees: &impl Fn(usize) -> bool, range: f32) -> (f32, Hit) {
    let mut best = (range, Hit::None);
    let mut offer = |t: Option<f32>, hit: Hit| {
        if let Some(t) = t.filter(|t| *t < best.0) {
            best = (t, hit);
        }
    };
    if let Some(walls) = world.walls_box() {
        for (point, inwards) in
            [(walls.min, Vec2::X), (walls.min, Vec2::Y), (walls.max, -Vec2::X), (walls.max, -Vec2::Y)]
        {
            let local = Ray::new(ray.origin - point, ray.dir);
            offer(HalfSpace::new(inwards).cast_local_ray(&local, range, true), Hit::Wall(0));
        }
    }
    for (i, obstacle) in world.obstacles().iter().enumerate() {
        offer(cast_solid(obstacle, ray, range), Hit::Obstacle(i));
    }
    for (i, body) in world.bodies().iter().enumerate().filter(|(i, _)| sees(*i)) {
        offer(cast_solid(body, ray, range), Hit::Body(i));
    }
    best
}

/// One beam against one shape; beams outside the shape's bounding circle are not cast.
fn cast_solid(solid: &Solid, ray: &Ray, range: f32) -> Option<f32> {
    let offset = solid.pose.position - ray.origin;
    let margin = solid.circumradius + 1e-3;
    if ray.dir.perp_dot(offset).abs() > margin || ray.dir.dot(offset) < -margin {
        return None;
    }
    match &solid.outline {
        Outline::Segment { a, b } => cast_side(&local(solid, ray), *a, *b),
        Outline::Closed(vertices) if solid.parry.as_cuboid().is_none() => {
            cast_sides(&local(solid, ray), vertices)
        }
        Outline::Circle(radius) => cast_disc(&local(solid, ray), f64::from(*radius)),
        Outline::Closed(_) => solid.parry.cast_ray(&solid.parry_pose(), ray, range, true),
    }
}

/// The ray in a solid's frame, in f64.
fn local(solid: &Solid, ray: &Ray) -> (DVec2, DVec2) {
    let turned = |v: DVec2| {
        let rotation = solid.rotation.as_dvec2();
        DVec2::new(rotation.dot(v), rotation.perp_dot(v))
    };
    (turned(ray.origin.as_dvec2() - solid.pose.position.as_dvec2()), turned(ray.dir.as_dvec2()))
}

/// The nearest side of a convex outline, or 0 from inside it.
fn cast_sides(ray: &(DVec2, DVec2), vertices: &[Vec2]) -> Option<f32> {
    let sides = || vertices.iter().zip(vertices.iter().cycle().skip(1));
    let inside = |(a, b): (&Vec2, &Vec2)| (b.as_dvec2() - a.as_dvec2()).perp_dot(ray.0 - a.as_dvec2()) >= 0.0;
    if sides().all(inside) {
        return Some(0.0);
    }
    sides().filter_map(|(a, b)| cast_side(ray, *a, *b)).reduce(f32::min)
}

/// Ray against a disc around the origin; 0 from inside it.
fn cast_disc((origin, direction): &(DVec2, DVec2), radius: f64) -> Option<f32> {
    if origin.length() <= radius {
        return Some(0.0);
    }
    let (ahead, beside) = (-direction.dot(*origin), direction.perp_dot(*origin));
    let t = ahead - (radius * radius - beside * beside).max(0.0).sqrt();
    (ahead > 0.0 && beside.abs() <= radius).then_some(t as f32)
}

/// Ray against segment: origin + t·d = a + u·(b − a), 0 ≤ u ≤ 1, 0 ≤ t.
fn cast_side((origin, direction): &(DVec2, DVec2), a: Vec2, b: Vec2) -> Option<f32> {
    let (along, to_a) = (b.as_dvec2() - a.as_dvec2(), a.as_dvec2() - *origin);
    let determinant = direction.perp_dot(along);
    let (t, u) = (to_a.perp_dot(along) / determinant, to_a.perp_dot(*direction) / determinant);
    (determinant != 0.0 && (0.0..=1.0).contains(&u) && t >= 0.0).then_some(t as f32)
}
