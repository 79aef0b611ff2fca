//! A training run as its folder tells it: configuration and update reports, read without disturbing
//! who writes them.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_ppo::report::EpisodeCounts;
use jostle_ppo::{Config, UpdateReport};

use crate::folder::{is_run_folder, read_optional};
use crate::run_folder::is_locked;

/// The present state of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// All updates are made.
    Finished,
    /// A process works in the folder.
    Running,
    /// Updates are missing, and nobody makes them.
    Stopped,
}

/// A run's configuration and log.
pub struct RunLog {
    /// Its folder.
    pub folder: PathBuf,
    /// The folder's name.
    pub name: String,
    /// Its configuration.
    pub config: Config,
    /// One for each update, from the first.
    pub reports: Vec<UpdateReport>,
    /// True where the last line is cut short: it is being written, or its writer was killed.
    pub torn: bool,
}

impl RunLog {
    /// Reads the run in a folder.
    ///
    /// # Errors
    /// A folder without a run; a configuration or a complete line that cannot be read.
    pub fn read(folder: &Path) -> Result<Self> {
        let shown = folder.display();
        if !is_run_folder(folder) {
            bail!("{shown} is no run folder; name one that `train` made");
        }
        let path = folder.join("config.toml");
        let text = read_optional(&path)?.with_context(|| format!("{shown} holds no config.toml"))?;
        let none: &[&str] = &[];
        let mut config = Config::parse(&text, &path.display().to_string(), none)?;
        config.stored_in(folder);
        let path = folder.join("log.ndjson");
        let text = read_optional(&path)?.unwrap_or_default();
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut reports = Vec::new();
        for (index, line) in text[..whole].lines().enumerate() {
            let report = serde_json::from_str(line)
                .with_context(|| format!("{}:{} is no update report", path.display(), index + 1))?;
            reports.push(report);
        }
        let full = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let name = full.file_name().unwrap_or(full.as_os_str()).to_string_lossy().into_owned();
        Ok(Self { folder: folder.to_owned(), name, config, reports, torn: whole < text.len() })
    }

    /// Tells whether it is finished, running or stopped.
    pub fn state(&self) -> Result<State> {
        let held = is_locked(&self.folder)?;
        Ok(match () {
            () if held => State::Running,
            () if self.reports.len() as u64 >= self.config.updates => State::Finished,
            () => State::Stopped,
        })
    }

    /// Reports of the `window` updates up to and with update `end`.
    fn window(&self, end: usize, window: usize) -> &[UpdateReport] {
        let end = end.min(self.reports.len());
        &self.reports[end.saturating_sub(window)..end]
    }

    /// Share of training episodes that reached their goal in the `window` updates up to `end`;
    /// `None` without episodes.
    pub fn success(&self, end: usize, window: usize) -> Option<f64> {
        let counts = self.episodes(end, window);
        (counts.ended > 0).then(|| counts.success as f64 / counts.ended as f64)
    }

    /// The outcomes of the training episodes of the `window` updates up to `end`.
    pub fn episodes(&self, end: usize, window: usize) -> EpisodeCounts {
        self.window(end, window).iter().fold(EpisodeCounts::default(), |sum, r| EpisodeCounts {
            ended: sum.ended + r.episodes.ended,
            success: sum.success + r.episodes.success,
            collision_wall: sum.collision_wall + r.episodes.collision_wall,
            collision_agent: sum.collision_agent + r.episodes.collision_agent,
            timeout: sum.timeout + r.episodes.timeout,
        })
    }

    /// Mean of a measure over the `window` updates up to `end` that have it.
    pub fn mean(
        &self,
        end: usize,
        window: usize,
        measure: impl Fn(&UpdateReport) -> Option<f64>,
    ) -> Option<f64> {
        let values: Vec<f64> = self.window(end, window).iter().filter_map(measure).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }

    /// The text that tells this run apart from others but its seed: runs that agree in it are
    /// repetitions.
    pub fn recipe(&self) -> String {
        Config { seed: 0, ..self.config.clone() }.hash()
    }
}

/// Depth to which folders are searched for runs.
pub const DEPTH: usize = 5;

/// Run folders at or below a folder, in the order of their names.
pub fn search(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<()> {
    if is_run_folder(folder) {
        found.push(folder.to_owned());
        return Ok(());
    }
    if depth == 0 || !folder.is_dir() {
        return Ok(());
    }
    let cannot_list = || format!("cannot list {}", folder.display());
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .with_context(cannot_list)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_>>()
        .with_context(cannot_list)?;
    entries.sort();
    entries.iter().filter(|path| path.is_dir()).try_for_each(|path| search(path, depth - 1, found))
}

/// The start of a hash, enough to tell runs apart.
pub fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}
