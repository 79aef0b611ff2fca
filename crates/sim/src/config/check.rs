//! Validation of a [`SimConfig`]: the first field out of range is named with what was found and
//! expected.

use super::{
    BaseConfig, LaserConfig, RewardConfig, SafetyZoneConfig, SimConfig, SpawnConfig, WITHOUT_DYNAMICS,
};
use crate::error::SimError;

/// Most beams a laser may have; the culling's angles are good to a quarter of the spacing at this
/// count.
const BEAMS_MAX: usize = 8192;
/// Angle of view of the full circle, rad.
const FULL_CIRCLE: f32 = std::f32::consts::TAU;
/// Least gap that a sector leaves, rad: a full circle written with too few digits is no sector. The
/// gap of a scan of [`BEAMS_MAX`] beams whose last one is the first one's neighbour is seven times
/// as wide.
const GAP_MIN: f32 = 1e-4;

/// `value` must lie in [low, high]; NaN never does.
pub(crate) fn within(field: &str, value: f32, low: f32, high: f32) -> Result<(), SimError> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(SimError::OutOfRange { field: field.into(), found: value, low, high, above_low: false })
}

/// `value` must lie in (0, high].
fn positive(field: &str, value: f32, high: f32) -> Result<(), SimError> {
    if value > 0.0 && value <= high {
        return Ok(());
    }
    Err(SimError::OutOfRange { field: field.into(), found: value, low: 0.0, high, above_low: true })
}

impl SimConfig {
    /// Checks every field.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        if self.room.map.is_none() {
            positive("room.width", self.room.width, 1000.0)?;
            positive("room.height", self.room.height, 1000.0)?;
        }
        positive("robot.length", self.robot.length, 100.0)?;
        positive("robot.width", self.robot.width, 100.0)?;
        positive("robot.v_max", self.robot.v_max, 100.0)?;
        positive("robot.w_max", self.robot.w_max, 100.0)?;
        if let Some(limits) = &self.robot.acceleration {
            positive("robot.acceleration.v", limits.v, 1e6)?;
            positive("robot.acceleration.w", limits.w, 1e6)?;
        }
        if cfg!(not(feature = "dynamics")) && !self.robot.dynamics.is_kinematic() {
            return Err(SimError::field("robot.dynamics", "rapier", WITHOUT_DYNAMICS));
        }
        if let Some(base) = &self.robot.base {
            base.validate()?;
        }
        self.laser.validate()?;
        positive("episode.goal_radius", self.episode.goal_radius, 100.0)?;
        within("episode.crash_range", self.episode.crash_range, 0.0, self.laser.range)?;
        positive("episode.dt", self.episode.dt, 10.0)?;
        if self.episode.step_limit == 0 {
            return Err(SimError::field("episode.step_limit", 0, "at least 1"));
        }
        self.spawn.validate()?;
        self.reward.validate()?;
        self.check_wall_clearance()
    }

    /// Refuses starts at a wall that are crashes.
    fn check_wall_clearance(&self) -> Result<(), SimError> {
        let (found, crash_range) = (self.spawn.wall_clearance, self.episode.crash_range);
        let least = self.passing_radius();
        if found >= least {
            return Ok(());
        }
        let why = if least == crash_range {
            "the crash range, so that no start is a crash"
        } else {
            "the body's circumradius, so that no start touches a wall"
        };
        Err(SimError::field("spawn.wall_clearance", found, format!("at least {least} m, {why}")))
    }
}

impl BaseConfig {
    /// Checks every field.
    ///
    /// # Errors
    ///
    /// [`SimError::OutOfRange`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        positive("robot.base.mass", self.mass, 1e4)?;
        positive("robot.base.inertia", self.inertia, 1e4)?;
        positive("robot.base.wheelbase", self.wheelbase, 100.0)?;
        positive("robot.base.track", self.track, 100.0)?;
        positive("robot.base.wheel_radius", self.wheel_radius, 10.0)?;
        within("robot.base.friction", self.friction, 0.0, 10.0)?;
        within("robot.base.motor_torque", self.motor_torque, 0.0, 1e6)?;
        positive("robot.base.motor_speed", self.motor_speed, 1e6)?;
        within("robot.base.turn_gain", self.turn_gain, 0.0, 10.0)?;
        within("robot.base.latency", self.latency, 0.0, 10.0)
    }
}

impl LaserConfig {
    /// Checks the laser's fields.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        if self.beams == 0 || self.beams > BEAMS_MAX {
            return Err(SimError::field(
                "laser.beams",
                self.beams,
                format!("an integer in [1, {BEAMS_MAX}]"),
            ));
        }
        positive("laser.range", self.range, 1000.0)?;
        within("laser.noise_std", self.noise_std, 0.0, 100.0)?;
        if !(self.fov > 0.0 && self.fov <= FULL_CIRCLE) {
            return Err(SimError::field("laser.fov", self.fov, format!("radians in (0, {FULL_CIRCLE}]")));
        }
        if !self.is_full_circle() && self.fov > FULL_CIRCLE - GAP_MIN {
            let expected =
                format!("{FULL_CIRCLE} for the full circle, or a sector with a gap of {GAP_MIN} rad");
            return Err(SimError::field("laser.fov", self.fov, expected));
        }
        if !(-FULL_CIRCLE..=FULL_CIRCLE).contains(&self.angle_min) {
            let expected = format!("radians in [{}, {FULL_CIRCLE}]", -FULL_CIRCLE);
            return Err(SimError::field("laser.angle_min", self.angle_min, expected));
        }
        if !self.is_full_circle() && self.beams == 1 {
            return Err(SimError::field(
                "laser.beams",
                1,
                "at least 2 in a sector, one for each of its edges",
            ));
        }
        Ok(())
    }
}

impl SpawnConfig {
    fn validate(&self) -> Result<(), SimError> {
        within("spawn.wall_clearance", self.wall_clearance, 0.0, 1000.0)?;
        within("spawn.body_clearance", self.body_clearance, 0.0, 1000.0)?;
        within("spawn.goal_distance", self.goal_distance, 0.0, 1000.0)
    }
}

impl RewardConfig {
    fn validate(&self) -> Result<(), SimError> {
        within("reward.goal", self.goal, 0.0, 1e6)?;
        within("reward.collision", self.collision, -1e6, 0.0)?;
        within("reward.progress", self.progress, 0.0, 1e6)?;
        within("reward.rotation", self.rotation, -1e6, 0.0)?;
        within("reward.rotation_threshold", self.rotation_threshold, 0.0, 1e6)?;
        self.safety_zone.as_ref().map_or(Ok(()), SafetyZoneConfig::validate)
    }
}

impl SafetyZoneConfig {
    fn validate(&self) -> Result<(), SimError> {
        within("reward.safety_zone.ego_radius", self.ego_radius, 0.0, 1000.0)?;
        within("reward.safety_zone.ego_weight", self.ego_weight, 0.0, 1e6)?;
        positive("reward.safety_zone.social_radius", self.social_radius, 1000.0)?;
        within("reward.safety_zone.social_horizon", self.social_horizon, 0.0, 1000.0)?;
        within("reward.safety_zone.social_weight", self.social_weight, 0.0, 1e6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Dynamics, RobotConfig};

    #[track_caller]
    fn check(toml: &str, expected: &str) {
        let config: SimConfig = toml::from_str(toml).expect("well-formed");
        let message = config.validate().expect_err("out of range").to_string();
        assert_eq!(message, expected);
    }

    #[test]
    fn defaults_are_valid_and_survive_toml_and_json() {
        let config = SimConfig::default();
        assert_eq!(config.validate(), Ok(()));
        assert_eq!(config.observation_len(), 1540);
        let text = toml::to_string(&config).expect("toml");
        assert_eq!(toml::from_str::<SimConfig>(&text).expect("toml"), config);
        let text = serde_json::to_string(&config).expect("json");
        assert_eq!(serde_json::from_str::<SimConfig>(&text).expect("json"), config);
    }

    #[test]
    fn messages_name_field_found_and_expected() {
        check("[laser]\nbeams = 0", "laser.beams: found 0, expected an integer in [1, 8192]");
        check("[laser]\nnoise_std = -1.0", "laser.noise_std: found -1, expected a number in [0, 100]");
        check("[robot]\nv_max = nan", "robot.v_max: found NaN, expected a number in (0, 100]");
        check("[episode]\nstep_limit = 0", "episode.step_limit: found 0, expected at least 1");
        check(
            "[reward.safety_zone]\nego_weight = -1.0",
            "reward.safety_zone.ego_weight: found -1, expected a number in [0, 1000000]",
        );
    }

    #[test]
    fn a_sector_is_given_in_radians_within_the_circle() {
        let of_fov = |value: &str, expected: &str| {
            check(
                &format!("[laser]\nfov = {value}"),
                &format!("laser.fov: found {value}, expected {expected}"),
            );
        };
        let radians = "radians in (0, 6.2831855]";
        for value in ["270", "0", "-1", "6.2832"] {
            of_fov(value, radians);
        }
        check("[laser]\nfov = nan", &format!("laser.fov: found NaN, expected {radians}"));
        // Two pi with too few digits is no sector whose ends are a hair apart.
        let gap = "6.2831855 for the full circle, or a sector with a gap of 0.0001 rad";
        for value in ["6.2831", "6.283185"] {
            of_fov(value, gap);
        }
        check(
            "[laser]\nangle_min = -180.0",
            "laser.angle_min: found -180, expected radians in [-6.2831855, 6.2831855]",
        );
        check(
            "[laser]\nangle_min = nan",
            "laser.angle_min: found NaN, expected radians in [-6.2831855, 6.2831855]",
        );
        let one = "laser.beams: found 1, expected at least 2 in a sector, one for each of its edges";
        check("[laser]\nbeams = 1\nfov = 1.0", one);
        for accepted in
            ["fov = 6.283", "fov = 6.283185307179586", "fov = 0.001\nbeams = 2", "angle_min = -6.283185307"]
        {
            let config: SimConfig = toml::from_str(&format!("[laser]\n{accepted}")).expect("well-formed");
            assert_eq!(config.validate(), Ok(()), "{accepted}");
        }
    }

    #[test]
    fn a_full_circle_from_straight_ahead_is_stored_as_before_there_were_sectors() {
        let before = r#"{"beams":512,"range":10.0,"noise_std":0.02,"kernel":"analytic"}"#;
        let laser: LaserConfig = serde_json::from_str(before).expect("JSON");
        assert_eq!(laser, LaserConfig::default());
        assert_eq!(serde_json::to_string(&laser).expect("JSON"), before);
        let sector = LaserConfig { fov: 3.0, angle_min: -1.5, ..laser };
        let text = serde_json::to_string(&sector).expect("JSON");
        assert!(text.contains(r#""fov":3.0,"angle_min":-1.5"#), "{text}");
        assert_eq!(serde_json::from_str::<LaserConfig>(&text).expect("JSON"), sector);
    }

    #[test]
    fn a_kinematic_robot_is_stored_as_before_there_were_bases() {
        let before = r#"{"length":0.5,"width":0.5,"v_max":1.0,"w_max":1.0}"#;
        let robot: RobotConfig = serde_json::from_str(before).expect("JSON");
        assert_eq!(robot, RobotConfig::default());
        assert_eq!(serde_json::to_string(&robot).expect("JSON"), before);
        let moved = RobotConfig { dynamics: Dynamics::Rapier, base: Some(BaseConfig::default()), ..robot };
        let text = serde_json::to_string(&moved).expect("JSON");
        assert!(text.contains(r#""dynamics":"rapier","base":{"mass":18.431,"#), "{text}");
        assert_eq!(serde_json::from_str::<RobotConfig>(&text).expect("JSON"), moved);
        check(
            "[robot]\ndynamics = \"rapier\"\nbase = { mass = 0.0 }",
            "robot.base.mass: found 0, expected a number in (0, 10000]",
        );
    }

    #[test]
    fn unknown_fields_are_refused() {
        assert!(toml::from_str::<SimConfig>("[laser]\nbeam = 3").is_err());
        assert!(toml::from_str::<SimConfig>("[lidar]\nbeams = 3").is_err());
    }
}
