//! One register of floats for each instruction set, with what the products need of it.
//!
//! Each module has a type `V` of `LANES` floats and the same functions on it, so that one body of a
//! product is compiled for every set ([`dense`](crate::dense), [`sparse`](crate::sparse)):
//!
//! | function | result |
//! |---|---|
//! | `zero`, `splat`, `load`, `store` | a register from nothing, one value, memory; and back |
//! | `broadcast` | one value in every lane, by way of a general register |
//! | `add`, `fma` | a + b; a · b + c, rounded once (in `plain` twice) |
//! | `relu` | max(x, 0) |
//! | `not_zero` | bit i is set where lane i is not zero |
//! | `keep` | lane i where bit i is set, else 0 |
//! | `keep_positive` | lane i where lane i of another register is positive, else 0 |
//! | `transpose` | the columns of a square |
//! | `prefetch_near`, `prefetch_far` | no result; a line on its way to the first- or second-level cache |

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod plain;
