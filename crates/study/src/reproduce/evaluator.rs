//! The study as far as it has been run: rows with their policies, and what came out of their
//! episodes.

use std::collections::BTreeMap;
use std::path::Path;

use crate::claims::{Row, SeedRun, Study};
use anyhow::{Result, ensure};
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_arena::{Driver, Planner};
use jostle_eval::compact::CompactEpisode;
use jostle_eval::diversity::{Diversity, TRAJECTORY_STEPS, diversity, trajectory};
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;

use super::cells::{Cells, Wanted};
use super::mujoco::Mujoco;
use super::plan::row_spec;
use super::policies::{Found, Policies};

/// The behaviour token of every row (paper, V-A).
pub(crate) const TOKEN: u32 = 0;
/// Seed of the trajectory that D is measured on.
const TRAJECTORY_SEED: u64 = 0;

/// Episodes of a planner, by crowd or map.
pub(super) type Sites = BTreeMap<String, Vec<CompactEpisode>>;

/// A row with its policies and episodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evaluated {
    /// By training seed; none where the row has not been trained.
    pub(crate) found: Vec<Found>,
    /// The same order.
    pub(crate) row: Row,
    /// The same order; empty unless it was asked for.
    pub(crate) diversity: Vec<Diversity>,
}

/// The study.
pub(crate) struct RowEvaluator {
    pub(crate) policies: Policies,
    pub(crate) cells: Cells,
    episodes: u64,
    pools: Pools,
    rows: BTreeMap<&'static str, Evaluated>,
    /// By planner and number of agents.
    planners: BTreeMap<(Planner, usize), Sites>,
    /// The trajectory that D is measured on, once it is needed.
    states: Option<Vec<f32>>,
}

impl RowEvaluator {
    /// A study of which nothing has been run yet.
    pub(crate) fn new(
        policies: Policies,
        results: &Path,
        fresh: bool,
        episodes: u64,
        mujoco: Option<Mujoco>,
    ) -> Result<Self> {
        ensure!(episodes > 0, "--episodes: found 0, expected at least 1");
        let pools = policies.pools()?;
        let cells = Cells::open(results.join("cells"), fresh, mujoco)?;
        Ok(Self {
            policies,
            cells,
            episodes,
            pools,
            rows: BTreeMap::new(),
            planners: BTreeMap::new(),
            states: None,
        })
    }

    /// Episodes of a cell.
    pub(crate) fn episodes(&self) -> u64 {
        self.episodes
    }

    /// A row among the six crowds.
    pub(crate) fn row(&mut self, name: &'static str) -> Result<&Evaluated> {
        let mut row = self.take(name)?;
        let (crowds, n_agents) = (CrowdKind::PAPER, row_spec(name).n_agents);
        for (found, run) in row.found.iter().zip(&mut row.row.seeds) {
            for crowd in crowds {
                if !run.sites.contains_key(crowd.name()) {
                    let episodes = self.crowd(found, TOKEN, crowd, n_agents)?;
                    run.sites.insert(crowd.name().to_owned(), episodes);
                }
            }
        }
        Ok(self.put(name, row))
    }

    /// A row with its D.
    pub(crate) fn row_with_diversity(&mut self, name: &'static str) -> Result<&Evaluated> {
        self.row(name)?;
        let states = self.states()?;
        let mut row = self.take(name)?;
        if let Some(states) = states.filter(|_| row.diversity.is_empty()) {
            for (found, run) in row.found.iter().zip(&mut row.row.seeds) {
                let measured = diversity(&found.policy, ArenaConfig::default().backend, &states)?;
                run.diversity = Some(measured.d);
                row.diversity.push(measured);
            }
        }
        Ok(self.put(name, row))
    }

    /// A row at further sites: `run` gives the episodes of one policy at each.
    pub(crate) fn row_at(
        &mut self,
        name: &'static str,
        mut run: impl FnMut(&mut Cells, &Found) -> Result<Vec<(String, Vec<CompactEpisode>)>>,
    ) -> Result<&Evaluated> {
        let mut row = self.take(name)?;
        for (found, seed) in row.found.iter().zip(&mut row.row.seeds) {
            seed.sites.extend(run(&mut self.cells, found)?);
        }
        Ok(self.put(name, row))
    }

    /// The episodes of a policy with a token in a crowd of `n_agents` − 1 (`None`: as many agents
    /// as in training).
    pub(crate) fn crowd(
        &mut self,
        found: &Found,
        token: u32,
        crowd: CrowdKind,
        n_agents: Option<usize>,
    ) -> Result<Vec<CompactEpisode>> {
        let config = ArenaConfig {
            sim: found.policy.sim_config()?,
            n_agents: n_agents.unwrap_or(found.policy.file.provenance.n_agents as usize),
            ..ArenaConfig::default()
        };
        let protocol = Protocol::new(config, self.pools.clone())?;
        let driver = Driver::Trained(Box::new(found.policy.clone()));
        let wanted = Wanted { protocol: &protocol, driver: &driver, token, crowd, episodes: self.episodes };
        Ok(self.cells.get(&wanted)?.episodes(self.episodes as usize))
    }

    /// A planner among the six crowds, one robot and `n_agents` − 1 pedestrians, in the room of the
    /// base setting.
    pub(crate) fn planner(&mut self, planner: Planner, n_agents: usize) -> Result<&Sites> {
        let mut sites = self.planners.remove(&(planner, n_agents)).unwrap_or_default();
        let driver = Driver::Planner(planner);
        let config = ArenaConfig { sim: self.policies.sim(), n_agents, ..ArenaConfig::default() };
        let protocol = Protocol::new(config, self.pools.clone())?;
        for crowd in CrowdKind::PAPER {
            if !sites.contains_key(crowd.name()) {
                let wanted = Wanted {
                    protocol: &protocol,
                    driver: &driver,
                    token: TOKEN,
                    crowd,
                    episodes: self.episodes,
                };
                let episodes = self.cells.get(&wanted)?.episodes(self.episodes as usize);
                sites.insert(crowd.name().to_owned(), episodes);
            }
        }
        Ok(self.planners.entry((planner, n_agents)).insert_entry(sites).into_mut())
    }

    /// The study of all rows that were run.
    pub(crate) fn study(&self) -> Study {
        let rows = self.rows.iter().map(|(name, row)| ((*name).to_owned(), row.row.clone()));
        Study { rows: rows.collect() }
    }

    /// Rows without a policy.
    pub(crate) fn missing(&self) -> Vec<&'static str> {
        self.rows.iter().filter(|(_, row)| row.found.is_empty()).map(|(name, _)| *name).collect()
    }

    /// A row out of the study, with its policies.
    fn take(&mut self, name: &'static str) -> Result<Evaluated> {
        if let Some(row) = self.rows.remove(name) {
            return Ok(row);
        }
        let spec = row_spec(name);
        let found = self.policies.of(spec.variant, spec.updates)?;
        let done = found.iter().map(|policy| policy.updates).min();
        let shorter = done.filter(|done| *done < spec.updates).map(|done| (done, spec.updates));
        let seeds = found.iter().map(|policy| SeedRun { seed: policy.seed, ..SeedRun::default() }).collect();
        Ok(Evaluated { found, row: Row { seeds, shorter }, diversity: Vec::new() })
    }

    fn put(&mut self, name: &'static str, row: Evaluated) -> &Evaluated {
        self.rows.entry(name).insert_entry(row).into_mut()
    }

    /// The states that D is measured on: a trajectory of the first baseline policy in its training
    /// room; `None` where there is no baseline.
    fn states(&mut self) -> Result<Option<Vec<f32>>> {
        if self.states.is_none() {
            let row = self.take("m1")?;
            if let Some(baseline) = row.found.first() {
                let sim = baseline.policy.sim_config()?;
                let n_agents = baseline.policy.file.provenance.n_agents as usize;
                let backend = ArenaConfig::default().backend;
                let (seed, steps) = (TRAJECTORY_SEED, TRAJECTORY_STEPS);
                self.states = Some(trajectory(&baseline.policy, &sim, backend, n_agents, seed, steps)?);
            }
            self.put("m1", row);
        }
        Ok(self.states.clone())
    }
}
