//! A policy of jostle on a ROS 2 robot: laser scans, odometry and a goal in, velocity commands out.
//! It needs no installation of ROS: the client and the transport (DDS) are Rust.
//!
//! Reading order: [`driver`] (all decisions), and what it is made of: [`scan`] (any scanner to the
//! policy's beams), [`frames`] (where robot and goal are), [`row`] (the observation), [`clock`]
//! (when a command is due), [`limits`] (what the policy cannot override), [`stop`] (why the robot
//! stands). Around it: [`params`], [`policy`], [`messages`], [`node`], which knows ROS, and
//! [`guard`], which commands zero where the node is killed.
//!
//! Architecture invariant: everything but [`node`] and [`guard`] is a function of messages and of
//! the time that it is told.

#![forbid(unsafe_code)]

pub mod clock;
pub mod driver;
pub mod error;
pub mod frames;
pub mod guard;
pub mod limits;
pub mod messages;
pub mod node;
pub mod params;
pub mod policy;
pub mod row;
pub mod scan;
pub mod stop;

pub use driver::{Command, Driver};
pub use error::RosError;
pub use params::Params;
pub use stop::Stop;
