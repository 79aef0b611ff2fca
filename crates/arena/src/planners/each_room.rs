//! A planner that knows where everyone is, as the robot of many rooms.

use rayon::prelude::*;

use crate::error::ArenaError;
use crate::robot::{Robot, RobotView, Views};

/// A function of one room's ground truth. It has no memory: `scratch` keeps its allocations and
/// nothing that is read.
pub trait RoomPlanner: Send + Sync {
    /// Working memory of a decision.
    type Scratch: Send;

    /// New working memory.
    fn scratch(&self) -> Self::Scratch;

    /// The action (v, ω) in a room.
    ///
    /// # Errors
    ///
    /// A view with numbers that are not finite.
    fn plan(&self, view: &RobotView<'_>, scratch: &mut Self::Scratch) -> Result<[f32; 2], ArenaError>;
}

/// A planner as a robot: rooms are planned for on all threads.
pub struct EachRoom<P: RoomPlanner>(P);

impl<P: RoomPlanner> EachRoom<P> {
    /// Wraps a planner.
    pub fn new(planner: P) -> Self {
        Self(planner)
    }
}

impl<P: RoomPlanner> Robot for EachRoom<P> {
    fn drive(
        &mut self,
        rooms: Views<'_, '_>,
        _memory: &mut Vec<f32>,
        actions: &mut [[f32; 2]],
    ) -> Result<(), ArenaError> {
        let (planner, views) = (&self.0, rooms.collect::<Vec<RobotView<'_>>>());
        let rooms = views.par_iter().zip(actions);
        rooms.try_for_each_init(
            || planner.scratch(),
            |scratch, (view, action)| {
                *action = planner.plan(view, scratch)?;
                Ok(())
            },
        )
    }
}

#[cfg(test)]
pub(super) mod testing {
    use glam::Vec2;
    use jostle_peds::Pedestrian;

    use crate::robot::RobotView;

    /// Asks about a robot at the origin that heads along x to a goal 8 m ahead, at full speed,
    /// among pedestrians of these positions and velocities.
    pub(in super::super) fn under_way<T>(
        others: &[(Vec2, Vec2)],
        ask: impl FnOnce(&RobotView<'_>) -> T,
    ) -> T {
        let at = |position, velocity, goal| Pedestrian { position, velocity, heading: 0.0, goal };
        let others = others.iter().map(|(position, velocity)| at(*position, *velocity, Vec2::ZERO));
        let pedestrians: Vec<Pedestrian> = others.collect();
        let robot = at(Vec2::ZERO, Vec2::X, 8.0 * Vec2::X);
        ask(&RobotView { row: &[], robot, pedestrians: &pedestrians })
    }
}
