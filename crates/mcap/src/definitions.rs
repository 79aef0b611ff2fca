//! What readers are told of the messages: their definitions in the language of `.msg` files, each
//! followed by those that it uses.
//!
//! Fields and types are those of ROS 2 from Humble to Kilted.
//! <https://mcap.dev/spec/registry#ros2msg>

/// A type: its name, its fields, and the types that these use.
struct Definition {
    name: &'static str,
    fields: &'static str,
    uses: &'static [&'static Definition],
}

static TIME: Definition =
    Definition { name: "builtin_interfaces/Time", fields: "int32 sec\nuint32 nanosec\n", uses: &[] };
static DURATION: Definition =
    Definition { name: "builtin_interfaces/Duration", fields: "int32 sec\nuint32 nanosec\n", uses: &[] };
static HEADER: Definition = Definition {
    name: "std_msgs/Header",
    fields: "builtin_interfaces/Time stamp\nstring frame_id\n",
    uses: &[&TIME],
};
static VECTOR: Definition =
    Definition { name: "geometry_msgs/Vector3", fields: "float64 x\nfloat64 y\nfloat64 z\n", uses: &[] };
static POINT: Definition =
    Definition { name: "geometry_msgs/Point", fields: "float64 x\nfloat64 y\nfloat64 z\n", uses: &[] };
static QUATERNION: Definition = Definition {
    name: "geometry_msgs/Quaternion",
    fields: "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    uses: &[],
};
static POSE: Definition = Definition {
    name: "geometry_msgs/Pose",
    fields: "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    uses: &[&POINT, &QUATERNION],
};
static TWIST: Definition = Definition {
    name: "geometry_msgs/Twist",
    fields: "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    uses: &[&VECTOR],
};
static TRANSFORM: Definition = Definition {
    name: "geometry_msgs/Transform",
    fields: "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    uses: &[&VECTOR, &QUATERNION],
};
static TRANSFORM_STAMPED: Definition = Definition {
    name: "geometry_msgs/TransformStamped",
    fields: "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    uses: &[&HEADER, &TRANSFORM],
};
static POSE_WITH_COVARIANCE: Definition = Definition {
    name: "geometry_msgs/PoseWithCovariance",
    fields: "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    uses: &[&POSE],
};
static TWIST_WITH_COVARIANCE: Definition = Definition {
    name: "geometry_msgs/TwistWithCovariance",
    fields: "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    uses: &[&TWIST],
};
static COLOR: Definition = Definition {
    name: "std_msgs/ColorRGBA",
    fields: "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
    uses: &[],
};
static COMPRESSED_IMAGE: Definition = Definition {
    name: "sensor_msgs/CompressedImage",
    fields: "std_msgs/Header header\nstring format\nuint8[] data\n",
    uses: &[&HEADER],
};
static UV_COORDINATE: Definition =
    Definition { name: "visualization_msgs/UVCoordinate", fields: "float32 u\nfloat32 v\n", uses: &[] };
static MESH_FILE: Definition =
    Definition { name: "visualization_msgs/MeshFile", fields: "string filename\nuint8[] data\n", uses: &[] };
static MARKER: Definition = Definition {
    name: "visualization_msgs/Marker",
    fields: "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n\
             geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\nbool frame_locked\n\
             geometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n\
             sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\n\
             string mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
    uses: &[
        &HEADER,
        &POSE,
        &VECTOR,
        &COLOR,
        &DURATION,
        &POINT,
        &COMPRESSED_IMAGE,
        &UV_COORDINATE,
        &MESH_FILE,
    ],
};

static LASER_SCAN: Definition = Definition {
    name: "sensor_msgs/LaserScan",
    fields: "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n\
             float32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities\n",
    uses: &[&HEADER],
};
static ODOMETRY: Definition = Definition {
    name: "nav_msgs/Odometry",
    fields: "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
             geometry_msgs/TwistWithCovariance twist\n",
    uses: &[&HEADER, &POSE_WITH_COVARIANCE, &TWIST_WITH_COVARIANCE],
};
static TF_MESSAGE: Definition = Definition {
    name: "tf2_msgs/TFMessage",
    fields: "geometry_msgs/TransformStamped[] transforms\n",
    uses: &[&TRANSFORM_STAMPED],
};
static MARKER_ARRAY: Definition = Definition {
    name: "visualization_msgs/MarkerArray",
    fields: "visualization_msgs/Marker[] markers\n",
    uses: &[&MARKER],
};

/// A topic's type, as its schema is called and as it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// `sensor_msgs/msg/LaserScan`.
    pub name: String,
    /// The definition and those that it uses.
    pub text: String,
}

/// The schemas of scan, odometry, transforms and markers, in this order.
pub fn schemas() -> [Schema; 4] {
    [&LASER_SCAN, &ODOMETRY, &TF_MESSAGE, &MARKER_ARRAY].map(schema)
}

fn schema(definition: &'static Definition) -> Schema {
    let mut text = definition.fields.to_owned();
    let mut known = Vec::new();
    let mut waiting: Vec<&Definition> = definition.uses.to_vec();
    while let Some(next) = waiting.pop() {
        if !known.contains(&next.name) {
            known.push(next.name);
            let line = "=".repeat(80);
            for part in [&*line, "\nMSG: ", next.name, "\n", next.fields] {
                text.push_str(part);
            }
            waiting.extend(next.uses);
        }
    }
    let (package, name) = definition.name.split_once('/').expect("a package and a name");
    Schema { name: format!("{package}/msg/{name}"), text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_that_is_used_is_defined_once() {
        for schema in schemas() {
            let defined: Vec<&str> =
                schema.text.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
            let mut unique = defined.clone();
            unique.sort_unstable();
            unique.dedup();
            assert_eq!(unique.len(), defined.len(), "{}", schema.name);
            for line in
                schema.text.lines().filter(|line| !line.starts_with("MSG: ") && !line.starts_with('='))
            {
                let kind = line.split(' ').next().and_then(|kind| kind.split('[').next()).expect("a type");
                assert!(!kind.contains('/') || defined.contains(&kind), "{}: {kind}", schema.name);
            }
        }
    }
}
