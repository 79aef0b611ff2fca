//! A scan, the bodies' motion, and the whole environment step.

use criterion::{BenchmarkId, Criterion, Throughput};
use jostle_bench::scenes::{Parts, SCENES, Stepping};

/// Rooms side by side in a whole step: as many as keep a core busy.
const ROOMS: usize = 8;

pub(crate) fn scan(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("scan");
    for (name, scene) in SCENES {
        let mut parts = Parts::new(scene).expect("a scene");
        group.throughput(Throughput::Elements(parts.scan() as u64));
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| bencher.iter(|| parts.scan()));
    }
}

pub(crate) fn physics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("physics");
    for (name, scene) in SCENES {
        let mut parts = Parts::new(scene).expect("a scene");
        group.throughput(Throughput::Elements(parts.advance() as u64));
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| bencher.iter(|| parts.advance()));
    }
}

pub(crate) fn env_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("env step");
    for (name, scene) in SCENES {
        let mut stepping = Stepping::new(scene, ROOMS).expect("a scene");
        group.throughput(Throughput::Elements(stepping.step() as u64));
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| bencher.iter(|| stepping.step()));
    }
}
