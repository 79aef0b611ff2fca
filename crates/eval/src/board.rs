//! Entries of a leaderboard: one robot on every scene of a suite among every crowd, small enough
//! for a repository, with what it takes to run it again to the bit.
//!
//! Reading order: [`Board`] (scenes, crowds, episodes), [`Entrant`] (who is tested),
//! [`Board::run`], [`BoardEntry`] (what is kept), [`BoardEntry::check`] and
//! [`BoardEntry::difference`] (whether it is what it says).
//!
//! Episodes themselves are not kept: a cell has their counts and the hash of their small form
//! ([`crate::compact`]), so that a run again either has the same bits or is found out.

use std::path::Path;

use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_arena::identity::{PolicyIdentity, hex_sha256, short};
use jostle_arena::robot::Robot;
use jostle_arena::room::{RoomPlan, metric_scale};
use jostle_arena::{ArenaError, Outcome};
use jostle_peds::{CrowdKind, CrowdName};
use jostle_policy::excerpt;
use jostle_sim::SimConfig;
use serde::{Deserialize, Serialize};

use crate::compact::CompactCell;
use crate::driving::{Driven, DrivingSummary};
use crate::error::EvalError;
use crate::protocol::{Protocol, Subject};
use crate::records::EpisodeRecord;
use crate::report::SuiteScore;
use crate::statistics::{Interval, half_width_of_mean, wilson};
use crate::suite::Suite;

/// The format's name in an entry's file.
pub const FORMAT: &str = "jostle-board-1";
/// Largest file of an entry that is read, in bytes.
const FILE_MAX: u64 = 1 << 20;
/// Most characters of an entry's name.
const NAME_MAX: usize = 60;

/// The sort of robot that an entry is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EntryKind {
    /// A policy that was trained.
    Learned,
    /// A planner of the observation row.
    Planner,
    /// A planner that reads everyone's true position and velocity.
    KnowsPositions,
    /// A robot of the user's own, which this program cannot make.
    Own,
}

impl EntryKind {
    /// The words of tables and pages.
    pub fn label(self) -> &'static str {
        match self {
            Self::Learned => "learned",
            Self::Planner => "planner",
            Self::KnowsPositions => "planner, knows positions",
            Self::Own => "own",
        }
    }
}

/// A robot that is to be entered.
#[derive(Clone, Debug)]
pub struct Entrant {
    /// Its name on the board, and that of its file.
    pub name: String,
    /// Its sort.
    pub kind: EntryKind,
    /// A line about it.
    pub about: String,
    /// The line that runs it again.
    pub command: String,
    /// Its identity.
    pub policy: PolicyIdentity,
    /// Its behaviour token; 0 for robots without.
    pub token: u32,
    /// The world that it drives in; room and number of agents are the scenes'.
    pub sim: SimConfig,
}

/// Makes an entrant's robot for the rooms of a plan.
pub type MakeRobot<'f> = &'f mut dyn FnMut(&RoomPlan) -> Result<Box<dyn Robot>, ArenaError>;

/// Scenes, crowds and episodes that every entry is run on.
#[derive(Clone, Debug)]
pub struct Board {
    /// The scenes.
    pub suite: Suite,
    /// The crowds of every scene.
    pub crowds: Vec<CrowdKind>,
    /// Episodes of a cell: a scene among a crowd.
    pub episodes: u64,
    /// Root seed of the episodes.
    pub seed: u64,
    /// Policies that drive learned pedestrians.
    pub pools: Pools,
}

/// A scene among a crowd.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardCell {
    /// The scene.
    pub scene: String,
    /// The crowd.
    pub crowd: CrowdName,
    /// One robot and `n_agents` − 1 pedestrians.
    pub n_agents: usize,
    /// Episodes that reached the goal.
    pub success: u64,
    /// Episodes that hit a wall.
    pub collision_wall: u64,
    /// Episodes that hit a pedestrian.
    pub collision_pedestrian: u64,
    /// Episodes that ran out of time.
    pub timeout: u64,
    /// Hash of all that its episodes depend on ([`crate::cell::CellKey::hash`]).
    pub cell: String,
    /// SHA-256 of its episodes as lines of [`crate::compact`].
    pub episodes_sha256: String,
}

/// One robot on the board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardEntry {
    /// [`FORMAT`].
    pub format: String,
    /// Its name on the board, and that of its file.
    pub name: String,
    /// Its sort.
    pub kind: EntryKind,
    /// A line about it.
    pub about: String,
    /// The line that runs it again.
    pub command: String,
    /// Its identity.
    pub policy: PolicyIdentity,
    /// Its behaviour token.
    pub token: u32,
    /// The suite.
    pub suite: String,
    /// Root seed of the episodes.
    pub seed: u64,
    /// Episodes of a cell.
    pub episodes: u64,
    /// Success in one number, and in two that look at the worst.
    pub score: SuiteScore,
    /// Measures of driving, all episodes together.
    pub driving: DrivingSummary,
    /// The cells: scene by scene, the crowds of each in the same order.
    pub cells: Vec<BoardCell>,
}

impl Board {
    /// The protocol of each scene for robots of a world.
    ///
    /// # Errors
    ///
    /// A world whose robot, episodes or places for starts and goals are not the usual ones, in
    /// which figures could not be compared; what a scene refuses.
    pub fn protocols(&self, sim: &SimConfig) -> Result<Vec<Protocol>, EvalError> {
        let usual = SimConfig::default();
        let refuse = |field, found: String, expected: String| {
            Err(EvalError::Setting { field, found, expected: format!("{expected}, as every entry has") })
        };
        if sim.robot != usual.robot {
            return refuse("sim.robot", format!("{:?}", sim.robot), format!("{:?}", usual.robot));
        }
        if sim.episode != usual.episode {
            return refuse("sim.episode", format!("{:?}", sim.episode), format!("{:?}", usual.episode));
        }
        if sim.spawn != usual.spawn {
            return refuse("sim.spawn", format!("{:?}", sim.spawn), format!("{:?}", usual.spawn));
        }
        let base = ArenaConfig { sim: sim.clone(), seed: self.seed, ..ArenaConfig::default() };
        let scenes = self.suite.scenes.iter();
        scenes.map(|scene| Protocol::new(scene.config(&base)?, self.pools.clone())).collect()
    }

    /// Scene, crowd and hash of every cell of an entrant, in the order of an entry's cells.
    ///
    /// # Errors
    ///
    /// As [`Self::protocols`].
    pub fn keys(
        &self,
        policy: &PolicyIdentity,
        token: u32,
        sim: &SimConfig,
    ) -> Result<Vec<(String, CrowdName, String)>, EvalError> {
        let protocols = self.protocols(sim)?;
        let subject = Subject { identity: policy, token };
        let keys = self.suite.scenes.iter().zip(&protocols).flat_map(|(scene, protocol)| {
            let key = move |crowd: &CrowdKind| {
                (scene.name.clone(), (*crowd).into(), protocol.key(subject, *crowd).hash())
            };
            self.crowds.iter().map(key)
        });
        Ok(keys.collect())
    }

    /// Runs an entrant on every scene among every crowd. `robot` makes it for the rooms of a plan;
    /// `progress` hears scene, crowd and episodes done, and is for display only.
    ///
    /// # Errors
    ///
    /// A name that is no file's; as [`Self::protocols`]; what a crowd, a room or the robot refuses,
    /// before the first episode where that can be told.
    pub fn run(
        &self,
        entrant: &Entrant,
        robot: MakeRobot<'_>,
        progress: &mut dyn FnMut(&str, CrowdKind, u64),
    ) -> Result<BoardEntry, EvalError> {
        check_name(&entrant.name).map_err(|(found, expected)| EvalError::Setting {
            field: "name",
            found,
            expected,
        })?;
        let protocols = self.protocols(&entrant.sim)?;
        for protocol in &protocols {
            for &crowd in &self.crowds {
                let plan = RoomPlan::new(protocol.config(), crowd)?;
                protocol.crowd(&plan)?;
                robot(&plan)?;
            }
        }
        let subject = Subject { identity: &entrant.policy, token: entrant.token };
        let (mut cells, mut all) = (Vec::new(), Vec::new());
        for (scene, protocol) in self.suite.scenes.iter().zip(&protocols) {
            for &crowd in &self.crowds {
                let mut driver = robot(&RoomPlan::new(protocol.config(), crowd)?)?;
                let told = |done| progress(&scene.name, crowd, done);
                let run = protocol.evaluate(&mut *driver, subject, crowd, self.episodes, None, told)?;
                cells.push(cell(&scene.name, protocol, subject, crowd, &run.records));
                all.extend(run.records);
            }
        }
        let driven = all.iter().map(|record| Driven {
            outcome: record.outcome,
            metrics: &record.metrics,
            driving: record.driving.as_ref(),
        });
        let scale = metric_scale(&ArenaConfig { sim: entrant.sim.clone(), ..ArenaConfig::default() });
        let driving = DrivingSummary::new(&scale, driven);
        let refuse = |found: &str| EvalError::Setting {
            field: "board",
            found: found.to_owned(),
            expected: "at least one scene and one crowd".to_owned(),
        };
        Ok(BoardEntry {
            format: FORMAT.to_owned(),
            name: entrant.name.clone(),
            kind: entrant.kind,
            about: entrant.about.clone(),
            command: entrant.command.clone(),
            policy: entrant.policy.clone(),
            token: entrant.token,
            suite: self.suite.name.clone(),
            seed: self.seed,
            episodes: self.episodes,
            score: score(&cells).ok_or_else(|| refuse("none"))?,
            driving,
            cells,
        })
    }
}

fn cell(
    scene: &str,
    protocol: &Protocol,
    subject: Subject<'_>,
    crowd: CrowdKind,
    records: &[EpisodeRecord],
) -> BoardCell {
    let count = |outcome| records.iter().filter(|record| record.outcome == outcome).count() as u64;
    let key = protocol.key(subject, crowd);
    let hash = key.hash();
    let scale = metric_scale(protocol.config());
    let text = CompactCell::new(key, subject.identity.clone(), scale, records).text();
    // Without the first line, which has the policy's name.
    let lines = text.split_once('\n').map_or("", |(_, lines)| lines);
    BoardCell {
        scene: scene.to_owned(),
        crowd: crowd.into(),
        n_agents: protocol.config().n_agents,
        success: count(Outcome::Success),
        collision_wall: count(Outcome::CollisionWall),
        collision_pedestrian: count(Outcome::CollisionPedestrian),
        timeout: count(Outcome::Timeout),
        cell: hash,
        episodes_sha256: hex_sha256(lines.as_bytes()),
    }
}

fn score(cells: &[BoardCell]) -> Option<SuiteScore> {
    SuiteScore::new(cells.iter().map(|cell| (cell.scene.as_str(), cell.crowd, cell.success_rate())))
}

/// A name that can be a file's on any system.
fn check_name(name: &str) -> Result<(), (String, String)> {
    let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_' || c == '.';
    if (1..=NAME_MAX).contains(&name.len()) && name.chars().all(fits) && !name.starts_with('.') {
        return Ok(());
    }
    let found = format!("{:?}", name.chars().take(NAME_MAX).collect::<String>());
    Err((found, format!("1 to {NAME_MAX} letters, digits, dots, hyphens and underscores, no dot first")))
}

impl BoardCell {
    /// Share of its episodes that reached the goal.
    pub fn success_rate(&self) -> f64 {
        self.success as f64 / self.episodes().max(1) as f64
    }

    /// All of its episodes.
    pub fn episodes(&self) -> u64 {
        self.success + self.collision_wall + self.collision_pedestrian + self.timeout
    }
}

impl BoardEntry {
    /// Mean success rate of the cells that are chosen; `None` where none is.
    pub fn mean(&self, chosen: impl Fn(&BoardCell) -> bool) -> Option<f64> {
        let rates: Vec<f64> =
            self.cells.iter().filter(|cell| chosen(cell)).map(BoardCell::success_rate).collect();
        (!rates.is_empty()).then(|| rates.iter().sum::<f64>() / rates.len() as f64)
    }

    /// Share of all episodes with an outcome.
    pub fn share(&self, outcome: Outcome) -> f64 {
        let count = |cell: &BoardCell| match outcome {
            Outcome::Success => cell.success,
            Outcome::CollisionWall => cell.collision_wall,
            Outcome::CollisionPedestrian => cell.collision_pedestrian,
            Outcome::Timeout => cell.timeout,
        };
        let (found, all): (u64, u64) =
            self.cells.iter().fold((0, 0), |(found, all), cell| (found + count(cell), all + cell.episodes()));
        found as f64 / all.max(1) as f64
    }

    /// 95 % interval of the mean score: that of a mean of independent rates, by the normal
    /// distribution, with the variance of each from its Wilson interval.
    pub fn mean_interval(&self) -> Interval {
        let certain = Interval { low: 0.0, high: 0.0 };
        let of_cell = |cell: &BoardCell| wilson(cell.success, cell.episodes()).unwrap_or(certain);
        let half = half_width_of_mean(&self.cells.iter().map(of_cell).collect::<Vec<_>>());
        Interval { low: (self.score.mean - half).max(0.0), high: (self.score.mean + half).min(1.0) }
    }

    /// The scenes in their order.
    pub fn scenes(&self) -> Vec<&str> {
        let mut scenes: Vec<&str> = Vec::new();
        for cell in &self.cells {
            if scenes.last() != Some(&cell.scene.as_str()) {
                scenes.push(&cell.scene);
            }
        }
        scenes
    }

    /// The crowds in their order: those of the first scene.
    pub fn crowds(&self) -> Vec<CrowdName> {
        let first = self.cells.first().map(|cell| cell.scene.as_str());
        let cells = self.cells.iter().take_while(|cell| Some(cell.scene.as_str()) == first);
        cells.map(|cell| cell.crowd).collect()
    }

    /// The file's text.
    pub fn text(&self) -> String {
        serde_json::to_string_pretty(self).expect("an entry is always JSON") + "\n"
    }

    /// Reads a file.
    ///
    /// # Errors
    ///
    /// [`EvalError::Io`] if it cannot be read, [`EvalError::Board`] if it is no entry, or one that
    /// contradicts itself ([`Self::check`]).
    pub fn read(path: &Path) -> Result<Self, EvalError> {
        let refuse = |problem: String| EvalError::Board { file: path.to_path_buf(), problem };
        let about = std::fs::metadata(path).map_err(EvalError::io(path, "read"))?;
        if !about.is_file() || about.len() > FILE_MAX {
            return Err(refuse(format!("{} bytes, expected a file of at most {FILE_MAX}", about.len())));
        }
        let text = std::fs::read_to_string(path).map_err(EvalError::io(path, "read"))?;
        let entry: Self = serde_json::from_str(&text).map_err(|error| refuse(excerpt(&error.to_string())))?;
        entry.check().map_err(refuse)?;
        Ok(entry)
    }

    /// Compares counts, cells and score with one another.
    ///
    /// # Errors
    ///
    /// The first field that does not: what was found, what was expected.
    pub fn check(&self) -> Result<(), String> {
        if self.format != FORMAT {
            return Err(format!("format: found {}, expected {FORMAT}", self.format));
        }
        check_name(&self.name)
            .map_err(|(found, expected)| format!("name: found {found}, expected {expected}"))?;
        let (scenes, crowds) = (self.scenes(), self.crowds());
        let expected: Vec<(&str, CrowdName)> =
            scenes.iter().flat_map(|scene| crowds.iter().map(move |crowd| (*scene, *crowd))).collect();
        let found: Vec<(&str, CrowdName)> =
            self.cells.iter().map(|cell| (cell.scene.as_str(), cell.crowd)).collect();
        if found != expected || found.is_empty() {
            return Err("cells: found some missing, twice or out of order, expected every scene among the same crowds".to_owned());
        }
        for cell in &self.cells {
            let place = format!("cell {}, {}", cell.scene, cell.crowd);
            if cell.episodes() != self.episodes {
                return Err(format!(
                    "{place}: found {} episodes in its counts, expected {}",
                    cell.episodes(),
                    self.episodes
                ));
            }
            for hash in [&cell.cell, &cell.episodes_sha256] {
                if hash.len() != 64 || !hash.bytes().all(|b| b.is_ascii_hexdigit()) {
                    return Err(format!(
                        "{place}: found {:?}, expected a SHA-256 in hexadecimal",
                        excerpt(hash)
                    ));
                }
            }
        }
        let expected = score(&self.cells).ok_or("cells: found none, expected at least one")?;
        if self.score != expected {
            return Err(format!("score: found {:?}, expected {expected:?}, as the cells say", self.score));
        }
        Ok(())
    }

    /// The first way in which another run of the same entrant is not this one, said of the other;
    /// `None` where all bits are the same.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differs = |what: &str, found: &dyn std::fmt::Display, expected: &dyn std::fmt::Display| {
            Some(format!("{what}: found {found}, expected {expected}, as stored"))
        };
        if self.policy.sha256 != other.policy.sha256 {
            return differs("policy", &short(&other.policy.sha256), &short(&self.policy.sha256));
        }
        if (self.token, self.seed, self.episodes) != (other.token, other.seed, other.episodes) {
            let said = |entry: &Self| {
                format!("z = {}, seed {}, {} episodes", entry.token, entry.seed, entry.episodes)
            };
            return differs("run", &said(other), &said(self));
        }
        if self.cells.len() != other.cells.len() {
            return differs("cells", &other.cells.len(), &self.cells.len());
        }
        let (old, new) = self.cells.iter().zip(&other.cells).find(|(old, new)| old != new)?;
        let place = format!("{}, {}", old.scene, old.crowd);
        if old.cell != new.cell {
            let what = format!("{place}: settings, scene or pedestrians' policies");
            return differs(&what, &short(&new.cell), &short(&old.cell));
        }
        let said =
            |cell: &BoardCell| format!("{} successes ({})", cell.success, short(&cell.episodes_sha256));
        differs(&place, &said(new), &said(old))
    }
}

#[cfg(test)]
mod tests {
    use jostle_arena::robot::PerRow;

    use super::*;

    const SUITE: &str = "name = \"two\"\n[[scene]]\nname = \"a\"\nabout = \"two walk\"\nagents = 3\n[[scene]]\nname = \"b\"\nabout = \"one walks\"\nagents = 2\n";

    fn board() -> Board {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two.toml");
        std::fs::write(&path, SUITE).unwrap();
        let crowds = vec![CrowdKind::Vo, CrowdKind::Straight];
        Board { suite: Suite::read(&path).unwrap(), crowds, episodes: 6, seed: 3, pools: Pools::default() }
    }

    fn entrant(name: &str) -> Entrant {
        Entrant {
            name: name.to_owned(),
            kind: EntryKind::Own,
            about: "turns to its goal".to_owned(),
            command: "cargo run --example seek".to_owned(),
            policy: PolicyIdentity::custom("seek", "1"),
            token: 0,
            sim: SimConfig::default(),
        }
    }

    /// Towards the goal, at a speed.
    fn run(board: &Board, entrant: &Entrant, speed: f32) -> Result<BoardEntry, EvalError> {
        let seek = move |row: &[f32]| {
            let turn = row[row.len() - 3].atan2(row[row.len() - 4]);
            [speed * turn.cos().max(0.0), turn.clamp(-1.0, 1.0)]
        };
        board.run(entrant, &mut |_| Ok(Box::new(PerRow::new(seek))), &mut |_, _, _| ())
    }

    #[test]
    fn an_entry_is_read_back_and_runs_again_to_the_bit() {
        let (board, entrant) = (board(), entrant("seek"));
        let entry = run(&board, &entrant, 1.0).unwrap();
        entry.check().unwrap();
        assert_eq!((entry.scenes(), entry.cells.len(), entry.cells[0].n_agents), (vec!["a", "b"], 4, 3));
        assert_eq!(entry.crowds(), [CrowdKind::Vo, CrowdKind::Straight].map(CrowdName::from));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("seek.json");
        std::fs::write(&path, entry.text()).unwrap();
        assert_eq!(BoardEntry::read(&path).unwrap(), entry);
        assert_eq!(entry.difference(&run(&board, &entrant, 1.0).unwrap()), None);
        let keys = board.keys(&entrant.policy, 0, &entrant.sim).unwrap();
        let found: Vec<_> = entry.cells.iter().map(|c| (c.scene.clone(), c.crowd, c.cell.clone())).collect();
        assert_eq!(found, keys);
    }

    #[test]
    fn another_run_is_named_by_what_differs() {
        let (board, entrant) = (board(), entrant("seek"));
        let entry = run(&board, &entrant, 1.0).unwrap();
        let slower = run(&board, &entrant, 0.999).unwrap();
        let message = entry.difference(&slower).unwrap();
        assert!(message.starts_with("a, VO: found ") && message.contains(" successes ("), "{message}");
        let other = Board { seed: 4, ..board.clone() };
        let message = entry.difference(&run(&other, &entrant, 1.0).unwrap()).unwrap();
        assert_eq!(
            message,
            "run: found z = 0, seed 4, 6 episodes, expected z = 0, seed 3, 6 episodes, as stored"
        );
        let mut stranger = entrant.clone();
        stranger.policy = PolicyIdentity::custom("seek", "2");
        assert!(entry.difference(&run(&board, &stranger, 1.0).unwrap()).unwrap().starts_with("policy: "));
        // A reward is no part of a test, but of its key.
        let mut paid = entrant.clone();
        paid.sim.reward.goal += 1.0;
        let message = entry.difference(&run(&board, &paid, 1.0).unwrap()).unwrap();
        assert!(message.starts_with("a, VO: settings, scene or"), "{message}");
    }

    #[test]
    fn an_entry_that_contradicts_itself_is_refused() {
        let entry = run(&board(), &entrant("seek"), 1.0).unwrap();
        let check = |change: &dyn Fn(&mut BoardEntry), part: &str| {
            let mut changed = entry.clone();
            change(&mut changed);
            let message = changed.check().unwrap_err();
            assert!(message.contains(part), "{message}");
        };
        check(&|e| e.cells[1].success += 1, "cell a, straight: found 7 episodes in its counts, expected 6");
        check(&|e| e.score.mean += 1e-9, "score: found");
        check(&|e| e.cells[2].cell = "x".to_owned(), "cell b, VO: found \"x\", expected a SHA-256");
        check(&|e| e.cells.swap(0, 1), "cells: found some");
        check(&|e| e.cells.clear(), "cells: found some");
        check(&|e| e.name = "../x".to_owned(), "name: found \"../x\", expected 1 to 60 letters");
        check(&|e| e.format = "jostle-board-9".to_owned(), "format: found jostle-board-9");
    }

    #[test]
    fn another_world_is_refused_before_the_first_episode() {
        let mut fast = entrant("fast");
        fast.sim.robot.v_max = 2.0;
        let message = run(&board(), &fast, 1.0).unwrap_err().to_string();
        assert!(
            message.starts_with("sim.robot: found") && message.ends_with("as every entry has"),
            "{message}"
        );
        let board = Board { crowds: vec![CrowdKind::Nh], ..board() };
        assert!(run(&board, &entrant("seek"), 1.0).unwrap_err().to_string().contains("needs a pool"));
    }

    /// Two cells, 9 and 5 of ten.
    #[test]
    fn scores_by_hand() {
        let mut entry = run(&board(), &entrant("seek"), 1.0).unwrap();
        entry.episodes = 10;
        entry.cells.truncate(2);
        for (cell, success) in entry.cells.iter_mut().zip([9, 5]) {
            (cell.success, cell.timeout) = (success, 10 - success);
            (cell.collision_wall, cell.collision_pedestrian) = (0, 0);
        }
        entry.score = score(&entry.cells).unwrap();
        entry.check().unwrap();
        assert!(
            (entry.score.mean - 0.7).abs() < 1e-12 && (entry.share(Outcome::Timeout) - 0.3).abs() < 1e-12
        );
        assert_eq!(entry.score.worst.success_rate, 0.5);
        assert_eq!(entry.mean(|cell| cell.crowd == CrowdKind::Vo), Some(0.9));
        assert_eq!(entry.mean(|cell| cell.scene == "b"), None);
        let ends = entry.mean_interval();
        let width = |success| {
            let ends = wilson(success, 10).unwrap();
            (ends.high - ends.low) / 2.0
        };
        let half = (width(9).powi(2) + width(5).powi(2)).sqrt() / 2.0;
        assert!((ends.low - (0.7 - half)).abs() < 1e-12 && (ends.high - (0.7 + half)).abs() < 1e-12);
    }
}
