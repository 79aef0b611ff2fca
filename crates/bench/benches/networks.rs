//! Inference of the actor, and learning: an update's worth, and an epoch of one discriminator.

use criterion::{BenchmarkId, Criterion, Throughput};
use jostle_bench::learners::{TRANSITIONS, WorkU};

/// Tells the learners' own clocks that other threads help.
fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

pub(crate) fn actor_forward(criterion: &mut Criterion) {
    let mut work = WorkU::new().expect("the paper's sizes");
    let mut group = criterion.benchmark_group("actor forward");
    for batch in [1, 5, 20, 80, 320] {
        group.throughput(Throughput::Elements(batch as u64));
        group.bench_function(BenchmarkId::from_parameter(batch), |bencher| {
            bencher.iter(|| work.actor.infer(batch));
        });
    }
}

pub(crate) fn update(criterion: &mut Criterion) {
    let mut work = WorkU::new().expect("the paper's sizes");
    let mut group = criterion.benchmark_group("update");
    group.throughput(Throughput::Elements(TRANSITIONS as u64)).sample_size(10);
    group.bench_function("actor, critic and discriminators", |bencher| bencher.iter(|| work.run(threads())));
}

pub(crate) fn discriminator(criterion: &mut Criterion) {
    let mut work = WorkU::new().expect("the paper's sizes");
    let mut group = criterion.benchmark_group("discriminator");
    group.throughput(Throughput::Elements(TRANSITIONS as u64));
    group.bench_function("epoch", |bencher| bencher.iter(|| work.q_state_action.epoch(threads())));
    group.bench_function("infer", |bencher| bencher.iter(|| work.q_state_action.infer(TRANSITIONS)));
}
