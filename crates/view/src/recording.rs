//! The options of commands that play back recorded people.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use jostle_arena::config::ArenaConfig;
use jostle_arena::recording::RecordingConfig;
use jostle_arena::room::metric_scale;
use jostle_runs::output::note;

/// A recording and how it is to be understood.
#[derive(Args)]
pub struct RecordingArgs {
    /// Play back people as they walked: ETH's `obsmat.txt`, lines of `frame id x y`, or trajnet++
    /// (`.ndjson`). They do not react; the room is the one around them.
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,
    /// Seconds between two annotated frames of a person (default: what the file says, else 0.4).
    #[arg(long, value_name = "S", requires = "recording")]
    recording_interval: Option<f64>,
    /// Longest gap in a person's frames, in seconds, that is bridged by a straight line (default:
    /// none).
    #[arg(long, value_name = "S", requires = "recording")]
    recording_gap: Option<f64>,
}

impl RecordingArgs {
    /// The settings of a test among the recorded people, where some are asked for, else `base`.
    ///
    /// # Errors
    /// A file that is no recording; a room without a place for the robot.
    pub fn config(&self, base: ArenaConfig) -> Result<ArenaConfig> {
        let Some(path) = &self.recording else { return Ok(base) };
        let dt = metric_scale(&base).dt;
        let recording = RecordingConfig::read(path, self.recording_interval, self.recording_gap, dt)?;
        let config = recording.config(&base)?;
        let found = recording.recording();
        let (width, height) = (config.sim.room.width, config.sim.room.height);
        note(&format!(
            "{}: {} people in {:.0} s, {} at once at most; a room of {width:.1} m by {height:.1} m{}",
            path.display(),
            found.tracks().len(),
            f64::from(found.n_steps()) * dt,
            found.n_slots(),
            match found.n_left_out() {
                0 => String::new(),
                n => format!("; {n} were seen in a single frame and are left out"),
            }
        ));
        Ok(config)
    }
}
