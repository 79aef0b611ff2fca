//! Four wheels on flat ground: two on either side, turned together by one motor a side.
//!
//! A wheel resists sliding over the ground by at most μ times its load, in whatever direction
//! (Coulomb's friction circle). Along the wheel the ground moves at the wheel's own speed, and
//! there the motor's torque is a second limit. The impulses of a step are those that leave the
//! least sliding within these limits: projected steps of steepest descent on the sum's kinetic
//! energy, as seen from the moving treads, one wheel after the other. So wheels that stand or run
//! free never add energy.
//!
//! # Formula
//!
//! A base that turns on the spot, its treads at ±k·ω·b/2, slides at every wheel and turns at
//! k·ω·(b/2)² / ((b/2)² + (l/2)²), b the track and l the wheelbase: there the moments of sliding
//! along and across the wheels are in balance.

use crate::config::BaseConfig;
use glam::Vec2;

/// Acceleration of free fall, m/s².
const GRAVITY: f32 = 9.81;
/// Rounds over the four wheels in a step.
const ROUNDS: usize = 10;

/// The motion of a base in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Twist {
    /// Velocity of the centre, x forward, y left, m/s.
    pub(super) velocity: Vec2,
    /// Turn rate, rad/s.
    pub(super) turn: f32,
}

impl Twist {
    /// Velocity of the ground's contact at a place of the base, m/s.
    fn at(self, place: Vec2) -> Vec2 {
        self.velocity + self.turn * place.perp()
    }
}

/// The twist after `dt` of friction, the motors holding the command (v, ω).
pub(super) fn push(base: &BaseConfig, twist: Twist, [v, w]: [f32; 2], dt: f32) -> Twist {
    let half = Vec2::new(base.wheelbase, base.track) / 2.0;
    let places = [half, Vec2::new(-half.x, half.y), -half, Vec2::new(half.x, -half.y)];
    let inverse_mass = 1.0 / base.mass + half.length_squared() / base.inertia;
    let grip = base.friction * base.mass * GRAVITY / 4.0 * dt;
    // Speed of a tread where it would hold the base to the command without sliding sideways.
    let tread = places.map(|place| v - base.turn_gain * w * place.y);
    let limits = places.map(|place| motor(base, twist.at(place).x, dt));
    let mut impulses = [Vec2::ZERO; 4];
    let mut now = twist;
    for _ in 0..ROUNDS {
        for wheel in 0..4 {
            let sliding = now.at(places[wheel]) - Vec2::new(tread[wheel], 0.0);
            let wanted = impulses[wheel] - sliding / inverse_mass;
            let impulse = within(wanted, grip, limits[wheel]);
            let change = impulse - impulses[wheel];
            impulses[wheel] = impulse;
            now.velocity += change / base.mass;
            now.turn += places[wheel].perp_dot(change) / base.inertia;
        }
    }
    now
}

/// The least and the largest impulse that a motor gives a wheel which runs over the ground at
/// `speed`: its torque falls in a straight line from the one at rest to none at its free speed;
/// against the motion it has all of it.
fn motor(base: &BaseConfig, speed: f32, dt: f32) -> (f32, f32) {
    let most = base.motor_torque / base.wheel_radius * dt;
    let left = (1.0 - speed.abs() / (base.motor_speed * base.wheel_radius)).max(0.0);
    if speed > 0.0 { (-most, most * left) } else { (-most * left, most) }
}

/// The point nearest to `wanted` of a disc around the origin, cut off on both sides.
fn within(wanted: Vec2, radius: f32, (low, high): (f32, f32)) -> Vec2 {
    let in_disc = wanted.clamp_length_max(radius);
    let x = in_disc.x.clamp(low, high);
    if x == in_disc.x {
        return in_disc;
    }
    let y = (radius * radius - x * x).max(0.0).sqrt();
    Vec2::new(x, wanted.y.clamp(-y, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: f32 = 0.005;

    fn twist(x: f32, y: f32, turn: f32) -> Twist {
        Twist { velocity: Vec2::new(x, y), turn }
    }

    fn energy(base: &BaseConfig, twist: Twist) -> f64 {
        let squared = f64::from(twist.velocity.x).powi(2) + f64::from(twist.velocity.y).powi(2);
        0.5 * (f64::from(base.mass) * squared + f64::from(base.inertia) * f64::from(twist.turn).powi(2))
    }

    /// A base whose motors give nothing.
    fn free() -> BaseConfig {
        BaseConfig { motor_torque: 0.0, ..BaseConfig::default() }
    }

    #[track_caller]
    fn near(found: f32, expected: f32, tolerance: f32) {
        assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected}");
    }

    #[test]
    fn free_wheels_roll_on_and_slide_to_a_stop() {
        let base = free();
        let mut now = twist(1.5, 1.0, 0.0);
        let mut way = 0.0;
        for step in 1..=100 {
            now = push(&base, now, [0.0, 0.0], STEP);
            way += now.velocity.y * STEP;
            // Sideways it slows down by μ·g, ahead not at all.
            let left = (1.0 - base.friction * GRAVITY * STEP * step as f32).max(0.0);
            near(now.velocity.y, left, 1e-4);
            near(now.velocity.x, 1.5, 1e-6);
            near(now.turn, 0.0, 1e-5);
        }
        // v²/(2·μ·g), less the half step that the sum comes short of.
        near(way, 1.0 / (2.0 * base.friction * GRAVITY) - STEP / 2.0, 2e-4);
    }

    #[test]
    fn a_strong_motor_is_held_by_the_grip_and_a_weak_one_by_its_torque() {
        let base = BaseConfig::default();
        let faster = push(&base, twist(0.0, 0.0, 0.0), [2.0, 0.0], STEP);
        near(faster.velocity.x, base.friction * GRAVITY * STEP, 1e-6);
        let weak = BaseConfig { motor_torque: 0.2, ..base };
        let slower = push(&weak, twist(0.0, 0.0, 0.0), [2.0, 0.0], STEP);
        near(slower.velocity.x, 4.0 * 0.2 / base.wheel_radius / base.mass * STEP, 1e-6);
        // At half the free speed it has half the torque, and against the motion all of it.
        let half = base.motor_speed * base.wheel_radius / 2.0;
        let gained = push(&weak, twist(half, 0.0, 0.0), [10.0, 0.0], STEP).velocity.x - half;
        near(gained, slower.velocity.x / 2.0, 1e-6);
        let lost = half - push(&weak, twist(half, 0.0, 0.0), [0.0, 0.0], STEP).velocity.x;
        near(lost, slower.velocity.x, 1e-6);
    }

    #[test]
    fn turning_on_the_spot_slides_as_the_formula_says() {
        for (gain, w) in [(1.5, 1.0), (1.0, 0.7), (1.5, -0.4)] {
            let base = BaseConfig { turn_gain: gain, ..BaseConfig::default() };
            let mut now = twist(0.0, 0.0, 0.0);
            for _ in 0..400 {
                now = push(&base, now, [0.0, w], STEP);
            }
            let [long, wide] = [base.wheelbase, base.track].map(|side| (side / 2.0).powi(2));
            near(now.turn, gain * w * wide / (wide + long), 0.01 * w.abs());
            near(now.velocity.length(), 0.0, 1e-4);
        }
    }

    #[test]
    fn the_nearest_point_of_a_cut_disc() {
        let check = |wanted: [f32; 2], expected: [f32; 2]| {
            let found = within(Vec2::from(wanted), 5.0, (-5.0, 3.0));
            assert!(found.distance(Vec2::from(expected)) < 1e-6, "{wanted:?}: {found}");
        };
        check([1.0, 2.0], [1.0, 2.0]);
        check([-6.0, 8.0], [-3.0, 4.0]);
        check([4.0, 0.5], [3.0, 0.5]);
        check([9.0, 9.0], [3.0, 4.0]);
        check([9.0, -1.0], [3.0, -1.0]);
    }

    proptest! {
        /// Wheels that stand still, or are free, only take energy; on a base of any proportions.
        #[test]
        fn friction_adds_no_energy(
            x in -5.0_f32..5.0, y in -5.0_f32..5.0, turn in -10.0_f32..10.0,
            mass in 1.0_f32..100.0, inertia in 0.05_f32..20.0, friction in 0.0_f32..2.0,
            wheelbase in 0.05_f32..1.0, track in 0.05_f32..1.0, torque in prop_oneof![Just(0.0_f32), 0.0_f32..50.0],
        ) {
            let base = BaseConfig {
                mass, inertia, friction, wheelbase, track, motor_torque: torque, ..BaseConfig::default()
            };
            let mut now = twist(x, y, turn);
            for _ in 0..200 {
                let next = push(&base, now, [0.0, 0.0], STEP);
                let (before, after) = (energy(&base, now), energy(&base, next));
                prop_assert!(after <= before * (1.0 + 1e-6) + 1e-9, "{before} J, then {after} J");
                now = next;
            }
        }
    }
}
