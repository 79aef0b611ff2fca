//! Robots with mass: wheels that grip and slip, motors that are only so strong, commands that
//! arrive late; rapier moves the bodies and solves their contacts.
//!
//! Reading order: [`wheels`] (the impulses of four wheels on the ground), [`scene`] (a control
//! period in rapier), this file (the state that is kept between two periods).
//!
//! Architecture invariant: the state of a base is its pose, its velocity and the commands under
//! way. rapier's scene is made anew for each control period, so that nothing that a solver
//! remembers decides what comes next, and a restored world goes on bit for bit.
//!
//! # Departures
//!
//! - From the vehicle: the ground is flat, the load lies evenly on the wheels, and the wheels' own
//!   inertia (a twentieth of a Jackal's mass) is left out. A motor holds its wheel's speed as well
//!   as its torque lets it.
//! - From Stage (`world.rs`): a base that meets something is pushed back by the contact and may
//!   slide along it. It counts as stopped by whatever it touched.

#[cfg(feature = "dynamics")]
mod scene;
#[cfg(feature = "dynamics")]
mod wheels;

use crate::config::BaseConfig;
use crate::geometry::Pose;
use glam::Vec2;
use serde::{Deserialize, Serialize};

#[cfg(feature = "dynamics")]
pub(crate) use scene::advance;

/// What a base keeps from one control period to the next, beside its pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveState {
    /// Velocity of the body's centre in the world, m/s.
    pub velocity: Vec2,
    /// Turn rate, rad/s.
    pub turn: f32,
    /// Commands (v, ω) of the last control periods that are not in force yet or still are, the
    /// oldest first; a base that has not been told more than these stood before.
    pub commands: Vec<[f32; 2]>,
}

impl DriveState {
    /// True if every number is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.velocity.is_finite()
            && self.turn.is_finite()
            && self.commands.iter().flatten().all(|value| value.is_finite())
    }
}

/// A body's base and its state.
#[derive(Clone, Debug)]
pub(crate) struct Drive {
    #[cfg_attr(not(feature = "dynamics"), expect(dead_code, reason = "no build without rapier has a base"))]
    pub(crate) base: BaseConfig,
    pub(crate) state: DriveState,
}

impl Drive {
    /// A base at rest.
    pub(crate) fn new(base: BaseConfig) -> Self {
        Self { base, state: DriveState::default() }
    }

    /// Velocity along the heading, m/s, and turn rate, rad/s: what odometry measures.
    pub(crate) fn measured(&self, pose: Pose) -> [f32; 2] {
        [pose.direction().dot(self.state.velocity), self.state.turn]
    }
}
