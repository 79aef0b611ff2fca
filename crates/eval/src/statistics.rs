//! Statistics of success rates: the Wilson interval, `McNemar`'s tests and Newcombe's interval of a paired
//! difference, all in f64.
//!
//! Reading order: [`mod@wilson`], [`mcnemar`], [`newcombe`]; [`binomial`] holds the sums that they need.

pub mod binomial;
pub mod mcnemar;
pub mod newcombe;
pub mod wilson;

pub use mcnemar::{Mcnemar, PairedCounts};
pub use newcombe::paired_difference;
pub use wilson::{Interval, wilson};

/// Two-sided 95 % point of the standard normal distribution: Φ(z) = 0.975, not the rounded 1.96.
pub const Z_95: f64 = 1.959_963_984_540_054;
