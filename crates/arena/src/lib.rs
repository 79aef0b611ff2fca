//! A robot among a crowd: rooms with one robot and pedestrians that it never met, episode by
//! episode (paper, section "Experiments").
//!
//! Reading order: [`config`] (settings), [`crowds`] (who walks there), [`room`] (one room, one
//! control period; `live`: a room that someone changes while it runs), [`robot`], [`planners`],
//! [`loaded`] and [`driver`] (who drives the robot), [`step`] and [`lock_step`] (many rooms side by
//! side); [`scene`] and [`site`] (harder places, and their outlines), [`recording`] (people as they
//! walked); [`Outcome`], [`metrics`] and [`driving`] (what is measured while an episode runs),
//! [`replay`] (episodes step by step), [`identity`] (which policy it was).
//!
//! Architecture invariants: nothing here trains, keeps records or knows a statistic; no episode
//! depends on the clock, the number of threads or the lock step.

#![forbid(unsafe_code)]

pub mod config;
pub mod crowds;
pub mod driver;
pub mod driving;
pub mod error;
pub mod identity;
pub mod loaded;
pub mod lock_step;
pub mod metrics;
pub mod planners;
pub mod recording;
pub mod replay;
pub mod robot;
pub mod room;
pub mod scene;
pub mod site;
pub mod step;

pub use config::{ArenaConfig, PedestrianCrash};
pub use crowds::Pools;
pub use driver::Driver;
pub use error::ArenaError;
pub use identity::PolicyIdentity;
pub use loaded::LoadedPolicy;
pub use planners::Planner;
pub use robot::{PerRow, Robot, RobotPolicy, RobotView, TrainedRobot};
pub use step::RoomStepper;

// The outcome of an episode, in a test as in training.
pub use jostle_sim::Outcome;
