//! The simulator, tested from outside. One program for all files: a program for each
//! would take minutes to link.

#[cfg(feature = "dynamics")]
mod dynamics;
#[cfg(all(feature = "png", feature = "toml", feature = "yaml"))]
mod hostile_maps;
mod lidar;
#[cfg(all(feature = "png", feature = "toml", feature = "yaml"))]
mod maps;
#[cfg(all(feature = "toml", feature = "yaml"))]
mod placement;
mod properties;
mod room_maps;
mod rooms;
mod sector;
mod symmetry;
