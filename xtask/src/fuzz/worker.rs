//! One process that tries input after input.

use std::fs;
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use jostle_sim::Streams;

use super::targets::{TARGETS, Verdict};
use jostle_runs::output;

/// An input that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(20);
/// Inputs between two lines to the supervisor.
const REPORT_EVERY: u64 = 100;
/// Longest message of a refusal, in bytes; the path of the file is a part of it.
const MESSAGE_MAX: usize = 2000;

/// Tries inputs until time or cases are used up. Prints `tried accepted crashes` now and then, and
/// at the end.
pub(super) fn run(
    name: &str,
    scratch: &Path,
    seed: u64,
    cases: u64,
    time: Duration,
    out: &Path,
) -> Result<ExitCode> {
    let target = TARGETS.iter().find(|target| target.name == name).context("an unknown target")?;
    let panic_message = Arc::new(Mutex::new(String::new()));
    let heard = Arc::clone(&panic_message);
    std::panic::set_hook(Box::new(move |panic| {
        *heard.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = panic.to_string();
    }));
    let started = Instant::now();
    let began = Arc::new(AtomicU64::new(0));
    watch(started, &began);
    let mut case = (target.prepare)(scratch)?;
    let (mut accepted, mut crashes) = (0, 0);
    let mut tried = 0;
    while tried < cases && started.elapsed() < time {
        began.store(started.elapsed().as_millis() as u64, Ordering::Relaxed);
        let mut rng = Streams::new(seed).stream(name, &[tried]);
        let verdict = catch_unwind(AssertUnwindSafe(|| case(&mut rng)));
        let problem = match verdict {
            Ok(Ok(Verdict::Accepted)) => {
                accepted += 1;
                None
            }
            Ok(Ok(Verdict::Refused(message))) => bad_message(&message),
            Ok(Err(error)) => return Err(error),
            Err(_) => Some(panic_message.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()),
        };
        if let Some(problem) = problem {
            crashes += 1;
            keep(scratch, out, name, &format!("{seed}-{tried}"), &problem)?;
        }
        tried += 1;
        if tried.is_multiple_of(REPORT_EVERY) || tried == 1 {
            output::result(&format!("{tried} {accepted} {crashes}\n"))?;
        }
    }
    output::result(&format!("{tried} {accepted} {crashes}\n"))?;
    Ok(ExitCode::SUCCESS)
}

/// The fault in the message of a refusal.
fn bad_message(message: &str) -> Option<String> {
    let one_line = !message.is_empty() && !message.chars().any(char::is_control);
    if one_line && message.len() <= MESSAGE_MAX {
        return None;
    }
    Some(format!(
        "a message that is no short line: {}",
        message.chars().take(MESSAGE_MAX).collect::<String>()
    ))
}

/// Keeps an input that crashed, with what was said about it.
pub(super) fn keep(scratch: &Path, out: &Path, target: &str, case: &str, problem: &str) -> Result<()> {
    let folder = out.join(format!("{target}-{case}"));
    let copy = || -> std::io::Result<()> {
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("problem.txt"), problem)?;
        for entry in fs::read_dir(scratch)? {
            let path = entry?.path();
            if let Some(name) = path.file_name().filter(|_| path.is_file()) {
                fs::copy(&path, folder.join(name))?;
            }
        }
        Ok(())
    };
    copy().with_context(|| format!("cannot keep a crash in {}", folder.display()))
}

/// Ends the process when an input takes too long, as nothing else can end a loop without an end.
fn watch(started: Instant, began: &Arc<AtomicU64>) {
    let began = Arc::clone(began);
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(500));
            let since =
                started.elapsed().saturating_sub(Duration::from_millis(began.load(Ordering::Relaxed)));
            if since > PATIENCE {
                let _ = writeln!(std::io::stderr(), "an input took longer than {} s", PATIENCE.as_secs());
                std::process::abort();
            }
        }
    });
}
