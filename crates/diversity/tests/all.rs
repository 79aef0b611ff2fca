//! Discriminators and D, tested from outside. One program for all files: a program for each
//! would take minutes to link.

mod kl_fixture;
mod networks;
