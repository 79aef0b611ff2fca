//! One driver in one crowd, with progress on standard error and records that are used again.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use jostle_arena::crowds::check_observation;
use jostle_arena::room::RoomPlan;
use jostle_arena::{Driver, Robot};
use jostle_eval::protocol::{CellRun, Protocol, Subject};
use jostle_eval::report::CellTiming;
use jostle_peds::CrowdKind;

use jostle_runs::output::note;
use jostle_runs::progress::Progress;

/// A cell of a table.
pub struct Cell<'a> {
    /// Settings and pools.
    pub protocol: &'a Protocol,
    /// The driver of the robot.
    pub driver: &'a Driver,
    /// The behaviour token that the robot is given.
    pub token: u32,
    /// The crowd.
    pub crowd: CrowdKind,
}

impl Cell<'_> {
    /// Refuses what would stop the cell, before anything is written.
    pub fn check(&self) -> Result<()> {
        if let Some(policy) = self.driver.trained() {
            check_observation(self.protocol.config(), policy)?;
        }
        self.robot()?;
        self.protocol.crowd(&self.plan()?)?;
        Ok(())
    }

    /// Runs the episodes that the folder's records do not hold yet. The timing is `None` where none
    /// was run.
    pub fn run(&self, episodes: u64, records: &Path) -> Result<(CellRun, Option<CellTiming>)> {
        let mut robot = self.robot()?;
        let identity = self.driver.identity();
        let subject = Subject { identity: &identity, token: self.token };
        let file = records.join(self.protocol.key(subject, self.crowd).file_name());
        let label = format!("{}, z = {}, {}", identity.name, self.token, self.crowd);
        let started = Instant::now();
        let mut progress = None;
        let run =
            self.protocol.evaluate(&mut *robot, subject, self.crowd, episodes, Some(&file), |done| {
                progress.get_or_insert_with(|| Progress::new(&label, episodes, done)).set(done, "");
            })?;
        if run.repaired.is_some() {
            note(&format!("{label}: repaired the torn last line of {}", file.display()));
        }
        if run.reused == episodes {
            return Ok((run, None));
        }
        if let Some(progress) = progress {
            let rate = run.result.summary.success_rate.unwrap_or(0.0);
            progress.finish(&format!("success {rate:.2}"));
        }
        let seconds = started.elapsed().as_secs_f64();
        let timing =
            CellTiming { cell: run.result.cell.clone(), label, episodes: episodes - run.reused, seconds };
        Ok((run, Some(timing)))
    }

    fn plan(&self) -> Result<RoomPlan> {
        Ok(RoomPlan::new(self.protocol.config(), self.crowd)?)
    }

    fn robot(&self) -> Result<Box<dyn Robot>> {
        Ok(self.driver.robot(self.token, &self.plan()?)?)
    }
}
