//! Progress of each run of a plan.

use anyhow::Result;

use super::plan::Plan;
use super::slurm;
use super::task::Stage;
use jostle_runs::log::RunLog;
use jostle_runs::output::columns;
use jostle_runs::pace::Pace;

/// A line for each run.
pub(super) fn table(plan: &Plan) -> Result<String> {
    let heads = ["run", "state", "host", "updates", "success", "transitions/s", "left"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let queued = slurm::queued(plan)?;
    let mut counts = std::collections::BTreeMap::new();
    for task in &plan.tasks {
        let stage = Stage::read(plan, task)?;
        *counts.entry(stage.word()).or_insert(0) += 1;
        let waits = matches!(stage, Stage::Waiting | Stage::Stopped | Stage::Trained);
        let queued = queued.get(&task.name).filter(|_| waits);
        let mut row = vec![task.name.clone(), queued.cloned().unwrap_or_else(|| stage.word().to_owned())];
        if stage == Stage::Waiting || !task.folder.join("config.toml").is_file() {
            row.extend(["–".to_owned(), format!("0/{}", task.config.updates)]);
            row.extend(["–", "–", "–"].map(str::to_owned));
        } else {
            let log = RunLog::read(&task.folder)?;
            let pace = Pace::new(&log, task.config.updates, plan.window);
            let success = log.success(log.reports.len(), plan.window);
            row.extend([
                pace.host_if(stage == Stage::Running),
                format!("{}/{}", log.reports.len(), task.config.updates),
                success.map_or_else(|| "–".to_owned(), |rate| format!("{rate:.2}")),
                pace.rate(),
                pace.left_if(stage == Stage::Running),
            ]);
        }
        rows.push(row);
    }
    let summary: Vec<String> = counts.iter().map(|(word, count)| format!("{count} {word}")).collect();
    Ok(format!("{}\n{} runs: {}\n", columns(&rows), plan.tasks.len(), summary.join(", ")))
}
