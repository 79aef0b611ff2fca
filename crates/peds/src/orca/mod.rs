//! Optimal reciprocal collision avoidance: a port of the RVO2 Library in its single precision, with
//! its polygon obstacles.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.
//!
//! Reading order: `line` (a half-plane of allowed velocities), `agent_lines` and `obstacle_lines`
//! (how they arise), `linear_program` (the velocity they leave), `agent_tree`, `vertex`,
//! `obstacle_tree` and `obstacle` (near agents and edges), `simulator` (a step), `crowd` (crowd VO
//! on top).
//!
//! # Departures
//! - Half-planes that are undetermined (0/0 when two agents coincide and move alike) are left out
//!   of the linear programs by an explicit step. RVO2 relies on every comparison with NaN being
//!   false; the velocities are the same.
//! - Obstacles are validated, immutable and shared; agents are stored packed. See `NOTICE` for the
//!   whole list.
//!
//! # References
//! J. van den Berg, S. J. Guy, M. Lin, D. Manocha, "Reciprocal n-body collision avoidance",
//! Robotics Research (ISRR), 2011, doi:10.1007/978-3-642-19457-3_1. RVO2 commit
//! 1c25b27258d191e26c2df83ff6e31abc8efbdaed.

mod agent;
mod agent_lines;
mod agent_tree;
mod crowd;
mod line;
mod linear_program;
mod obstacle;
mod obstacle_lines;
mod obstacle_tree;
mod simulator;
mod vertex;

pub use agent::AgentParameters;
pub use crowd::{OrcaConfig, OrcaCrowd};
pub use line::Line;
pub use obstacle::Obstacles;
pub use simulator::{AgentLines, OrcaSimulator};

/// RVO2's tolerance for "parallel" and "on the line".
const EPSILON: f32 = 1e-5;
