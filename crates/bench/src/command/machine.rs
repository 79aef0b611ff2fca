//! Under what conditions a figure was measured.

use std::fs;

use jostle_runs::provenance;

/// One Markdown line: command, commit, processor, threads, and how busy the machine was when the
/// command began.
pub(super) struct Conditions {
    line: String,
}

impl Conditions {
    /// To be asked for before the measurement, which loads the machine itself.
    pub(super) fn now() -> Self {
        let command: Vec<String> = std::env::args().skip(1).collect();
        let line = format!(
            "`cargo xtask {}`; commit {}; {}, {} threads; load average before the start {}.\n\n",
            command.join(" "),
            provenance::commit(),
            processor(),
            std::thread::available_parallelism().map_or(1, usize::from),
            load(),
        );
        Self { line }
    }

    pub(super) fn markdown(&self) -> &str {
        &self.line
    }
}

/// The processor's name, with its family and model, since a virtual machine's name may say little.
fn processor() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = info.lines().find(|line| line.split(':').next().is_some_and(|key| key.trim() == name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    match (field("model name"), field("cpu family"), field("model")) {
        (Some(name), Some(family), Some(model)) => format!("{name} (family {family}, model {model})"),
        (Some(name), _, _) => name,
        _ => std::env::consts::ARCH.to_owned(),
    }
}

/// Mean number of runnable processes over the last minute.
fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().filter(|load| !load.is_empty()).unwrap_or("unknown").to_owned()
}
