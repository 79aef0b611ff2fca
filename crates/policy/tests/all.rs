//! Networks and policy files, tested from outside. One program for all files: a program for each
//! would take minutes to link.

mod common;

mod back_ends;
mod encoder;
mod gradients;
mod initialisation;
mod policy_file;
