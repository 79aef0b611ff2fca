//! Why the robot is commanded to stand.

use std::fmt;

/// Why the robot is commanded to stand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stop {
    /// No scan has come yet.
    NoScan,
    /// The last scan is older than it may be.
    StaleScan,
    /// The last scan cannot be used.
    BadScan(String),
    /// No odometry has come yet.
    NoOdometry,
    /// The last odometry is older than it may be.
    StaleOdometry,
    /// The last odometry cannot be used.
    BadOdometry(String),
    /// No goal has come yet.
    NoGoal,
    /// The goal was not repeated in time, or its frame is another one now.
    LostGoal(String),
    /// The last goal cannot be used.
    BadGoal(String),
    /// The goal is reached.
    Reached,
    /// The policy answered with a number that is none.
    BadAction,
    /// The policy panicked; it is not asked again.
    Panicked(String),
    /// The node ends.
    Exit,
}

impl Stop {
    /// True if nobody wants the robot to drive: no goal, or one that is reached.
    pub fn is_idle(&self) -> bool {
        matches!(self, Self::NoGoal | Self::Reached)
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoScan => f.write_str("no scan yet"),
            Self::StaleScan => f.write_str("the last scan is too old"),
            Self::BadScan(why) => write!(f, "scan: {why}"),
            Self::NoOdometry => f.write_str("no odometry yet"),
            Self::StaleOdometry => f.write_str("the last odometry is too old"),
            Self::BadOdometry(why) => write!(f, "odometry: {why}"),
            Self::NoGoal => f.write_str("no goal"),
            Self::LostGoal(why) => write!(f, "the goal is lost: {why}"),
            Self::BadGoal(why) => write!(f, "goal: {why}"),
            Self::Reached => f.write_str("the goal is reached"),
            Self::BadAction => f.write_str("the policy answered with a number that is not finite"),
            Self::Panicked(why) => write!(f, "the policy panicked: {why}"),
            Self::Exit => f.write_str("the node ends"),
        }
    }
}
