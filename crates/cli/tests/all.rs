//! The program, tested as a user runs it. One program for all files: a program for each
//! would take minutes to link.

mod common;

mod bad_input;
mod experience;
mod hostile_disk;
mod leaderboard;
mod maps;
mod reproduce;
mod sweep;
mod train;
