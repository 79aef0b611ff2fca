//! An agent: its state, and the six parameters of RVO2.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

use crate::{
    PedsError,
    error::{MAGNITUDE_LIMIT, require},
};

/// An agent's body, speed and the range in which it looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgentParameters {
    /// Others at this distance or farther are not looked at, m.
    pub neighbour_distance: f32,
    /// At most this many others are looked at, nearest first.
    pub max_neighbours: usize,
    /// Velocities are kept free of collisions with agents for this long, s.
    pub time_horizon: f32,
    /// The same for obstacles, s.
    pub time_horizon_obstacles: f32,
    /// Radius of the disc, m.
    pub radius: f32,
    /// Largest speed, m/s.
    pub max_speed: f32,
}

impl AgentParameters {
    /// Checks every range.
    ///
    /// # Errors
    /// Times at most 0; negative, non-finite or huge lengths and speeds.
    pub fn validate(&self) -> Result<(), PedsError> {
        let within = |x: f32| (0.0..=MAGNITUDE_LIMIT).contains(&x);
        let time = |x: f32| (1e-3..=1e4).contains(&x);
        require(
            within(self.neighbour_distance),
            "neighbour_distance",
            self.neighbour_distance.into(),
            "0 to 1e6 m",
        )?;
        require(self.max_neighbours <= 1 << 16, "max_neighbours", self.max_neighbours as f64, "0 to 65536")?;
        require(time(self.time_horizon), "time_horizon", self.time_horizon.into(), "0.001 to 10000 s")?;
        let horizon = self.time_horizon_obstacles;
        require(time(horizon), "time_horizon_obstacles", horizon.into(), "0.001 to 10000 s")?;
        require(within(self.radius), "radius", self.radius.into(), "0 to 1e6 m")?;
        require(within(self.max_speed), "max_speed", self.max_speed.into(), "0 to 1e6 m/s")
    }

    /// Squared distance within which obstacle edges matter.
    pub(super) fn obstacle_range_sq(&self) -> f32 {
        let range = self.time_horizon_obstacles * self.max_speed + self.radius;
        range * range
    }
}

/// An agent of the simulator.
#[derive(Debug, Clone, Copy)]
pub(super) struct Agent {
    pub(super) position: Vec2,
    pub(super) velocity: Vec2,
    pub(super) preferred_velocity: Vec2,
    pub(super) planned_velocity: Vec2,
    pub(super) parameters: AgentParameters,
}

/// The part of an agent that the others need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    pub(super) position: Vec2,
    pub(super) velocity: Vec2,
    pub(super) radius: f32,
    /// Index of the agent in order of addition.
    pub(super) agent: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: AgentParameters = AgentParameters {
        neighbour_distance: 10.0,
        max_neighbours: 10,
        time_horizon: 4.0,
        time_horizon_obstacles: 3.0,
        radius: 0.5,
        max_speed: 2.0,
    };

    #[test]
    fn edges_matter_as_far_as_the_agent_walks_within_the_horizon() {
        assert_eq!(PARAMETERS.obstacle_range_sq(), 6.5 * 6.5);
    }

    #[test]
    fn too_many_neighbours_are_refused() {
        assert_eq!(AgentParameters { max_neighbours: 1 << 16, ..PARAMETERS }.validate(), Ok(()));
        assert!(AgentParameters { max_neighbours: (1 << 16) + 1, ..PARAMETERS }.validate().is_err());
    }
}
