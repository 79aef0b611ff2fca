//! Forks and threads. A forked process has the memory of its parent's thread pool and none of its
//! threads: whoever waits for them waits for ever. Better to say so.

use std::sync::atomic::{AtomicU32, Ordering};

/// The process that first used the pool; 0 before.
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Refuses work for several threads in a process whose threads were lost in a fork.
///
/// To be called before every use of the pool, also by work for one thread alone, which may start
/// the pool all the same.
///
/// # Errors
///
/// One line that says what to do.
pub fn check(needs_threads: bool) -> Result<(), &'static str> {
    check_process(&OWNER, std::process::id(), needs_threads)
}

fn check_process(owner: &AtomicU32, process: u32, needs_threads: bool) -> Result<(), &'static str> {
    let first = owner.compare_exchange(0, process, Ordering::Relaxed, Ordering::Relaxed);
    if needs_threads && first.is_err_and(|owner| owner != process) {
        return Err(
            "this process was forked from one that had used jostle, and has lost its threads: start it with \
                    the method spawn or forkserver",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fork_of_a_user_is_refused_threads_alone() {
        let owner = AtomicU32::new(0);
        assert!(check_process(&owner, 7, true).is_ok());
        assert!(check_process(&owner, 7, true).is_ok());
        assert!(check_process(&owner, 8, false).is_ok());
        assert!(check_process(&owner, 8, true).unwrap_err().contains("spawn"));
    }
}
