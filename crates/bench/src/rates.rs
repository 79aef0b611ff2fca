//! Rates of the machine itself: yardsticks measured beside the work, on the same threads.

use std::hint::black_box;

use candle_core::{DType, Device, Tensor};
use jostle_kernels::{Finish, Grid, HALF, Isa, PANEL, Start, Strips, rows_times_panel};

use crate::clock::{Round, Stopwatch};
use crate::error::BenchError;

/// Side of the square matrices of the general product.
const SIDE: usize = 1024;

/// Operations per second of a general product of two 1024 × 1024 matrices of f32 (candle on the
/// crate gemm, with AVX-512 where there is AVX-512), on the threads of the pool that calls.
///
/// # Errors
///
/// When candle refuses the product.
pub fn sgemm(threads: usize) -> Result<f64, BenchError> {
    let a = Tensor::ones((SIDE, SIDE), DType::F32, &Device::Cpu)?;
    let b = Tensor::ones((SIDE, SIDE), DType::F32, &Device::Cpu)?;
    a.matmul(&b)?;
    let mut failure = None;
    let round = Round::repeat(threads, || {
        failure = black_box(a.matmul(&b)).err();
        2.0 * (SIDE * SIDE * SIDE) as f64
    });
    failure.map_or(Ok(round.units / round.seconds), |error| Err(error.into()))
}

/// Operations per second, on one thread, of the kernels' own product on operands that stay in the
/// first-level cache: what the processor gives at its present clock.
pub fn in_cache() -> f64 {
    const CALLS: usize = 2000;
    let (a, panel) = (vec![0.5; 14 * 256], vec![0.5; 256 * PANEL]);
    let mut out = vec![0.0; 14 * PANEL];
    let isa = Isa::detect();
    let mut calls = || {
        for _ in 0..CALLS {
            let strips = Strips { data: black_box(&a), blocks: 16, block_len: 16, block_stride: 14 * 16 };
            let grid = Grid { data: black_box(&mut out[..]), row: PANEL, half: HALF };
            rows_times_panel::<16>(isa, 14, strips, &panel, Start::Zero, Finish::Store, grid);
        }
        (2 * CALLS * 14 * 256 * PANEL) as f64
    };
    calls();
    let round = Round::repeat(1, calls);
    round.units / round.seconds
}

/// The instruction set that the kernels found.
pub fn instruction_set() -> &'static str {
    Isa::detect().name()
}

/// Makes the kernels use the instruction set of this name (`avx512`, `avx2` or `plain`) instead of
/// the widest, for the whole process. candle's product and the simulator's laser keep their own
/// choice.
///
/// # Errors
///
/// When the processor has no such set, or a kernel has run with another.
pub fn choose_instruction_set(name: &str) -> Result<(), BenchError> {
    let sets = Isa::available();
    if sets.iter().any(|isa| isa.key() == name && isa.choose()) {
        return Ok(());
    }
    let names: Vec<&str> = sets.iter().map(|isa| isa.key()).collect();
    let expected = format!("one of {}, before anything runs", names.join(", "));
    Err(BenchError::InstructionSet { found: name.to_owned(), expected })
}

/// Seconds that one call takes, for work too long to be repeated.
pub fn once<T>(threads: usize, work: impl FnOnce() -> T) -> (T, f64) {
    let watch = Stopwatch::start(threads);
    let result = work();
    (result, watch.seconds())
}
