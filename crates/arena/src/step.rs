//! One control period of rooms that share a plan: the robot and the crowd decide for all of them at
//! once, then every room moves.
//!
//! A test in lock step, a trace, the live page and Python's environments all step their rooms here.

use jostle_peds::{Command, Crowd, Pedestrian, RoomView};
use rayon::prelude::*;

use crate::error::ArenaError;
use crate::robot::Robot;
use crate::room::{ArenaRoom, FinishedEpisode, RoomPlan};

/// Steps rooms; it keeps its memory from one step to the next, and nothing else.
#[derive(Default)]
pub struct RoomStepper {
    observations: Vec<f32>,
    actions: Vec<[f32; 2]>,
    robots: Vec<Pedestrian>,
    commands: Vec<Command>,
}

impl RoomStepper {
    /// One control period, the robots driven by `robot`. Gives one entry for each room: its result
    /// if the episode has ended, after which the room is spent.
    ///
    /// # Errors
    ///
    /// Refusals of the robot, the crowd or a room.
    pub fn step(
        &mut self,
        plan: &RoomPlan,
        robot: &mut dyn Robot,
        crowd: &mut dyn Crowd,
        rooms: &mut [ArenaRoom],
    ) -> Result<Vec<Option<FinishedEpisode>>, ArenaError> {
        let mut actions = std::mem::take(&mut self.actions);
        actions.clear();
        actions.resize(rooms.len(), [0.0; 2]);
        let mut views = rooms.iter().map(ArenaRoom::robot_view);
        robot.drive(&mut views, &mut self.observations, &mut actions)?;
        let ends = self.step_with(plan, crowd, rooms, &actions);
        self.actions = actions;
        ends
    }

    /// As [`Self::step`], with the robots' actions (v, ω): one for each room, m/s and rad/s.
    ///
    /// # Errors
    ///
    /// Refusals of the crowd or a room.
    ///
    /// # Panics
    ///
    /// When there are fewer actions than rooms.
    pub fn step_with(
        &mut self,
        plan: &RoomPlan,
        crowd: &mut dyn Crowd,
        rooms: &mut [ArenaRoom],
        actions: &[[f32; 2]],
    ) -> Result<Vec<Option<FinishedEpisode>>, ArenaError> {
        self.decide(plan, crowd, rooms)?;
        let n_pedestrians = plan.config.n_pedestrians();
        let commands = &self.commands;
        // `chunks` refuses a length of 0, which a room without pedestrians has.
        let of_room = |i: usize| &commands[i * n_pedestrians..(i + 1) * n_pedestrians];
        let step = |(i, room): (usize, &mut ArenaRoom)| room.step(plan, actions[i], of_room(i));
        if rooms.len() == 1 {
            // One room: no need to wake another thread.
            return rooms.iter_mut().enumerate().map(step).collect();
        }
        rooms.par_iter_mut().enumerate().map(step).collect()
    }

    /// Moves the pedestrians of a room whose robot moves elsewhere ([`ArenaRoom::walk`]).
    ///
    /// # Errors
    ///
    /// Refusals of the crowd.
    pub fn walk(
        &mut self,
        plan: &RoomPlan,
        crowd: &mut dyn Crowd,
        room: &mut ArenaRoom,
    ) -> Result<(), ArenaError> {
        self.decide(plan, crowd, std::slice::from_ref(room))?;
        room.walk(plan, &self.commands);
        Ok(())
    }

    /// Lets the crowd decide for all rooms at once, with the robot in view if its pedestrians see
    /// it.
    fn decide(
        &mut self,
        plan: &RoomPlan,
        crowd: &mut dyn Crowd,
        rooms: &[ArenaRoom],
    ) -> Result<(), ArenaError> {
        self.robots.clear();
        self.robots.extend(rooms.iter().map(ArenaRoom::robot));
        let seen = plan.visibility.robot;
        let views: Vec<RoomView<'_>> = rooms
            .iter()
            .zip(&self.robots)
            .map(|(room, robot)| room.view(if seen { std::slice::from_ref(robot) } else { &[] }))
            .collect();
        self.commands.clear();
        self.commands.resize(rooms.len() * plan.config.n_pedestrians(), Command::STILL);
        Ok(crowd.decide(&views, &mut self.commands)?)
    }
}

/// The results of the rooms that have ended; the rooms themselves are taken out.
pub(crate) fn take_ended(
    rooms: &mut Vec<ArenaRoom>,
    ends: Vec<Option<FinishedEpisode>>,
) -> Vec<FinishedEpisode> {
    let mut ended = ends.iter().map(Option::is_some);
    rooms.retain(|_| !ended.next().unwrap_or(false));
    ends.into_iter().flatten().collect()
}
