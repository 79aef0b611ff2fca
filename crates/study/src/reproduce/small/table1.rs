//! Table 1: trains its rows and its pedestrians, tests each row among the six crowds, prints.

use std::path::{Path, PathBuf};

use crate::paper::{BehavioursRow, TABLE_1};
use anyhow::{Context as _, Result};
use jostle_arena::Driver;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_arena::loaded::LoadedPolicy;
use jostle_eval::protocol::Protocol;
use jostle_eval::records::EpisodeRecord;
use jostle_eval::report::{CellTiming, Comparison, SuccessRow, SuccessTable, timings_csv};
use jostle_peds::CrowdKind;

use super::plan::{self, Run, pool_runs, row_run, row_runs};
use crate::cell::Cell;
use crate::reproduce::Trainings;
use crate::success_tables;
use jostle_runs::folder::checkpoint_path;
use jostle_runs::output;
use jostle_runs::policies;
use jostle_runs::run_folder::write_atomically;

/// The robot's behaviour token in every row.
const TOKEN: u32 = 0;

/// Does what is missing under `out` and prints the table.
pub(crate) fn run(out: &Path, threads: usize, trainings: &dyn Trainings) -> Result<()> {
    for run in [pool_runs(), row_runs()].concat() {
        let mut config = run.config.clone();
        config.threads = threads;
        trainings.train(&config, &out.join(&run.folder), &run.folder)?;
    }
    let pools = pools(out)?;
    let records = out.join("records");
    std::fs::create_dir_all(&records).with_context(|| format!("cannot create {}", records.display()))?;

    let mut table = success_tables::table_1();
    let mut timings = Vec::new();
    let mut baseline: Option<Vec<Vec<EpisodeRecord>>> = None;
    for (row, of_paper) in table.rows.iter_mut().zip(&TABLE_1) {
        let cells = fill(row, of_paper, out, &pools, &records, &mut timings)?;
        match &baseline {
            None => baseline = Some(cells),
            Some(baseline) => {
                for ((cell, first), second) in row.cells.iter_mut().zip(baseline).zip(&cells) {
                    cell.versus_baseline = Comparison::new(first, second);
                }
            }
        }
    }
    store(out, &table, &timings)?;
    output::result(&table.text())
}

/// Tests the policy of one row; gives the records of its cells.
fn fill(
    row: &mut SuccessRow,
    of_paper: &BehavioursRow,
    out: &Path,
    pools: &Pools,
    records: &Path,
    timings: &mut Vec<CellTiming>,
) -> Result<Vec<Vec<EpisodeRecord>>> {
    let run = row_run(of_paper.n_behaviours);
    let policy = policies::load(&trained(out, &run, plan::updates(of_paper.updates.into())))?;
    let config = ArenaConfig { sim: policy.sim_config()?, n_agents: row.n_agents, ..ArenaConfig::default() };
    let driver = Driver::Trained(Box::new(policy));
    let protocol = Protocol::new(config, pools.clone())?;
    let mut all = Vec::new();
    for crowd in CrowdKind::PAPER {
        let cell = Cell { protocol: &protocol, driver: &driver, token: TOKEN, crowd };
        let (run, timing) = cell.run(plan::EPISODES, records)?;
        timings.extend(timing);
        row.cells.push(run.result);
        all.push(run.records);
    }
    row.policy = Some(driver.identity());
    row.token = TOKEN;
    row.note = Some(plan::note(of_paper));
    Ok(all)
}

/// The pedestrians' policies, whole and half trained.
fn pools(out: &Path) -> Result<Pools> {
    let load = |half: bool| -> Result<Vec<LoadedPolicy>> {
        let checkpoint =
            |run: &Run| trained(out, run, if half { run.config.updates / 2 } else { run.config.updates });
        pool_runs().iter().map(|run| Ok(policies::load(&checkpoint(run))?)).collect()
    };
    Ok(Pools { full: load(false)?, half: load(true)? })
}

fn trained(out: &Path, run: &Run, update: u64) -> PathBuf {
    checkpoint_path(&out.join(&run.folder), update)
}

fn store(out: &Path, table: &SuccessTable, timings: &[CellTiming]) -> Result<()> {
    write_atomically(&out.join("table1.md"), &table.markdown())?;
    write_atomically(&out.join("table1.csv"), &table.csv())?;
    write_atomically(&out.join("table1.json"), &table.json())?;
    if !timings.is_empty() {
        write_atomically(&out.join("table1.seconds.csv"), &timings_csv(timings))?;
    }
    output::note(&format!("reports and records: {}", out.display()));
    Ok(())
}
