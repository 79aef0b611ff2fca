//! The four terms of the model, one function each (Helbing & Molnár 1995, Eqs. 2–8). All forces are
//! accelerations, m/s².

use glam::DVec2;

use super::{Border, SocialForceConfig, ViewTest, Walker};

/// Unit vector to the goal; 0 at the goal.
fn direction(walker: &Walker) -> DVec2 {
    (walker.goal - walker.position).normalize_or_zero()
}

/// Drive to the desired velocity.
///
/// # Formula
/// F⁰ = (v⁰ e − v) / τ.
pub(super) fn goal_force(config: &SocialForceConfig, a: &Walker) -> DVec2 {
    (a.desired_speed * direction(a) - a.velocity) / config.tau
}

/// Repulsion of `a` by `b`, before the view of `a` weighs it.
///
/// # Formula
/// With r = xₐ − xᵦ and s = |vᵦ| Δt eᵦ: b = ½ √((|r| + |r − s|)² − |s|²), V = V⁰ exp(−b/σ), and
/// f = −∇V = (V/σ) ∇b, where ∇b = (|r| + |r − s|) / (4 b) · (r/|r| + (r − s)/|r − s|).
pub(super) fn pair_force(config: &SocialForceConfig, a: &Walker, b: &Walker) -> DVec2 {
    let r = a.position - b.position;
    let s = b.velocity.length() * config.variant.foresight() * direction(b);
    let from_step = r - s;
    let distances = r.length() + from_step.length();
    let semi_minor = 0.5 * (distances * distances - s.length_squared()).max(0.0).sqrt();
    let semi_minor = semi_minor.max(config.b_min);
    let gradient = distances / (4.0 * semi_minor) * (r.normalize_or_zero() + from_step.normalize_or_zero());
    config.v0 / config.sigma * (-semi_minor / config.sigma).exp() * gradient
}

/// Weight of the repulsion `force` of `a` by `b`: 1 in the view of `a`, else c.
///
/// # Formula
/// w = 1 if eₐ · u ≥ |u| cos φ, else c, with u = −f or, by the other test, u = −r.
pub(super) fn view_weight(config: &SocialForceConfig, a: &Walker, b: &Walker, force: DVec2) -> f64 {
    let u = match config.variant.view_test() {
        ViewTest::Force => -force,
        ViewTest::Position => b.position - a.position,
    };
    let cos_half_view = (0.5 * config.field_of_view_degrees).to_radians().cos();
    if direction(a).dot(u) >= u.length() * cos_half_view { 1.0 } else { config.out_of_view_weight }
}

/// Repulsion by the nearest point of a border; 0 where the border does not face the pedestrian.
///
/// # Formula
/// f = (U⁰/R) exp(−|d|/R) d/|d|, with d from the border's nearest point to the pedestrian.
pub(super) fn wall_force(config: &SocialForceConfig, position: DVec2, border: &Border) -> DVec2 {
    let Some(nearest) = border.nearest(position) else { return DVec2::ZERO };
    let d = position - nearest;
    config.u0 / config.r * (-d.length() / config.r).exp() * d.normalize_or_zero()
}
