//! Things for a person to look at: episodes on a page, a live page, learning curves and other
//! pictures.
//!
//! Reading order: [`replay`] (episodes as one page), [`play`] (a policy in real time), [`demo`]
//! (the first of these that a newcomer sees); [`board`] (the leaderboard), [`curves`] (what is
//! drawn of runs), [`draw`] (the only place that knows the plotting library), [`picture`] (files).
//!
//! Architecture invariant: pages need no network; what is on them was simulated by the code that
//! the tests of robots use.

#![forbid(unsafe_code)]

pub mod board;
pub mod curves;
pub mod demo;
pub mod draw;
pub mod picture;
pub mod play;
pub mod recording;
pub mod replay;
