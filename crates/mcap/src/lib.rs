//! Episodes as MCAP files, which Foxglove, rerun, `ros2 bag play` and the readers of ROS 2 open
//! without anything of jostle.
//!
//! Reading order: [`recording`] (what is written), [`messages`] (as what), [`definitions`] (what
//! readers are told of the messages), [`error`].
//!
//! Architecture invariant: a file is a function of its recording: no clock is read.

#![forbid(unsafe_code)]

pub mod definitions;
pub mod error;
pub mod messages;
pub mod recording;

pub use error::McapError;
pub use recording::{Episode, Moment, Place, Scanner, Wall, write};
