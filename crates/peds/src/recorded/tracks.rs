//! From annotations to tracks on a regular clock.

use std::collections::BTreeMap;

use glam::{DVec2, Vec2};

use super::rows::Row;
use super::{Recording, RecordingOptions, Track};

/// Nobody runs faster, m/s: a larger speed means other units or another frame rate.
const SPEED_MAX: f64 = 10.0;
/// Largest coordinate that is accepted, m.
const COORDINATE_MAX: f64 = 1e5;
/// Most steps of a recording: a day at ten a second.
const STEPS_MAX: f64 = 864_000.0;
/// The part of a step that rounding may take from a whole number of them.
const SLACK: f64 = 1e-6;

type Problem = (usize, String);

/// Tracks of rows whose frames are `interval` seconds apart.
pub(super) fn from_rows(
    rows: Vec<Row>,
    interval: f64,
    options: &RecordingOptions,
) -> Result<Recording, Problem> {
    let first_frame = rows.iter().map(|row| row.frame).min().unwrap_or_default();
    let mut people: BTreeMap<i64, Vec<Row>> = BTreeMap::new();
    for row in rows {
        if row.place.iter().any(|value| value.abs() > COORDINATE_MAX) {
            let [x, y] = row.place;
            return Err((row.line, format!("found ({x}, {y}), expected at most {COORDINATE_MAX} m")));
        }
        people.entry(row.id).or_default().push(row);
    }
    for rows in people.values_mut() {
        rows.sort_by_key(|row| (row.frame, row.line));
        if let Some([first, second]) = rows.array_windows().find(|[a, b]| a.frame == b.frame) {
            let problem =
                format!("pedestrian {} is in frame {} already (line {})", first.id, first.frame, first.line);
            return Err((second.line, problem));
        }
    }
    let stride = stride(people.values())?;
    let seconds = interval / stride as f64;
    let mut tracks = Vec::new();
    let mut n_left_out = 0;
    for rows in people.values() {
        check(rows, stride, seconds, options.max_gap.unwrap_or(0.0))?;
        let track = resampled(rows, first_frame, seconds, options.time_step)?;
        if track.places.is_empty() {
            n_left_out += 1;
        } else {
            tracks.push(track);
        }
    }
    // By time; people of one step by their numbers, in which order they are.
    tracks.sort_by_key(|track| track.first_step);
    Ok(Recording::new(tracks, n_left_out))
}

/// Frames between two annotations of a pedestrian: the most frequent difference, the least of
/// several.
fn stride<'r>(people: impl Iterator<Item = &'r Vec<Row>>) -> Result<i64, Problem> {
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    for rows in people {
        for [a, b] in rows.array_windows() {
            *counts.entry(b.frame - a.frame).or_default() += 1;
        }
    }
    let most = counts.values().copied().max();
    let stride = counts.iter().find(|(_, count)| Some(**count) == most).map(|(stride, _)| *stride);
    stride.ok_or_else(|| (0, "found no pedestrian in two frames, expected at least one".to_owned()))
}

/// Gaps, other frame rates, and speeds that nobody has.
fn check(rows: &[Row], stride: i64, seconds: f64, max_gap: f64) -> Result<(), Problem> {
    for [a, b] in rows.array_windows() {
        let (apart, id) = (b.frame - a.frame, b.id);
        let time = apart as f64 * seconds;
        let bridged = apart % stride == 0 && time <= max_gap + SLACK;
        if apart != stride && !bridged {
            return Err((
                b.line,
                format!(
                    "pedestrian {id}: found frame {} after {}, expected {}: frames of this file are {stride} apart (a gap, or another frame rate)",
                    b.frame,
                    a.frame,
                    a.frame + stride
                ),
            ));
        }
        let way = DVec2::from(a.place).distance(DVec2::from(b.place));
        if way > SPEED_MAX * time {
            let problem = format!(
                "pedestrian {id} moves {way:.1} m in {time:.1} s, expected at most {SPEED_MAX} m/s: positions in metres, frames {:.3} s apart",
                seconds * stride as f64
            );
            return Err((b.line, problem));
        }
    }
    Ok(())
}

/// A place for each step of the clock between a pedestrian's first and last frame, on straight
/// lines between its annotations.
fn resampled(rows: &[Row], first_frame: i64, seconds: f64, time_step: f64) -> Result<Track, Problem> {
    let time = |row: &Row| (row.frame - first_frame) as f64 * seconds / time_step;
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    if time(last) > STEPS_MAX {
        let found = time(last) * time_step;
        return Err((
            last.line,
            format!("found {found:.0} s after the first frame, expected at most a day's"),
        ));
    }
    let (from, to) = ((time(first) - SLACK).ceil(), (time(last) + SLACK).floor());
    let mut places = Vec::new();
    let mut next = 0;
    let mut step = from;
    while step <= to {
        while next + 1 < rows.len() && time(&rows[next]) < step - SLACK {
            next += 1;
        }
        let (a, b) = (&rows[next.saturating_sub(1)], &rows[next]);
        let length = time(b) - time(a);
        let part = if length > 0.0 { ((step - time(a)) / length).clamp(0.0, 1.0) } else { 0.0 };
        let place: Vec2 = DVec2::from(a.place).lerp(DVec2::from(b.place), part).as_vec2();
        places.push(place);
        step += 1.0;
    }
    Ok(Track { id: first.id, first_step: from.max(0.0) as u32, places })
}
