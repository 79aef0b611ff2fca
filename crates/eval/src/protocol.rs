//! The test protocol: a policy in a crowd over the paired episodes, with records that are reused and continued.
//!
//! Reading order: [`Protocol::evaluate`]; [`crate::lock_step`] runs the episodes, [`crate::room`] one of them.

use std::path::Path;

use jostle_peds::{Crowd, CrowdKind};

use crate::cell::{CellKey, PROTOCOL_VERSION};
use crate::config::EvalConfig;
use crate::crowds::{Pools, make_crowd};
use crate::error::EvalError;
use crate::identity::{PolicyIdentity, short};
use crate::lock_step::run_episodes;
use crate::records::{EpisodeRecord, RecordWriter, TornTail};
use crate::report::CellResult;
use crate::robot::RobotPolicy;
use crate::room::{FinishedEpisode, RoomPlan, metric_scale};
use crate::site::polygons;

/// Who is tested, and with which token.
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
    /// How many of them stood in the file already.
    pub reused: u64,
    /// Half a line that was cut off the file's end; to be told to the user.
    pub repaired: Option<TornTail>,
}

/// Settings and pools of a test.
#[derive(Clone, Debug)]
pub struct Protocol {
    config: EvalConfig,
    pools: Pools,
}

impl Protocol {
    /// A protocol of valid settings.
    ///
    /// # Errors
    ///
    /// The first setting out of its range.
    pub fn new(config: EvalConfig, pools: Pools) -> Result<Self, EvalError> {
        config.validate()?;
        Ok(Self { config, pools })
    }

    /// The settings.
    pub fn config(&self) -> &EvalConfig {
        &self.config
    }

    /// The pools.
    pub fn pools(&self) -> &Pools {
        &self.pools
    }

    /// The key of a cell.
    pub fn key(&self, subject: Subject<'_>, crowd: CrowdKind) -> CellKey {
        let pool = self.pools.of(crowd, self.config.n_pedestrians());
        CellKey {
            protocol_version: PROTOCOL_VERSION,
            policy: subject.identity.sha256.clone(),
            token: subject.token,
            crowd,
            pool: pool.iter().map(|policy| policy.identity.sha256.clone()).collect(),
            n_agents: self.config.n_agents,
            seed: self.config.seed,
            settings: self.config.settings_hash(),
        }
    }

    /// A crowd of the kind, ready for [`run_episodes`].
    ///
    /// # Errors
    ///
    /// As [`make_crowd`].
    pub fn crowd(&self, plan: &RoomPlan) -> Result<Box<dyn Crowd>, EvalError> {
        make_crowd(&self.config, plan.crowd, &self.pools, &polygons(&plan.scenario))
    }

    /// Tests a policy in a crowd over the first `episodes` episodes.
    ///
    /// With a file, records that it holds are reused, and new ones are appended as soon as they are known, so that an
    /// interrupted test goes on where it stopped. `progress` hears the number of episodes done, and is for display alone.
    ///
    /// # Errors
    ///
    /// No episode asked for; what the crowd, a room or the file refuses.
    pub fn evaluate(
        &self,
        robot: &mut dyn RobotPolicy,
        subject: Subject<'_>,
        crowd: CrowdKind,
        episodes: u64,
        file: Option<&Path>,
        mut progress: impl FnMut(u64),
    ) -> Result<CellRun, EvalError> {
        if episodes == 0 {
            let expected = "at least 1".to_owned();
            return Err(EvalError::Setting { field: "episodes", found: "0".to_owned(), expected });
        }
        let plan = RoomPlan::new(&self.config, crowd)?;
        let mut pedestrians = self.crowd(&plan)?;
        let key = self.key(subject, crowd);
        let hash = key.hash();
        let opened = file.map(|path| RecordWriter::resume(path, &key)).transpose()?;
        let (mut writer, held) = opened.map_or((None, None), |(writer, held)| (Some(writer), Some(held)));
        let repaired = held.as_ref().and_then(|held| held.torn);
        let mut records = held.map_or_else(Vec::new, |held| held.records);
        records.truncate(usize::try_from(episodes).unwrap_or(usize::MAX));
        let reused = records.len() as u64;
        progress(reused);
        run_episodes(&plan, robot, &mut *pedestrians, reused..episodes, |finished| {
            let record = record(&finished, subject, crowd, &hash);
            if let Some(writer) = &mut writer {
                writer.append(&record)?;
            }
            records.push(record);
            progress(records.len() as u64);
            Ok(())
        })?;
        writer.map_or(Ok(()), RecordWriter::finish)?;
        let pool = self.pools.note(crowd, self.config.n_pedestrians());
        let result = CellResult::new(crowd, hash, metric_scale(&self.config).v_max, &records, pool);
        Ok(CellRun { result, records, reused, repaired })
    }
}

fn record(finished: &FinishedEpisode, subject: Subject<'_>, crowd: CrowdKind, hash: &str) -> EpisodeRecord {
    EpisodeRecord {
        episode: finished.episode,
        crowd,
        token: subject.token,
        outcome: finished.outcome,
        steps: finished.steps,
        start: finished.start,
        goal: finished.goal,
        metrics: finished.metrics,
        cell: short(hash).to_owned(),
        provenance: subject.identity.reference(),
    }
}
