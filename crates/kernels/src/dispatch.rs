//! The instruction set that the kernels use, found once at run time, and the one place that chooses
//! between them.

use std::sync::OnceLock;

/// An instruction set that this processor has.
///
/// The value is proof of that: outside this module it can only be had from [`detect`](Self::detect)
/// and [`available`](Self::available), which ask the processor. The build stays portable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Isa(Level);

/// The sets that there are kernels for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    Avx512,
    Avx2,
    Plain,
}

static CHOSEN: OnceLock<Isa> = OnceLock::new();

impl Isa {
    /// The widest set of this processor, asked once; or the one that was [chosen](Self::choose).
    pub fn detect() -> Self {
        *CHOSEN.get_or_init(|| Self::available()[0])
    }

    /// Makes this set the answer of [`detect`](Self::detect) in this process, to measure what
    /// another processor would do. It has to come first: `false` if another set is the answer
    /// already.
    pub fn choose(self) -> bool {
        *CHOSEN.get_or_init(|| self) == self
    }

    /// All sets of this processor that there are kernels for, the widest first; plain Rust is
    /// always there.
    pub fn available() -> Vec<Self> {
        let mut found = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            // BMI1 and POPCNT are in every processor with AVX2: the sparse kernels walk over bits
            // and count them.
            let has_avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("popcnt");
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

    /// A name for arguments: `avx512`, `avx2` or `plain`.
    pub fn key(self) -> &'static str {
        match self.0 {
            Level::Avx512 => "avx512",
            Level::Avx2 => "avx2",
            Level::Plain => "plain",
        }
    }

    /// `true` if multiply-adds are rounded once. All sets that do so give the same bits.
    pub fn is_fused(self) -> bool {
        self.0 != Level::Plain
    }

    /// For [`on_set`].
    pub(crate) fn level(self) -> Level {
        self.0
    }

    /// Does some work in code that was compiled for this instruction set.
    ///
    /// The bits are those of plain Rust: the compiler neither fuses multiply-adds nor reorders sums
    /// by itself.
    pub fn run<W: Work>(self, work: W) -> W::Output {
        // SAFETY: the functions have no other condition than the set.
        unsafe { on_set!(self, run(work)) }
    }
}

/// Calls one function of the module `avx512`, `avx2` or `plain`, those that are in scope, as an
/// [`Isa`] says. All that a function asks of the processor is proven by the `Isa`; the caller's
/// `unsafe` block answers for the rest of its conditions.
macro_rules! on_set {
    ($isa:expr, $function:ident $(::<$constant:ident>)? ($($operand:expr),* $(,)?)) => {
        match $isa.level() {
            #[cfg(target_arch = "x86_64")]
            $crate::dispatch::Level::Avx512 => avx512::$function$(::<$constant>)?($($operand),*),
            #[cfg(target_arch = "x86_64")]
            $crate::dispatch::Level::Avx2 => avx2::$function$(::<$constant>)?($($operand),*),
            _ => plain::$function$(::<$constant>)?($($operand),*),
        }
    };
}
pub(crate) use on_set;

/// Plain Rust that gains from wide registers. [`Isa::run`] compiles it once for each instruction
/// set.
///
/// Only what is inlined into [`run`](Self::run) is compiled anew, so hot functions below it are
/// `#[inline(always)]`.
pub trait Work {
    /// The result.
    type Output;
    /// The work; `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

/// [`Work`] compiled for one set.
macro_rules! run {
    ($set:ident $(#[$feature:meta])?) => {
        mod $set {
            use super::Work;

            /// # Safety
            ///
            /// The processor has the instruction set.
            $(#[$feature])?
            pub(super) unsafe fn run<W: Work>(work: W) -> W::Output {
                work.run()
            }
        }
    };
}
#[cfg(target_arch = "x86_64")]
run!(avx512 #[target_feature(enable = "avx512f,avx2,bmi1,popcnt")]);
#[cfg(target_arch = "x86_64")]
run!(avx2 #[target_feature(enable = "avx2,bmi1,popcnt")]);
run!(plain);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_set_cannot_be_chosen_once_one_is_in_use() {
        let detected = Isa::detect();
        for isa in Isa::available() {
            assert_eq!(isa.choose(), isa == detected, "{}", isa.name());
        }
        assert_eq!(Isa::detect(), detected);
        assert_eq!(detected, Isa::available()[0]);
    }
}
