//! The paper's study: its figures and claims as data, the rows that its tables need with their
//! training, the policies that are shipped for them, and what is printed beside the paper's
//! figures.
//!
//! Reading order: [`paper`] (its tables), [`claims`] and [`verdicts`] (what its text says, tested),
//! [`cell`] (one robot in one crowd), [`reproduce`] (rows, tables, figures), [`ship`] and
//! [`verify`] (what the repository holds of them); [`leaderboard`] (robots on harder places, beyond
//! the paper).
//!
//! Architecture invariants: nothing here trains; who trains is handed in
//! ([`reproduce::Trainings`]). No number of the paper is anywhere but in [`paper`] and
//! [`claims::of_paper`].

#![forbid(unsafe_code)]

pub mod cell;
pub mod claims;
pub mod leaderboard;
pub mod paper;
pub mod reproduce;
pub mod ship;
pub mod success_tables;
pub mod verdicts;
pub mod verify;
