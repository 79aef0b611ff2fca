//! Training, tested from outside. One program for all files: a program for each
//! would take minutes to link.

mod common;

mod autograd;
mod back_ends;
mod configs;
mod contracts;
mod determinism_training;
mod gae_fixture;
mod hostile_files;
mod learning;
mod ranks;
