//! The reward of a step (paper Sec. IV, the reward equation; `d_col` there is the goal radius).

use crate::config::{RewardConfig, SafetyZoneConfig};
use crate::episode::Outcome;
use glam::Vec2;

/// The outcome of a step, but for the time limit, in the order of the paper's equation: the goal
/// before a crash.
///
/// `crash`: the kind of collision, if there is one.
pub fn outcome(goal_distance: f32, goal_radius: f32, crash: Option<Outcome>) -> Option<Outcome> {
    if goal_distance < goal_radius { Some(Outcome::Success) } else { crash }
}

/// Reward of one step, without the safety-zone terms.
///
/// `progress` is the distance to the goal before the step less that after it, m; `w` the executed
/// angular velocity.
///
/// # Formula
///
/// `r = r_goal` if the goal was reached, else `r_collision` if crashed, else `c·(d_{t−1} − d_t)`;
/// plus `r_rotation·|ω|` where |ω| exceeds the threshold.
pub fn reward(config: &RewardConfig, outcome: Option<Outcome>, progress: f32, w: f32) -> f32 {
    let main = match outcome {
        Some(Outcome::Success) => config.goal,
        Some(Outcome::CollisionWall | Outcome::CollisionPedestrian) => config.collision,
        Some(Outcome::Timeout) | None => config.progress * progress,
    };
    let turning = if w.abs() > config.rotation_threshold { config.rotation * w.abs() } else { 0.0 };
    main + turning
}

/// A body as the social term sees it: ground truth, for training only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoneBody {
    /// Position in the world, m.
    pub position: Vec2,
    /// Velocity in the world, m/s.
    pub velocity: Vec2,
}

/// The safety-zone terms (Jin-style; see [`SafetyZoneConfig`]), never positive.
///
/// # Formula
///
/// Ego: `−w_e·(d_e − d_min)` where `crash_range ≤ d_min < d_e`. Social: `−w_s·Σ overlap` over the
/// others, where a body's zone is a disc around p + ½·h·u of radius ρ + ½·h·|u| (it reaches h·|u|
/// further ahead than behind), and the overlap of two zones is max(0, 1 − distance/(sum of the
/// radii)).
pub fn safety_zone(
    config: &SafetyZoneConfig,
    min_range: f32,
    crash_range: f32,
    own: ZoneBody,
    others: impl Iterator<Item = ZoneBody>,
) -> f32 {
    let ego = if min_range >= crash_range && min_range < config.ego_radius {
        config.ego_radius - min_range
    } else {
        0.0
    };
    let half = 0.5 * config.social_horizon;
    let zone =
        |b: ZoneBody| (b.position + half * b.velocity, config.social_radius + half * b.velocity.length());
    let (centre, radius) = zone(own);
    let overlap = |other: ZoneBody| {
        let (c, r) = zone(other);
        (1.0 - centre.distance(c) / (radius + r)).max(0.0)
    };
    let social: f32 = others.map(overlap).sum();
    -(config.ego_weight * ego + config.social_weight * social)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_that_applies() {
        let config = RewardConfig::default();
        let crash = Some(Outcome::CollisionWall);
        assert_eq!(outcome(0.49, 0.5, crash), Some(Outcome::Success));
        assert_eq!(outcome(0.5, 0.5, crash), crash);
        assert_eq!(outcome(0.5, 0.5, None), None);
        assert_eq!(reward(&config, Some(Outcome::Success), 9.0, 0.7), 15.0);
        assert_eq!(reward(&config, crash, 9.0, -0.5), -15.0);
        assert_eq!(reward(&config, None, 0.1, 0.0), 0.25);
        assert!((reward(&config, None, -0.1, -0.8) - (-0.25 - 0.08)).abs() < 1e-6);
        assert!((reward(&config, Some(Outcome::Success), 0.0, 1.0) - 14.9).abs() < 1e-6);
    }

    #[test]
    fn zones_cost_when_they_are_entered() {
        let config = SafetyZoneConfig::default();
        let at = |x: f32, vx: f32| ZoneBody { position: Vec2::new(x, 0.0), velocity: Vec2::new(vx, 0.0) };
        let cost = |min_range, other| safety_zone(&config, min_range, 0.5, at(0.0, 0.0), [other].into_iter());
        assert_eq!(cost(1.2, at(5.0, 0.0)), 0.0);
        assert!((cost(0.7, at(5.0, 0.0)) + 0.3 * 0.5).abs() < 1e-6);
        assert_eq!(cost(0.49, at(5.0, 0.0)), 0.0);
        // Standing at 0.6 m: 1 − 0.6/0.8; walking towards us at 1 m/s: centre 0.1 m away, radii 0.4
        // + 0.9.
        assert!((cost(2.0, at(0.6, 0.0)) + 0.3 * 0.25).abs() < 1e-6);
        assert!((cost(2.0, at(0.6, -1.0)) + 0.3 * (1.0 - 0.1 / 1.3)).abs() < 1e-6);
    }
}
