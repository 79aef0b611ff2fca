//! Evaluation, tested from outside. One program for all files: a program for each
//! would take minutes to link.

mod common;

mod diversity;
mod dynamics;
mod loaded;
mod maps;
mod metric_fixtures;
mod own_crowd;
mod planners;
mod protocol;
mod recorded_sample;
mod recording;
mod replay;
mod sector;
mod suite;
mod validation_crowds;
mod visibility;
