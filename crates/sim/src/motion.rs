//! Motions: the move that a body is told to make in one control period, and the robot's limits on
//! it.

use crate::config::{AccelerationLimits, RobotConfig};
use glam::Vec2;

/// The motion of a body during one control period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Stays where it is.
    Still,
    /// Differential drive.
    Drive {
        /// Linear velocity along the heading, m/s.
        v: f32,
        /// Angular velocity, rad/s.
        w: f32,
    },
    /// Holonomic: moves by a velocity in the world frame, the heading unchanged.
    Walk {
        /// Velocity in the world frame, m/s.
        velocity: Vec2,
    },
}

/// The executed copy of a sampled action (v, ω): v within [0, `v_max`], ω within ±`w_max`.
///
/// # Panics
///
/// When a component is not finite: such an action must not get into a rollout.
pub fn clip_action(action: [f32; 2], robot: &RobotConfig) -> [f32; 2] {
    assert!(action.iter().all(|a| a.is_finite()), "action: found {action:?}, expected finite numbers");
    [action[0].clamp(0.0, robot.v_max), action[1].clamp(-robot.w_max, robot.w_max)]
}

/// The velocity that a robot at `current` has when it is commanded `command` for `dt`.
///
/// Without limits the command acts at once; with them each component moves towards it by at most
/// limit·dt.
pub fn apply_limits(
    current: [f32; 2],
    command: [f32; 2],
    limits: Option<&AccelerationLimits>,
    dt: f32,
) -> [f32; 2] {
    let Some(limits) = limits else { return command };
    let towards = |now: f32, wanted: f32, step: f32| now + (wanted - now).clamp(-step, step);
    [towards(current[0], command[0], limits.v * dt), towards(current[1], command[1], limits.w * dt)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_clipped_on_both_sides() {
        let robot = RobotConfig::default();
        assert_eq!(clip_action([-3.0, -3.0], &robot), [0.0, -1.0]);
        assert_eq!(clip_action([3.0, 3.0], &robot), [1.0, 1.0]);
        assert_eq!(clip_action([0.25, -0.5], &robot), [0.25, -0.5]);
    }

    #[test]
    #[should_panic(expected = "expected finite numbers")]
    fn an_action_that_is_not_finite_is_caught() {
        clip_action([f32::NAN, 0.0], &RobotConfig::default());
    }

    #[test]
    fn limits_bound_the_change_of_velocity() {
        let limits = AccelerationLimits { v: 2.0, w: 5.0 };
        assert_eq!(apply_limits([0.5, 0.0], [1.0, -1.0], None, 0.1), [1.0, -1.0]);
        let reached = apply_limits([0.5, 0.0], [1.0, -1.0], Some(&limits), 0.1);
        assert!((reached[0] - 0.7).abs() < 1e-6 && (reached[1] + 0.5).abs() < 1e-6);
        assert_eq!(apply_limits([0.5, 0.0], [0.45, 0.1], Some(&limits), 0.1), [0.45, 0.1]);
    }
}
