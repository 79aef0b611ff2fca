//! The number of worker threads: no result depends on it.

use std::num::NonZeroUsize;

use anyhow::{Context as _, Result};

/// Sets the size of the thread pool; without a number every core is used.
pub fn set(threads: Option<NonZeroUsize>) -> Result<()> {
    let threads = threads.map_or(0, NonZeroUsize::get);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .context("cannot start the worker threads")
}
