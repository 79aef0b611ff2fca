//! Hundreds of episodes in lock step, so that every policy infers in one batch a step.
//!
//! A room that ends is replaced by the next episode at once, so that batches stay full; results are
//! handed on in the order of the episodes. Neither the number of rooms side by side nor the number
//! of threads changes a bit: rooms share nothing, and policies answer row by row.

use std::collections::BTreeMap;
use std::ops::Range;

use jostle_peds::Crowd;
use jostle_sim::Laser;
use rayon::prelude::*;

use crate::error::ArenaError;
use crate::robot::Robot;
use crate::room::{ArenaRoom, FinishedEpisode, RoomPlan};
use crate::step::{RoomStepper, take_ended};

/// Runs the episodes of a range and hands each on, in order, as soon as all before it have ended.
///
/// # Errors
///
/// The refusal of a room, the crowd or `finished`; episodes handed on until then are kept.
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
    let mut stepper = RoomStepper::default();
    while !rooms.is_empty() {
        let ends = stepper.step(plan, robot, crowd, &mut rooms)?;
        let ended = take_ended(&mut rooms, ends);
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
