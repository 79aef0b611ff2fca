//! Cells of the tables, each run once and kept in `results/cells` in the small form, by the hash of
//! all it depends on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_arena::Driver;
use jostle_arena::identity::short;
use jostle_arena::room::{RoomPlan, metric_scale};
use jostle_eval::cell::CellKey;
use jostle_eval::compact::CompactCell;
use jostle_eval::protocol::{Protocol, Subject};
use jostle_peds::CrowdKind;

use super::mujoco::{self, Mujoco, Pilot};
use jostle_runs::output::note;
use jostle_runs::progress::Progress;
use jostle_runs::run_folder::write_atomically;

/// The store of cells.
pub(crate) struct Cells {
    folder: PathBuf,
    /// Run also what is stored, and compare.
    fresh: bool,
    /// Runs cells in MuJoCo; where it is not installed, they are read.
    mujoco: Option<Mujoco>,
    /// Cells that this store has run, which are not run twice.
    ran: BTreeSet<PathBuf>,
    /// Cells that were run and were not stored before.
    pub(crate) new: u64,
    /// Cells that were run again and came out the same.
    pub(crate) same: u64,
    /// Cells that were read.
    pub(crate) read: u64,
}

/// The cell that is to be run.
pub(crate) struct Wanted<'a> {
    pub(crate) protocol: &'a Protocol,
    pub(crate) driver: &'a Driver,
    pub(crate) token: u32,
    pub(crate) crowd: CrowdKind,
    pub(crate) episodes: u64,
}

impl Cells {
    /// A store in a folder, which is made.
    pub(crate) fn open(folder: PathBuf, fresh: bool, mujoco: Option<Mujoco>) -> Result<Self> {
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        Ok(Self { folder, fresh, mujoco, ran: BTreeSet::new(), new: 0, same: 0, read: 0 })
    }

    /// A cell with at least the episodes asked for.
    ///
    /// # Errors
    /// What the protocol refuses; with `fresh`, a stored cell that differs from what comes out now.
    pub(crate) fn get(&mut self, wanted: &Wanted<'_>) -> Result<CompactCell> {
        let Wanted { protocol, driver, token, crowd, episodes } = *wanted;
        let identity = driver.identity();
        let subject = Subject { identity: &identity, token };
        let key = protocol.key(subject, crowd);
        let path = self.path(&key);
        let stored = stored_cell(&path, &key)?;
        if let Some(stored) = self.usable(&path, stored.as_ref(), episodes, self.fresh) {
            return Ok(stored);
        }
        let mut robot = driver.robot(token, &RoomPlan::new(protocol.config(), crowd)?)?;
        let label = format!("{}, z = {token}, {crowd}", identity.name);
        let mut progress = Progress::new(&label, episodes, 0);
        let run = protocol
            .evaluate(&mut *robot, subject, crowd, episodes, None, |done| progress.set(done, ""))
            .with_context(|| label.clone())?;
        progress.finish(&format!("success {:.2}", run.result.summary.success_rate.unwrap_or(0.0)));
        let cell = CompactCell::new(key, identity.clone(), metric_scale(protocol.config()), &run.records);
        self.keep(path, stored, &cell)?;
        Ok(cell)
    }

    /// As [`Self::get`], in MuJoCo; `None` where the cell is not stored and MuJoCo not installed.
    pub(crate) fn get_in_mujoco(
        &mut self,
        wanted: &Wanted<'_>,
        pilot: Pilot<'_>,
    ) -> Result<Option<CompactCell>> {
        let Wanted { protocol, driver, token, crowd, episodes } = *wanted;
        let identity = driver.identity();
        let own = protocol.key(Subject { identity: &identity, token }, crowd);
        let key = mujoco::key(&own);
        let path = self.path(&key);
        let stored = stored_cell(&path, &key)?;
        let again = self.fresh && self.mujoco.is_some();
        if let Some(stored) = self.usable(&path, stored.as_ref(), episodes, again) {
            return Ok(Some(stored));
        }
        let Some(mujoco) = &self.mujoco else { return Ok(None) };
        let cell = mujoco.run(protocol, pilot, (&own, &identity), episodes)?;
        self.keep(path, stored, &cell)?;
        Ok(Some(cell))
    }

    fn path(&self, key: &CellKey) -> PathBuf {
        self.folder.join(format!("{}-z{}-{}.txt", key.crowd, key.token, short(&key.hash())))
    }

    /// A stored cell with enough episodes, unless it is to be run again.
    fn usable(
        &mut self,
        path: &Path,
        stored: Option<&CompactCell>,
        episodes: u64,
        again: bool,
    ) -> Option<CompactCell> {
        let stored = stored.filter(|stored| stored.head.episodes >= episodes)?;
        if again && !self.ran.contains(path) {
            return None;
        }
        self.read += 1;
        Some(stored.clone())
    }

    /// Stores what was run, or compares it with what is stored.
    fn keep(&mut self, path: PathBuf, stored: Option<CompactCell>, cell: &CompactCell) -> Result<()> {
        if let Some(stored) = stored {
            self.compare(&path, &stored, cell)?;
        } else {
            self.new += 1;
            write_atomically(&path, &cell.text())?;
        }
        self.ran.insert(path);
        Ok(())
    }

    /// A stored cell must be the beginning of the new one, or the other way round; the longer one
    /// stays.
    fn compare(&mut self, path: &Path, stored: &CompactCell, cell: &CompactCell) -> Result<()> {
        let shared = stored.head.episodes.min(cell.head.episodes) as usize;
        let (old, new) = (stored.episodes(shared), cell.episodes(shared));
        let moved = |k: &usize| {
            let (old, new) = (&old[*k], &new[*k]);
            (old.outcome, &old.metrics) != (new.outcome, &new.metrics)
                || old.driving.is_some_and(|driving| new.driving != Some(driving))
        };
        if let Some(episode) = (0..shared).find(moved) {
            bail!(
                "{}: episode {episode} now comes out otherwise: stored {:?}, now {:?}",
                path.display(),
                old[episode],
                new[episode]
            );
        }
        self.same += 1;
        // What was stored before there were values of driving gets them.
        let gains = old.iter().zip(&new).any(|(old, new)| old.driving.is_none() && new.driving.is_some());
        if cell.head.episodes > stored.head.episodes || (gains && shared as u64 == stored.head.episodes) {
            write_atomically(path, &cell.text())?;
        }
        Ok(())
    }

    /// Says what was done, on standard error.
    pub(crate) fn describe(&self) {
        let Self { new, same, read, .. } = self;
        note(&format!(
            "{}: {read} cells read, {new} run, {same} run again with the same result",
            self.folder.display()
        ));
    }
}

/// The cell of a file, if there is one.
fn stored_cell(path: &Path, key: &CellKey) -> Result<Option<CompactCell>> {
    let stored = path.exists().then(|| CompactCell::read(path)).transpose()?;
    if let Some(other) = stored.as_ref().filter(|stored| stored.head.key != *key) {
        bail!("{}: holds another cell ({})", path.display(), short(&other.head.key.hash()));
    }
    Ok(stored)
}
