//! Tables and claims, tested from outside. One program for all files: a program for each
//! would take minutes to link.

#[path = "../../eval/tests/common/mod.rs"]
mod common;

mod claims;
mod reports;
