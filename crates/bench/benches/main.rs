//! Criterion benches of every hot path: `cargo bench -p jostle-bench -- NAME`, with NAME any part
//! of a bench's name.
//!
//! The settings of criterion are those of [`settings`] alone. Each bench says how much it does, so
//! that criterion prints beams, agent-steps, rows, transitions or episodes per second beside the
//! time.

mod crowds;
mod evaluation;
mod networks;
mod planners;
mod simulator;

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};

/// Few samples and short times: the rounds of `cargo xtask bench` serve comparisons, these benches
/// serve work on a kernel.
fn settings() -> Criterion {
    Criterion::default()
        .sample_size(15)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
}

criterion_group! {
    name = all;
    config = settings();
    targets = simulator::scan, simulator::physics, simulator::env_step, crowds::orca, crowds::social_force,
        networks::actor_forward, networks::update, networks::discriminator, evaluation::episode, planners::decision
}
criterion_main!(all);
