//! Parameters: what may be set in the file of `--params`. `params.toml` beside the manifest holds
//! all of them with what they mean; a test keeps it complete and at the defaults.

use std::net::IpAddr;
use std::path::Path;

use jostle_policy::did_you_mean;
use serde::Deserialize;

use crate::error::RosError;

/// The commented file with all parameters at their defaults.
pub const DEFAULTS: &str = include_str!("../params.toml");

/// All parameters.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Names of topics.
    pub topics: Topics,
    /// Qualities of service.
    pub qos: Qos,
    /// The scanner.
    pub scan: ScanParams,
    /// The odometry.
    pub odom: OdomParams,
    /// The goal.
    pub goal: GoalParams,
    /// The command and its limits.
    pub command: CommandParams,
    /// When commands are given.
    pub clock: ClockParams,
    /// The node on the network.
    pub network: NetworkParams,
}

/// Names of topics.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Topics {
    /// `sensor_msgs/msg/LaserScan`.
    pub scan: String,
    /// `nav_msgs/msg/Odometry`.
    pub odom: String,
    /// `geometry_msgs/msg/PoseStamped`.
    pub goal: String,
    /// `geometry_msgs/msg/Twist` or `TwistStamped`.
    pub cmd: String,
}

impl Default for Topics {
    fn default() -> Self {
        let name = str::to_owned;
        Self { scan: name("/scan"), odom: name("/odom"), goal: name("/goal_pose"), cmd: name("/cmd_vel") }
    }
}

/// Resending of messages that were lost on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reliability {
    /// It is not. Reads publishers of both kinds.
    BestEffort,
    /// It is. Reads reliable publishers only.
    Reliable,
}

/// Qualities of service. Commands are always published reliably, which subscribers of both kinds
/// read.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Qos {
    /// Of scans.
    pub scan: Reliability,
    /// Of odometry.
    pub odom: Reliability,
    /// Of goals.
    pub goal: Reliability,
    /// True to read a goal that was published before this node started (transient local).
    pub goal_latched: bool,
}

impl Default for Qos {
    fn default() -> Self {
        let (scan, odom) = (Reliability::BestEffort, Reliability::BestEffort);
        Self { scan, odom, goal: Reliability::Reliable, goal_latched: false }
    }
}

/// Meaning of a finite reading below `range_min`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BelowMin {
    /// A return at that distance.
    Near,
    /// No measurement, as NaN.
    Invalid,
    /// A beam that met nothing.
    Nothing,
}

/// Meaning of directions into which the policy looks and the scanner does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unseen {
    /// A reason to stand.
    Stop,
    /// Free.
    Free,
}

/// The scanner.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScanParams {
    /// Forward from the robot's centre, m.
    pub x: f64,
    /// To the left of the robot's centre, m.
    pub y: f64,
    /// Counter-clockwise from the robot's heading, rad.
    pub yaw: f64,
    /// True if its angles run clockwise.
    pub inverted: bool,
    /// A scan that is older stops the robot, s.
    pub timeout: f64,
    /// Meaning of a finite reading below `range_min`.
    pub below_min: BelowMin,
    /// A scan of which a larger share is invalid is refused.
    pub invalid_max: f64,
    /// Meaning of directions that the scanner does not see.
    pub unseen: Unseen,
}

impl Default for ScanParams {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            yaw: 0.0,
            inverted: false,
            timeout: 0.2,
            below_min: BelowMin::Near,
            invalid_max: 0.5,
            unseen: Unseen::Stop,
        }
    }
}

/// The odometry.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OdomParams {
    /// Odometry that is older stops the robot, s.
    pub timeout: f64,
    /// A jump of the pose beyond this loses the goal, m.
    pub jump: f64,
}

impl Default for OdomParams {
    fn default() -> Self {
        Self { timeout: 0.2, jump: 1.0 }
    }
}

/// The goal.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GoalParams {
    /// The goal is reached nearer than this, m; the policy's own radius where there is none.
    pub radius: Option<f64>,
    /// A goal that is not repeated within this time is lost, s.
    pub timeout: Option<f64>,
    /// Frames whose origin is that of the odometry's frame.
    pub fixed_frames: Vec<String>,
}

/// The type of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum CommandType {
    /// `geometry_msgs/msg/Twist`.
    Twist,
    /// `geometry_msgs/msg/TwistStamped`.
    TwistStamped,
}

/// The messages while nobody wants the robot to drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Idle {
    /// A zero command each period.
    Zeros,
    /// Ten zero commands, then nothing.
    Silence,
}

/// The command, and limits that the policy cannot override.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CommandParams {
    /// The message.
    #[serde(rename = "type")]
    pub kind: CommandType,
    /// `frame_id` of a `TwistStamped`.
    pub frame: String,
    /// Highest speed, m/s; the policy's own limit where there is none.
    pub v_max: Option<f64>,
    /// Highest turning rate, rad/s; the policy's own limit where there is none.
    pub w_max: Option<f64>,
    /// With a return nearer than this ahead, the robot does not drive on, m from its centre.
    pub stop_distance: Option<f64>,
    /// The angle that is ahead: half of it to the left, half to the right, rad.
    pub stop_arc: f64,
    /// The messages without a goal.
    pub idle: Idle,
}

impl Default for CommandParams {
    fn default() -> Self {
        Self {
            kind: CommandType::Twist,
            frame: "base_link".to_owned(),
            v_max: None,
            w_max: None,
            stop_distance: None,
            stop_arc: std::f64::consts::PI,
            idle: Idle::Zeros,
        }
    }
}

/// When commands are given.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockParams {
    /// Share of the period by which a command may be early or late so that it follows a scan at
    /// once.
    pub window: f64,
}

impl Default for ClockParams {
    fn default() -> Self {
        Self { window: 0.1 }
    }
}

/// The node on the network.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkParams {
    /// The node's name.
    pub name: String,
    /// The node's namespace.
    pub namespace: String,
    /// The domain; that of `ROS_DOMAIN_ID`, else 0, where there is none.
    pub domain: Option<u16>,
    /// Addresses of the interfaces to use; empty: all.
    pub interfaces: Vec<IpAddr>,
}

impl Default for NetworkParams {
    fn default() -> Self {
        let (name, namespace) = ("jostle".to_owned(), "/".to_owned());
        Self { name, namespace, domain: None, interfaces: Vec::new() }
    }
}

impl Params {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, is no TOML, has a key that is none, or a value out of range:
    /// file, line or key, what was found, what was expected.
    pub fn load(file: &Path) -> Result<Self, RosError> {
        let text = std::fs::read_to_string(file)
            .map_err(|reason| RosError::Read { file: file.to_owned(), reason })?;
        Self::parse(&text, &file.display().to_string())
    }

    /// Reads the text of a file that messages call `place`.
    ///
    /// # Errors
    ///
    /// As [`Params::load`].
    pub fn parse(text: &str, place: &str) -> Result<Self, RosError> {
        let params: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map(|span| 1 + text[..span.start].matches('\n').count());
            let place = line.map_or_else(|| place.to_owned(), |line| format!("{place}: line {line}"));
            RosError::Parameters { place, problem: with_hint(error.message()) }
        })?;
        params.validate(place)?;
        Ok(params)
    }

    /// Checks ranges; `place` is what messages name.
    ///
    /// # Errors
    ///
    /// The first parameter that is out of range.
    pub fn validate(&self, place: &str) -> Result<(), RosError> {
        let check = |key: &'static str, found: f64, range: std::ops::RangeInclusive<f64>| {
            if range.contains(&found) {
                return Ok(());
            }
            let expected = format!("a number in [{}, {}]", range.start(), range.end());
            Err(RosError::Parameter { place: place.to_owned(), key, found: found.to_string(), expected })
        };
        check("scan.x", self.scan.x, -10.0..=10.0)?;
        check("scan.y", self.scan.y, -10.0..=10.0)?;
        check("scan.yaw", self.scan.yaw, -7.0..=7.0)?;
        check("scan.timeout", self.scan.timeout, 0.01..=10.0)?;
        check("scan.invalid_max", self.scan.invalid_max, 0.0..=1.0)?;
        check("odom.timeout", self.odom.timeout, 0.01..=10.0)?;
        check("odom.jump", self.odom.jump, 0.01..=1e6)?;
        let optional =
            |key, found: Option<f64>, range| found.map_or(Ok(()), |found| check(key, found, range));
        optional("goal.radius", self.goal.radius, 0.01..=100.0)?;
        optional("goal.timeout", self.goal.timeout, 0.01..=1e6)?;
        optional("command.v_max", self.command.v_max, 0.0..=100.0)?;
        optional("command.w_max", self.command.w_max, 0.0..=100.0)?;
        optional("command.stop_distance", self.command.stop_distance, 0.0..=100.0)?;
        check("command.stop_arc", self.command.stop_arc, 0.0..=7.0)?;
        check("clock.window", self.clock.window, 0.0..=0.4)?;
        if let Some(domain) = self.network.domain.filter(|domain| *domain > MAX_DOMAIN) {
            let (key, expected) = ("network.domain", format!("an integer in [0, {MAX_DOMAIN}]"));
            let found = domain.to_string();
            return Err(RosError::Parameter { place: place.to_owned(), key, found, expected });
        }
        Ok(())
    }
}

/// Largest domain whose ports exist on every system (ROS 2, "The `ROS_DOMAIN_ID`").
pub const MAX_DOMAIN: u16 = 232;

/// serde's message on a key that is none, in one line and with the key that was probably meant.
fn with_hint(message: &str) -> String {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let line = message.replace('\n', " ");
    match quoted.split_first() {
        Some((found, known)) if message.starts_with("unknown ") => {
            format!("{line}{}", did_you_mean(found, known.iter().copied()))
        }
        _ => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        Params::parse(text, "robot.toml").expect_err("refused").to_string()
    }

    #[test]
    fn the_commented_file_holds_every_key_at_its_default() {
        assert_eq!(Params::parse(DEFAULTS, "params.toml").expect("valid"), Params::default());
        // Optional keys are comments; with them it holds all that there are.
        let optional = |line: &'static str| {
            let key = line.strip_prefix("# ").filter(|rest| rest.split(' ').nth(1) == Some("="));
            key.unwrap_or(line)
        };
        let full = DEFAULTS.lines().map(optional).collect::<Vec<_>>().join("\n");
        let written: toml::Table = full.parse().expect("TOML");
        Params::parse(&full, "params.toml").expect("valid");
        for (section, known) in [
            ("topics", keys::<Topics>()),
            ("qos", keys::<Qos>()),
            ("scan", keys::<ScanParams>()),
            ("odom", keys::<OdomParams>()),
            ("goal", keys::<GoalParams>()),
            ("command", keys::<CommandParams>()),
            ("clock", keys::<ClockParams>()),
            ("network", keys::<NetworkParams>()),
        ] {
            let table = written[section].as_table().expect("a section");
            let mut found: Vec<String> = table.keys().cloned().collect();
            let mut known = known;
            found.sort();
            known.sort();
            assert_eq!(found, known, "{section}");
        }
        assert_eq!(written.len(), 8);
    }

    /// The keys that serde names when it refuses one.
    fn keys<T: serde::de::DeserializeOwned>() -> Vec<String> {
        let error = toml::from_str::<T>("no_such_key = 0").err().expect("refused").message().to_owned();
        error.split('`').skip(1).step_by(2).skip(1).map(str::to_owned).collect()
    }

    #[test]
    fn a_key_that_is_none_is_one_clear_error() {
        assert_eq!(
            refusal("[scan]\nx = 0.1\ntimeot = 0.5\n"),
            "robot.toml: line 3: unknown field `timeot`, expected one of `x`, `y`, `yaw`, `inverted`, `timeout`, \
             `below_min`, `invalid_max`, `unseen`; did you mean timeout?"
        );
        let message = refusal("[scna]\n");
        assert!(message.starts_with("robot.toml: line 1: unknown field `scna`"), "{message}");
        assert!(message.ends_with("did you mean scan?"), "{message}");
    }

    #[test]
    fn values_are_checked() {
        for (text, expected) in [
            ("[scan]\ntimeout = 0.0", "robot.toml: scan.timeout: found 0, expected a number in [0.01, 10]"),
            ("[scan]\nx = nan", "robot.toml: scan.x: found NaN, expected a number in [-10, 10]"),
            ("[command]\nv_max = -1.0", "robot.toml: command.v_max: found -1, expected a number in [0, 100]"),
            ("[clock]\nwindow = 0.5", "robot.toml: clock.window: found 0.5, expected a number in [0, 0.4]"),
            (
                "[network]\ndomain = 233",
                "robot.toml: network.domain: found 233, expected an integer in [0, 232]",
            ),
        ] {
            assert_eq!(refusal(text), expected);
        }
        for text in [
            "[scan]\nunseen = \"fre\"",
            "[network]\ninterfaces = [\"localhost\"]",
            "[qos]\nscan = 1",
            "[scan",
        ] {
            let message = refusal(text);
            assert!(message.starts_with("robot.toml: line ") && !message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let message = Params::load(Path::new("no/such.toml")).expect_err("refused").to_string();
        assert!(message.starts_with("no/such.toml: cannot read: "), "{message}");
    }
}
