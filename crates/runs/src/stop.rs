//! Ctrl-C, and what a scheduler sends before it kills: work ends at the next good place instead of
//! in the middle.
//!
//! | what | ends | exit status |
//! |---|---|---|
//! | the first SIGINT or SIGTERM | at a checkpoint, after the update in hand | [`STOPPED`] |
//! | the first one where every place is a good one ([`anywhere`]) | at once | [`INTERRUPTED`] |
//! | the second one | at once; what came after the last checkpoint is lost, as by any kill | [`INTERRUPTED`] |
//!
//! SIGHUP is left alone, so that `nohup` works as ever.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

use anyhow::{Context as _, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit status of a process that stopped at a checkpoint: `EX_TEMPFAIL` of sysexits.h, "try again
/// later". No other end of a command has it, so that a script can tell it from a failure.
pub const STOPPED: u8 = 75;
/// Exit status of a process that a signal ended at once: 128 and the number of SIGINT, as shells
/// have it.
pub const INTERRUPTED: i32 = 130;

/// A flag that signals set.
type Flag = LazyLock<Arc<AtomicBool>>;

/// True if the work is to end.
static ASKED: Flag = LazyLock::new(Arc::default);
/// True if the next signal ends the process.
static AT_ONCE: Flag = LazyLock::new(Arc::default);
/// True if every place is a good one.
static ANYWHERE: AtomicBool = AtomicBool::new(false);

/// The end that was asked for has come: holds the line that says where, and what to do next.
#[derive(Debug)]
pub struct Stopped(pub String);

impl std::fmt::Display for Stopped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Stopped {}

/// From now on the first SIGINT or SIGTERM only asks for an end.
///
/// # Errors
/// When the system refuses.
pub fn on_signals() -> Result<()> {
    for signal in [SIGINT, SIGTERM] {
        // In the order in which they act on a signal: the first one only sets the flags.
        flag::register_conditional_shutdown(signal, INTERRUPTED, Arc::clone(&AT_ONCE))
            .and_then(|_| flag::register(signal, Arc::clone(&ASKED)))
            .and_then(|_| flag::register(signal, Arc::clone(&AT_ONCE)))
            .context("cannot watch for signals")?;
    }
    Ok(())
}

/// Asks for an end as a first signal does. Asking again changes nothing.
pub fn ask() {
    ASKED.store(true, Ordering::SeqCst);
    if ANYWHERE.load(Ordering::SeqCst) {
        std::process::exit(INTERRUPTED);
    }
}

/// True if the work is to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// From now on this process may end anywhere: what it writes is whole after every line.
pub fn anywhere() {
    ANYWHERE.store(true, Ordering::SeqCst);
    AT_ONCE.store(true, Ordering::SeqCst);
    if asked() {
        std::process::exit(INTERRUPTED);
    }
}
