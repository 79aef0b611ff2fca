//! From a velocity that a holonomic model asks for to the command of a robot that can only turn and
//! drive on.

use glam::Vec2;
use jostle_sim::{RobotConfig, wrap_angle};

use super::reader::angle_of;

/// Turns towards a velocity (in the world's frame) as fast as that takes no more than one control
/// period, and drives the part of it that lies ahead.
pub(super) fn steer(velocity: Vec2, heading: f32, robot: &RobotConfig, dt: f32) -> [f32; 2] {
    if velocity == Vec2::ZERO {
        return [0.0; 2];
    }
    let turn = wrap_angle(f64::from(angle_of(velocity) - heading));
    let ahead = velocity.length() * libm::cosf(turn);
    [ahead.clamp(0.0, robot.v_max), (turn / dt).clamp(-robot.w_max, robot.w_max)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_turns_first_and_drives_what_lies_ahead() {
        let robot = RobotConfig::default();
        let command = |x: f32, y: f32, heading: f32| steer(Vec2::new(x, y), heading, &robot, 0.1);
        assert_eq!(command(0.0, 0.0, 1.0), [0.0, 0.0]);
        assert_eq!(command(0.8, 0.0, 0.0), [0.8, 0.0]);
        assert_eq!(command(2.0, 0.0, 0.0), [1.0, 0.0]);
        assert_eq!(command(-1.0, 0.1, 0.0), [0.0, 1.0]);
        let [v, w] = command(0.0, -1.0, std::f32::consts::FRAC_PI_2);
        assert!(v == 0.0 && w.abs() == 1.0, "straight behind: either way");
        // 0.05 rad off: turned through within the period.
        let [v, w] = steer(Vec2::from_angle(0.05), 0.0, &robot, 0.1);
        assert!((v - 0.05_f32.cos()).abs() < 1e-6 && (w - 0.5).abs() < 1e-6);
    }
}
