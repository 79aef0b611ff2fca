//! Decisions of planners, one at a time, in rooms that are in the middle of their episodes.

use jostle_arena::planners::Planner;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{ArenaConfig, Pools, Robot, RoomStepper};
use jostle_eval::Protocol;
use jostle_peds::CrowdKind;
use jostle_sim::Laser;

use crate::error::BenchError;

/// Rooms that are begun; those in which the robot meets its end on the way are left out.
const ROOMS: u64 = 32;
/// Steps that they have behind them: pedestrians walk by then, and scans differ from each other.
const STEPS: usize = 30;
/// The robot's action meanwhile.
const ACTION: [f32; 2] = [0.7, 0.1];

/// A planner and rooms that it can be asked about, among four social-force pedestrians.
pub struct Decisions {
    robot: Box<dyn Robot>,
    rooms: Vec<ArenaRoom>,
    memory: Vec<f32>,
    next: usize,
}

impl Decisions {
    /// The rooms, 30 steps after their start.
    ///
    /// # Errors
    ///
    /// When the evaluation refuses its settings.
    pub fn new(planner: Planner) -> Result<Self, BenchError> {
        let protocol = Protocol::new(ArenaConfig::default(), Pools::default())?;
        let plan = RoomPlan::new(protocol.config(), CrowdKind::Sf)?;
        let (laser, mut crowd) = (Laser::new(&plan.config.sim.laser)?, protocol.crowd(&plan)?);
        let rooms: Result<Vec<ArenaRoom>, _> = (0..ROOMS).map(|k| ArenaRoom::new(&plan, &laser, k)).collect();
        let (mut rooms, mut stepper) = (rooms?, RoomStepper::default());
        for _ in 0..STEPS {
            let actions = vec![ACTION; rooms.len()];
            let mut ends = stepper.step_with(&plan, &mut *crowd, &mut rooms, &actions)?.into_iter();
            rooms.retain(|_| ends.next().is_some_and(|end| end.is_none()));
        }
        Ok(Self { robot: planner.robot(&plan)?, rooms, memory: Vec::new(), next: 0 })
    }

    /// One decision in the next room.
    ///
    /// # Errors
    ///
    /// A room that the planner cannot work with.
    pub fn decide(&mut self) -> Result<[f32; 2], BenchError> {
        self.next = (self.next + 1) % self.rooms.len();
        let mut action = [[0.0; 2]];
        let view = self.rooms[self.next].robot_view();
        self.robot.drive(&mut std::iter::once(view), &mut self.memory, &mut action)?;
        Ok(action[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rooms_are_on_their_way_and_differ() {
        let mut decisions = Decisions::new(Planner::Dwa).unwrap();
        assert!(decisions.rooms.len() > ROOMS as usize / 2, "{}", decisions.rooms.len());
        let answers: Vec<[f32; 2]> =
            (0..decisions.rooms.len()).map(|_| decisions.decide().unwrap()).collect();
        assert!(answers.iter().any(|answer| *answer != answers[0]), "{answers:?}");
    }
}
