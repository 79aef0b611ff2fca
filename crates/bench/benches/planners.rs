//! One decision of each planner, on one thread.

use criterion::{BenchmarkId, Criterion};
use jostle_arena::Planner;
use jostle_bench::planners::Decisions;

pub(crate) fn decision(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("planner decision");
    for planner in Planner::ALL {
        let mut decisions = Decisions::new(planner).expect("the default protocol");
        group.bench_function(BenchmarkId::from_parameter(planner), |bencher| {
            bencher.iter(|| decisions.decide().expect("a room"));
        });
    }
}
