//! The simulator's configuration: every number of the world and of the decision process, with its
//! default.
//!
//! Defaults are the paper's (Sec. V-A and the reward of Sec. IV) and, where it is silent, those of
//! its lineage (Long et al. 2018, arXiv:1709.10082). [`SimConfig::validate`] is the only gate: what
//! has passed it cannot fail later for a reason of range or type.

use crate::geometry::Shape;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

pub(crate) mod check;
mod located;

pub use located::NamingFolder;

/// Frames in an observation.
pub const FRAMES: usize = 3;
/// Numbers in an observation beside the scans: goal x, goal y, v, ω.
pub const EXTRAS: usize = 4;
/// Length of an observation row at the default 512 beams.
pub const OBSERVATION_LEN: usize = FRAMES * 512 + EXTRAS;

/// Everything the simulator needs to know; the `[sim]` part of a training file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SimConfig {
    /// The room.
    pub room: RoomConfig,
    /// Body, commands and limits of a robot.
    pub robot: RobotConfig,
    /// The laser scanner.
    pub laser: LaserConfig,
    /// The ends of an episode.
    pub episode: EpisodeConfig,
    /// Starts and goals.
    pub spawn: SpawnConfig,
    /// The reward of a step.
    pub reward: RewardConfig,
}

impl SimConfig {
    /// Length of one observation row: three scans, the goal and the velocity.
    pub fn observation_len(&self) -> usize {
        FRAMES * self.laser.beams + EXTRAS
    }

    /// Distance from walls and obstacles that lets a robot be somewhere without a crash, whatever
    /// its heading, m: the crash range, or the body's circumradius where that is larger.
    pub fn passing_radius(&self) -> f32 {
        self.episode.crash_range.max(self.robot.circumradius())
    }

    /// Distance between the centres of two bodies at which neither has crashed, whatever their
    /// headings, m: as [`SimConfig::passing_radius`] from the nearest point of the other.
    pub fn body_clearance_min(&self) -> f32 {
        self.robot.circumradius() + self.passing_radius()
    }
}

/// The room: a rectangle centred on the origin, or a map file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct RoomConfig {
    /// Extent along x, m. Unused when a map is given.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub width: f32,
    /// Extent along y, m. Unused when a map is given.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub height: f32,
    /// A polygon map (`.toml`, `.json`) or a ROS `map.yaml` that replaces the rectangle. A relative
    /// path starts from the folder of the file that names it; one given by a command or a program,
    /// from the working directory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<PathBuf>,
    // The folder that a relative `map` starts from.
    #[serde(skip)]
    folder: NamingFolder,
}

impl Default for RoomConfig {
    fn default() -> Self {
        Self { width: 20.0, height: 20.0, map: None, folder: NamingFolder::default() }
    }
}

/// Body and commands of a differential-drive robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct RobotConfig {
    /// Extent of the body along its heading, m.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub length: f32,
    /// Extent of the body across its heading, m.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub width: f32,
    /// Largest linear velocity, m/s; the least is 0.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m/s")))]
    pub v_max: f32,
    /// Largest angular velocity either way, rad/s.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "rad/s")))]
    pub w_max: f32,
    /// Switch: limits on how fast the velocity changes. Absent: a command acts at once (Stage's
    /// velocity mode).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<AccelerationLimits>,
    /// Switch: what moves the body. `kinematic`: Stage's velocity mode. `rapier`: motors and wheels
    /// push a body that has mass, and rapier solves its contacts. Default `kinematic` (paper).
    #[serde(skip_serializing_if = "Dynamics::is_kinematic")]
    #[cfg_attr(feature = "schema", schemars(extend("default" = "kinematic", "origin" = "paper")))]
    pub dynamics: Dynamics,
    /// Switch: masses, wheels and motors for `dynamics = "rapier"`. Absent: a Jackal's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<BaseConfig>,
}

impl Default for RobotConfig {
    fn default() -> Self {
        Self {
            length: 0.5,
            width: 0.5,
            v_max: 1.0,
            w_max: 1.0,
            acceleration: None,
            dynamics: Dynamics::Kinematic,
            base: None,
        }
    }
}

impl RobotConfig {
    /// A Clearpath Jackal: its body (data sheet), the limits that its controller sets
    /// (`jackal_control/config/control.yaml` of <https://github.com/jackal/jackal>), and its base.
    pub fn jackal() -> Self {
        Self {
            length: 0.508,
            width: 0.430,
            v_max: 2.0,
            w_max: 4.0,
            acceleration: Some(AccelerationLimits { v: 20.0, w: 25.0 }),
            dynamics: Dynamics::Rapier,
            base: None,
        }
    }

    /// The base that moves the body, if one does.
    pub fn dynamic_base(&self) -> Option<BaseConfig> {
        (!self.dynamics.is_kinematic()).then(|| self.base.clone().unwrap_or_default())
    }

    /// Distance from the body's centre to its corners, m.
    pub fn circumradius(&self) -> f32 {
        Shape::Box { length: self.length, width: self.width }.circumradius()
    }
}

/// What moves a robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Dynamics {
    /// A command is the velocity at once; a body that would touch something stays where it is.
    #[default]
    Kinematic,
    /// A command goes to motors; rapier moves the body. Needs the feature `dynamics`.
    Rapier,
}

/// The expected value where rapier's solver is not part of the build.
pub(crate) const WITHOUT_DYNAMICS: &str = "kinematic, or a build with the feature `dynamics`";

impl Dynamics {
    /// True for the default, which is left out of stored configurations.
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
    pub fn is_kinematic(&self) -> bool {
        *self == Self::Kinematic
    }
}

/// A skid-steered base with mass: four wheels, those of one side turned by one motor.
///
/// The defaults are a Clearpath Jackal's. URDF: `jackal_description/urdf/jackal.urdf.xacro` of
/// <https://github.com/jackal/jackal>; control: `jackal_control/config/control.yaml` there; data
/// sheet: 500 W of drive power, 2 m/s.
///
/// # Examples
///
/// ```
/// use jostle_sim::RobotConfig;
/// assert_eq!(RobotConfig::jackal().dynamic_base().map(|base| base.mass), Some(18.431));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct BaseConfig {
    /// Mass with wheels, kg. Default 18.431 (URDF: 16.523 and four of 0.477).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10_000.0, "unit" = "kg")))]
    pub mass: f32,
    /// Moment of inertia about the vertical through the centre, with wheels, kg·m². Default 0.5537
    /// (URDF: 0.4485 and the wheels where they are).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10_000.0, "unit" = "kg·m²")))]
    pub inertia: f32,
    /// Distance between front and rear wheels, m. Default 0.262 (URDF).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub wheelbase: f32,
    /// Distance between left and right wheels, m. Default 0.37559 (URDF).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub track: f32,
    /// Radius of a wheel, m. Default 0.098 (URDF).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10.0, "unit" = "m")))]
    pub wheel_radius: f32,
    /// Friction of wheels on the ground, and of the body along what it touches. Default 0.5 (URDF).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 10.0)))]
    pub friction: f32,
    /// Largest torque of a wheel at rest, N·m; it falls in a straight line to none at
    /// `motor_speed`. Default 24.5 (data sheet: such a motor's most power, a quarter of torque
    /// times speed, is 125 W a wheel).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "N·m")))]
    pub motor_torque: f32,
    /// Turning speed of a wheel that nothing holds, rad/s. Default 20.41 (data sheet: 2 m/s).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "rad/s")))]
    pub motor_speed: f32,
    /// The wheels' speeds are set as if the track were so many times as wide, because wheels slide
    /// while a base turns. Default 1.5 (control).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 10.0)))]
    pub turn_gain: f32,
    /// Time from a command until the motors heed it, s. Default 0.02 (control: one period at 50
    /// Hz).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 10.0, "unit" = "s")))]
    pub latency: f32,
}

impl Default for BaseConfig {
    fn default() -> Self {
        Self {
            mass: 18.431,
            inertia: 0.5537,
            wheelbase: 0.262,
            track: 0.37559,
            wheel_radius: 0.098,
            friction: 0.5,
            motor_torque: 24.5,
            motor_speed: 20.41,
            turn_gain: 1.5,
            latency: 0.02,
        }
    }
}

/// Largest change of the velocity, either way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct AccelerationLimits {
    /// Linear, m/s².
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "m/s²")))]
    pub v: f32,
    /// Angular, rad/s².
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "rad/s²")))]
    pub w: f32,
}

/// The laser: `beams` from the body's centre, counter-clockwise, over the full circle or a sector
/// of it.
///
/// Beam k points `angle_min` + k·increment from straight ahead. Over the full circle the increment
/// is 2π/`beams`, so that the last beam is the first one's neighbour; in a sector it is
/// `fov`/(`beams` − 1), so that the first and the last beam lie on the sector's edges, as in ROS'
/// `sensor_msgs/LaserScan`. [`LaserConfig::beam_angle`] gives it.
///
/// A sector limits what the robot observes and nothing else: crashes and the safety zone are judged
/// all round (see [`ScanSummary`](crate::ScanSummary)).
///
/// # Examples
///
/// ```
/// use jostle_sim::LaserConfig;
/// use std::f32::consts::PI;
/// // 270°, centred straight ahead.
/// let laser = LaserConfig { beams: 541, fov: 1.5 * PI, angle_min: -0.75 * PI, ..LaserConfig::default() };
/// assert!(laser.beam_angle(270).abs() < 1e-6);
/// assert!((laser.beam_angle(540) - 0.75 * std::f64::consts::PI).abs() < 1e-6);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct LaserConfig {
    /// Number of beams, evenly spaced over the angle of view; a network that learns takes 3 or
    /// more.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 3, "maximum" = 8192)))]
    pub beams: usize,
    /// A beam that meets nothing within this distance reads exactly this, m.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub range: f32,
    /// Standard deviation of the Gaussian noise on in-range returns, m; 0 turns it off.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub noise_std: f32,
    /// Angle of view, rad; less than 2π is a sector, outside which no beam exists. Default
    /// 6.2831855 (paper), the full circle.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = std::f32::consts::TAU, "default" = std::f32::consts::TAU, "unit" = "rad", "origin" = "paper")))]
    #[serde(skip_serializing_if = "is_full_circle")]
    pub fov: f32,
    /// Angle of beam 0 from straight ahead, counter-clockwise, rad; −`fov`/2 centres a sector
    /// ahead. Default 0.0 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = -std::f32::consts::TAU, "maximum" = std::f32::consts::TAU, "default" = 0.0, "unit" = "rad", "origin" = "lineage")))]
    #[serde(skip_serializing_if = "is_zero")]
    pub angle_min: f32,
    /// The code that casts the beams.
    pub kernel: LaserKernel,
}

impl Default for LaserConfig {
    fn default() -> Self {
        Self {
            beams: 512,
            range: 10.0,
            noise_std: 0.02,
            fov: std::f32::consts::TAU,
            angle_min: 0.0,
            kernel: LaserKernel::Analytic,
        }
    }
}

impl LaserConfig {
    /// True if the beams go all round.
    pub fn is_full_circle(&self) -> bool {
        is_full_circle(&self.fov)
    }

    /// Angle of a beam from straight ahead, counter-clockwise, rad; not wrapped.
    ///
    /// # Formula
    ///
    /// `angle_min` + k·2π/`beams` over the full circle, `angle_min` + k·`fov`/(`beams` − 1) in a
    /// sector.
    pub fn beam_angle(&self, beam: usize) -> f64 {
        let (view, intervals) = if self.is_full_circle() {
            (std::f64::consts::TAU, self.beams)
        } else {
            (f64::from(self.fov), self.beams - 1)
        };
        f64::from(self.angle_min) + view * beam as f64 / intervals as f64
    }

    /// Angles of all beams in order, as [`LaserConfig::beam_angle`] gives them.
    pub fn beam_angles(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        (0..self.beams).map(|beam| self.beam_angle(beam))
    }

    /// True if the beams of another laser point to the same angles, given the same number of beams.
    pub fn points_as(&self, other: &Self) -> bool {
        (self.fov, self.angle_min) == (other.fov, other.angle_min)
    }

    /// The angle of view in words, for a message: `all round from 0 rad`, `3.1 rad from -1.55 rad`.
    pub fn view(&self) -> String {
        let from = self.angle_min;
        if self.is_full_circle() {
            return format!("all round from {from} rad");
        }
        format!("{} rad from {from} rad", self.fov)
    }
}

/// True if an angle of view is the default, which is left out of stored configurations.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_full_circle(fov: &f32) -> bool {
    *fov == std::f32::consts::TAU
}

/// True if an angle is the default, which is left out of stored configurations.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_zero(angle: &f32) -> bool {
    *angle == 0.0
}

/// The code that casts beams. Both give the same ranges within 1e-4 m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum LaserKernel {
    /// Closed forms for walls, edges and circles over eight beams at a time.
    #[default]
    Analytic,
    /// parry's ray casts, one beam after the other: the oracle.
    Parry,
}

/// The ends of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeConfig {
    /// The goal is reached nearer than this, m. (Long et al. use 0.1.)
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub goal_radius: f32,
    /// A robot whose least noise-free range is below this has crashed, m. So has one that was
    /// stopped by something which no such range shows.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "unit" = "m")))]
    pub crash_range: f32,
    /// An episode that lasts this many steps is truncated.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1)))]
    pub step_limit: u32,
    /// Control period, s.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10.0, "unit" = "s")))]
    pub dt: f32,
}

impl Default for EpisodeConfig {
    fn default() -> Self {
        Self { goal_radius: 0.5, crash_range: 0.5, step_limit: 400, dt: 0.1 }
    }
}

/// Starts and goals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SpawnConfig {
    /// Least distance of a start or goal from walls and obstacles, m; at least the crash range and
    /// the body's circumradius.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub wall_clearance: f32,
    /// Least distance of a start from every other body's centre, m; at least two circumradii, and
    /// one with the crash range.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub body_clearance: f32,
    /// Least distance of a goal from its start, m. A goal can be reached from its start.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub goal_distance: f32,
}

impl Default for SpawnConfig {
    fn default() -> Self {
        Self { wall_clearance: 1.0, body_clearance: 1.0, goal_distance: 10.0 }
    }
}

/// The reward of a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct RewardConfig {
    /// Reward of reaching the goal.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0)))]
    pub goal: f32,
    /// Reward (a negative number) of a crash.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = -1_000_000.0, "maximum" = 0.0)))]
    pub collision: f32,
    /// Per metre of progress towards the goal.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0)))]
    pub progress: f32,
    /// Per rad/s of turning faster than the threshold (a negative number).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = -1_000_000.0, "maximum" = 0.0)))]
    pub rotation: f32,
    /// Turning rate above which rotation counts, rad/s.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "rad/s")))]
    pub rotation_threshold: f32,
    /// Switch: the safety-zone baseline (Jin-style).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub safety_zone: Option<SafetyZoneConfig>,
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self {
            goal: 15.0,
            collision: -15.0,
            progress: 2.5,
            rotation: -0.1,
            rotation_threshold: 0.7,
            safety_zone: None,
        }
    }
}

/// The safety-zone terms, after Jin et al. 2020 (arXiv:1911.03074), whose constants are not public.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SafetyZoneConfig {
    /// Radius of the ego zone `d_e`, m.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub ego_radius: f32,
    /// Weight of the ego term `w_e`, per metre and step.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0)))]
    pub ego_weight: f32,
    /// Radius of a standing body's social zone, m.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1000.0, "unit" = "m")))]
    pub social_radius: f32,
    /// Time by which a moving body's zone stretches ahead, s.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "s")))]
    pub social_horizon: f32,
    /// Weight of the social term `w_s`, per unit of overlap and step.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0)))]
    pub social_weight: f32,
}

impl Default for SafetyZoneConfig {
    fn default() -> Self {
        Self { ego_radius: 1.2, ego_weight: 0.3, social_radius: 0.4, social_horizon: 1.0, social_weight: 0.3 }
    }
}
