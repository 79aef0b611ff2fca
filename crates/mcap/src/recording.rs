//! What is recorded, and the file that it becomes.
//!
//! | topic | type | what |
//! |---|---|---|
//! | `/scan` | `sensor_msgs/LaserScan` | the scan, in the frame `laser` |
//! | `/odom` | `nav_msgs/Odometry` | true pose in the frame `map`, executed velocity in `base_link` |
//! | `/tf` | `tf2_msgs/TFMessage` | `map` to `base_link` to `laser` |
//! | `/markers` | `visualization_msgs/MarkerArray` | pedestrians, the goal, walls |
//!
//! Episodes follow one another, with a pause between them; time starts at 1 s, as 0 means "the
//! newest" to ROS. The file's metadata has a record `episode K` for each, K from 0: its name, its
//! notes, and `begin` and `end`, the times of its first and last message, ns.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use cdr_encoding::to_writer;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};
use serde::Serialize;

use crate::definitions::schemas;
use crate::error::McapError;
use crate::messages::{
    ADD, CYLINDER, Color, DELETE_ALL, Header, LINE_LIST, LaserScan, Marker, MarkerArray, Odometry, Pose,
    Quaternion, TfMessage, Time, Transform, TransformStamped, Twist, Vector3,
};

/// The fixed frame, the robot's and the scanner's.
const FRAMES: [&str; 3] = ["map", "base_link", "laser"];
/// When the first episode begins, and the pause between two, ns.
const START: u64 = 1_000_000_000;
const PAUSE: u64 = 1_000_000_000;
/// Height of what is drawn for a person, m, and of a goal.
const HEIGHTS: (f64, f64) = (1.6, 0.02);
/// Largest number of moments of an episode, pedestrians or beams: beyond that a recording is a
/// mistake.
const MOST: usize = 1_000_000;

/// The robot's laser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scanner {
    /// Direction of beam 0 from straight ahead, counter-clockwise, rad.
    pub angle_min: f64,
    /// From a beam to the next, rad.
    pub increment: f64,
    /// Number of beams.
    pub beams: usize,
    /// What a beam reads at most, m; at this range it met nothing.
    pub range: f32,
}

/// Where someone is, m, and which way they look, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// m.
    pub position: [f32; 2],
    /// rad.
    pub heading: f32,
}

/// One moment of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// The robot.
    pub robot: Place,
    /// v, m/s, and ω, rad/s, executed in the step that led here.
    pub velocity: [f32; 2],
    /// The robot's goal, m.
    pub goal: [f32; 2],
    /// Ranges of the scanner's beams, m.
    pub ranges: Vec<f32>,
    /// The pedestrians' centres, m.
    pub pedestrians: Vec<[f32; 2]>,
}

/// An episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// What it is called.
    pub name: String,
    /// More of it, by key. The keys `name`, `begin` and `end` are taken.
    pub notes: BTreeMap<String, String>,
    /// From the start on, one moment a step.
    pub moments: Vec<Moment>,
}

/// A straight piece of a wall or an obstacle's outline: both ends, m.
pub type Wall = [[f32; 2]; 2];

/// What does not change.
struct Scene<'a> {
    scanner: &'a Scanner,
    walls: &'a [Wall],
    /// m.
    goal_radius: f32,
    pedestrian_radius: f32,
    step: u64,
}

/// Writes episodes, whose moments are `dt` s apart, in a room with these walls.
///
/// `radii` are the goal's and a pedestrian's, m; they are only drawn.
///
/// # Errors
///
/// A moment whose scan has another number of beams than the scanner, numbers that are not finite, a
/// `dt` out of range; a file that cannot be written.
pub fn write<W: Write + Seek>(
    file: W,
    episodes: &[Episode],
    dt: f64,
    scanner: &Scanner,
    walls: &[Wall],
    radii: [f32; 2],
) -> Result<(), McapError> {
    if !(dt > 0.0 && dt <= 10.0) {
        return Err(McapError::Setting {
            field: "dt",
            found: dt.to_string(),
            expected: "seconds in (0, 10]",
        });
    }
    check(episodes, scanner)?;
    let [goal_radius, pedestrian_radius] = radii;
    let scene = Scene { scanner, walls, goal_radius, pedestrian_radius, step: (dt * 1e9).round() as u64 };
    let failed = |error: mcap::McapError| McapError::Write { reason: error.to_string() };
    let options = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .compression_threads(0)
        .profile("ros2")
        .library("jostle");
    let mut writer = options.create(file).map_err(failed)?;
    let mut channels = [0; 4];
    for ((channel, schema), topic) in channels.iter_mut().zip(schemas()).zip(TOPICS) {
        let id = writer.add_schema(&schema.name, "ros2msg", schema.text.as_bytes()).map_err(failed)?;
        *channel = writer.add_channel(id, topic, "cdr", &BTreeMap::new()).map_err(failed)?;
    }
    let mut out = Out { writer, channels, sequence: [0; 4] };
    let mut now = START;
    for (index, episode) in episodes.iter().enumerate() {
        let begin = now;
        for (step, moment) in episode.moments.iter().enumerate() {
            now = begin + scene.step * step as u64;
            scene.moment(&mut out, now, step == 0, moment)?;
        }
        out.writer.write_metadata(&metadata(index, episode, begin, now)).map_err(failed)?;
        now += scene.step + PAUSE;
    }
    out.writer.finish().map_err(failed)?;
    Ok(())
}

/// Topics, in the order of the schemas.
pub const TOPICS: [&str; 4] = ["/scan", "/odom", "/tf", "/markers"];

fn metadata(index: usize, episode: &Episode, begin: u64, end: u64) -> Metadata {
    let mut metadata = episode.notes.clone();
    let own = [("name", episode.name.clone()), ("begin", begin.to_string()), ("end", end.to_string())];
    metadata.extend(own.map(|(key, value)| (key.to_owned(), value)));
    Metadata { name: format!("episode {index}"), metadata }
}

/// The file, with what is counted.
struct Out<W: Write + Seek> {
    writer: mcap::Writer<W>,
    channels: [u16; 4],
    sequence: [u32; 4],
}

impl<W: Write + Seek> Out<W> {
    fn put<M: Serialize>(&mut self, topic: usize, now: u64, message: &M) -> Result<(), McapError> {
        // The encapsulation's head: little-endian CDR, no options.
        let mut bytes = vec![0, 1, 0, 0];
        to_writer::<_, byteorder::LittleEndian, _>(&mut bytes, message)
            .map_err(|error| McapError::Write { reason: error.to_string() })?;
        let header = MessageHeader {
            channel_id: self.channels[topic],
            sequence: self.sequence[topic],
            log_time: now,
            publish_time: now,
        };
        self.sequence[topic] += 1;
        self.writer
            .write_to_known_channel(&header, &bytes)
            .map_err(|error| McapError::Write { reason: error.to_string() })
    }
}

impl Scene<'_> {
    /// All messages of a moment.
    fn moment<W: Write + Seek>(
        &self,
        out: &mut Out<W>,
        now: u64,
        first: bool,
        moment: &Moment,
    ) -> Result<(), McapError> {
        let header = |frame: &str| Header { stamp: Time::from_nanoseconds(now), frame_id: frame.to_owned() };
        let [map, base, laser] = FRAMES;
        let pose = pose_of(moment.robot);
        let to = |header, child: &str, pose: Pose| TransformStamped {
            header,
            child_frame_id: child.to_owned(),
            transform: Transform { translation: pose.position, rotation: pose.orientation },
        };
        let transforms = vec![to(header(map), base, pose), to(header(base), laser, Pose::default())];
        out.put(2, now, &TfMessage { transforms })?;
        let [v, w] = moment.velocity.map(f64::from);
        let twist = Twist {
            linear: Vector3 { x: v, ..Vector3::default() },
            angular: Vector3 { z: w, ..Vector3::default() },
        };
        let child_frame_id = base.to_owned();
        out.put(
            1,
            now,
            &Odometry { header: header(map), child_frame_id, pose, twist, ..Odometry::default() },
        )?;
        out.put(0, now, &self.scan(header(laser), &moment.ranges))?;
        out.put(3, now, &MarkerArray { markers: self.markers(&header(map), first, moment) })
    }

    fn scan(&self, header: Header, ranges: &[f32]) -> LaserScan {
        let Scanner { angle_min, increment, beams, range } = *self.scanner;
        let met = |reading: &f32| if *reading < range { *reading } else { f32::INFINITY };
        LaserScan {
            header,
            angle_min: angle_min as f32,
            angle_max: (angle_min + increment * (beams - 1) as f64) as f32,
            angle_increment: increment as f32,
            scan_time: (self.step as f64 * 1e-9) as f32,
            range_min: 0.0,
            range_max: range,
            ranges: ranges.iter().map(met).collect(),
            ..LaserScan::default()
        }
    }

    /// At an episode's start everything of the one before is taken away, and the walls are put up.
    fn markers(&self, header: &Header, first: bool, moment: &Moment) -> Vec<Marker> {
        let mut markers = Vec::new();
        if first {
            markers.push(Marker { header: header.clone(), action: DELETE_ALL, ..Marker::default() });
            let at = |[x, y]: [f32; 2]| Vector3 { x: x.into(), y: y.into(), z: 0.0 };
            markers.push(Marker {
                header: header.clone(),
                ns: "walls".to_owned(),
                kind: LINE_LIST,
                action: ADD,
                scale: Vector3 { x: 0.05, ..Vector3::default() },
                color: Color { r: 0.3, g: 0.3, b: 0.3, a: 1.0 },
                points: self.walls.iter().flatten().map(|end| at(*end)).collect(),
                ..Marker::default()
            });
        }
        let cylinder = |ns: &str, id: usize, [x, y]: [f32; 2], radius: f32, height: f64, color| Marker {
            header: header.clone(),
            ns: ns.to_owned(),
            id: id as i32,
            kind: CYLINDER,
            action: ADD,
            pose: Pose { position: Vector3 { x: x.into(), y: y.into(), z: height / 2.0 }, ..Pose::default() },
            scale: Vector3 { x: (2.0 * radius).into(), y: (2.0 * radius).into(), z: height },
            color,
            ..Marker::default()
        };
        let (person, goal) = HEIGHTS;
        let green = Color { r: 0.1, g: 0.6, b: 0.2, a: 0.6 };
        let orange = Color { r: 0.8, g: 0.4, b: 0.0, a: 0.9 };
        markers.push(cylinder("goal", 0, moment.goal, self.goal_radius, goal, green));
        let walkers = moment.pedestrians.iter().enumerate();
        markers.extend(
            walkers.map(|(id, at)| cylinder("pedestrians", id, *at, self.pedestrian_radius, person, orange)),
        );
        markers
    }
}

fn pose_of(place: Place) -> Pose {
    let [x, y] = place.position.map(f64::from);
    Pose { position: Vector3 { x, y, z: 0.0 }, orientation: Quaternion::about_z(place.heading.into()) }
}

/// Refuses moments that do not fit the scanner, and numbers that are none.
fn check(episodes: &[Episode], scanner: &Scanner) -> Result<(), McapError> {
    let known = scanner.angle_min.is_finite() && scanner.increment.is_finite() && scanner.range > 0.0;
    if !known || scanner.beams == 0 || scanner.beams > MOST {
        let found = format!("{scanner:?}");
        return Err(McapError::Setting {
            field: "scanner",
            found,
            expected: "finite angles, beams, a range",
        });
    }
    for (index, episode) in episodes.iter().enumerate() {
        for (at, moment) in episode.moments.iter().enumerate() {
            let refuse = |field, found: String, expected: String| {
                Err(McapError::Moment { episode: index, moment: at, field, found, expected })
            };
            if moment.ranges.len() != scanner.beams {
                let expected = format!("{} ranges", scanner.beams);
                return refuse("ranges", moment.ranges.len().to_string(), expected);
            }
            if let Some(found) = moment.ranges.iter().find(|range| range.is_nan()) {
                return refuse("ranges", found.to_string(), "numbers".to_owned());
            }
            let others = moment.pedestrians.iter().flatten().chain(&moment.goal).chain(&moment.velocity);
            let mut numbers = others.chain(&moment.robot.position).chain([&moment.robot.heading]);
            if let Some(found) = numbers.find(|number| !number.is_finite()) {
                return refuse("places", found.to_string(), "finite numbers".to_owned());
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use cdr_encoding::from_bytes;

    use super::*;

    const SCANNER: Scanner = Scanner { angle_min: 0.0, increment: 1.5, beams: 4, range: 10.0 };

    fn episode(steps: u8) -> Episode {
        let moment = |step: u8| Moment {
            robot: Place { position: [f32::from(step), 2.0], heading: 0.5 },
            velocity: [1.0, -0.25],
            goal: [8.0, 2.0],
            ranges: vec![1.5, 10.0, 3.0, 0.25],
            pedestrians: vec![[4.0, 1.0], [5.0, f32::from(step)]],
        };
        let notes = [("crowd".to_owned(), "SF".to_owned())].into();
        Episode { name: "an episode".to_owned(), notes, moments: (0..steps).map(moment).collect() }
    }

    fn bytes(episodes: &[Episode]) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        let walls = [[[-10.0, -10.0], [10.0, -10.0]]];
        write(&mut file, episodes, 0.1, &SCANNER, &walls, [0.5, 0.25]).unwrap();
        file.into_inner()
    }

    /// The messages of a topic: when, and what.
    fn read<M: serde::de::DeserializeOwned>(file: &[u8], topic: &str) -> Vec<(u64, M)> {
        mcap::MessageStream::new(file)
            .unwrap()
            .map(Result::unwrap)
            .filter(|message| message.channel.topic == topic)
            .map(|message| {
                assert_eq!(message.data[..4], [0, 1, 0, 0]);
                let payload = &message.data[4..];
                let (value, used) = from_bytes::<M, byteorder::LittleEndian>(payload).unwrap();
                assert_eq!(used, payload.len());
                (message.log_time, value)
            })
            .collect()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let file = bytes(&[episode(3), episode(2)]);
        let odometry: Vec<(u64, Odometry)> = read(&file, "/odom");
        let times: Vec<u64> = odometry.iter().map(|(time, _)| time / 1_000_000).collect();
        assert_eq!(times, [1000, 1100, 1200, 2300, 2400]);
        let (_, last) = &odometry[4];
        assert_eq!((last.pose.position.x, last.twist.linear.x, last.twist.angular.z), (1.0, 1.0, -0.25));
        assert!((last.pose.orientation.z - 0.25_f64.sin()).abs() < 1e-9);
        let scans: Vec<(u64, LaserScan)> = read(&file, "/scan");
        assert_eq!(scans[0].1.ranges, [1.5, f32::INFINITY, 3.0, 0.25]);
        assert_eq!((scans[0].1.angle_max, scans[0].1.range_max), (4.5, 10.0));
        let transforms: Vec<(u64, TfMessage)> = read(&file, "/tf");
        let chain: Vec<(&str, &str)> = transforms[0]
            .1
            .transforms
            .iter()
            .map(|transform| (&*transform.header.frame_id, &*transform.child_frame_id))
            .collect();
        assert_eq!(chain, [("map", "base_link"), ("base_link", "laser")]);
        assert_eq!(transforms[1].1.transforms[0].transform.translation.x, 1.0);
        let markers: Vec<(u64, MarkerArray)> = read(&file, "/markers");
        let names = |at: usize| -> Vec<String> {
            markers[at].1.markers.iter().map(|marker| format!("{} {}", marker.ns, marker.id)).collect()
        };
        assert_eq!(names(0), [" 0", "walls 0", "goal 0", "pedestrians 0", "pedestrians 1"]);
        assert_eq!(names(1), ["goal 0", "pedestrians 0", "pedestrians 1"]);
        assert_eq!(markers[3].1.markers[0].action, DELETE_ALL, "a new episode begins");
        assert_eq!(markers[2].1.markers[2].pose.position.y, 2.0);
    }

    #[test]
    fn schemas_go_with_their_topics_and_the_same_recording_is_the_same_file() {
        let file = bytes(&[episode(2)]);
        assert_eq!(bytes(&[episode(2)]), file);
        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        let mut found: Vec<(String, String)> = summary
            .channels
            .values()
            .map(|channel| (channel.topic.clone(), channel.schema.as_ref().unwrap().name.clone()))
            .collect();
        found.sort();
        let expected = [
            ("/markers", "visualization_msgs/msg/MarkerArray"),
            ("/odom", "nav_msgs/msg/Odometry"),
            ("/scan", "sensor_msgs/msg/LaserScan"),
            ("/tf", "tf2_msgs/msg/TFMessage"),
        ];
        assert_eq!(found, expected.map(|(topic, name)| (topic.to_owned(), name.to_owned())));
    }

    #[test]
    fn metadata_tells_one_episode_from_another() {
        let file = bytes(&[episode(3), episode(2)]);
        let mut found = Vec::new();
        for record in mcap::read::LinearReader::new(&file).unwrap() {
            if let mcap::records::Record::Metadata(metadata) = record.unwrap() {
                let value = |key: &str| metadata.metadata[key].clone();
                found.push([metadata.name.clone(), value("begin"), value("end"), value("crowd")]);
            }
        }
        assert_eq!(found[0], ["episode 0", "1000000000", "1200000000", "SF"]);
        assert_eq!(found[1], ["episode 1", "2300000000", "2400000000", "SF"]);
        assert_eq!(found.len(), 2);
    }

    #[test]
    fn moments_that_do_not_fit_are_refused() {
        let refusal = |change: fn(&mut Moment)| {
            let mut broken = episode(3);
            change(&mut broken.moments[1]);
            let file = Cursor::new(Vec::new());
            write(file, &[broken], 0.1, &SCANNER, &[], [0.5, 0.25]).unwrap_err().to_string()
        };
        assert_eq!(
            refusal(|moment| moment.ranges.truncate(3)),
            "episode 0, moment 1: ranges: found 3, expected 4 ranges"
        );
        assert!(
            refusal(|moment| moment.ranges[0] = f32::NAN).ends_with("ranges: found NaN, expected numbers")
        );
        for broken in [
            (|moment: &mut Moment| moment.robot.heading = f32::NAN) as fn(&mut Moment),
            |moment| moment.velocity[1] = f32::INFINITY,
            |moment| moment.pedestrians[0][1] = f32::NAN,
        ] {
            assert!(refusal(broken).contains("expected finite numbers"));
        }
        let file = Cursor::new(Vec::new());
        let message = write(file, &[], 0.0, &SCANNER, &[], [0.5, 0.25]).unwrap_err().to_string();
        assert_eq!(message, "dt: found 0, expected seconds in (0, 10]");
    }
}
