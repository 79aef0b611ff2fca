//! From messages to commands: everything that this node decides, without ROS and without a clock of
//! its own.
//!
//! Whoever calls hands over messages as they arrive and the time of one steady clock, and asks
//! [`Driver::step`] for a command whenever something has arrived or [`Driver::deadline`] has come.
//!
//! Architecture invariant: a command other than zero is only given if the last scan, the last
//! odometry and the goal are there, young and valid, and the policy has answered with finite
//! numbers; it is always within the [`Limits`]. As soon as that no longer holds, a zero command is
//! due at once, not only at the next beat.

use std::panic::{AssertUnwindSafe, catch_unwind};

use jostle_arena::RobotPolicy;
use jostle_sim::SimConfig;

use crate::clock::Clock;
use crate::frames::{Motion, Wish, fixed_goal, in_robot, motion, wish};
use crate::limits::Limits;
use crate::messages::{LaserScan, Odometry, PoseStamped, Time};
use crate::params::{Idle, Params};
use crate::row::History;
use crate::scan::{Resampler, Return};
use crate::stop::Stop;

/// Zero commands that are given before the topic is left to others.
const LAST_ZEROS: u32 = 10;
/// Two goals nearer to each other than this are one, m.
const SAME_GOAL: f64 = 1e-3;

/// A command to the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Command {
    /// m/s.
    pub v: f64,
    /// rad/s.
    pub w: f64,
    /// When the scan was measured that it answers, by the scanner's clock. Of a zero command it is
    /// now, by that clock. The origin of time where no scan has come.
    pub stamp: Time,
    /// Why it is zero, if it is not the policy's.
    pub stop: Option<Stop>,
}

/// Something that has to be young.
#[derive(Clone, Debug, Default)]
struct Fresh {
    /// When the last valid one arrived.
    arrived: Option<f64>,
    /// Its stamp.
    stamp: Time,
    /// The fault of the last one.
    refused: Option<String>,
}

impl Fresh {
    /// True if a message says anything new. One with the stamp of the last one does not: whoever
    /// sends it is stuck. Without stamps every message is new.
    fn is_new(&self, stamp: Time) -> bool {
        stamp == Time::default() || self.arrived.is_none() || stamp != self.stamp
    }

    fn accept(&mut self, now: f64, stamp: Time) {
        *self = Self { arrived: Some(now), stamp, refused: None };
    }

    /// When it becomes too old.
    fn expires(&self, timeout: f64) -> f64 {
        self.arrived.map_or(f64::INFINITY, |arrived| arrived + timeout)
    }
}

/// The robot's goal.
#[derive(Clone, Debug)]
enum Goal {
    None,
    Refused(String),
    Lost(String),
    /// It came before any odometry; its frame is not yet known.
    Pending {
        wish: Wish,
        arrived: f64,
    },
    /// In the odometry's frame.
    Fixed {
        place: [f64; 2],
        arrived: f64,
    },
    Reached {
        place: [f64; 2],
    },
}

/// Decides what the robot is told.
pub struct Driver {
    policy: Box<dyn RobotPolicy>,
    resampler: Resampler,
    history: History,
    clock: Clock,
    limits: Limits,
    params: Params,
    goal_radius: f64,
    ranges: Vec<f32>,
    returns: Vec<Return>,
    row: Vec<f32>,
    scan: Fresh,
    odom: Fresh,
    motion: Option<Motion>,
    goal: Goal,
    panicked: Option<String>,
    /// True if the last command was not zero.
    driving: bool,
    /// Zero commands since nobody wants the robot to drive.
    idle_zeros: u32,
}

impl Driver {
    /// A driver by a policy, which was trained with the settings `sim`.
    pub fn new(policy: Box<dyn RobotPolicy>, sim: &SimConfig, params: Params) -> Self {
        // 0.1, not the single-precision number nearest to it.
        let decimal = |value: f32| value.to_string().parse::<f64>().expect("a printed number can be read");
        let period = decimal(sim.episode.dt);
        Self {
            policy,
            resampler: Resampler::new(&sim.laser, &params.scan),
            history: History::new(period, sim.laser.range),
            clock: Clock::new(period, params.clock.window),
            limits: Limits::new(&sim.robot, &params.command),
            goal_radius: params.goal.radius.unwrap_or_else(|| decimal(sim.episode.goal_radius)),
            params,
            ranges: Vec::new(),
            returns: Vec::new(),
            row: Vec::new(),
            scan: Fresh::default(),
            odom: Fresh::default(),
            motion: None,
            goal: Goal::None,
            panicked: None,
            driving: false,
            idle_zeros: 0,
        }
    }

    /// The policy's period, s.
    pub fn period(&self) -> f64 {
        self.clock.period()
    }

    /// The panic's message, if the policy panicked. It is not asked again.
    pub fn panicked(&self) -> Option<&str> {
        self.panicked.as_deref()
    }

    /// A scan has arrived.
    pub fn scan(&mut self, now: f64, scan: &LaserScan) {
        let stamp = scan.header.stamp;
        if !self.scan.is_new(stamp) {
            return;
        }
        if let Err(why) = self.resampler.resample(scan, &mut self.ranges, &mut self.returns) {
            self.scan.refused = Some(why);
            return;
        }
        // A clock that was set back, or messages that now have stamps: what came before is from
        // another time.
        if stamp < self.scan.stamp || (self.scan.stamp == Time::default() && stamp != Time::default()) {
            self.history.clear();
        }
        let time = if stamp == Time::default() { now } else { stamp.nanoseconds() as f64 * 1e-9 };
        self.history.push(time, &self.ranges);
        self.scan.accept(now, stamp);
        self.clock.scan(now);
    }

    /// Odometry has arrived.
    pub fn odometry(&mut self, now: f64, odometry: &Odometry) {
        let stamp = odometry.header.stamp;
        if !self.odom.is_new(stamp) {
            return;
        }
        let motion = match motion(odometry) {
            Ok(motion) => motion,
            Err(why) => {
                self.odom.refused = Some(why);
                return;
            }
        };
        if let (Some(before), Goal::Fixed { .. } | Goal::Reached { .. }) = (&self.motion, &self.goal) {
            let moved = (motion.pose[0] - before.pose[0]).hypot(motion.pose[1] - before.pose[1]);
            if motion.fixed_frame != before.fixed_frame {
                let (old, new) = (&before.fixed_frame, &motion.fixed_frame);
                self.goal = Goal::Lost(format!("the odometry's frame was {old} and is {new}"));
            } else if moved > self.params.odom.jump {
                self.goal = Goal::Lost(format!("the odometry jumped by {moved:.2} m"));
            }
        }
        if let Goal::Pending { wish, arrived } = &self.goal {
            self.goal = self.fixed(wish, *arrived, &motion);
        }
        self.motion = Some(motion);
        self.odom.accept(now, stamp);
    }

    /// A goal has arrived.
    pub fn goal(&mut self, now: f64, goal: &PoseStamped) {
        let found = match wish(goal) {
            Err(why) => Goal::Refused(why),
            Ok(wish) => match &self.motion {
                Some(motion) => self.fixed(&wish, now, motion),
                None => Goal::Pending { wish, arrived: now },
            },
        };
        // A goal that is repeated after it was reached stays reached.
        if let (Goal::Reached { place: old }, Goal::Fixed { place: new, .. }) = (&self.goal, &found)
            && (old[0] - new[0]).hypot(old[1] - new[1]) < SAME_GOAL
        {
            return;
        }
        self.goal = found;
    }

    fn fixed(&self, wish: &Wish, arrived: f64, motion: &Motion) -> Goal {
        match fixed_goal(wish, motion, &self.params.goal.fixed_frames) {
            Ok(place) => Goal::Fixed { place, arrived },
            Err(why) => Goal::Refused(why),
        }
    }

    /// When [`Driver::step`] has to be called at the latest.
    pub fn deadline(&self) -> f64 {
        if !self.driving {
            return self.clock.deadline();
        }
        let goal = match (&self.goal, self.params.goal.timeout) {
            (Goal::Fixed { arrived, .. }, Some(timeout)) => arrived + timeout,
            _ => f64::INFINITY,
        };
        let scan = self.scan.expires(self.params.scan.timeout);
        let odom = self.odom.expires(self.params.odom.timeout);
        self.clock.deadline().min(scan).min(odom).min(goal)
    }

    /// The command that is due now, if one is: at each beat, and at once when the robot has to
    /// stop.
    pub fn step(&mut self, now: f64) -> Option<Command> {
        let beat = self.clock.tick(now);
        let stop = self.stop(now);
        let must_stop = stop.is_some() && self.driving;
        if !beat && !must_stop {
            return None;
        }
        let command = match stop {
            Some(stop) => self.zero(now, stop),
            None => self.drive(now),
        };
        self.driving = command.v != 0.0 || command.w != 0.0;
        let idle = command.stop.as_ref().is_some_and(Stop::is_idle);
        self.idle_zeros = if idle { self.idle_zeros.saturating_add(1) } else { 0 };
        let silent = self.params.command.idle == Idle::Silence && self.idle_zeros > LAST_ZEROS;
        (!silent).then_some(command)
    }

    /// A zero command.
    pub fn zero(&self, now: f64, stop: Stop) -> Command {
        let stamped = self.scan.arrived.filter(|_| self.scan.stamp != Time::default());
        let stamp = stamped.map_or_else(Time::default, |arrived| self.scan.stamp.later(now - arrived));
        Command { v: 0.0, w: 0.0, stamp, stop: Some(stop) }
    }

    /// Why the robot has to stand, if it has to.
    fn stop(&mut self, now: f64) -> Option<Stop> {
        if let Some(why) = &self.panicked {
            return Some(Stop::Panicked(why.clone()));
        }
        if let Some(why) = &self.scan.refused {
            return Some(Stop::BadScan(why.clone()));
        }
        if let Some(why) = &self.odom.refused {
            return Some(Stop::BadOdometry(why.clone()));
        }
        if self.scan.arrived.is_none() {
            return Some(Stop::NoScan);
        }
        if now >= self.scan.expires(self.params.scan.timeout) {
            return Some(Stop::StaleScan);
        }
        let Some(motion) = &self.motion else { return Some(Stop::NoOdometry) };
        if now >= self.odom.expires(self.params.odom.timeout) {
            return Some(Stop::StaleOdometry);
        }
        match &self.goal {
            Goal::None | Goal::Pending { .. } => Some(Stop::NoGoal),
            Goal::Refused(why) => Some(Stop::BadGoal(why.clone())),
            Goal::Lost(why) => Some(Stop::LostGoal(why.clone())),
            Goal::Reached { .. } => Some(Stop::Reached),
            Goal::Fixed { place, arrived } => {
                if self.params.goal.timeout.is_some_and(|timeout| now >= arrived + timeout) {
                    self.goal = Goal::Lost("it was not repeated in time".to_owned());
                    return Some(Stop::LostGoal("it was not repeated in time".to_owned()));
                }
                let [x, y] = in_robot(*place, motion.pose);
                if x.hypot(y) < self.goal_radius {
                    self.goal = Goal::Reached { place: *place };
                    return Some(Stop::Reached);
                }
                None
            }
        }
    }

    /// The policy's command, within the limits. Called where nothing stops the robot.
    fn drive(&mut self, now: f64) -> Command {
        let (Some(motion), Goal::Fixed { place, .. }) = (&self.motion, &self.goal) else {
            return self.zero(now, Stop::NoGoal);
        };
        self.history.write(in_robot(*place, motion.pose), motion.velocity, &mut self.row);
        let mut action = [[f32::NAN; 2]];
        let asked = catch_unwind(AssertUnwindSafe(|| self.policy.act(&self.row, &mut action)));
        if let Err(panic) = asked {
            let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            let why = text.unwrap_or_else(|| "without a message".to_owned());
            self.panicked = Some(why.clone());
            return self.zero(now, Stop::Panicked(why));
        }
        match self.limits.apply(action[0], &self.returns) {
            Some([v, w]) => Command { v, w, stamp: self.scan.stamp, stop: None },
            None => self.zero(now, Stop::BadAction),
        }
    }
}

#[cfg(test)]
mod tests {
    use jostle_arena::PerRow;

    use super::*;
    use crate::messages::{
        Header, Pose, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3,
    };

    fn stamp(now: f64) -> Time {
        let nanoseconds = ((100.0 + now) * 1e9).round() as i64;
        Time { sec: (nanoseconds / 1_000_000_000) as i32, nanosec: (nanoseconds % 1_000_000_000) as u32 }
    }

    fn header(now: f64, frame: &str) -> Header {
        Header { stamp: stamp(now), frame_id: frame.to_owned() }
    }

    fn scan(now: f64) -> LaserScan {
        let increment = std::f32::consts::TAU / 512.0;
        LaserScan {
            header: header(now, "laser"),
            angle_min: 0.0,
            angle_max: increment * 511.0,
            angle_increment: increment,
            range_min: 0.05,
            range_max: 10.0,
            ranges: vec![5.0; 512],
            ..LaserScan::default()
        }
    }

    fn odometry(now: f64, x: f64) -> Odometry {
        let pose = Pose { position: Vector3 { x, ..Vector3::default() }, orientation: Quaternion::default() };
        let linear = Vector3 { x: 0.5, ..Vector3::default() };
        Odometry {
            header: header(now, "odom"),
            child_frame_id: "base_link".to_owned(),
            pose: PoseWithCovariance { pose, ..PoseWithCovariance::default() },
            twist: TwistWithCovariance {
                twist: Twist { linear, ..Twist::default() },
                ..TwistWithCovariance::default()
            },
        }
    }

    fn goal(now: f64, x: f64) -> PoseStamped {
        let position = Vector3 { x, ..Vector3::default() };
        PoseStamped { header: header(now, "odom"), pose: Pose { position, ..Pose::default() } }
    }

    fn driver_with(params: Params, policy: impl FnMut(&[f32]) -> [f32; 2] + Send + 'static) -> Driver {
        Driver::new(Box::new(PerRow::new(policy)), &SimConfig::default(), params)
    }

    fn ahead() -> Driver {
        driver_with(Params::default(), |_| [0.75, 0.25])
    }

    /// A driver that drives, at this time.
    fn driving_at(now: f64) -> Driver {
        let mut driver = ahead();
        feed(&mut driver, now);
        driver.goal(now, &goal(now, 5.0));
        assert_eq!(told(&mut driver, now), (0.75, 0.25, None));
        driver
    }

    fn feed(driver: &mut Driver, now: f64) {
        driver.odometry(now, &odometry(now, 0.0));
        driver.scan(now, &scan(now));
    }

    #[track_caller]
    fn told(driver: &mut Driver, now: f64) -> (f64, f64, Option<Stop>) {
        let command = driver.step(now).expect("a command is due");
        (command.v, command.w, command.stop)
    }

    #[track_caller]
    fn stops(driver: &mut Driver, now: f64, why: Stop) {
        assert_eq!(told(driver, now), (0.0, 0.0, Some(why)));
    }

    #[test]
    fn it_drives_by_the_row_that_the_policy_was_trained_with() {
        let mut driver = driver_with(Params::default(), |row| {
            assert_eq!(row.len(), 1540);
            assert!(row[..1536].iter().all(|value| *value == 0.0), "5 m of 10 m is 0");
            assert_eq!(row[1536..], [5.0, 0.0, 0.5, 0.0]);
            [0.5, -0.5]
        });
        feed(&mut driver, 1.0);
        driver.goal(1.0, &goal(1.0, 5.0));
        let command = driver.step(1.0).expect("due");
        let expected = Command { v: 0.5, w: -0.5, stamp: stamp(1.0), stop: None };
        assert_eq!(command, expected);
        assert_eq!(driver.step(1.05), None, "once in a period");
    }

    #[test]
    fn nothing_is_driven_before_everything_is_there() {
        let mut driver = ahead();
        stops(&mut driver, 0.0, Stop::NoScan);
        driver.goal(0.05, &goal(0.05, 5.0));
        stops(&mut driver, 0.2, Stop::NoScan);
        driver.scan(0.3, &scan(0.3));
        stops(&mut driver, 0.31, Stop::NoOdometry);
        feed(&mut driver, 0.41);
        assert_eq!(told(&mut driver, 0.41), (0.75, 0.25, None));
        let mut without_goal = ahead();
        feed(&mut without_goal, 0.0);
        stops(&mut without_goal, 0.0, Stop::NoGoal);
    }

    #[test]
    fn a_stale_scan_stops_it_at_once_between_two_beats() {
        let mut driver = driving_at(1.0);
        // Odometry goes on, scans do not.
        for now in [1.05, 1.1, 1.15] {
            driver.odometry(now, &odometry(now, 0.0));
        }
        assert!(driver.step(1.11).is_some(), "still young");
        assert!(driver.step(1.199).is_none());
        assert!((driver.deadline() - 1.2).abs() < 1e-9, "the loop is woken up when the scan is too old");
        let command = driver.step(1.2).expect("at once");
        assert_eq!((command.v, command.w, command.stop), (0.0, 0.0, Some(Stop::StaleScan)));
        assert_eq!(command.stamp, stamp(1.2), "a zero command is as old as it is");
        // And goes on when scans come again.
        feed(&mut driver, 1.5);
        assert_eq!(told(&mut driver, 1.5), (0.75, 0.25, None));
    }

    #[test]
    fn stale_odometry_stops_it_at_once() {
        let mut driver = driving_at(1.0);
        for now in [1.1, 1.19] {
            driver.scan(now, &scan(now));
            driver.step(now);
        }
        assert!((driver.deadline() - 1.2).abs() < 1e-9);
        stops(&mut driver, 1.2, Stop::StaleOdometry);
    }

    #[test]
    fn a_sender_that_is_stuck_is_a_stale_one() {
        let mut driver = driving_at(1.0);
        for now in [1.05, 1.1, 1.15] {
            driver.odometry(now, &odometry(now, 0.0));
            // The scan of 1.0 again and again.
            driver.scan(now, &scan(1.0));
        }
        driver.step(1.15);
        stops(&mut driver, 1.2, Stop::StaleScan);
        // Senders without stamps are taken by when they arrive.
        let mut driver = ahead();
        let unstamped = |now: f64| LaserScan { header: Header::default(), ..scan(now) };
        for now in [2.0, 2.1, 2.2, 2.3] {
            driver.odometry(now, &odometry(now, 0.0));
            driver.goal(now, &goal(now, 5.0));
            driver.scan(now, &unstamped(now));
            assert_eq!(told(&mut driver, now).2, None);
        }
    }

    #[test]
    fn a_sender_that_starts_again_with_an_earlier_clock_is_followed() {
        let mut driver = driving_at(50.0);
        driver.odometry(51.0, &odometry(-99.0, 0.0));
        driver.scan(51.0, &scan(-99.0));
        assert_eq!(told(&mut driver, 51.0).2, None);
        // What it measured before is from another time: no frame of the row is of then.
        let mut driver = ahead();
        driver.goal(1.0, &goal(1.0, 5.0));
        for (now, stamped, range) in [(1.0, 1.0, 2.0), (1.1, 1.1, 2.0), (1.2, 1.05, 5.0)] {
            driver.odometry(now, &odometry(now, 0.0));
            driver.scan(now, &LaserScan { ranges: vec![range; 512], ..scan(stamped) });
        }
        assert_eq!(told(&mut driver, 1.2).2, None);
        assert!(driver.row[..1536].iter().all(|value| *value == 0.0));
    }

    #[test]
    fn a_scan_that_is_none_stops_it_until_a_good_one_comes() {
        let mut driver = driving_at(1.0);
        driver.odometry(1.04, &odometry(1.04, 0.0));
        driver.scan(1.04, &LaserScan { ranges: vec![5.0; 3], ..scan(1.04) });
        let command = driver.step(1.04).expect("at once");
        assert!(matches!(command.stop, Some(Stop::BadScan(_))) && command.v == 0.0);
        feed(&mut driver, 1.1);
        assert_eq!(told(&mut driver, 1.1).2, None);
        driver.scan(1.14, &LaserScan { ranges: vec![f32::NAN; 512], ..scan(1.14) });
        assert!(matches!(told(&mut driver, 1.14).2, Some(Stop::BadScan(_))));
    }

    #[test]
    fn odometry_that_is_not_finite_stops_it_at_once() {
        let mut driver = driving_at(1.0);
        driver.odometry(1.04, &odometry(1.04, f64::NAN));
        assert!(matches!(told(&mut driver, 1.04), (0.0, 0.0, Some(Stop::BadOdometry(_)))));
        feed(&mut driver, 1.12);
        assert_eq!(told(&mut driver, 1.12).2, None);
    }

    #[test]
    fn a_goal_that_is_not_finite_or_in_an_unknown_frame_stops_it_at_once() {
        let mut driver = driving_at(1.0);
        driver.goal(1.04, &goal(1.04, f64::INFINITY));
        assert!(matches!(told(&mut driver, 1.04), (0.0, 0.0, Some(Stop::BadGoal(_)))));
        let mut driver = driving_at(1.0);
        let elsewhere = PoseStamped { header: header(1.04, "world"), ..goal(1.04, 5.0) };
        driver.goal(1.04, &elsewhere);
        assert!(matches!(told(&mut driver, 1.04), (0.0, 0.0, Some(Stop::BadGoal(_)))));
        driver.goal(1.05, &goal(1.05, 5.0));
        feed(&mut driver, 1.14);
        assert_eq!(told(&mut driver, 1.14).2, None);
    }

    #[test]
    fn a_goal_that_is_reached_stops_it_and_stays_reached() {
        let mut driver = driving_at(1.0);
        driver.odometry(1.02, &odometry(1.02, 4.4));
        assert_eq!(driver.goal_radius, 0.5);
        // A jump of 4.4 m would lose the goal.
        assert!(matches!(told(&mut driver, 1.02).2, Some(Stop::LostGoal(_))));
        let mut driver = driving_at(1.0);
        let mut now = 1.0;
        for x in [0.9, 1.8, 2.7, 3.6, 4.4] {
            now += 0.1;
            driver.odometry(now, &odometry(now, x));
            driver.scan(now, &scan(now));
            assert_eq!(told(&mut driver, now).2, None, "at {x}");
        }
        driver.odometry(now + 0.02, &odometry(now + 0.02, 4.51));
        stops(&mut driver, now + 0.02, Stop::Reached);
        // Pushed away, and told the same goal again: nobody asked for another drive.
        now += 0.1;
        driver.odometry(now, &odometry(now, 4.0));
        driver.scan(now, &scan(now));
        driver.goal(now, &goal(now, 5.0));
        stops(&mut driver, now, Stop::Reached);
        driver.goal(now + 0.05, &goal(now, 6.0));
        driver.scan(now + 0.1, &scan(now + 0.1));
        assert_eq!(told(&mut driver, now + 0.1).2, None);
    }

    #[test]
    fn a_goal_is_lost_when_it_is_not_repeated_or_its_frame_changes() {
        let mut params = Params::default();
        params.goal.timeout = Some(0.15);
        let mut driver = driver_with(params, |_| [0.5, 0.0]);
        feed(&mut driver, 1.0);
        driver.goal(1.0, &goal(1.0, 5.0));
        assert_eq!(told(&mut driver, 1.0).2, None);
        feed(&mut driver, 1.1);
        assert_eq!(told(&mut driver, 1.1).2, None);
        assert!((driver.deadline() - 1.15).abs() < 1e-9);
        stops(&mut driver, 1.15, Stop::LostGoal("it was not repeated in time".to_owned()));
        let mut driver = driving_at(1.0);
        let other = Odometry { header: header(1.05, "odom_b"), ..odometry(1.05, 0.0) };
        driver.odometry(1.05, &other);
        stops(&mut driver, 1.05, Stop::LostGoal("the odometry's frame was odom and is odom_b".to_owned()));
    }

    #[test]
    fn a_goal_that_comes_before_odometry_waits_for_it() {
        let mut driver = ahead();
        driver.goal(0.9, &goal(0.9, 5.0));
        feed(&mut driver, 1.0);
        assert_eq!(told(&mut driver, 1.0).2, None);
    }

    #[test]
    fn an_answer_that_is_no_number_is_a_zero_command() {
        let mut driver = driver_with(Params::default(), |_| [f32::NAN, 0.0]);
        feed(&mut driver, 1.0);
        driver.goal(1.0, &goal(1.0, 5.0));
        stops(&mut driver, 1.0, Stop::BadAction);
    }

    #[test]
    fn a_panic_is_a_zero_command_and_the_policy_is_not_asked_again() {
        let mut calls = 0;
        let mut driver = driver_with(Params::default(), move |_| {
            calls += 1;
            assert!(calls < 2, "for a test");
            [0.5, 0.0]
        });
        feed(&mut driver, 1.0);
        driver.goal(1.0, &goal(1.0, 5.0));
        assert_eq!(told(&mut driver, 1.0).2, None);
        feed(&mut driver, 1.1);
        stops(&mut driver, 1.1, Stop::Panicked("for a test".to_owned()));
        feed(&mut driver, 1.2);
        stops(&mut driver, 1.2, Stop::Panicked("for a test".to_owned()));
        assert_eq!(driver.panicked(), Some("for a test"));
    }

    #[test]
    fn limits_hold_whatever_the_policy_says() {
        let mut params = Params::default();
        (params.command.v_max, params.command.stop_distance) = (Some(0.3), Some(0.6));
        let mut driver = driver_with(params, |_| [9.0, 9.0]);
        feed(&mut driver, 1.0);
        driver.goal(1.0, &goal(1.0, 5.0));
        assert_eq!(told(&mut driver, 1.0), (0.3, 1.0, None));
        let mut near = scan(1.1);
        near.ranges[3] = 0.5;
        driver.odometry(1.1, &odometry(1.1, 0.0));
        driver.scan(1.1, &near);
        assert_eq!(told(&mut driver, 1.1), (0.0, 1.0, None));
    }

    #[test]
    fn the_topic_is_left_to_others_if_asked_for() {
        let mut params = Params::default();
        params.command.idle = Idle::Silence;
        let mut driver = driver_with(params, |_| [0.5, 0.0]);
        let mut given = 0;
        for k in 0..30 {
            let now = f64::from(k) * 0.1;
            feed(&mut driver, now);
            given += u32::from(driver.step(now).is_some());
        }
        assert_eq!(given, LAST_ZEROS);
        driver.goal(3.0, &goal(3.0, 5.0));
        feed(&mut driver, 3.0);
        assert_eq!(told(&mut driver, 3.0).2, None);
        // A reason to stop that is no wish of anybody is repeated for ever.
        for k in 0..30 {
            assert!(driver.step(3.5 + f64::from(k) * 0.12).is_some());
        }
    }
}
