//! Which instruction set the kernels use, found once at run time.

use std::sync::OnceLock;

/// An instruction set that this processor has.
///
/// The value is proof of that: outside this module it can only be had from [`detect`](Self::detect) and
/// [`available`](Self::available), which ask the processor. The build stays portable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Isa(pub(crate) Level);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    Avx512,
    Avx2,
    Plain,
}

impl Isa {
    /// The widest set of this processor; asked once.
    pub fn detect() -> Self {
        static FOUND: OnceLock<Isa> = OnceLock::new();
        *FOUND.get_or_init(|| Self::available()[0])
    }

    /// All sets of this processor that there are kernels for, the widest first; plain Rust is always there.
    pub fn available() -> Vec<Self> {
        let mut found = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            // BMI1 and POPCNT are in every processor with AVX2: the sparse kernels walk over bits and count them.
            let has_avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("popcnt");
            // Some kernels for AVX-512 use parts for AVX2.
            if has_avx2 && is_x86_feature_detected!("avx512f") {
                found.push(Self(Level::Avx512));
            }
            if has_avx2 {
                found.push(Self(Level::Avx2));
            }
        }
        found.push(Self(Level::Plain));
        found
    }

    /// A name for reports.
    pub fn name(self) -> &'static str {
        match self.0 {
            Level::Avx512 => "AVX-512",
            Level::Avx2 => "AVX2 and FMA",
            Level::Plain => "plain",
        }
    }

    /// Does some work in code that was compiled for this instruction set.
    ///
    /// The bits are those of plain Rust: the compiler neither fuses multiply-adds nor reorders sums by itself.
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self.0 {
            // SAFETY: the value proves that the processor has the set (see `available`).
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { with_avx512(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { with_avx2(work) },
            _ => work.run(),
        }
    }
}

/// Plain Rust that gains from wide registers. [`Isa::run`] compiles it once for each instruction set.
///
/// Only what is inlined into [`run`](Self::run) is compiled anew, so hot functions below it are `#[inline(always)]`.
pub trait Work {
    /// What comes out.
    type Output;
    /// The work; `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,bmi1,popcnt")]
fn with_avx512<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,popcnt")]
fn with_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}
