//! The six unseen crowds, paired episodes, metrics, intervals and reports (paper, section "Experiments").
//!
//! Reading order: [`protocol`] (a policy in a crowd), [`config`], [`crowds`], [`robot`], [`planners`] and [`driver`] (who is tested), [`lock_step`] and
//! [`room`] (how episodes run), [`scene`] and [`suite`] (harder places); [`outcome`], [`metrics`], [`driving`], [`statistics`] (what is measured), [`diversity`] (the metric D);
//! [`cell`], [`records`] and [`compact`] (what is kept), [`claims`] (what the paper says, tested), [`replay`] (episodes step by step), [`paper`] (its tables as data), [`report`] (what is printed).
//!
//! Architecture invariants: nothing here trains or knows the trainer; no result depends on the clock, the number of
//! threads or the lock step.

#![forbid(unsafe_code)]

pub mod cell;
pub mod claims;
pub mod compact;
pub mod config;
pub mod crowds;
pub mod diversity;
pub mod driver;
pub mod driving;
pub mod error;
pub mod identity;
pub mod loaded;
pub mod lock_step;
pub mod metrics;
pub mod outcome;
pub mod paper;
pub mod planners;
pub mod protocol;
pub mod records;
pub mod replay;
pub mod report;
pub mod robot;
pub mod room;
pub mod scene;
pub mod site;
pub mod statistics;
pub mod suite;

pub use config::{EvalConfig, PedestrianCrash};
pub use crowds::Pools;
pub use driver::Driver;
pub use error::EvalError;
pub use identity::PolicyIdentity;
pub use loaded::LoadedPolicy;
pub use outcome::EpisodeOutcome;
pub use planners::Planner;
pub use protocol::{CellRun, Protocol, Subject};
pub use robot::{PerRow, Robot, RobotPolicy, RobotView, TrainedRobot};
