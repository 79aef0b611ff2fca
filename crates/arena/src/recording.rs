//! Rooms of recorded pedestrians: a recording as a setting of a test, and its playback in an
//! episode.
//!
//! The room is the rectangle around all recorded places with a margin. The robot's start and goal
//! are drawn in it as ever; the pedestrians are put where they were, step by step, and nothing that
//! the robot does moves them.

use std::path::Path;
use std::sync::Arc;

use glam::Vec2;
use jostle_peds::recorded::{Recording, RecordingOptions};
use jostle_sim::{Pose, RoomConfig, StreamRng};
use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::config::ArenaConfig;
use crate::error::ArenaError;

/// Margin of the room beyond the recorded places on each side (m).
const MARGIN: f32 = 2.0;
/// A pedestrian whose track begins nearer to the robot than this is not there before it is as far
/// (m): nobody is hit by someone who came out of nothing.
const APPEAR: f32 = 1.5;
/// Slower than this a pedestrian keeps its heading (m/s).
const TURNING: f32 = 0.1;

/// A recording as a setting: what it is, and the tracks themselves, which are not written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingConfig {
    /// SHA-256 of its tracks on the clock, so that a test depends on what is in a file and not on
    /// where it lies.
    pub sha256: String,
    #[serde(skip)]
    tracks: Arc<Recording>,
}

impl RecordingConfig {
    /// A recording that was read or made.
    pub fn new(recording: Recording) -> Self {
        let mut hasher = Sha256::new();
        for track in recording.tracks() {
            hasher.update(track.id.to_le_bytes());
            hasher.update(track.first_step.to_le_bytes());
            for place in &track.places {
                hasher.update(place.x.to_le_bytes());
                hasher.update(place.y.to_le_bytes());
            }
        }
        Self { sha256: jostle_policy::hex(&hasher.finalize()), tracks: Arc::new(recording) }
    }

    /// Reads a file for rooms with a control period of `dt` (s).
    ///
    /// # Errors
    ///
    /// As [`Recording::read`].
    pub fn read(
        path: &Path,
        interval: Option<f64>,
        max_gap: Option<f64>,
        dt: f64,
    ) -> Result<Self, ArenaError> {
        let options = RecordingOptions { interval, max_gap, time_step: dt };
        Ok(Self::new(Recording::read(path, &options)?))
    }

    /// The tracks; none where the setting was read without them.
    pub fn recording(&self) -> &Recording {
        &self.tracks
    }

    /// The settings of a test among these pedestrians: the room around them, a body for each that
    /// is there at once. Where the room is small, goals are at least half of its diagonal away
    /// instead of the usual distance.
    ///
    /// # Errors
    ///
    /// Settings that do not fit the room or the number of people.
    pub fn config(&self, base: &ArenaConfig) -> Result<ArenaConfig, ArenaError> {
        let mut config = base.clone();
        let mut room = RoomConfig::default();
        let size = (self.tracks.half_extent() + MARGIN) * 2.0;
        (room.width, room.height) = (size.x, size.y);
        config.sim.room = room;
        config.sim.spawn.goal_distance = config.sim.spawn.goal_distance.min(size.length() / 2.0);
        (config.n_agents, config.scene) = (1 + self.tracks.n_slots(), None);
        config.recording = Some(self.clone());
        config.validate()?;
        Ok(config)
    }

    /// Refuses settings that are not of this recording.
    pub(crate) fn validate(&self, n_agents: usize) -> Result<(), ArenaError> {
        let refuse =
            |field, found: String, expected: String| Err(ArenaError::Setting { field, found, expected });
        if self.tracks.tracks().is_empty() {
            return refuse("recording", "no pedestrian".to_owned(), "at least one".to_owned());
        }
        let expected = 1 + self.tracks.n_slots();
        if n_agents != expected {
            return refuse("n_agents", n_agents.to_string(), format!("the recording's {expected}"));
        }
        Ok(())
    }
}

/// A recording that is played in an episode.
#[derive(Clone, Debug)]
pub(crate) struct Playback {
    recording: Arc<Recording>,
    /// The recording's step at which the episode starts.
    first: u32,
    dt: f32,
    /// The place of slots without a pedestrian, beyond the walls.
    waiting: Vec2,
    /// The track that is shown in each slot.
    shown: Vec<Option<usize>>,
    headings: Vec<f32>,
}

/// One body of a playback at a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Played {
    pub(crate) pose: Pose,
    pub(crate) velocity: Vec2,
    pub(crate) goal: Vec2,
}

impl Playback {
    /// The playback of an episode of at most `step_limit` steps. It starts at a step that is drawn
    /// uniformly from those at which somebody is there and from which on the recording lasts for
    /// the whole episode, or, if there is none, from all with somebody.
    pub(crate) fn new(
        config: &RecordingConfig,
        step_limit: u32,
        dt: f32,
        walls: (Vec2, Vec2),
        rng: &mut StreamRng,
    ) -> Self {
        let recording = Arc::clone(&config.tracks);
        let busy = |limit: u32| (0..limit).filter(|step| recording.is_busy(*step)).collect::<Vec<u32>>();
        let whole = busy((recording.n_steps() + 1).saturating_sub(step_limit));
        let starts = if whole.is_empty() { busy(recording.n_steps()) } else { whole };
        let first = starts[rng.random_range(0..starts.len())];
        let slots = recording.n_slots();
        let (shown, headings) = (vec![None; slots], vec![0.0; slots]);
        Self { recording, first, dt, waiting: walls.1 + 100.0, shown, headings }
    }

    /// True while somebody is shown in a slot.
    pub(crate) fn is_shown(&self, slot: usize) -> bool {
        self.shown[slot].is_some()
    }

    /// The body of a slot at an episode's step. A pedestrian is not shown before it is [`APPEAR`]
    /// away from `robot`; at the start, when the robot is placed after the pedestrians, there is
    /// none.
    pub(crate) fn play(&mut self, slot: usize, step: u32, robot: Option<Vec2>) -> Played {
        let now = self.recording.at(slot, self.first + step, self.dt);
        let far = |place: Vec2| robot.is_none_or(|robot| robot.distance(place) >= APPEAR);
        let Some(now) = now.filter(|now| self.shown[slot] == Some(now.track) || far(now.position)) else {
            self.shown[slot] = None;
            let place = self.waiting + Vec2::new(2.0 * slot as f32, 0.0);
            return Played { pose: Pose::new(place, 0.0), velocity: Vec2::ZERO, goal: place };
        };
        self.shown[slot] = Some(now.track);
        if now.velocity.length() >= TURNING {
            self.headings[slot] = now.velocity.to_angle();
        }
        Played { pose: Pose::new(now.position, self.headings[slot]), velocity: now.velocity, goal: now.goal }
    }
}
