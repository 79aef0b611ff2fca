//! The vertices of static polygons, linked into rings.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.

use glam::Vec2;

/// A vertex and the edge that leaves it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub(super) point: Vec2,
    /// Unit vector to the next vertex.
    pub(super) direction: Vec2,
    /// Index of the next vertex of the ring.
    pub(super) next: u32,
    /// Index of the previous vertex of the ring.
    pub(super) previous: u32,
    /// True if the ring does not turn to the right here.
    pub(super) is_convex: bool,
}
