//! The one trait that all crowds share, and what passes through it (paper, Sect. V: the six unseen
//! crowds).
//!
//! Architecture invariant: nothing here knows a simulator, a laser or a network. A crowd sees views
//! of rooms and answers with commands.

use glam::Vec2;

use crate::{CrowdName, PedsError, Visibility};

/// The command of one pedestrian for the next control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Moves with a velocity in world coordinates; its heading stays.
    Walk {
        /// m/s.
        velocity: Vec2,
    },
    /// Drives like a robot.
    Drive {
        /// Linear velocity, m/s.
        v: f32,
        /// Angular velocity, rad/s, counter-clockwise.
        w: f32,
    },
}

impl Command {
    /// Standing still.
    pub const STILL: Self = Self::Walk { velocity: Vec2::ZERO };
}

/// One pedestrian (or the robot, when it is seen) at one step, in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pedestrian {
    /// Centre, m.
    pub position: Vec2,
    /// Velocity actually executed in the last step, m/s.
    pub velocity: Vec2,
    /// Heading, rad.
    pub heading: f32,
    /// Goal, m.
    pub goal: Vec2,
}

/// The part of a room at one step that a crowd may know.
#[derive(Debug, Clone, Copy)]
pub struct RoomView<'a> {
    /// The pedestrians that the crowd decides for.
    pub pedestrians: &'a [Pedestrian],
    /// Bodies that are not the crowd's: the robot. A crowd whose row of the visibility matrix hides
    /// it ignores them.
    pub others: &'a [Pedestrian],
    /// Observation rows `[pedestrians, row]` for crowds that sense by laser, else empty.
    pub observations: &'a [f32],
    /// One factor for each pedestrian, or empty where all are 1. It multiplies the executed speed
    /// in VA, the desired speed in SF, and 1 m/s in the validation crowds. It is drawn for each
    /// episode; that of a stop-and-go walker is 0 while it stands.
    pub speed_factor: &'a [f32],
}

impl RoomView<'_> {
    /// The factor of pedestrian `i`; 1 when none are given.
    pub(crate) fn factor(&self, i: usize) -> f32 {
        self.speed_factor.get(i).copied().unwrap_or(1.0)
    }

    /// An error unless there are no factors or one finite, non-negative factor for each pedestrian.
    pub(crate) fn check_factors(&self) -> Result<(), PedsError> {
        let (found, expected) = (self.speed_factor.len(), self.pedestrians.len());
        if found != 0 && found != expected {
            return Err(PedsError::Length { what: "speed_factor", found, expected });
        }
        for &factor in self.speed_factor {
            let found = f64::from(factor);
            crate::error::require((0.0..=100.0).contains(&factor), "speed_factor", found, "0 to 100")?;
        }
        Ok(())
    }
}

/// A crowd: decides the commands of the pedestrians of many rooms at once, so that learned crowds
/// infer in batches.
///
/// A decision is a function of the views only: a crowd keeps no state between calls but scratch
/// memory, so that a run can be resumed and rooms can be regrouped without changing a bit.
pub trait Crowd: Send {
    /// Its name, which keys, records and reports carry: [`CrowdName::new`] for a crowd of one's
    /// own.
    fn name(&self) -> CrowdName;

    /// True if `decide` needs the rooms' observations.
    fn senses_by_laser(&self) -> bool;

    /// The bodies that its pedestrians see: each other and not the robot, unless overridden. The
    /// built-in crowds have been told their rows of the configuration's matrix
    /// ([`crate::VisibilityMatrix::row`]).
    fn visibility(&self) -> Visibility {
        Visibility::PEDESTRIANS
    }

    /// Its version. For a crowd of one's own it must change when the crowd's behaviour does, since
    /// stored episodes are used again by name, visibility and version.
    #[expect(clippy::unnecessary_literal_bound, reason = "an implementation may hold its version")]
    fn version(&self) -> &str {
        "1"
    }

    /// Decides one command per pedestrian, concatenated room by room.
    ///
    /// # Errors
    /// Lists whose lengths do not fit, and non-finite input.
    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError>;
}

/// An error unless there is one command for each pedestrian of all rooms.
pub(crate) fn check_commands(rooms: &[RoomView<'_>], commands: &[Command]) -> Result<(), PedsError> {
    let expected = rooms.iter().map(|room| room.pedestrians.len()).sum();
    let found = commands.len();
    if found == expected { Ok(()) } else { Err(PedsError::Length { what: "commands", found, expected }) }
}

/// The rooms, each with its own part of the commands.
pub(crate) fn with_commands<'r, 'a, 'm>(
    rooms: &'r [RoomView<'a>],
    mut commands: &'m mut [Command],
) -> Vec<(&'r RoomView<'a>, &'m mut [Command])> {
    rooms
        .iter()
        .map(|room| {
            let (own, rest) = std::mem::take(&mut commands).split_at_mut(room.pedestrians.len());
            commands = rest;
            (room, own)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_split_by_room() {
        let someone =
            Pedestrian { position: Vec2::ZERO, velocity: Vec2::ZERO, heading: 0.0, goal: Vec2::ZERO };
        let crowd = [someone; 3];
        let room = |n: usize| RoomView {
            pedestrians: &crowd[..n],
            others: &[],
            observations: &[],
            speed_factor: &[],
        };
        let rooms = [room(2), room(0), room(3)];
        let mut commands = [Command::STILL; 5];
        let lengths: Vec<usize> =
            with_commands(&rooms, &mut commands).iter().map(|(_, own)| own.len()).collect();
        assert_eq!(lengths, [2, 0, 3]);
        assert!(check_commands(&rooms, &commands[..4]).is_err());
    }

    #[test]
    fn factors_are_one_unless_given_and_one_for_each() {
        let someone =
            Pedestrian { position: Vec2::ZERO, velocity: Vec2::ZERO, heading: 0.0, goal: Vec2::ZERO };
        let crowd = [someone; 2];
        let check = |speed_factor: &[f32]| {
            let room = RoomView { pedestrians: &crowd, others: &[], observations: &[], speed_factor };
            room.check_factors().map(|()| [room.factor(0), room.factor(1)])
        };
        assert_eq!(check(&[]), Ok([1.0, 1.0]));
        assert_eq!(check(&[0.0, 100.0]), Ok([0.0, 100.0]));
        for bad in [&[1.0][..], &[1.0; 3], &[1.0, -0.1], &[100.1, 1.0], &[1.0, f32::NAN]] {
            assert!(check(bad).is_err(), "{bad:?}");
        }
    }
}
