//! Episodes of a test in lock step.

use criterion::{BenchmarkId, Criterion, Throughput};
use jostle_bench::evaluation::Cells;
use jostle_peds::CrowdKind;

/// Episodes of one measurement; a cell of the paper has 1000.
const EPISODES: u64 = 16;

pub(crate) fn episode(criterion: &mut Criterion) {
    let cells = Cells::new().expect("the default protocol");
    let mut group = criterion.benchmark_group("evaluation episode");
    group.throughput(Throughput::Elements(EPISODES)).sample_size(10);
    for crowd in [CrowdKind::Nh, CrowdKind::Vo, CrowdKind::Sf] {
        group.bench_function(BenchmarkId::from_parameter(crowd), |bencher| {
            bencher.iter(|| cells.run(crowd, EPISODES).expect("a crowd"));
        });
    }
}
