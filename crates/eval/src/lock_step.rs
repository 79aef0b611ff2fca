//! Hundreds of episodes in lock step, so that every policy infers in one batch a step.
//!
//! A room that ends is replaced by the next episode at once, so that batches stay full; results are handed on in the
//! order of the episodes. Neither the number of rooms side by side nor the number of threads changes a bit: rooms share
//! nothing, and policies answer row by row.

use std::collections::BTreeMap;
use std::ops::Range;

use jostle_peds::{Crowd, Motion, Pedestrian, RoomView};
use jostle_sim::Laser;
use rayon::prelude::*;

use crate::error::EvalError;
use crate::robot::RobotPolicy;
use crate::room::{EvalRoom, FinishedEpisode, RoomPlan};

/// Runs the episodes of a range and hands each on, in order, as soon as all before it have ended.
///
/// # Errors
///
/// What a room, the crowd or `finished` refuses; episodes handed on until then stand.
pub fn run_episodes(
    plan: &RoomPlan,
    robot: &mut dyn RobotPolicy,
    crowd: &mut dyn Crowd,
    episodes: Range<u64>,
    mut finished: impl FnMut(FinishedEpisode) -> Result<(), EvalError>,
) -> Result<(), EvalError> {
    let laser = Laser::new(&plan.config.sim.laser)?;
    let width =
        plan.config.lock_step.min(usize::try_from(episodes.end - episodes.start).unwrap_or(usize::MAX));
    let mut upcoming = episodes.clone();
    let spawn = |episodes: Vec<u64>| -> Result<Vec<EvalRoom>, EvalError> {
        episodes.into_par_iter().map(|episode| EvalRoom::new(plan, &laser, episode)).collect()
    };
    let mut rooms = spawn(upcoming.by_ref().take(width).collect())?;
    let mut waiting = BTreeMap::new();
    let mut next = episodes.start;
    let mut buffers = Buffers::default();
    while !rooms.is_empty() {
        let ended = buffers.step(plan, robot, crowd, &mut rooms, &mut |_| {})?;
        if ended.is_empty() {
            continue;
        }
        waiting.extend(ended.into_iter().map(|episode| (episode.episode, episode)));
        while let Some(episode) = waiting.remove(&next) {
            finished(episode)?;
            next += 1;
        }
        rooms.extend(spawn(upcoming.by_ref().take(width - rooms.len()).collect())?);
    }
    Ok(())
}

/// Memory of a step that is kept for the next.
#[derive(Default)]
pub(crate) struct Buffers {
    observations: Vec<f32>,
    actions: Vec<[f32; 2]>,
    robots: Vec<Pedestrian>,
    motions: Vec<Motion>,
}

impl Buffers {
    /// One control period of all rooms; `watch` sees each of them, then the rooms that ended are taken out.
    pub(crate) fn step(
        &mut self,
        plan: &RoomPlan,
        robot: &mut dyn RobotPolicy,
        crowd: &mut dyn Crowd,
        rooms: &mut Vec<EvalRoom>,
        watch: &mut dyn FnMut(&EvalRoom),
    ) -> Result<Vec<FinishedEpisode>, EvalError> {
        self.decide(plan, robot, crowd, rooms)?;
        let n_pedestrians = plan.config.n_pedestrians();
        // `chunks` refuses a length of 0, which an empty room has.
        let walks = |i: usize| &self.motions[i * n_pedestrians..(i + 1) * n_pedestrians];
        let actions = &self.actions;
        let results: Vec<Option<FinishedEpisode>> = rooms
            .par_iter_mut()
            .enumerate()
            .map(|(i, room)| room.step(plan, actions[i], walks(i)))
            .collect::<Result<_, EvalError>>()?;
        for room in rooms.iter() {
            watch(room);
        }
        let mut ended = results.iter().map(Option::is_some);
        rooms.retain(|_| !ended.next().unwrap_or(false));
        Ok(results.into_iter().flatten().collect())
    }

    fn decide(
        &mut self,
        plan: &RoomPlan,
        robot: &mut dyn RobotPolicy,
        crowd: &mut dyn Crowd,
        rooms: &[EvalRoom],
    ) -> Result<(), EvalError> {
        self.observations.clear();
        for room in rooms {
            self.observations.extend_from_slice(room.robot_observation());
        }
        self.actions.clear();
        self.actions.resize(rooms.len(), [0.0; 2]);
        robot.act(&self.observations, &mut self.actions);

        self.robots.clear();
        self.robots.extend(rooms.iter().map(EvalRoom::robot));
        let seen = plan.visibility.robot;
        let views: Vec<RoomView<'_>> = rooms
            .iter()
            .zip(&self.robots)
            .map(|(room, robot)| room.view(if seen { std::slice::from_ref(robot) } else { &[] }))
            .collect();
        self.motions.clear();
        self.motions.resize(rooms.len() * plan.config.n_pedestrians(), Motion::STILL);
        crowd.decide(&views, &mut self.motions)?;
        Ok(())
    }
}
