//! Statistics of success rates: the Wilson interval, `McNemar`'s tests and Newcombe's interval of a
//! paired difference; over training seeds Welch's interval, a permutation test and a hierarchical
//! bootstrap. All in f64.
//!
//! Reading order: [`mod@wilson`], [`mcnemar`], [`newcombe`] (episodes of two policies);
//! [`contrast`], [`bootstrap`] (training seeds); [`binomial`] and [`student`] hold the sums that
//! they need; [`tail`] is about the worst values.

pub mod binomial;
pub mod bootstrap;
pub mod contrast;
pub mod mcnemar;
pub mod newcombe;
pub mod student;
pub mod tail;
pub mod wilson;

pub use contrast::{Contrast, Permutation};
pub use mcnemar::{Mcnemar, PairedCounts};
pub use newcombe::paired_difference;
pub use tail::cvar;
pub(crate) use wilson::half_width_of_mean;
pub use wilson::{Interval, wilson};

/// Two-sided 95 % point of the standard normal distribution: Φ(z) = 0.975, not the rounded 1.96.
pub const Z_95: f64 = 1.959_963_984_540_054;
