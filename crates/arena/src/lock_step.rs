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

use crate::error::ArenaError;
use crate::robot::Robot;
use crate::room::{ArenaRoom, FinishedEpisode, RoomPlan};

/// Runs the episodes of a range and hands each on, in order, as soon as all before it have ended.
///
/// # Errors
///
/// What a room, the crowd or `finished` refuses; episodes handed on until then stand.
pub fn run_episodes<E: From<ArenaError>>(
    plan: &RoomPlan,
    robot: &mut dyn Robot,
    crowd: &mut dyn Crowd,
    episodes: Range<u64>,
    mut finished: impl FnMut(FinishedEpisode) -> Result<(), E>,
) -> Result<(), E> {
    let laser = Laser::new(&plan.config.sim.laser).map_err(ArenaError::from)?;
    let width =
        plan.config.lock_step.min(usize::try_from(episodes.end - episodes.start).unwrap_or(usize::MAX));
    let mut upcoming = episodes.clone();
    let spawn = |episodes: Vec<u64>| -> Result<Vec<ArenaRoom>, ArenaError> {
        episodes.into_par_iter().map(|episode| ArenaRoom::new(plan, &laser, episode)).collect()
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
    walks: Walks,
}

impl Buffers {
    /// One control period of all rooms; `watch` sees each of them, then the rooms that ended are taken out.
    pub(crate) fn step(
        &mut self,
        plan: &RoomPlan,
        robot: &mut dyn Robot,
        crowd: &mut dyn Crowd,
        rooms: &mut Vec<ArenaRoom>,
        watch: &mut dyn FnMut(&ArenaRoom),
    ) -> Result<Vec<FinishedEpisode>, ArenaError> {
        self.actions.clear();
        self.actions.resize(rooms.len(), [0.0; 2]);
        let mut views = rooms.iter().map(ArenaRoom::robot_view);
        robot.drive(&mut views, &mut self.observations, &mut self.actions)?;
        self.walks.decide(plan, crowd, rooms)?;
        let (actions, walks) = (&self.actions, &self.walks);
        let results: Vec<Option<FinishedEpisode>> = rooms
            .par_iter_mut()
            .enumerate()
            .map(|(i, room)| room.step(plan, actions[i], walks.of(i)))
            .collect::<Result<_, ArenaError>>()?;
        for room in rooms.iter() {
            watch(room);
        }
        let mut ended = results.iter().map(Option::is_some);
        rooms.retain(|_| !ended.next().unwrap_or(false));
        Ok(results.into_iter().flatten().collect())
    }
}

/// What the pedestrians of all rooms do next; keeps its memory from step to step.
#[derive(Default)]
pub struct Walks {
    robots: Vec<Pedestrian>,
    motions: Vec<Motion>,
    n_pedestrians: usize,
}

impl Walks {
    /// Lets the crowd decide for all rooms at once, with the robot in view where the visibility matrix says so.
    ///
    /// # Errors
    ///
    /// What the crowd refuses.
    pub fn decide(
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
        self.n_pedestrians = plan.config.n_pedestrians();
        self.motions.clear();
        self.motions.resize(rooms.len() * self.n_pedestrians, Motion::STILL);
        crowd.decide(&views, &mut self.motions)?;
        Ok(())
    }

    /// The motions of room `i` of those last decided for.
    ///
    /// # Panics
    ///
    /// When there was no such room.
    pub fn of(&self, i: usize) -> &[Motion] {
        // `chunks` refuses a length of 0, which an empty room has.
        &self.motions[i * self.n_pedestrians..(i + 1) * self.n_pedestrians]
    }
}
