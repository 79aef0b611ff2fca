//! A cell's episodes in a small file: what `results/` keeps, and what every table is computed from.
//!
//! ```text
//! {"format":"jostle-cell-1","key":{…},"policy":{…},"scale":{…},"episodes":1000}
//! S 245 23.8123456 21.4012345 0.6120000 0 12 0 31 210.5000000 4 0
//! P 12 0.9123456 14.7723456 0.2400000 7 10 8 11 1210.7500000 0 0
//! ```
//!
//! The first line says what the cell is; then one line for each episode in order: outcome (S
//! success, W wall, P pedestrian, T timeout), steps, way travelled and straight distance from start
//! to goal (m, rounded to 1e-7); then the values of [`Driving`] in the order of its fields: least
//! clearance (m, `-` without pedestrians), steps with a time to collision below 1 s and below 2 s,
//! in intimate and in personal space, mean squared jerk (m²/s⁶), stalled steps and those at the
//! end. Lines from before there were these eight end before them. Times and extras follow from the
//! first ([`EpisodeMetrics::from_totals`]). A table is computed from this form also when the
//! episodes have just been run, so that a stored cell and a fresh one give the same bytes.

use std::fmt::Write as _;
use std::path::Path;

use jostle_policy::excerpt;
use serde::{Deserialize, Serialize};

use crate::cell::CellKey;
use crate::error::EvalError;
use crate::records::EpisodeRecord;
use jostle_arena::Outcome;
use jostle_arena::driving::Driving;
use jostle_arena::identity::PolicyIdentity;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};

/// The format's name in the first line.
pub const FORMAT: &str = "jostle-cell-1";
/// Largest file that is read, in bytes: a million episodes.
const FILE_MAX: u64 = 64 << 20;
/// Decimals of a distance.
const DECIMALS: usize = 7;

/// One episode, as far as the tables need it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompactEpisode {
    /// Its outcome.
    pub outcome: Outcome,
    /// Time, way and extras.
    pub metrics: EpisodeMetrics,
    /// Nearness, smoothness, stalling; `None` where the cell was stored before there were these
    /// values.
    pub driving: Option<Driving>,
}

/// A line of a file, rounded as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    outcome: Outcome,
    steps: u64,
    path: f64,
    straight: f64,
    driving: Option<Driving>,
}

impl Line {
    fn new(outcome: Outcome, steps: u64, metrics: &EpisodeMetrics, driving: Option<Driving>) -> Self {
        Self {
            outcome,
            steps,
            path: rounded(metrics.path_length),
            straight: rounded(metrics.straight_distance),
            driving: driving.map(|driving| Driving {
                min_clearance: driving.min_clearance.map(rounded),
                mean_squared_jerk: rounded(driving.mean_squared_jerk),
                ..driving
            }),
        }
    }
}

/// The first line of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompactHead {
    /// [`FORMAT`].
    pub format: String,
    /// The key of everything that the episodes depend on.
    pub key: CellKey,
    /// The robot's policy.
    pub policy: PolicyIdentity,
    /// Control period, goal radius, speed.
    pub scale: MetricScale,
    /// Number of episodes.
    pub episodes: u64,
    /// The other simulator that ran them; left out where it was ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<Simulator>,
}

/// Another simulator, and what it ran with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulator {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Version of the robot and the room that were made for it.
    pub model: u32,
    /// SHA-256 of the program that made them.
    pub driver: String,
    /// Version of numpy.
    pub numpy: String,
    /// Version of Python.
    pub python: String,
}

/// A cell with its episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct CompactCell {
    /// The kind of file and its version.
    pub head: CompactHead,
    /// The episodes, as written.
    lines: Vec<Line>,
}

impl CompactCell {
    /// The small form of records.
    pub fn new(key: CellKey, policy: PolicyIdentity, scale: MetricScale, records: &[EpisodeRecord]) -> Self {
        let line =
            |record: &EpisodeRecord| Line::new(record.outcome, record.steps, &record.metrics, record.driving);
        let format = FORMAT.to_owned();
        let episodes = records.len() as u64;
        let head = CompactHead { format, key, policy, scale, episodes, simulator: None };
        Self { head, lines: records.iter().map(line).collect() }
    }

    /// The small form of episodes that another simulator ran, each with its number of steps.
    pub fn simulated(
        key: CellKey,
        policy: PolicyIdentity,
        scale: MetricScale,
        simulator: Simulator,
        episodes: &[(CompactEpisode, u64)],
    ) -> Self {
        let lines = episodes
            .iter()
            .map(|(episode, steps)| Line::new(episode.outcome, *steps, &episode.metrics, episode.driving));
        let lines: Vec<Line> = lines.collect();
        let (format, episodes) = (FORMAT.to_owned(), lines.len() as u64);
        let head = CompactHead { format, key, policy, scale, episodes, simulator: Some(simulator) };
        Self { head, lines }
    }

    /// The first `count` episodes.
    pub fn episodes(&self, count: usize) -> Vec<CompactEpisode> {
        let episode = |&Line { outcome, steps, path, straight, driving }: &Line| CompactEpisode {
            outcome,
            metrics: EpisodeMetrics::from_totals(&self.head.scale, outcome, steps, path, straight),
            driving,
        };
        self.lines.iter().take(count).map(episode).collect()
    }

    /// The file's text.
    pub fn text(&self) -> String {
        let mut text = serde_json::to_string(&self.head).expect("strings and numbers are always JSON");
        text.push('\n');
        for Line { outcome, steps, path, straight, driving } in &self.lines {
            write!(text, "{} {steps} {path:.DECIMALS$} {straight:.DECIMALS$}", letter(*outcome))
                .expect("a string takes everything");
            if let Some(driving) = driving {
                text += &driving_text(driving);
            }
            text.push('\n');
        }
        text
    }

    /// Reads a file.
    ///
    /// # Errors
    ///
    /// [`EvalError::Io`] if it cannot be read, [`EvalError::Record`] with the first line that is
    /// not as it should be.
    pub fn read(path: &Path) -> Result<Self, EvalError> {
        let about = std::fs::metadata(path).map_err(EvalError::io(path, "read"))?;
        let refuse = |line: usize, problem: String| EvalError::Record {
            file: path.to_path_buf(),
            line,
            problem: excerpt(&problem),
        };
        if !about.is_file() || about.len() > FILE_MAX {
            return Err(refuse(1, format!("{} bytes, expected a file of at most {FILE_MAX}", about.len())));
        }
        let text = std::fs::read_to_string(path).map_err(EvalError::io(path, "read"))?;
        Self::parse(&text).map_err(|(line, problem)| refuse(line, problem))
    }

    /// The cell of a text, or the line that is wrong and why.
    fn parse(text: &str) -> Result<Self, (usize, String)> {
        let mut lines = text.lines();
        let first = lines.next().unwrap_or_default();
        let head: CompactHead = serde_json::from_str(first).map_err(|error| (1, error.to_string()))?;
        if head.format != FORMAT {
            return Err((1, format!("found format {}, expected {FORMAT}", head.format)));
        }
        let lines: Vec<_> = lines
            .enumerate()
            .map(|(i, line)| {
                let expected = "expected an outcome (S, W, P, T), steps, way and distance, and nothing or eight values more";
                parse_line(line).ok_or_else(|| (i + 2, format!("found {line:?}, {expected}")))
            })
            .collect::<Result<_, _>>()?;
        if lines.len() as u64 != head.episodes || !text.ends_with('\n') {
            let problem = format!("found {} whole episodes, expected {}", lines.len(), head.episodes);
            return Err((lines.len() + 1, problem));
        }
        Ok(Self { head, lines })
    }
}

/// A number as it will be read back.
fn rounded(value: f64) -> f64 {
    format!("{value:.DECIMALS$}").parse().expect("a printed number can be read")
}

fn letter(outcome: Outcome) -> char {
    match outcome {
        Outcome::Success => 'S',
        Outcome::CollisionWall => 'W',
        Outcome::CollisionPedestrian => 'P',
        Outcome::Timeout => 'T',
    }
}

fn driving_text(driving: &Driving) -> String {
    let clearance = driving.min_clearance.map_or_else(|| "-".to_owned(), |m| format!("{m:.DECIMALS$}"));
    let [ttc_1, ttc_2] = driving.ttc_steps;
    let Driving { intimate_steps, personal_steps, stalled_steps, final_stall_steps, .. } = driving;
    let jerk = driving.mean_squared_jerk;
    format!(
        " {clearance} {ttc_1} {ttc_2} {intimate_steps} {personal_steps} {jerk:.DECIMALS$} {stalled_steps} {final_stall_steps}"
    )
}

fn parse_line(line: &str) -> Option<Line> {
    let mut fields = line.split(' ');
    let first = fields.next()?;
    let outcome = *Outcome::ALL.iter().find(|outcome| first == letter(**outcome).to_string())?;
    let steps = fields.next()?.parse().ok()?;
    let (path, straight) = (amount(fields.next()?)?, amount(fields.next()?)?);
    let driving = match fields.next() {
        None => None,
        Some(clearance) => Some(parse_driving(clearance, &mut fields)?),
    };
    fields.next().is_none().then_some(Line { outcome, steps, path, straight, driving })
}

/// A number of at least 0.
fn amount(field: &str) -> Option<f64> {
    field.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0)
}

fn parse_driving<'a>(clearance: &str, fields: &mut impl Iterator<Item = &'a str>) -> Option<Driving> {
    let min_clearance = if clearance == "-" { None } else { Some(amount(clearance)?) };
    let mut count = || fields.next()?.parse::<u64>().ok();
    let (ttc_steps, intimate_steps, personal_steps) = ([count()?, count()?], count()?, count()?);
    let mean_squared_jerk = amount(fields.next()?)?;
    let (stalled_steps, final_stall_steps) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some(Driving {
        min_clearance,
        ttc_steps,
        intimate_steps,
        personal_steps,
        mean_squared_jerk,
        stalled_steps,
        final_stall_steps,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::tests::key;
    use jostle_arena::identity::short;

    const DRIVING: Driving = Driving {
        min_clearance: Some(2.0 / 3.0),
        ttc_steps: [1, 2],
        intimate_steps: 3,
        personal_steps: 4,
        mean_squared_jerk: 100.0 / 7.0,
        stalled_steps: 5,
        final_stall_steps: 0,
    };

    /// Four episodes, the last two from before there were values of driving.
    fn cell() -> CompactCell {
        let key = key("p");
        let scale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
        let identity = PolicyIdentity::custom("test", "1");
        let record = |episode: u64| {
            let outcome = Outcome::ALL[episode as usize];
            EpisodeRecord {
                episode,
                crowd: key.crowd,
                token: 0,
                outcome,
                steps: 123,
                start: [0.0, 0.0],
                goal: [10.0, 0.0],
                metrics: EpisodeMetrics::from_totals(&scale, outcome, 123, 11.3 / 0.9, 10.0 / 3.0),
                driving: match episode {
                    0 => Some(DRIVING),
                    1 => Some(Driving { min_clearance: None, ..DRIVING }),
                    _ => None,
                },
                cell: short(&key.hash()).to_owned(),
                provenance: identity.reference(),
            }
        };
        let records: Vec<_> = (0..4).map(record).collect();
        CompactCell::new(key, identity, scale, &records)
    }

    #[test]
    fn a_cell_comes_back_and_rounds_once() {
        let cell = cell();
        let text = cell.text();
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert_eq!(lines[0], "S 123 12.5555556 3.3333333 0.6666667 1 2 3 4 14.2857143 5 0");
        assert_eq!(lines[1], "W 123 12.5555556 3.3333333 - 1 2 3 4 14.2857143 5 0");
        assert_eq!(lines[2], "P 123 12.5555556 3.3333333");
        let read = CompactCell::parse(&text).unwrap();
        assert_eq!(read, cell);
        assert_eq!((read.text(), read.episodes(9).len(), read.episodes(2).len()), (text, 4, 2));
        // 12.3 s − (3.3333333 − 0.5) m at 1 m/s.
        let episodes = read.episodes(4);
        assert_eq!((episodes[1].driving.unwrap().min_clearance, episodes[2].driving), (None, None));
        let success = episodes[0].metrics;
        assert!((success.extra_time.unwrap() - 9.466_666_7).abs() < 1e-12);
    }

    #[test]
    fn a_cell_of_another_simulator_names_it() {
        let own = cell();
        let simulator = Simulator {
            name: "mujoco".to_owned(),
            version: "4.0.0".to_owned(),
            model: 1,
            driver: "d".to_owned(),
            numpy: "2.0.0".to_owned(),
            python: "3.11.0".to_owned(),
        };
        let CompactHead { key, policy, scale, .. } = own.head.clone();
        let episodes: Vec<_> = own.episodes(4).into_iter().map(|episode| (episode, 123)).collect();
        let found = CompactCell::simulated(key, policy, scale, simulator.clone(), &episodes);
        let read = CompactCell::parse(&found.text()).unwrap();
        assert_eq!((read.head.simulator.as_ref(), &read.lines), (Some(&simulator), &own.lines));
        assert!(found.text().contains(r#""simulator":{"name":"mujoco","#));
        assert!(!own.text().contains("simulator"), "cells of before stay as they are");
    }

    #[test]
    fn what_is_no_cell_is_named_by_its_line() {
        let text = cell().text();
        let check = |text: String, line: usize, part: &str| {
            let (found, problem) = CompactCell::parse(&text).unwrap_err();
            assert!(found == line && problem.contains(part), "{found}: {problem}");
        };
        check(String::new(), 1, "EOF");
        check(text.replace(FORMAT, "jostle-cell-9"), 1, "found format jostle-cell-9");
        check(text.replace("W 123", "X 123"), 3, "found \"X 123");
        check(text.replace("W 123", "W -1"), 3, "expected an outcome");
        check(text.replace("3.3333333\nT", "3.3333333 1\nT"), 4, "nothing or eight values more");
        check(text.replace(" 5 0\nW", " 5 0 0\nW"), 2, "nothing or eight values more");
        check(text.replace(" - 1 2", " -1 1 2"), 3, "nothing or eight values more");
        check(text.replace("12.5555556", "NaN"), 2, "expected an outcome");
        check(text[..text.len() - 1].to_owned(), 5, "whole episodes");
        let (start, _) = text.rsplit_once("T ").unwrap();
        check(start.to_owned(), 4, "found 3 whole episodes, expected 4");
    }
}
