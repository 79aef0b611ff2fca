//! Records of episodes: one JSON object a line (NDJSON), in the order of the episodes, safe to
//! append to and to resume.
//!
//! A run that is killed may leave half a line at the file's end. Reading reports it, resuming cuts
//! it off, and both say so; any other fault is an error, since a file with a broken middle is not
//! what this program wrote.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use jostle_peds::CrowdName;
use jostle_policy::excerpt;
use serde::{Deserialize, Serialize};

use crate::cell::CellKey;
use crate::error::EvalError;
use jostle_arena::Outcome;
use jostle_arena::driving::Driving;
use jostle_arena::identity::{ProvenanceRef, short};
use jostle_arena::metrics::EpisodeMetrics;

/// Largest record file that is read, in bytes: two million episodes.
const FILE_MAX: u64 = 1 << 30;

/// One episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeRecord {
    /// Its index k, from 0.
    pub episode: u64,
    /// Name of the crowd.
    pub crowd: CrowdName,
    /// The robot's behaviour token.
    pub token: u32,
    /// Its outcome.
    pub outcome: Outcome,
    /// Steps until then.
    pub steps: u64,
    /// The robot's start (m).
    pub start: [f32; 2],
    /// Its goal (m).
    pub goal: [f32; 2],
    /// Time, way, and what they exceed the straight way by.
    #[serde(flatten)]
    pub metrics: EpisodeMetrics,
    /// Nearness, smoothness, stalling; `None` in records from before there were these values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driving: Option<Driving>,
    /// First 16 digits of the cell's hash.
    pub cell: String,
    /// The policy's provenance.
    pub provenance: ProvenanceRef,
}

/// The bytes behind a file's last complete line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TornTail {
    /// Their start: the length of the sound part.
    pub offset: u64,
    /// Its length.
    pub bytes: u64,
}

/// A record file as it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordFile {
    /// The complete records.
    pub records: Vec<EpisodeRecord>,
    /// Half a line at the end, if there is one.
    pub torn: Option<TornTail>,
}

/// Reads a record file. Episodes must be 0, 1, 2, … and all of one cell.
///
/// # Errors
///
/// A file that cannot be read, a complete line that is no record or is out of order, records of
/// several cells.
pub fn read_records(path: &Path) -> Result<RecordFile, EvalError> {
    let mut file = File::open(path).map_err(EvalError::io(path, "read"))?;
    let text = read_capped(path, &mut file)?;
    parse_records(path, &text)
}

/// All bytes of a record file, if it is a file and not absurdly large.
fn read_capped(path: &Path, file: &mut File) -> Result<Vec<u8>, EvalError> {
    let about = file.metadata().map_err(EvalError::io(path, "read"))?;
    if !about.is_file() || about.len() > FILE_MAX {
        let problem = format!("{} bytes, expected a file of at most {FILE_MAX}", about.len());
        return Err(EvalError::Record { file: path.to_path_buf(), line: 1, problem });
    }
    let mut text = Vec::new();
    file.read_to_end(&mut text).map_err(EvalError::io(path, "read"))?;
    Ok(text)
}

fn parse_records(path: &Path, text: &[u8]) -> Result<RecordFile, EvalError> {
    let sound = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
    let mut records: Vec<EpisodeRecord> = Vec::new();
    for (idx, line) in text[..sound].split_inclusive(|byte| *byte == b'\n').enumerate() {
        let refuse = |problem: String| {
            let problem = excerpt(&problem);
            EvalError::Record { file: path.to_path_buf(), line: idx + 1, problem }
        };
        let record: EpisodeRecord =
            serde_json::from_slice(line).map_err(|error| refuse(error.to_string()))?;
        if record.episode != idx as u64 {
            return Err(refuse(format!("found episode {}, expected {idx}", record.episode)));
        }
        if let Some(first) = records.first().filter(|first| first.cell != record.cell) {
            return Err(refuse(format!("found cell {}, expected {}", record.cell, first.cell)));
        }
        records.push(record);
    }
    let bytes = (text.len() - sound) as u64;
    let torn = (bytes > 0).then_some(TornTail { offset: sound as u64, bytes });
    Ok(RecordFile { records, torn })
}

/// The answer to whether a file holds a number of episodes of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Completeness {
    /// There is no such file.
    Missing,
    /// It holds fewer episodes.
    Partial {
        /// Complete records.
        episodes: u64,
    },
    /// It holds as many or more.
    Complete,
}

/// Tells whether the file at `path` holds the first `episodes` episodes of a cell.
///
/// # Errors
///
/// As [`read_records`], and [`EvalError::OtherCell`] for a sound file of another cell.
pub fn completeness(path: &Path, key: &CellKey, episodes: u64) -> Result<Completeness, EvalError> {
    if !path.exists() {
        return Ok(Completeness::Missing);
    }
    let file = read_records(path)?;
    check_cell(path, &file, key)?;
    let held = file.records.len() as u64;
    Ok(if held >= episodes { Completeness::Complete } else { Completeness::Partial { episodes: held } })
}

fn check_cell(path: &Path, file: &RecordFile, key: &CellKey) -> Result<(), EvalError> {
    let hash = key.hash();
    match file.records.first() {
        Some(record) if record.cell != short(&hash) => Err(EvalError::OtherCell {
            file: path.to_path_buf(),
            found: record.cell.clone(),
            expected: short(&hash).to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Appends records to a file of one cell; each goes to the file in one write. The file is locked
/// while it lives.
#[derive(Debug)]
pub struct RecordWriter {
    path: PathBuf,
    file: File,
    cell: String,
    next: u64,
}

impl RecordWriter {
    /// Opens or creates the file of a cell and returns what it holds already; a torn tail is cut
    /// off and reported.
    ///
    /// # Errors
    ///
    /// As [`completeness`]; [`EvalError::Locked`] if another run writes the file. Nothing is
    /// changed on an error.
    pub fn resume(path: &Path, key: &CellKey) -> Result<(Self, RecordFile), EvalError> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(EvalError::io(path, "open"))?;
        file.try_lock().map_err(|error| match error {
            std::fs::TryLockError::WouldBlock => EvalError::Locked { file: path.to_path_buf() },
            std::fs::TryLockError::Error(reason) => {
                EvalError::Io { file: path.to_path_buf(), action: "lock", reason }
            }
        })?;
        let text = read_capped(path, &mut file)?;
        let held = parse_records(path, &text)?;
        check_cell(path, &held, key)?;
        if let Some(torn) = held.torn {
            file.set_len(torn.offset).map_err(EvalError::io(path, "repair"))?;
        }
        file.seek(SeekFrom::End(0)).map_err(EvalError::io(path, "seek"))?;
        let next = held.records.len() as u64;
        let cell = short(&key.hash()).to_owned();
        Ok((Self { path: path.to_path_buf(), file, cell, next }, held))
    }

    /// Appends the next episode's record.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    ///
    /// # Panics
    ///
    /// If the record is not the next episode of this cell.
    pub fn append(&mut self, record: &EpisodeRecord) -> Result<(), EvalError> {
        assert_eq!((record.episode, &record.cell), (self.next, &self.cell), "records come in order");
        let mut line = serde_json::to_vec(record).expect("records are always JSON");
        line.push(b'\n');
        self.file.write_all(&line).map_err(EvalError::io(&self.path, "write"))?;
        self.next += 1;
        Ok(())
    }

    /// Asks the system to put everything on the disk.
    ///
    /// # Errors
    ///
    /// If it cannot.
    pub fn finish(self) -> Result<(), EvalError> {
        self.file.sync_all().map_err(EvalError::io(&self.path, "sync"))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use jostle_peds::CrowdKind;

    use super::*;
    use jostle_arena::driving::DrivingMeter;
    use jostle_arena::identity::PolicyIdentity;
    use jostle_arena::metrics::MetricScale;

    pub(crate) fn key(policy: &str) -> CellKey {
        CellKey {
            protocol_version: 1,
            policy: policy.into(),
            token: 0,
            crowd: CrowdKind::Sf.into(),
            pool: vec![],
            n_agents: 5,
            seed: 0,
            settings: String::new(),
        }
    }

    fn record(episode: u64, key: &CellKey) -> EpisodeRecord {
        let scale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
        let outcome = Outcome::ALL[episode as usize % 4];
        EpisodeRecord {
            episode,
            crowd: key.crowd,
            token: 0,
            outcome,
            steps: 123,
            start: [0.1, -9.87],
            goal: [1.0 / 3.0, 5.0],
            metrics: EpisodeMetrics::from_totals(&scale, outcome, 123, 11.3 / 0.9, 10.0),
            driving: (episode != 1).then(|| DrivingMeter::new(0.1).driving()),
            cell: short(&key.hash()).to_owned(),
            provenance: PolicyIdentity::custom("test", "1").reference(),
        }
    }

    #[test]
    fn records_survive_the_file_and_a_torn_tail_is_said_and_repaired() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cell.ndjson");
        let key = key("p");
        assert_eq!(completeness(&path, &key, 2).unwrap(), Completeness::Missing);
        let (mut writer, held) = RecordWriter::resume(&path, &key).unwrap();
        assert!(held.records.is_empty() && held.torn.is_none());
        let records: Vec<_> = (0..3).map(|k| record(k, &key)).collect();
        for record in &records[..2] {
            writer.append(record).unwrap();
        }
        assert!(matches!(RecordWriter::resume(&path, &key), Err(EvalError::Locked { .. })));
        writer.finish().unwrap();
        assert_eq!(read_records(&path).unwrap().records, records[..2]);
        assert_eq!(completeness(&path, &key, 2).unwrap(), Completeness::Complete);

        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 7]).unwrap();
        assert_eq!(completeness(&path, &key, 2).unwrap(), Completeness::Partial { episodes: 1 });
        let (mut writer, held) = RecordWriter::resume(&path, &key).unwrap();
        assert_eq!((held.records.len(), held.torn.is_some()), (1, true));
        for record in &records[1..] {
            writer.append(record).unwrap();
        }
        writer.finish().unwrap();
        assert_eq!(read_records(&path).unwrap(), RecordFile { records, torn: None });
    }

    #[test]
    fn foreign_and_broken_files_are_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cell.ndjson");
        let line = |k| serde_json::to_string(&record(k, &key("p"))).unwrap() + "\n";
        let check = |text: String, message: &str| {
            std::fs::write(&path, &text).unwrap();
            let error = RecordWriter::resume(&path, &key("p")).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        };
        check(line(0) + "{}\n", "line 2: missing field");
        check(line(0) + "no JSON\n" + &line(1), "line 2");
        check(line(1), "line 1: found episode 1, expected 0");
        check(serde_json::to_string(&record(0, &key("q"))).unwrap() + "\n", "holds cell");
        assert!(matches!(completeness(&path, &key("p"), 1), Err(EvalError::OtherCell { .. })));
        let missing = folder.path().join("none").join("cell.ndjson");
        assert!(matches!(RecordWriter::resume(&missing, &key("p")), Err(EvalError::Io { .. })));
    }
}
