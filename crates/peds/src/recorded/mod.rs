//! Recorded pedestrians: tracks of people that walked somewhere, played back as they were.
//!
//! Files: ETH's `obsmat.txt`, lines of `frame id x y`, and the ndjson of trajnet++. The user brings
//! them; none comes with this crate but a small synthetic sample. Reading order:
//! [`RecordingOptions`], [`Recording::read`] (`rows` reads a file's lines, `tracks` makes them into
//! tracks on a regular clock), [`Recording::at`].
//!
//! Positions are annotated a few times a second and wanted ten times: between two annotations a
//! pedestrian moves straight at constant speed. Rejected: splines, which overshoot where someone
//! stops.
//!
//! # References
//!
//! S. Pellegrini et al., "You'll never walk alone", ICCV 2009, doi:10.1109/ICCV.2009.5459260 (the
//! ETH recordings); P. Kothari et al., "Human trajectory forecasting in crowds", IEEE T-ITS 2022,
//! doi:10.1109/TITS.2021.3069362 (trajnet++).

mod rows;
mod tracks;

use std::path::{Path, PathBuf};

use glam::Vec2;
use rows::{File, Format};

use crate::{
    Command, Crowd, CrowdKind, CrowdName, PedsError, RoomView, Visibility, crowd::check_commands,
    error::require,
};

/// Largest recording that is read, in bytes.
const FILE_MAX: u64 = 256 << 20;

/// The meaning of a file's frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordingOptions {
    /// Time between two annotated frames of a pedestrian, s. Where it is absent: what the file says
    /// (trajnet++), else 0.4 s, at which the recordings of ETH and UCY are annotated.
    pub interval: Option<f64>,
    /// Largest gap in a pedestrian's frames that is bridged by a straight line, s. A longer one is
    /// an error. By default none is bridged.
    pub max_gap: Option<f64>,
    /// Time step of the playback, s. Default 0.1.
    pub time_step: f64,
}

impl Default for RecordingOptions {
    fn default() -> Self {
        Self { interval: None, max_gap: None, time_step: 0.1 }
    }
}

impl RecordingOptions {
    fn validate(&self) -> Result<(), PedsError> {
        let time = |value: f64| (1e-3..=60.0).contains(&value);
        require(time(self.time_step), "time_step", self.time_step, "0.001 to 60 s")?;
        for (field, value) in [("interval", self.interval), ("max_gap", self.max_gap)] {
            require(value.is_none_or(time), field, value.unwrap_or_default(), "0.001 to 60 s")?;
        }
        Ok(())
    }
}

/// One pedestrian of a recording, from its first to its last step.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Its number in the file.
    pub id: i64,
    /// The step of its first place.
    pub first_step: u32,
    /// A place for each step, m.
    pub places: Vec<Vec2>,
}

impl Track {
    /// The step after its last.
    pub fn end_step(&self) -> u32 {
        self.first_step + self.places.len() as u32
    }
}

/// A recorded pedestrian at a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedPedestrian {
    /// Index of its track.
    pub track: usize,
    /// Its place, m.
    pub position: Vec2,
    /// From here to its next place, m/s; from its last place but one where there is no next.
    pub velocity: Vec2,
    /// The end of its track, m.
    pub goal: Vec2,
}

/// Tracks on a regular clock, around the origin.
///
/// Tracks are dealt out to *slots*: at each step a slot holds at most one of them, and there are as
/// many slots as people were ever there at once. A room has one body for each slot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    tracks: Vec<Track>,
    /// For each slot its tracks in the order of time.
    slots: Vec<Vec<usize>>,
    n_steps: u32,
    /// Half of the extent of all places along x and y, m.
    half_extent: Vec2,
    /// Pedestrians of the file that are on no step of the clock.
    n_left_out: usize,
}

impl Recording {
    /// Reads a file: ndjson by its ending, else by the number of columns.
    ///
    /// # Errors
    ///
    /// [`PedsError::Recording`] with file, line, what was found and what was expected: a file that
    /// cannot be read, a line of another form, a pedestrian twice in a frame, a gap, frames at
    /// another rate than the rest, a speed of over 10 m/s.
    pub fn read(path: &Path, options: &RecordingOptions) -> Result<Self, PedsError> {
        options.validate()?;
        let refuse = |problem: String| PedsError::Recording { file: path.to_path_buf(), line: 0, problem };
        let cannot = |error: std::io::Error| refuse(format!("cannot read: {error}"));
        let about = std::fs::metadata(path).map_err(cannot)?;
        if !about.is_file() || about.len() > FILE_MAX {
            return Err(refuse(format!(
                "found {} bytes, expected a file of at most {FILE_MAX}",
                about.len()
            )));
        }
        let text = std::fs::read_to_string(path).map_err(cannot)?;
        let is_ndjson = path.extension().is_some_and(|extension| extension == "ndjson");
        let format = is_ndjson.then_some(Format::Trajnet);
        Self::parse(&text, format, options).map_err(|(line, problem)| PedsError::Recording {
            file: PathBuf::from(path),
            line,
            problem,
        })
    }

    fn parse(
        text: &str,
        format: Option<Format>,
        options: &RecordingOptions,
    ) -> Result<Self, (usize, String)> {
        let File { rows, interval } = rows::read(text, format)?;
        let interval = match (options.interval, interval) {
            (Some(asked), Some((line, said))) if (asked - said).abs() > 1e-6 => {
                let problem =
                    format!("found {} frames a second, expected {} as asked", 1.0 / said, 1.0 / asked);
                return Err((line, problem));
            }
            (asked, said) => asked.or(said.map(|(_, said)| said)).unwrap_or(0.4),
        };
        tracks::from_rows(rows, interval, options)
    }

    /// A recording of tracks in their order, which must be that of their first steps; moves them
    /// around the origin.
    fn new(mut tracks: Vec<Track>, n_left_out: usize) -> Self {
        let places = || tracks.iter().flat_map(|track| &track.places);
        let low = places().copied().fold(Vec2::INFINITY, Vec2::min);
        let high = places().copied().fold(Vec2::NEG_INFINITY, Vec2::max);
        let (centre, half_extent) = ((low + high) / 2.0, (high - low) / 2.0);
        for place in tracks.iter_mut().flat_map(|track| &mut track.places) {
            *place -= centre;
        }
        let mut slots: Vec<Vec<usize>> = Vec::new();
        for (i, track) in tracks.iter().enumerate() {
            let is_free = |slot: &&mut Vec<usize>| {
                slot.last().is_none_or(|last| tracks[*last].end_step() <= track.first_step)
            };
            match slots.iter_mut().find(is_free) {
                Some(slot) => slot.push(i),
                None => slots.push(vec![i]),
            }
        }
        let n_steps = tracks.iter().map(Track::end_step).max().unwrap_or(0);
        Self { tracks, slots, n_steps, half_extent, n_left_out }
    }

    /// The tracks, in the order of their first steps.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Most pedestrians that are there at once.
    pub fn n_slots(&self) -> usize {
        self.slots.len()
    }

    /// Number of steps from the first place of all to the last.
    pub fn n_steps(&self) -> u32 {
        self.n_steps
    }

    /// Half of the extent of all places along x and y, m; the origin is the middle.
    pub fn half_extent(&self) -> Vec2 {
        self.half_extent
    }

    /// Pedestrians of the file that are on no step of the clock (seen in a single frame between two
    /// steps).
    pub fn n_left_out(&self) -> usize {
        self.n_left_out
    }

    /// The pedestrian in a slot at a step, if there is one. `time_step` is the clock's, s.
    pub fn at(&self, slot: usize, step: u32, time_step: f32) -> Option<RecordedPedestrian> {
        let tracks = self.slots.get(slot)?;
        let after = tracks.partition_point(|track| self.tracks[*track].first_step <= step);
        let index = tracks[after.checked_sub(1)?];
        let track = &self.tracks[index];
        let k = (step - track.first_step) as usize;
        let position = *track.places.get(k)?;
        let pair = match track.places.get(k + 1) {
            Some(next) => (position, *next),
            None => (track.places[k.saturating_sub(1)], position),
        };
        let goal = *track.places.last()?;
        Some(RecordedPedestrian { track: index, position, velocity: (pair.1 - pair.0) / time_step, goal })
    }

    /// True if anybody is there at a step.
    pub fn is_busy(&self, step: u32) -> bool {
        (0..self.n_slots()).any(|slot| self.at(slot, step, 1.0).is_some())
    }
}

/// Crowd `recorded`: nobody decides, since the room puts everyone where they were.
#[derive(Debug, Clone, Copy, Default)]
pub struct RecordedCrowd;

impl Crowd for RecordedCrowd {
    fn name(&self) -> CrowdName {
        CrowdKind::Recorded.into()
    }

    fn senses_by_laser(&self) -> bool {
        false
    }

    fn visibility(&self) -> Visibility {
        Visibility::NONE
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError> {
        check_commands(rooms, commands)?;
        commands.fill(Command::STILL);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Recording, (usize, String)> {
        Recording::parse(text, None, &RecordingOptions::default())
    }

    /// Pedestrian 1 walks 4 m along x in 1.6 s, 2 stands, 3 comes when 1 has gone.
    const SAMPLE: &str = "\
        0 1 10.0 5.0\n\
        10 1 11.0 5.0\n\
        20 1 12.0 5.0\n\
        30 1 13.0 5.0\n\
        40 1 14.0 5.0\n\
        10 2 12.0 7.0\n\
        20 2 12.0 7.0\n\
        50 3 10.0 3.0\n\
        60 3 10.0 4.0\n";

    #[test]
    fn tracks_are_resampled_centred_and_dealt_to_slots() {
        let recording = parse(SAMPLE).unwrap();
        let ids: Vec<_> = recording.tracks().iter().map(|t| (t.id, t.first_step, t.places.len())).collect();
        assert_eq!(ids, [(1, 0, 17), (2, 4, 5), (3, 20, 5)]);
        // x from 10 to 14, y from 3 to 7.
        assert_eq!(recording.half_extent(), Vec2::new(2.0, 2.0));
        assert_eq!((recording.n_slots(), recording.n_steps(), recording.n_left_out()), (2, 25, 0));
        let walker = recording.at(0, 5, 0.1).unwrap();
        assert!(walker.position.distance(Vec2::new(-0.75, 0.0)) < 1e-6, "{walker:?}");
        assert!(walker.velocity.distance(Vec2::new(2.5, 0.0)) < 1e-5);
        assert_eq!(walker.goal, Vec2::new(2.0, 0.0));
        let last = recording.at(0, 16, 0.1).unwrap();
        assert!(last.position == last.goal && last.velocity.distance(Vec2::new(2.5, 0.0)) < 1e-5);
        assert_eq!(recording.at(1, 6, 0.1).unwrap().velocity, Vec2::ZERO);
        assert_eq!(recording.at(0, 20, 0.1).unwrap().track, 2);
        for (slot, step) in [(0, 17), (0, 19), (0, 25), (1, 3), (1, 9), (2, 0)] {
            assert_eq!(recording.at(slot, step, 0.1), None, "{slot} at {step}");
        }
        assert!(recording.is_busy(16) && !recording.is_busy(18));
    }

    #[test]
    fn the_three_formats_say_the_same() {
        let each = |form: &dyn Fn([&str; 4]) -> String| {
            let lines =
                SAMPLE.lines().map(|line| form(line.split(' ').collect::<Vec<_>>().try_into().unwrap()));
            lines.collect::<Vec<String>>().join("\n")
        };
        let obsmat = each(&|[frame, id, x, y]| {
            format!("  {frame}.0000000e+00   {id}.0000000e+00 {x} 0.0 {y} 0.1 0.0 0.2")
        });
        let ndjson = each(&|[frame, id, x, y]| {
            format!("{{\"track\": {{\"f\": {frame}, \"p\": {id}, \"x\": {x}, \"y\": {y}}}}}")
        });
        let scene = r#"{"scene": {"id": 0, "p": 1, "s": 0, "e": 40, "fps": 2.5, "tag": [1, []]}}"#;
        let expected = parse(SAMPLE).unwrap();
        assert_eq!(parse(&obsmat).unwrap(), expected);
        assert_eq!(parse(&SAMPLE.replace(' ', "\t")).unwrap(), expected);
        let options = RecordingOptions::default();
        let trajnet = |text: &str| Recording::parse(text, Some(Format::Trajnet), &options);
        assert_eq!(trajnet(&format!("{scene}\n{ndjson}")).unwrap(), expected);
        let slower = trajnet(&format!("{}\n{ndjson}", scene.replace("2.5", "1.25"))).unwrap();
        assert_eq!(slower.tracks()[0].places.len(), 33);
        let asked = RecordingOptions { interval: Some(0.4), ..options };
        let text = format!("{}\n{ndjson}", scene.replace("2.5", "25"));
        let error = Recording::parse(&text, Some(Format::Trajnet), &asked).unwrap_err();
        assert_eq!(error, (1, "found 25 frames a second, expected 2.5 as asked".to_owned()));
    }

    #[test]
    fn what_is_wrong_is_named_by_its_line() {
        let check = |text: &str, line: usize, part: &str| {
            let (found, problem) = parse(text).unwrap_err();
            assert!(found == line && problem.contains(part), "line {found}: {problem}");
        };
        check("", 0, "found no line");
        check("0 1 2.0\n", 1, "found 3 columns, expected 4 (frame id x y) or 8 (obsmat.txt)");
        check("0 1 2.0 3.0\n10 1 2.0\n", 2, "found 3 columns, expected 4");
        check("0 1 2.0 x\n", 1, "found \"x\", expected a number");
        check("0.5 1 2.0 3.0\n", 1, "frame: found 0.5, expected a whole number");
        check("0 1 2.0 inf\n", 1, "found \"inf\", expected a number");
        check("0 1 2 3\n10 1 2 3\n0 1 2 3\n", 3, "pedestrian 1 is in frame 0 already (line 1)");
        check("0 1 2 3\n10 1 2 3\n30 1 2 3\n", 3, "pedestrian 1: found frame 30 after 10, expected 20");
        check("0 1 2 3\n10 1 2 3\n20 1 2 3\n30 1 2 3\n35 1 2 3\n", 5, "found frame 35 after 30, expected 40");
        check("0 1 2 3\n10 1 9 3\n", 2, "moves 7.0 m in 0.4 s, expected at most 10 m/s");
        let one_frame_each = "0 1 2 3\n0 2 4 3\n";
        check(one_frame_each, 0, "found no pedestrian in two frames");
    }

    #[test]
    fn a_gap_is_bridged_where_that_is_asked_for() {
        let text = "0 1 2 3\n10 1 3 3\n30 1 5 3\n";
        let options = RecordingOptions { max_gap: Some(0.8), ..RecordingOptions::default() };
        let recording = Recording::parse(text, None, &options).unwrap();
        let xs: Vec<f32> = recording.tracks()[0].places.iter().map(|place| place.x).collect();
        assert_eq!(xs.len(), 13);
        assert!(xs.windows(2).all(|pair| (pair[1] - pair[0] - 0.25).abs() < 1e-5), "{xs:?}");
        let options = RecordingOptions { max_gap: Some(0.7), ..options };
        assert!(Recording::parse(text, None, &options).is_err());
        // Frames that are no multiple apart are another rate, whatever may be bridged.
        let odd = "0 1 2 3\n10 1 3 3\n20 1 3 3\n35 1 5 3\n";
        let options = RecordingOptions { max_gap: Some(5.0), ..options };
        let (_, problem) = Recording::parse(odd, None, &options).unwrap_err();
        assert!(problem.contains("frames of this file are 10 apart"), "{problem}");
    }

    #[test]
    fn who_is_between_two_steps_is_left_out() {
        let text = "0 1 2 3\n10 1 3 3\n3 2 4 3\n";
        let recording = parse(text).unwrap();
        assert_eq!((recording.tracks().len(), recording.n_left_out()), (1, 1));
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let missing = Path::new("/nonexistent/obsmat.txt");
        let read = |options: RecordingOptions| Recording::read(missing, &options).unwrap_err().to_string();
        let options = RecordingOptions::default();
        assert!(read(options).starts_with("/nonexistent/obsmat.txt: cannot read: "));
        let bad = read(RecordingOptions { interval: Some(0.0), ..options });
        assert_eq!(bad, "interval = 0; expected 0.001 to 60 s");
        assert!(read(RecordingOptions { time_step: f64::NAN, ..options }).starts_with("time_step"));
    }

    #[test]
    fn nobody_decides() {
        let room = RoomView { pedestrians: &[], others: &[], observations: &[], speed_factor: &[] };
        assert!(RecordedCrowd.decide(&[room], &mut [Command::STILL]).is_err());
        assert_eq!(RecordedCrowd.name().as_str(), "recorded");
        assert_eq!(RecordedCrowd.visibility(), Visibility::NONE);
    }
}
