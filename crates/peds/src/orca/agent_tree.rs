//! A k-d tree over the agents: the nearest neighbours of each, in RVO2's order.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust from the RVO2 Library
//! (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg, Stephen J. Guy, Jamie Snape, Ming C. Lin and
//! Dinesh Manocha; changed: see `NOTICE`.
//!
//! The same splits, the same visiting order and the same strict comparisons as RVO2, so that the neighbour lists agree
//! even where distances tie; but over packed entries of 12 bytes in tree order instead of pointers to agents.

use glam::Vec2;

use super::agent::{Agent, Body};

/// A node with at most this many agents is a leaf.
const MAX_LEAF: usize = 10;

#[derive(Debug, Clone, Copy)]
struct Entry {
    position: Vec2,
    agent: u32,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    min: Vec2,
    max: Vec2,
    begin: u32,
    end: u32,
    /// Index of the right child (the left one follows its parent); 0 in a leaf.
    right: u32,
}

/// An agent near another.
#[derive(Debug, Clone, Copy)]
pub(super) struct AgentNeighbour {
    pub(super) distance_sq: f32,
    /// Index into [`AgentTree::bodies`].
    pub(super) slot: u32,
}

/// Result and scratch memory of a search.
#[derive(Debug, Clone, Default)]
pub(super) struct Search {
    /// The neighbours, nearest first.
    pub(super) found: Vec<AgentNeighbour>,
    /// Far children still to be visited, with their squared distances.
    pending: Vec<(u32, f32)>,
}

/// The tree. Its order persists from step to step, as RVO2's does: it decides ties.
#[derive(Debug, Clone, Default)]
pub(super) struct AgentTree {
    entries: Vec<Entry>,
    nodes: Vec<Node>,
    /// The agents in tree order.
    pub(super) bodies: Vec<Body>,
}

impl AgentTree {
    /// Forgets the agents and their order.
    pub(super) fn clear(&mut self) {
        self.entries.clear();
    }

    /// Sorts the agents (those added since the last build come last) into the tree.
    pub(super) fn build(&mut self, agents: &[Agent]) {
        for agent in self.entries.len()..agents.len() {
            self.entries.push(Entry { position: Vec2::ZERO, agent: agent as u32 });
        }
        for entry in &mut self.entries {
            entry.position = agents[entry.agent as usize].position;
        }
        self.nodes.clear();
        if !self.entries.is_empty() {
            self.build_nodes();
        }
        self.bodies.clear();
        self.bodies.extend(self.entries.iter().map(|entry| {
            let agent = &agents[entry.agent as usize];
            Body {
                position: agent.position,
                velocity: agent.velocity,
                radius: agent.parameters.radius,
                agent: entry.agent,
            }
        }));
    }

    /// Builds the nodes depth first. With an explicit stack: agents at one point make a tree as deep as their number.
    fn build_nodes(&mut self) {
        const NO_PARENT: usize = usize::MAX;
        let mut pending = vec![(0, self.entries.len(), NO_PARENT)];
        while let Some((begin, end, parent_of_right)) = pending.pop() {
            let node = self.nodes.len();
            if parent_of_right != NO_PARENT {
                self.nodes[parent_of_right].right = node as u32;
            }
            let entries = &mut self.entries[begin..end];
            let (min, max) = bounds(entries);
            self.nodes.push(Node { min, max, begin: begin as u32, end: end as u32, right: 0 });
            if end - begin > MAX_LEAF {
                let middle = begin + partition(entries, min, max);
                pending.push((middle, end, node));
                pending.push((begin, middle, NO_PARENT));
            }
        }
    }

    /// Collects the at most `max_neighbours` nearest others of the agent at `slot` with squared distance below `range_sq`,
    /// sorted by distance; ties keep the tree's order.
    pub(super) fn neighbours(
        &self,
        slot: usize,
        max_neighbours: usize,
        mut range_sq: f32,
        search: &mut Search,
    ) {
        let Search { found, pending } = search;
        found.clear();
        if max_neighbours == 0 {
            return;
        }
        let position = self.entries[slot].position;
        pending.clear();
        let mut node = 0_u32;
        loop {
            let Node { begin, end, right, .. } = self.nodes[node as usize];
            if right == 0 {
                for (i, entry) in self.entries[begin as usize..end as usize].iter().enumerate() {
                    let distance_sq = (position - entry.position).length_squared();
                    let other = begin as usize + i;
                    if distance_sq < range_sq && other != slot {
                        insert(
                            found,
                            max_neighbours,
                            AgentNeighbour { distance_sq, slot: other as u32 },
                            &mut range_sq,
                        );
                    }
                }
            } else {
                let left = node + 1;
                let left_sq = self.box_distance_sq(left, position);
                let right_sq = self.box_distance_sq(right, position);
                let (near, near_sq, far, far_sq) = if left_sq < right_sq {
                    (left, left_sq, right, right_sq)
                } else {
                    (right, right_sq, left, left_sq)
                };
                if near_sq < range_sq {
                    pending.push((far, far_sq));
                    node = near;
                    continue;
                }
            }
            // The next far child that is still within range.
            loop {
                let Some((far, far_sq)) = pending.pop() else {
                    return;
                };
                if far_sq < range_sq {
                    node = far;
                    break;
                }
            }
        }
    }

    #[inline]
    fn box_distance_sq(&self, node: u32, position: Vec2) -> f32 {
        let Node { min, max, .. } = self.nodes[node as usize];
        let below = (min - position).max(Vec2::ZERO);
        let above = (position - max).max(Vec2::ZERO);
        below.x * below.x + above.x * above.x + below.y * below.y + above.y * above.y
    }
}

fn bounds(entries: &[Entry]) -> (Vec2, Vec2) {
    let first = entries[0].position;
    entries[1..]
        .iter()
        .fold((first, first), |(min, max), entry| (min.min(entry.position), max.max(entry.position)))
}

/// Moves the entries below the middle of the longer side to the front; returns how many (at least one).
fn partition(entries: &mut [Entry], min: Vec2, max: Vec2) -> usize {
    let is_x = max.x - min.x > max.y - min.y;
    let coordinate = |entry: &Entry| if is_x { entry.position.x } else { entry.position.y };
    let split = 0.5 * if is_x { max.x + min.x } else { max.y + min.y };
    let mut left = 0;
    let mut right = entries.len();
    while left < right {
        while left < right && coordinate(&entries[left]) < split {
            left += 1;
        }
        while right > left && coordinate(&entries[right - 1]) >= split {
            right -= 1;
        }
        if left < right {
            entries.swap(left, right - 1);
            left += 1;
            right -= 1;
        }
    }
    left.max(1)
}

/// Inserts behind all that are as near, drops the farthest when there are too many, and then narrows the range.
#[inline]
fn insert(found: &mut Vec<AgentNeighbour>, max_neighbours: usize, new: AgentNeighbour, range_sq: &mut f32) {
    if found.len() < max_neighbours {
        found.push(new);
    }
    let mut at = found.len() - 1;
    while at > 0 && new.distance_sq < found[at - 1].distance_sq {
        found[at] = found[at - 1];
        at -= 1;
    }
    found[at] = new;
    if found.len() == max_neighbours {
        *range_sq = found[max_neighbours - 1].distance_sq;
    }
}
