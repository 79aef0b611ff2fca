//! A k-d tree over the agents: the nearest neighbours of each, in RVO2's order.
//!
//! SPDX-FileCopyrightText: 2008 University of North Carolina at Chapel Hill
//! SPDX-License-Identifier: Apache-2.0
//!
//! Licensed under the Apache License, Version 2.0 (`LICENSE-APACHE` of this crate). Ported to Rust
//! from the RVO2 Library (snape/RVO2, <https://gamma.cs.unc.edu/RVO2/>) by Jur van den Berg,
//! Stephen J. Guy, Jamie Snape, Ming C. Lin and Dinesh Manocha; changed: see `NOTICE`.
//!
//! The same splits, the same visiting order and the same strict comparisons as RVO2, so that the
//! neighbour lists agree even where distances tie; but over packed entries of 12 bytes in tree
//! order instead of pointers to agents.

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

    /// Builds the nodes depth first. With an explicit stack: agents at one point make a tree as
    /// deep as their number.
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

    /// Collects the at most `max_neighbours` nearest others of the agent at `slot` with squared
    /// distance below `range_sq`, sorted by distance; ties keep the tree's order.
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

/// Moves the entries below the middle of the longer side to the front; returns how many (at least
/// one).
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

/// Inserts behind all that are as near, drops the farthest when there are too many, and then
/// narrows the range.
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

#[cfg(test)]
mod tests {
    use super::*;

    use rand::RngExt;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    use crate::orca::AgentParameters;

    fn agents(positions: &[Vec2]) -> Vec<Agent> {
        let parameters = AgentParameters {
            neighbour_distance: 10.0,
            max_neighbours: 10,
            time_horizon: 2.0,
            time_horizon_obstacles: 2.0,
            radius: 0.25,
            max_speed: 1.0,
        };
        let agent = |(i, position): (usize, &Vec2)| Agent {
            position: *position,
            velocity: Vec2::splat(i as f32),
            preferred_velocity: Vec2::ZERO,
            planned_velocity: Vec2::ZERO,
            parameters,
        };
        positions.iter().enumerate().map(agent).collect()
    }

    fn scattered(n: usize, seed: u64) -> Vec<Vec2> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || 8.0 * rng.random::<f32>() - 3.0;
        (0..n).map(|_| Vec2::new(draw(), 0.5 * draw())).collect()
    }

    fn tree(positions: &[Vec2]) -> AgentTree {
        let mut tree = AgentTree::default();
        tree.build(&agents(positions));
        tree
    }

    #[test]
    fn the_nearest_are_found_as_by_comparing_all() {
        for (n, seed) in [(1, 0), (9, 1), (40, 2), (150, 3)] {
            let tree = tree(&scattered(n, seed));
            let mut search = Search::default();
            for (most, range) in [(0, 9.0_f32), (3, 9.0), (10, 1.5), (1000, 2.5)] {
                for slot in 0..n {
                    tree.neighbours(slot, most, range * range, &mut search);
                    let at = tree.bodies[slot].position;
                    let mut expected: Vec<(f32, u32)> = (0..n)
                        .filter(|other| *other != slot)
                        .map(|other| (tree.bodies[other].position.distance_squared(at), other as u32))
                        .filter(|(distance_sq, _)| *distance_sq < range * range)
                        .collect();
                    expected.sort_by(|a, b| a.0.total_cmp(&b.0));
                    expected.truncate(most);
                    let found: Vec<(f32, u32)> =
                        search.found.iter().map(|found| (found.distance_sq, found.slot)).collect();
                    assert_eq!(found, expected, "{n} agents, at most {most} within {range}");
                }
            }
        }
    }

    #[test]
    fn nodes_are_tight_boxes_split_in_the_middle_of_the_longer_side() {
        let tree = tree(&scattered(150, 4));
        for (i, node) in tree.nodes.iter().enumerate() {
            let (begin, end) = (node.begin as usize, node.end as usize);
            let positions = || tree.entries[begin..end].iter().map(|entry| entry.position);
            assert_eq!(node.min, positions().reduce(Vec2::min).unwrap());
            assert_eq!(node.max, positions().reduce(Vec2::max).unwrap());
            assert_eq!(node.right == 0, end - begin <= MAX_LEAF);
            if node.right == 0 {
                continue;
            }
            let (left, right) = (tree.nodes[i + 1], tree.nodes[node.right as usize]);
            assert_eq!((left.begin, left.end, right.end), (node.begin, right.begin, node.end));
            let (size, middle) = (node.max - node.min, 0.5 * (node.min + node.max));
            let is_left = |at: Vec2| if size.x > size.y { at.x < middle.x } else { at.y < middle.y };
            for (k, at) in positions().enumerate() {
                assert_eq!(is_left(at), begin + k < left.end as usize);
            }
        }
    }

    #[test]
    fn distances_to_a_box_by_hand() {
        // The box is 2 × 1 m.
        let tree = tree(&[Vec2::ZERO, Vec2::new(2.0, 1.0)]);
        let distance_sq = |x, y| tree.box_distance_sq(0, Vec2::new(x, y));
        assert_eq!(distance_sq(1.0, 0.5), 0.0);
        assert_eq!((distance_sq(-3.0, 0.5), distance_sq(4.0, 0.5)), (9.0, 4.0));
        assert_eq!((distance_sq(1.0, -1.5), distance_sq(1.0, 3.0)), (2.25, 4.0));
        assert_eq!((distance_sq(-3.0, -4.0), distance_sq(5.0, 5.0)), (25.0, 25.0));
    }

    #[test]
    fn equals_keep_the_order_in_which_they_come() {
        let (mut found, mut range_sq) = (Vec::new(), 9.0);
        for (slot, distance_sq) in [(0, 4.0), (1, 1.0), (2, 4.0), (3, 1.0), (4, 2.0)] {
            insert(&mut found, 4, AgentNeighbour { distance_sq, slot }, &mut range_sq);
            assert_eq!(range_sq, if slot < 3 { 9.0 } else { 4.0 });
        }
        assert_eq!(found.iter().map(|f| f.slot).collect::<Vec<_>>(), [1, 3, 4, 0]);
    }

    #[test]
    fn a_cleared_tree_forgets_the_order() {
        let positions = scattered(60, 5);
        let mut used = tree(&scattered(60, 6));
        used.clear();
        used.build(&agents(&positions));
        let fresh = tree(&positions);
        let order = |tree: &AgentTree| tree.bodies.iter().map(|body| body.agent).collect::<Vec<_>>();
        assert_eq!(order(&used), order(&fresh));
        for body in &fresh.bodies {
            assert_eq!(body.velocity, Vec2::splat(body.agent as f32));
            assert_eq!((body.position, body.radius), (positions[body.agent as usize], 0.25));
        }
    }
    #[test]
    fn the_range_is_open_and_of_equally_near_ones_the_first_are_kept() {
        let tree = tree(&[Vec2::ZERO, 2.0 * Vec2::X, -2.0 * Vec2::X, 2.0 * Vec2::Y]);
        let mut search = Search::default();
        let mut found = |most, range_sq| {
            tree.neighbours(0, most, range_sq, &mut search);
            search.found.iter().map(|found| found.slot).collect::<Vec<_>>()
        };
        assert!(found(9, 4.0).is_empty());
        assert_eq!(found(9, 4.1), [1, 2, 3]);
        assert_eq!(found(2, 4.1), [1, 2]);
    }
}
