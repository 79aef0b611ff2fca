//! A rollout allocates nothing: an update with four times the steps allocates as often.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator with a counter.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator as it is; counting touches no memory of
// it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Allocations of one update, when all memory has grown to its size.
fn allocations(horizon: usize) -> usize {
    let (steps, rows) = (format!("horizon={horizon}"), format!("minibatch={}", 4 * horizon));
    // One minibatch whatever the horizon, so that only the rollout differs.
    let mut trainer = common::trainer(&[&steps, &rows, "threads=1", "bootstrap_truncation=false"]);
    for _ in 0..3 {
        trainer.update().unwrap();
    }
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    trainer.update().unwrap();
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

#[test]
fn steps_of_a_rollout_allocate_nothing() {
    let (short, long) = (allocations(16), allocations(64));
    assert!(short > 0, "the counter counts");
    assert!(long <= short, "{long} allocations in 64 steps, {short} in 16");
}
