//! Steps of crowds on open ground.

use criterion::{BenchmarkId, Criterion, Throughput};
use jostle_bench::crowds::{OrcaScene, SocialForceScene};

pub(crate) fn orca(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ORCA step");
    for n_agents in [5, 100, 1_000, 10_000] {
        group.throughput(Throughput::Elements(n_agents as u64));
        for (how, parallel) in [("one thread", false), ("parallel", true)] {
            let mut scene = OrcaScene::new(n_agents).expect("a scene");
            group.bench_function(BenchmarkId::new(how, n_agents), |bencher| {
                bencher.iter(|| scene.step(parallel));
            });
        }
    }
}

pub(crate) fn social_force(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("social-force step");
    for n_walkers in [5, 20, 100] {
        let mut scene = SocialForceScene::new(n_walkers).expect("a scene");
        group.throughput(Throughput::Elements(n_walkers as u64));
        group.bench_function(BenchmarkId::from_parameter(n_walkers), |bencher| bencher.iter(|| scene.step()));
    }
}
