//! A second process that commands zero where the driving one is killed.
//!
//! What a process does on its way out, `kill -9` and a crash of the machine code leave undone: the
//! robot would keep the last command until its base times out. So the process that a user starts
//! does not drive. It joins the network, starts the driving process, and waits. If that one ends
//! without having been asked to, zero commands follow within milliseconds. The other way round, the
//! driving process ends as by a signal when its standard input does: when the guard is killed.

use std::process::{Child, Command as Process, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::driver::Command;
use crate::error::RosError;
use crate::messages::Time;
use crate::node::{Ends, Out, join};
use crate::params::Params;
use crate::stop::Stop;

/// Time between two looks at the driving process.
const POLL: Duration = Duration::from_millis(5);
/// Longest time for the driving process to end when it is asked to.
const PATIENCE: Duration = Duration::from_secs(2);
/// Zero commands after it ended by itself, a few times each period.
const ZEROS: u32 = 20;

/// Starts this program again, to drive, and stops the robot if that ends by itself. Commands come
/// every `period` s.
///
/// # Errors
///
/// The driving process cannot be started or ended by itself; the network cannot be joined.
pub fn run(mut ends: Ends, params: &Params, period: f64) -> Result<(), RosError> {
    let mut node = join(&params.network, &format!("{}_guard", params.network.name))?;
    let out = Out::new(&mut node, params)?;
    let asked = Arc::new(AtomicBool::new(false));
    let mut child = start()?;
    let heard = Arc::clone(&asked);
    std::thread::spawn(move || {
        ends.wait();
        heard.store(true, Ordering::SeqCst);
    });
    let mut asked_at = None;
    let status = loop {
        let failed = RosError::transport("wait for the driving process");
        if let Some(status) = child.try_wait().map_err(failed)? {
            break status;
        }
        if asked_at.is_none() && asked.load(Ordering::SeqCst) {
            // The end of its standard input is what it ends with.
            drop(child.stdin.take());
            asked_at = Some(Instant::now());
        }
        if asked_at.is_some_and(|at| at.elapsed() > PATIENCE) {
            child.kill().map_err(RosError::transport("end the driving process"))?;
        }
        std::thread::sleep(POLL);
    };
    if status.success() {
        return Ok(());
    }
    let zero = Command { v: 0.0, w: 0.0, stamp: Time::default(), stop: Some(Stop::Exit) };
    for _ in 0..ZEROS {
        out.publish(&zero)?;
        std::thread::sleep(Duration::from_secs_f64(period / 2.0));
    }
    Err(RosError::Killed { status })
}

/// Starts the driving process.
fn start() -> Result<Child, RosError> {
    let failed = || RosError::transport("start the driving process");
    let program = std::env::current_exe().map_err(failed())?;
    let arguments = std::env::args_os().skip(1).chain(["--guarded".into()]);
    Process::new(program).args(arguments).stdin(Stdio::piped()).spawn().map_err(failed())
}
