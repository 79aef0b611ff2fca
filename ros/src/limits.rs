//! Limits on the policy's commands that it cannot override, applied last.

use jostle_sim::RobotConfig;

use crate::params::CommandParams;
use crate::scan::Return;

/// Limits on commands.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    v_max: f64,
    w_max: f64,
    /// Distance, m, and half the angle that is ahead, rad.
    stop: Option<(f64, f64)>,
}

impl Limits {
    /// The limits of a robot, narrowed by parameters: a parameter above the robot's own limit
    /// changes nothing.
    pub fn new(robot: &RobotConfig, params: &CommandParams) -> Self {
        let narrowed = |own: f32, limit: Option<f64>| f64::from(own).min(limit.unwrap_or(f64::INFINITY));
        Self {
            v_max: narrowed(robot.v_max, params.v_max),
            w_max: narrowed(robot.w_max, params.w_max),
            stop: params.stop_distance.map(|distance| (distance, params.stop_arc / 2.0)),
        }
    }

    /// The command (v, ω) that is given instead of an action, or `None` if the action has a number
    /// that is not finite.
    ///
    /// v is within 0 and the highest speed, |ω| within the highest turning rate. With a return
    /// nearer than the stop distance ahead, v is 0; turning stays possible, so that the robot finds
    /// a way out.
    pub fn apply(&self, action: [f32; 2], returns: &[Return]) -> Option<[f64; 2]> {
        let [v, w] = action.map(f64::from);
        if !(v.is_finite() && w.is_finite()) {
            return None;
        }
        let v = if self.blocked(returns) { 0.0 } else { v.clamp(0.0, self.v_max) };
        Some([v, w.clamp(-self.w_max, self.w_max)])
    }

    /// True if something is nearer ahead than the robot may come.
    fn blocked(&self, returns: &[Return]) -> bool {
        let Some((distance, half_arc)) = self.stop else { return false };
        returns.iter().any(|seen| seen.range < distance && seen.angle.abs() - seen.half_width <= half_arc)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn limits(params: &CommandParams) -> Limits {
        Limits::new(&RobotConfig::default(), params)
    }

    fn at(angle: f64, range: f64) -> Return {
        Return { angle, half_width: 0.006, range }
    }

    #[test]
    fn commands_are_within_the_limits_whatever_the_policy_says() {
        let own = limits(&CommandParams::default());
        assert_eq!(own.apply([5.0, -9.0], &[]), Some([1.0, -1.0]));
        assert_eq!(own.apply([-1.0, 0.5], &[]), Some([0.0, 0.5]));
        let slow = limits(&CommandParams { v_max: Some(0.25), w_max: Some(0.5), ..CommandParams::default() });
        assert_eq!(slow.apply([1.0, 1.0], &[]), Some([0.25, 0.5]));
        assert_eq!(slow.apply([0.125, -0.25], &[]), Some([0.125, -0.25]));
        // A limit above the robot's own is none.
        let fast = limits(&CommandParams { v_max: Some(3.0), ..CommandParams::default() });
        assert_eq!(fast.apply([2.0, 0.0], &[]), Some([1.0, 0.0]));
    }

    #[test]
    fn numbers_that_are_none_are_no_command() {
        let own = limits(&CommandParams::default());
        for action in [[f32::NAN, 0.0], [0.0, f32::NAN], [f32::INFINITY, 0.0], [0.0, f32::NEG_INFINITY]] {
            assert_eq!(own.apply(action, &[]), None);
        }
    }

    #[test]
    fn nobody_drives_on_within_the_stop_distance() {
        let careful = limits(&CommandParams { stop_distance: Some(0.6), ..CommandParams::default() });
        assert_eq!(careful.apply([1.0, 0.5], &[at(0.3, 0.59)]), Some([0.0, 0.5]));
        assert_eq!(careful.apply([1.0, 0.5], &[at(0.3, 0.61)]), Some([1.0, 0.5]));
        // Behind the robot it does not count; on the arc's edge it does.
        assert_eq!(careful.apply([1.0, 0.5], &[at(PI, 0.1)]), Some([1.0, 0.5]));
        assert_eq!(careful.apply([1.0, 0.5], &[at(PI / 2.0 + 0.005, 0.1)]), Some([0.0, 0.5]));
        let all_round =
            limits(&CommandParams { stop_distance: Some(0.6), stop_arc: 7.0, ..CommandParams::default() });
        assert_eq!(all_round.apply([1.0, 0.0], &[at(PI, 0.1)]), Some([0.0, 0.0]));
        let off = limits(&CommandParams::default());
        assert_eq!(off.apply([1.0, 0.0], &[at(0.0, 0.0)]), Some([1.0, 0.0]));
    }
}
