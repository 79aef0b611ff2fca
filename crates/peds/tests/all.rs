//! The crowd models, tested from outside. One program for all files: a program for each
//! would take minutes to link.

mod support;

mod crowds;
#[cfg(feature = "learned")]
mod learned;
mod orca_properties;
mod rvo2;
mod social_force;
mod social_force_properties;
