//! The ROS 2 messages that are read and written, field by field in the order of their definitions
//! (CDR has no names).
//!
//! Definitions: `sensor_msgs/msg/LaserScan`, `nav_msgs/msg/Odometry`,
//! `geometry_msgs/msg/PoseStamped`, `Twist`, `TwistStamped` of ROS 2 Kilted
//! (<https://github.com/ros2/common_interfaces>). They have not changed since ROS 2 Foxy.

use serde::{Deserialize, Serialize};

/// Nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// `builtin_interfaces/msg/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds within the second.
    pub nanosec: u32,
}

impl Time {
    /// Nanoseconds since the clock's origin.
    pub fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * SECOND + i64::from(self.nanosec)
    }

    /// The time that many seconds later.
    #[must_use]
    pub fn later(self, seconds: f64) -> Self {
        let nanoseconds = self.nanoseconds() + (seconds * SECOND as f64).round() as i64;
        Self { sec: nanoseconds.div_euclid(SECOND) as i32, nanosec: nanoseconds.rem_euclid(SECOND) as u32 }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When the data was measured.
    pub stamp: Time,
    /// The frame that the data is in.
    pub frame_id: String,
}

/// `sensor_msgs/msg/LaserScan`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LaserScan {
    /// Stamp of the first beam, frame of the scanner.
    pub header: Header,
    /// Angle of the first beam, rad.
    pub angle_min: f32,
    /// Angle of the last beam, rad.
    pub angle_max: f32,
    /// Angle between two beams, rad; negative where the scanner turns clockwise.
    pub angle_increment: f32,
    /// Time between two beams, s.
    pub time_increment: f32,
    /// Time between two scans, s.
    pub scan_time: f32,
    /// Least range that is valid, m.
    pub range_min: f32,
    /// Largest range that is valid, m.
    pub range_max: f32,
    /// Ranges, m.
    pub ranges: Vec<f32>,
    /// Intensities; not read.
    pub intensities: Vec<f32>,
}

/// `geometry_msgs/msg/Vector3`, and `Point`, which has the same fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

/// `geometry_msgs/msg/Quaternion`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// i.
    pub x: f64,
    /// j.
    pub y: f64,
    /// k.
    pub z: f64,
    /// The real part.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/msg/Pose`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// m.
    pub position: Vector3,
    /// A unit quaternion.
    pub orientation: Quaternion,
}

/// A covariance, 6 × 6, which is not read. (serde knows arrays up to 32.)
pub type Covariance = [[f64; 6]; 6];

/// `geometry_msgs/msg/PoseWithCovariance`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    /// The pose.
    pub pose: Pose,
    /// Not read.
    pub covariance: Covariance,
}

/// `geometry_msgs/msg/Twist`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// m/s.
    pub linear: Vector3,
    /// rad/s.
    pub angular: Vector3,
}

/// `geometry_msgs/msg/TwistWithCovariance`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TwistWithCovariance {
    /// The twist.
    pub twist: Twist,
    /// Not read.
    pub covariance: Covariance,
}

/// `nav_msgs/msg/Odometry`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Stamp, and the frame of the pose.
    pub header: Header,
    /// The robot's own frame, that of the twist.
    pub child_frame_id: String,
    /// The robot's pose.
    pub pose: PoseWithCovariance,
    /// Its velocity.
    pub twist: TwistWithCovariance,
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseStamped {
    /// Stamp, and the frame of the pose.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

/// `geometry_msgs/msg/TwistStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TwistStamped {
    /// Stamp, and the robot's own frame.
    pub header: Header,
    /// The twist.
    pub twist: Twist,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_count_nanoseconds() {
        assert_eq!(Time { sec: 2, nanosec: 5 }.nanoseconds(), 2_000_000_005);
        assert_eq!(Time { sec: 2, nanosec: 900_000_000 }.later(0.25), Time { sec: 3, nanosec: 150_000_000 });
        assert!(Time { sec: 1, nanosec: 999_999_999 } < Time { sec: 2, nanosec: 0 });
    }
}
