//! The repository and its checks. One program for all files: a program for each
//! would take minutes to link.

mod common;

mod book;
mod conformance;
mod hostile_quick;
mod tidy;
