//! Poses of the robot and its goal: the frames of odometry and goals.
//!
//! There is no transform tree here. A goal is understood in one of these frames, and refused in any
//! other:
//!
//! - the odometry's own (`header.frame_id`), or one that `goal.fixed_frames` says has the same
//!   origin: a fixed place;
//! - the robot's (`child_frame_id`): a place seen from where the robot is when the goal arrives,
//!   fixed from then on.
//!
//! A slash at a name's start is left out, as ROS 1 wrote it.

use crate::messages::{Odometry, PoseStamped, Quaternion};

/// The robot's pose and velocity, on the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The frame of the pose.
    pub fixed_frame: String,
    /// The robot's frame.
    pub robot_frame: String,
    /// Place, m, and heading, rad.
    pub pose: [f64; 3],
    /// v, m/s, and ω, rad/s.
    pub velocity: [f64; 2],
}

/// A goal as it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// Its frame.
    pub frame: String,
    /// Its place there, m.
    pub place: [f64; 2],
}

/// The pose and velocity in an odometry.
///
/// # Errors
///
/// Numbers that are not finite, a quaternion that is no rotation, frames without names: what was
/// found, what was expected.
pub fn motion(odometry: &Odometry) -> Result<Motion, String> {
    let (pose, twist) = (&odometry.pose.pose, &odometry.twist.twist);
    let numbers = [pose.position.x, pose.position.y, twist.linear.x, twist.angular.z];
    if let Some(found) = numbers.iter().find(|number| !number.is_finite()) {
        return Err(format!("found {found}, expected finite numbers"));
    }
    let heading = yaw(pose.orientation)?;
    Ok(Motion {
        fixed_frame: named("header.frame_id", &odometry.header.frame_id)?,
        robot_frame: named("child_frame_id", &odometry.child_frame_id)?,
        pose: [pose.position.x, pose.position.y, heading],
        velocity: [twist.linear.x, twist.angular.z],
    })
}

/// The wish in a goal; its heading is not read.
///
/// # Errors
///
/// Numbers that are not finite, a frame without a name.
pub fn wish(goal: &PoseStamped) -> Result<Wish, String> {
    let (x, y) = (goal.pose.position.x, goal.pose.position.y);
    if !(x.is_finite() && y.is_finite()) {
        return Err(format!("found ({x}, {y}), expected finite numbers"));
    }
    Ok(Wish { frame: named("header.frame_id", &goal.header.frame_id)?, place: [x, y] })
}

/// The goal in the odometry's frame, m.
///
/// # Errors
///
/// A frame that is neither the odometry's, nor the robot's, nor one of `fixed_frames`.
pub fn fixed_goal(wish: &Wish, motion: &Motion, fixed_frames: &[String]) -> Result<[f64; 2], String> {
    let frame = &wish.frame;
    if *frame == motion.fixed_frame || fixed_frames.iter().any(|fixed| without_slash(fixed) == *frame) {
        return Ok(wish.place);
    }
    if *frame == motion.robot_frame {
        let ([x, y, heading], [forward, left]) = (motion.pose, wish.place);
        let (sin, cos) = heading.sin_cos();
        return Ok([x + forward * cos - left * sin, y + forward * sin + left * cos]);
    }
    Err(format!(
        "found frame {frame}, expected {} or {} (parameter goal.fixed_frames adds frames with the odometry's origin)",
        motion.fixed_frame, motion.robot_frame
    ))
}

/// A fixed place seen from the robot: x forward, y left, m.
pub fn in_robot(place: [f64; 2], pose: [f64; 3]) -> [f64; 2] {
    let (dx, dy) = (place[0] - pose[0], place[1] - pose[1]);
    let (sin, cos) = pose[2].sin_cos();
    [dx * cos + dy * sin, dy * cos - dx * sin]
}

/// The rotation about z, rad.
///
/// # Formula
///
/// atan2(2(wz + xy), 1 − 2(y² + z²)) of the unit quaternion.
fn yaw(q: Quaternion) -> Result<f64, String> {
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if !(0.9..=1.1).contains(&norm) {
        return Err(format!("found a quaternion of length {norm}, expected 1"));
    }
    let [x, y, z, w] = [q.x, q.y, q.z, q.w].map(|part| part / norm);
    Ok((2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)))
}

fn named(field: &str, frame: &str) -> Result<String, String> {
    let name = without_slash(frame);
    if name.is_empty() {
        return Err(format!("found an empty {field}, expected a frame's name"));
    }
    Ok(name.to_owned())
}

fn without_slash(frame: &str) -> &str {
    frame.strip_prefix('/').unwrap_or(frame)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::messages::{Header, Pose, PoseWithCovariance, Twist, TwistWithCovariance, Vector3};

    fn odometry(x: f64, y: f64, heading: f64) -> Odometry {
        let orientation = Quaternion { x: 0.0, y: 0.0, z: (heading / 2.0).sin(), w: (heading / 2.0).cos() };
        let twist = Twist { linear: Vector3 { x: 0.5, ..Vector3::default() }, ..Twist::default() };
        Odometry {
            header: Header { frame_id: "/odom".to_owned(), ..Header::default() },
            child_frame_id: "base_link".to_owned(),
            pose: PoseWithCovariance {
                pose: Pose { position: Vector3 { x, y, z: 0.0 }, orientation },
                ..PoseWithCovariance::default()
            },
            twist: TwistWithCovariance { twist, ..TwistWithCovariance::default() },
        }
    }

    fn goal(frame: &str, x: f64, y: f64) -> PoseStamped {
        let pose = Pose { position: Vector3 { x, y, z: 0.0 }, ..Pose::default() };
        PoseStamped { header: Header { frame_id: frame.to_owned(), ..Header::default() }, pose }
    }

    fn close(a: [f64; 2], b: [f64; 2]) -> bool {
        (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-12
    }

    #[test]
    fn a_goal_is_fixed_when_it_arrives() {
        let here = motion(&odometry(1.0, 2.0, FRAC_PI_2)).unwrap();
        assert!((here.pose[2] - FRAC_PI_2).abs() < 1e-12);
        let at =
            |frame: &str| fixed_goal(&wish(&goal(frame, 3.0, 1.0)).unwrap(), &here, &["/map".to_owned()]);
        assert_eq!(at("odom").unwrap(), [3.0, 1.0]);
        assert_eq!(at("/odom").unwrap(), [3.0, 1.0]);
        assert_eq!(at("map").unwrap(), [3.0, 1.0]);
        // Three metres ahead is along y, one metre to the left along −x.
        assert!(close(at("base_link").unwrap(), [0.0, 5.0]));
        assert!(close(in_robot([0.0, 5.0], here.pose), [3.0, 1.0]));
        let refusal = at("world").unwrap_err();
        assert!(refusal.starts_with("found frame world, expected odom or base_link"), "{refusal}");
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let broken = |change: fn(&mut Odometry)| {
            let mut odometry = odometry(0.0, 0.0, 0.0);
            change(&mut odometry);
            motion(&odometry).expect_err("refused")
        };
        broken(|o| o.pose.pose.position.x = f64::NAN);
        broken(|o| o.pose.pose.position.y = f64::INFINITY);
        broken(|o| o.twist.twist.linear.x = f64::NAN);
        broken(|o| o.twist.twist.angular.z = f64::NEG_INFINITY);
        broken(|o| o.pose.pose.orientation.z = f64::NAN);
        let zero = broken(|o| o.pose.pose.orientation.w = 0.0);
        assert_eq!(zero, "found a quaternion of length 0, expected 1");
        assert_eq!(
            broken(|o| o.child_frame_id.clear()),
            "found an empty child_frame_id, expected a frame's name"
        );
        assert!(wish(&goal("odom", f64::NAN, 0.0)).is_err());
        assert!(wish(&goal("/", 0.0, 0.0)).is_err());
    }
}
