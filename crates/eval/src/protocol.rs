//! The test protocol: a policy in a crowd over the paired episodes, with records that are reused
//! and continued.
//!
//! Reading order: [`Protocol::evaluate`]; [`jostle_arena::lock_step`] runs the episodes,
//! [`jostle_arena::room`] one of them.

use std::path::Path;

use jostle_peds::{Crowd, CrowdKind, CrowdName};
use jostle_sim::maps;

use crate::cell::{CellKey, PROTOCOL_VERSION};
use crate::error::EvalError;
use crate::records::{EpisodeRecord, RecordWriter, TornTail};
use crate::report::CellResult;
use jostle_arena::ArenaError;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::{Pools, make_crowd};
use jostle_arena::identity::{PolicyIdentity, hex_sha256, short};
use jostle_arena::lock_step::run_episodes;
use jostle_arena::robot::Robot;
use jostle_arena::room::{FinishedEpisode, RoomPlan, metric_scale};

/// The robot that is tested, with its token.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The policy's identity.
    pub identity: &'a PolicyIdentity,
    /// The behaviour token that the robot's policy was made with; 0 for policies without.
    pub token: u32,
}

/// A cell that was run, or read, or both.
#[derive(Clone, Debug)]
pub struct CellRun {
    /// Its result.
    pub result: CellResult,
    /// The records of the episodes asked for.
    pub records: Vec<EpisodeRecord>,
    /// Number of those that were in the file already.
    pub reused: u64,
    /// Half a line that was cut off the file's end; to be told to the user.
    pub repaired: Option<TornTail>,
}

/// Settings and pools of a test.
#[derive(Clone, Debug)]
pub struct Protocol {
    config: ArenaConfig,
    pools: Pools,
    /// Hash of the map's content, if there is a map.
    map_sha256: Option<String>,
}

impl Protocol {
    /// A protocol of valid settings.
    ///
    /// # Errors
    ///
    /// The first setting out of its range; a map that cannot be read.
    pub fn new(config: ArenaConfig, pools: Pools) -> Result<Self, EvalError> {
        config.validate()?;
        let map_sha256 = config.sim.room.map_file().map(|map| maps::sha256(&map)).transpose()?;
        Ok(Self { config, pools, map_sha256 })
    }

    /// The settings.
    pub fn config(&self) -> &ArenaConfig {
        &self.config
    }

    /// The pools.
    pub fn pools(&self) -> &Pools {
        &self.pools
    }

    /// The key of a cell.
    pub fn key(&self, subject: Subject<'_>, crowd: impl Into<CrowdName>) -> CellKey {
        let crowd = crowd.into();
        let n_pedestrians = self.config.n_pedestrians();
        let pool = crowd.built_in().map_or(&[][..], |kind| self.pools.drivers(kind, n_pedestrians));
        CellKey {
            protocol_version: PROTOCOL_VERSION,
            policy: subject.identity.sha256.clone(),
            token: subject.token,
            crowd,
            pool: pool.iter().map(|policy| policy.identity.sha256.clone()).collect(),
            n_agents: self.config.n_agents,
            seed: self.config.seed,
            settings: self.config.settings_hash(self.map_sha256.as_deref()),
        }
    }

    /// The built-in crowd of a plan, ready for [`run_episodes`].
    ///
    /// # Errors
    ///
    /// As [`make_crowd`]; [`ArenaError::OwnCrowd`] for a crowd of one's own, which only its owner
    /// can make.
    pub fn crowd(&self, plan: &RoomPlan) -> Result<Box<dyn Crowd>, ArenaError> {
        let kind = plan.crowd.built_in().ok_or(ArenaError::OwnCrowd { crowd: plan.crowd })?;
        make_crowd(&self.config, kind, &self.pools, &plan.scenario.boundary())
    }

    /// The key of a cell with a crowd of one's own: its visibility, its sensing and its version are
    /// part of the settings.
    pub fn key_among(&self, subject: Subject<'_>, crowd: &dyn Crowd) -> CellKey {
        let key = self.key(subject, crowd.name());
        let own = (&key.settings, crowd.visibility(), crowd.senses_by_laser(), crowd.version());
        let text = serde_json::to_vec(&own).expect("texts and flags are always JSON");
        CellKey { settings: hex_sha256(&text), ..key }
    }

    /// Tests a policy in a built-in crowd over the first `episodes` episodes.
    ///
    /// With a file, records that it holds are reused, and new ones are appended as soon as they are
    /// known, so that an interrupted test goes on where it stopped. `progress` hears the number of
    /// episodes done, and is for display alone.
    ///
    /// # Errors
    ///
    /// No episode asked for; what the crowd, a room or the file refuses.
    pub fn evaluate(
        &self,
        robot: &mut dyn Robot,
        subject: Subject<'_>,
        crowd: CrowdKind,
        episodes: u64,
        file: Option<&Path>,
        progress: impl FnMut(u64),
    ) -> Result<CellRun, EvalError> {
        let plan = RoomPlan::new(&self.config, crowd)?;
        let (mut crowd, key) = (self.crowd(&plan)?, self.key(subject, crowd));
        self.run(
            Cell { plan: &plan, crowd: &mut *crowd, key: &key, subject, file },
            robot,
            episodes,
            progress,
        )
    }

    /// As [`Self::evaluate`], in a crowd of one's own.
    ///
    /// # Errors
    ///
    /// As [`Self::evaluate`]; a crowd with a built-in one's name, whose records would be taken for
    /// its own.
    pub fn evaluate_among(
        &self,
        robot: &mut dyn Robot,
        subject: Subject<'_>,
        crowd: &mut dyn Crowd,
        episodes: u64,
        file: Option<&Path>,
        progress: impl FnMut(u64),
    ) -> Result<CellRun, EvalError> {
        if crowd.name().built_in().is_some() {
            let expected = "a name of its own (see `CrowdName::new`)".to_owned();
            return Err(EvalError::Setting { field: "crowd", found: crowd.name().to_string(), expected });
        }
        let plan = RoomPlan::among(&self.config, crowd)?;
        let key = self.key_among(subject, crowd);
        self.run(Cell { plan: &plan, crowd, key: &key, subject, file }, robot, episodes, progress)
    }

    fn run(
        &self,
        cell: Cell<'_>,
        robot: &mut dyn Robot,
        episodes: u64,
        mut progress: impl FnMut(u64),
    ) -> Result<CellRun, EvalError> {
        if episodes == 0 {
            let expected = "at least 1".to_owned();
            return Err(EvalError::Setting { field: "episodes", found: "0".to_owned(), expected });
        }
        let Cell { plan, crowd, key, subject, file } = cell;
        let (name, hash) = (plan.crowd, key.hash());
        let opened = file.map(|path| RecordWriter::resume(path, key)).transpose()?;
        let (mut writer, held) = opened.map_or((None, None), |(writer, held)| (Some(writer), Some(held)));
        let repaired = held.as_ref().and_then(|held| held.torn);
        let mut records = held.map_or_else(Vec::new, |held| held.records);
        records.truncate(usize::try_from(episodes).unwrap_or(usize::MAX));
        let reused = records.len() as u64;
        progress(reused);
        run_episodes::<EvalError>(plan, robot, crowd, reused..episodes, |finished| {
            let record = record(&finished, subject, name, &hash);
            if let Some(writer) = &mut writer {
                writer.append(&record)?;
            }
            records.push(record);
            progress(records.len() as u64);
            Ok(())
        })?;
        writer.map_or(Ok(()), RecordWriter::finish)?;
        let n_pedestrians = self.config.n_pedestrians();
        let pool = name.built_in().and_then(|kind| self.pools.note(kind, n_pedestrians));
        let result = CellResult::new(name, hash, &metric_scale(&self.config), &records, pool);
        Ok(CellRun { result, records, reused, repaired })
    }
}

/// A cell that is about to be run.
struct Cell<'a> {
    plan: &'a RoomPlan,
    crowd: &'a mut dyn Crowd,
    key: &'a CellKey,
    subject: Subject<'a>,
    file: Option<&'a Path>,
}

fn record(finished: &FinishedEpisode, subject: Subject<'_>, crowd: CrowdName, hash: &str) -> EpisodeRecord {
    EpisodeRecord {
        episode: finished.episode,
        crowd,
        token: subject.token,
        outcome: finished.outcome,
        steps: finished.steps,
        start: finished.start,
        goal: finished.goal,
        metrics: finished.metrics,
        driving: Some(finished.driving),
        cell: short(hash).to_owned(),
        provenance: subject.identity.reference(),
    }
}
