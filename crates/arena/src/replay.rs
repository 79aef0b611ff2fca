//! Episodes step by step, to be looked at: where everyone stood, what the laser saw, what the robot
//! did.
//!
//! Traces come from the rooms that records come from, through the same steps; a test that wants
//! none pays one call of an empty function for each step.

use std::collections::{BTreeMap, BTreeSet};

use jostle_peds::{Crowd, CrowdName, Pedestrian};
use jostle_sim::Laser;
use rayon::prelude::*;

use crate::error::ArenaError;
use crate::robot::Robot;
use crate::room::{ArenaRoom, FinishedEpisode, RoomPlan};
use crate::step::{RoomStepper, take_ended};

/// The steps of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeTrace {
    /// Name of the crowd.
    pub crowd: CrowdName,
    /// Outcome and metrics, the same as the episode's record has.
    pub finished: FinishedEpisode,
    /// Behaviour token of learned pedestrians, which is always 0; `None` for the others.
    pub pedestrian_token: Option<u32>,
    /// A speed factor for each pedestrian (crowds VA and SF), 1 where there is none.
    pub speed_factors: Vec<f32>,
    /// The start, then the room after every step.
    pub frames: Vec<TraceFrame>,
}

/// One moment of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceFrame {
    /// The robot, with the velocity that it executed and its goal.
    pub robot: Pedestrian,
    /// Linear and angular velocity executed in the step that led here; 0 at the start and where the
    /// robot was stopped.
    pub velocity: [f32; 2],
    /// Noise-free distance from the robot's centre to the nearest thing all round (m).
    pub min_range: f32,
    /// Noise-free ranges of the kept beams, counter-clockwise from beam 0 (m); one that met nothing
    /// holds the laser's range.
    pub ranges: Vec<f32>,
    /// The pedestrians, those that were re-spawned in this step at their new places.
    pub pedestrians: Vec<Pedestrian>,
}

/// The spacing of the beams that a trace keeps: every `stride`-th, so that at most `beams` remain
/// of `total`; `beams` 0 counts as 1.
///
/// # Examples
///
/// ```
/// assert_eq!(jostle_arena::replay::beam_stride(512, 128), 4);
/// assert_eq!(jostle_arena::replay::beam_stride(16, 128), 1);
/// ```
pub fn beam_stride(total: usize, beams: usize) -> usize {
    total.div_ceil(beams.max(1)).max(1)
}

/// Runs episodes side by side and keeps every step; the answer has each episode once, in the order
/// of their indices. Of a scan at most `beams` are kept, as [`beam_stride`] says; `usize::MAX`
/// keeps all.
///
/// # Errors
///
/// As [`run_episodes`](crate::lock_step::run_episodes).
pub fn trace_episodes(
    plan: &RoomPlan,
    robot: &mut dyn Robot,
    crowd: &mut dyn Crowd,
    episodes: &[u64],
    beams: usize,
) -> Result<Vec<EpisodeTrace>, ArenaError> {
    let laser = Laser::new(&plan.config.sim.laser)?;
    let stride = beam_stride(plan.config.sim.laser.beams, beams);
    let episodes: Vec<u64> = episodes.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let mut rooms: Vec<ArenaRoom> = episodes
        .into_par_iter()
        .map(|episode| ArenaRoom::new(plan, &laser, episode))
        .collect::<Result<_, _>>()?;
    let factors: BTreeMap<u64, Vec<f32>> =
        rooms.iter().map(|room| (room.episode(), room.speed_factors().to_vec())).collect();
    let mut frames: BTreeMap<u64, Vec<TraceFrame>> =
        rooms.iter().map(|room| (room.episode(), vec![frame(room, stride)])).collect();
    let mut ended = BTreeMap::new();
    let mut stepper = RoomStepper::default();
    while !rooms.is_empty() {
        let ends = stepper.step(plan, robot, crowd, &mut rooms)?;
        for room in &rooms {
            frames.entry(room.episode()).or_default().push(frame(room, stride));
        }
        let finished = take_ended(&mut rooms, ends);
        ended.extend(finished.into_iter().map(|finished| (finished.episode, finished)));
    }
    let pedestrian_token = plan.crowd.built_in().filter(|kind| kind.is_learned()).map(|_| 0);
    let traces = ended.into_values().zip(frames.into_values()).zip(factors.into_values());
    Ok(traces
        .map(|((finished, frames), speed_factors)| EpisodeTrace {
            crowd: plan.crowd,
            finished,
            pedestrian_token,
            speed_factors,
            frames,
        })
        .collect())
}

fn frame(room: &ArenaRoom, stride: usize) -> TraceFrame {
    TraceFrame {
        robot: room.robot(),
        velocity: room.robot_velocity(),
        min_range: room.robot_nearest(),
        ranges: room.robot_ranges().iter().step_by(stride).copied().collect(),
        pedestrians: room.pedestrians().to_vec(),
    }
}
