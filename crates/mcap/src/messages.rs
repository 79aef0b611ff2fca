//! The ROS 2 messages of a recording, field by field in the order of their
//! [definitions](crate::definitions).

use serde::{Deserialize, Serialize};

/// `builtin_interfaces/msg/Time`, and `Duration`, which has the same fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds within the second.
    pub nanosec: u32,
}

impl Time {
    /// The time so many nanoseconds after the origin.
    pub fn from_nanoseconds(nanoseconds: u64) -> Self {
        Self { sec: (nanoseconds / 1_000_000_000) as i32, nanosec: (nanoseconds % 1_000_000_000) as u32 }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When.
    pub stamp: Time,
    /// In which frame.
    pub frame_id: String,
}

/// `geometry_msgs/msg/Vector3` and `Point`.
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

impl Quaternion {
    /// The rotation about z by an angle, rad.
    pub fn about_z(angle: f64) -> Self {
        Self { x: 0.0, y: 0.0, z: (angle / 2.0).sin(), w: (angle / 2.0).cos() }
    }
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

/// `geometry_msgs/msg/Transform`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// m.
    pub translation: Vector3,
    /// A unit quaternion.
    pub rotation: Quaternion,
}

/// `geometry_msgs/msg/TransformStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// When, and from which frame.
    pub header: Header,
    /// To which frame.
    pub child_frame_id: String,
    /// The transform.
    pub transform: Transform,
}

/// `tf2_msgs/msg/TFMessage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TfMessage {
    /// Transforms.
    pub transforms: Vec<TransformStamped>,
}

/// `sensor_msgs/msg/LaserScan`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LaserScan {
    /// When, and the scanner's frame.
    pub header: Header,
    /// Of the first beam, rad.
    pub angle_min: f32,
    /// Of the last beam, rad.
    pub angle_max: f32,
    /// Between two beams, rad.
    pub angle_increment: f32,
    /// Between two beams, s.
    pub time_increment: f32,
    /// Between two scans, s.
    pub scan_time: f32,
    /// m.
    pub range_min: f32,
    /// m.
    pub range_max: f32,
    /// m; infinite where nothing is met (REP 117).
    pub ranges: Vec<f32>,
    /// None.
    pub intensities: Vec<f32>,
}

/// `geometry_msgs/msg/Twist`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// m/s.
    pub linear: Vector3,
    /// rad/s.
    pub angular: Vector3,
}

/// A covariance, 6 × 6. (serde knows arrays up to 32.)
pub type Covariance = [[f64; 6]; 6];

/// `nav_msgs/msg/Odometry`, its poses and twists with covariances written out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// When, and the frame of the pose.
    pub header: Header,
    /// The frame of the twist.
    pub child_frame_id: String,
    /// Where.
    pub pose: Pose,
    /// Zero: ground truth.
    pub pose_covariance: Covariance,
    /// How it moves.
    pub twist: Twist,
    /// Zero: ground truth.
    pub twist_covariance: Covariance,
}

/// `std_msgs/msg/ColorRGBA`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Color {
    /// Red, from 0 to 1.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// 1 hides what is behind.
    pub a: f32,
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Unused.
    pub header: Header,
    /// Unused.
    pub format: String,
    /// None.
    pub data: Vec<u8>,
}

/// `visualization_msgs/msg/Marker`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker {
    /// When, and in which frame.
    pub header: Header,
    /// What it belongs to.
    pub ns: String,
    /// Which one of those.
    pub id: i32,
    /// Its shape.
    pub kind: i32,
    /// Added, or taken away.
    pub action: i32,
    /// Where.
    pub pose: Pose,
    /// m.
    pub scale: Vector3,
    /// Its colour.
    pub color: Color,
    /// Until taken away.
    pub lifetime: Time,
    /// Whether it moves with its frame.
    pub frame_locked: bool,
    /// Ends of lines.
    pub points: Vec<Vector3>,
    /// Unused.
    pub colors: Vec<Color>,
    /// Unused.
    pub texture_resource: String,
    /// Unused.
    pub texture: CompressedImage,
    /// Unused.
    pub uv_coordinates: Vec<[f32; 2]>,
    /// Unused.
    pub text: String,
    /// Unused.
    pub mesh_resource: String,
    /// Unused.
    pub mesh_file_name: String,
    /// Unused.
    pub mesh_file_data: Vec<u8>,
    /// Unused.
    pub mesh_use_embedded_materials: bool,
}

/// A marker's shape: a cylinder.
pub const CYLINDER: i32 = 3;
/// A marker's shape: pairs of points, each of them a line.
pub const LINE_LIST: i32 = 5;
/// What happens to a marker: it is there from now on.
pub const ADD: i32 = 0;
/// What happens to markers: all of the topic are gone.
pub const DELETE_ALL: i32 = 3;

/// `visualization_msgs/msg/MarkerArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerArray {
    /// Markers.
    pub markers: Vec<Marker>,
}
