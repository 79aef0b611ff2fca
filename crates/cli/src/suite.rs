//! `cargo xtask evaluate --suite`: a policy on every scene of a suite among every crowd that is
//! asked for.

use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_arena::Driver;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_eval::protocol::Protocol;
use jostle_eval::report::{CellTiming, SceneResult, SuiteReport, timings_csv};
use jostle_eval::suite::Suite;
use jostle_peds::CrowdKind;

use jostle_runs::output;
use jostle_runs::run_folder::write_atomically;
use jostle_study::cell::Cell;

/// The robot, the crowds and the number of episodes asked for.
pub(crate) struct Asked<'a> {
    pub(crate) suite: Suite,
    pub(crate) driver: &'a Driver,
    pub(crate) token: u32,
    pub(crate) crowds: &'a [CrowdKind],
    pub(crate) episodes: u64,
    pub(crate) out: &'a Path,
}

/// The suite of a name, or of a file.
pub(crate) fn open(name: &str) -> Result<Suite> {
    let standard = Suite::standard();
    if name == standard.name {
        return Ok(standard);
    }
    Suite::read(Path::new(name))
        .with_context(|| format!("--suite {name}: expected {}, or a file of scenes", standard.name))
}

/// Runs all cells, prints the report and writes it beside the records.
pub(crate) fn run(asked: &Asked<'_>, base: &ArenaConfig, pools: &Pools) -> Result<()> {
    let protocols = asked
        .suite
        .scenes
        .iter()
        .map(|scene| {
            let protocol = Protocol::new(scene.config(base)?, pools.clone())?;
            for &crowd in asked.crowds {
                cell(asked, &protocol, crowd).check()?;
            }
            Ok(protocol)
        })
        .collect::<Result<Vec<Protocol>>>()?;
    let records = asked.out.join("records");
    std::fs::create_dir_all(&records).with_context(|| format!("cannot create {}", records.display()))?;
    let mut timings = Vec::new();
    let mut scenes = Vec::new();
    for (scene, protocol) in asked.suite.scenes.iter().zip(&protocols) {
        output::note(&format!("{}: {}", scene.name, scene.about));
        let mut cells = Vec::new();
        for &crowd in asked.crowds {
            let (run, timing) = cell(asked, protocol, crowd).run(asked.episodes, &records)?;
            timings.extend(timing);
            cells.push(run.result);
        }
        let n_agents = protocol.config().n_agents;
        scenes.push(SceneResult { scene: scene.name.clone(), about: scene.about.clone(), n_agents, cells });
    }
    let (name, identity) = (asked.suite.name.clone(), asked.driver.identity());
    let report = SuiteReport::new(name, identity, asked.token, base.seed, asked.episodes, scenes);
    store(asked.out, &report, &timings)?;
    output::result(&report.text())
}

fn cell<'a>(asked: &Asked<'a>, protocol: &'a Protocol, crowd: CrowdKind) -> Cell<'a> {
    Cell { protocol, driver: asked.driver, token: asked.token, crowd }
}

/// Writes the report beside its records.
fn store(out: &Path, report: &SuiteReport, timings: &[CellTiming]) -> Result<()> {
    let name = format!("{}-{}-z{}", report.suite, report.policy.name, report.token);
    let path = |extension: &str| out.join(format!("{name}.{extension}"));
    write_atomically(&path("md"), &report.markdown())?;
    write_atomically(&path("csv"), &report.csv())?;
    write_atomically(&path("json"), &report.json())?;
    if !timings.is_empty() {
        write_atomically(&path("seconds.csv"), &timings_csv(timings))?;
    }
    output::note(&format!("records and reports: {}", out.display()));
    Ok(())
}
