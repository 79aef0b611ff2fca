//! Starts and goals: uniform over the places of the room in which a body can be.
//!
//! A draw is a rejection first: points of the room until one holds, with a bound on the tries.
//! Where the bound is reached, the cells of the enumerated free space are asked instead
//! (`free_space`), from the same stream; so a draw never fails, and in a room in which the first
//! part succeeds the second changes no bit. The rules, in the order in which they give way:
//!
//! 1. A start or a goal keeps the wall clearance, and a goal can be reached from its start.
//! 2. A start keeps the body clearance. [`Spawner::check_room`] refuses rooms in which that could
//!    become impossible.
//! 3. A goal is a goal distance away, and a start has such a goal. [`Spawner::new`] refuses rooms
//!    without.
//! 4. A re-spawned body keeps its larger clearance; where none does, it gets the place that is
//!    farthest from all bodies.
//! 5. A body that has arrived where no goal is far enough gets the farthest place there is.

use crate::config::SimConfig;
use crate::error::SimError;
use crate::free_space::{Demands, FreeSpace};
use crate::geometry::Pose;
use crate::world::World;
use glam::Vec2;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Uniform};
use std::sync::Arc;

/// Candidates tried for one start, one goal, or one pair of them.
const TRIES: u32 = 20_000;
/// Goals tried for one start before another start is drawn.
const GOALS_PER_START: u32 = 64;
/// Points tried within one cell before its middle is taken.
const TRIES_PER_CELL: u32 = 16;
/// Largest share of the places that the other bodies' discs may cover.
const COVERED_MAX: f32 = 0.8;

/// Draws starts and goals for a world with walls.
///
/// It knows the obstacles that the world had when it was made: a world that gets another one needs
/// another spawner.
#[derive(Clone, Debug)]
pub struct Spawner {
    wall_clearance: f32,
    body_clearance: f32,
    /// Least `body_clearance` of two bodies, m.
    body_clearance_min: f32,
    goal_distance: f32,
    x: Uniform<f32>,
    y: Uniform<f32>,
    heading: Uniform<f32>,
    /// True if the room has no obstacle: every point that is drawn is then a place.
    open: bool,
    space: Arc<FreeSpace>,
}

impl Spawner {
    /// A spawner for the room of `world`.
    ///
    /// # Errors
    ///
    /// When the world has no walls, the walls are nearer to each other than twice the wall
    /// clearance, or no two places that can be reached from one another are a goal distance apart.
    pub fn new(config: &SimConfig, world: &World) -> Result<Self, SimError> {
        let walls =
            world.walls().ok_or_else(|| SimError::field("room", "no walls", "walls to spawn within"))?;
        let (min, max) = walls;
        let spawn = &config.spawn;
        let (low, high) = (min + spawn.wall_clearance, max - spawn.wall_clearance);
        let axis = |low: f32, high: f32| {
            Uniform::new_inclusive(low, high).ok().filter(|_| low < high).ok_or_else(|| {
                SimError::field(
                    "spawn.wall_clearance",
                    spawn.wall_clearance,
                    format!("less than half of the room's {} m by {} m", max.x - min.x, max.y - min.y),
                )
            })
        };
        let pi = std::f32::consts::PI;
        let heading = Uniform::new(-pi, pi).expect("a finite interval");
        let (x, y) = (axis(low.x, high.x)?, axis(low.y, high.y)?);
        let demands = Demands {
            radius: config.passing_radius(),
            wall_clearance: spawn.wall_clearance,
            goal_distance: spawn.goal_distance,
        };
        let space = FreeSpace::new(demands, walls, world);
        if !space.has_places() {
            return Err(no_places(config, &space));
        }
        Ok(Self {
            wall_clearance: spawn.wall_clearance,
            body_clearance: spawn.body_clearance,
            body_clearance_min: config.body_clearance_min(),
            goal_distance: spawn.goal_distance,
            x,
            y,
            heading,
            open: world.n_obstacles() == 0,
            space: Arc::new(space),
        })
    }

    /// Tells before anything runs whether `n_bodies` will always find a place.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] when the body clearance lets two bodies crash where they start,
    /// [`SimError::RoomTooSmall`] when the other bodies' discs could cover 80 % of the area in
    /// which a start can be.
    pub fn check_room(&self, n_bodies: usize) -> Result<(), SimError> {
        let n_others = n_bodies.saturating_sub(1);
        if n_others > 0 && self.body_clearance < self.body_clearance_min {
            return Err(SimError::field(
                "spawn.body_clearance",
                self.body_clearance,
                format!(
                    "at least {} m, a body's radius and the crash range, so that no start is a crash",
                    self.body_clearance_min
                ),
            ));
        }
        let area = self.space.area();
        let covered = n_others as f32 * std::f32::consts::PI * self.body_clearance.powi(2);
        if covered >= COVERED_MAX * area || !self.space.holds(n_others, self.body_clearance) {
            return Err(SimError::RoomTooSmall { n_bodies, free_area: area });
        }
        Ok(())
    }

    /// A start with the configured body clearance from every body that `counts`, its heading
    /// uniform, and a goal for it. A start without a goal (in the middle of a small room) is drawn
    /// anew.
    pub fn start_and_goal(
        &self,
        world: &World,
        counts: impl Fn(usize) -> bool,
        rng: &mut impl Rng,
    ) -> (Pose, Vec2) {
        let far = |point: Vec2| is_far(world, &counts, point, self.body_clearance);
        for _ in 0..TRIES / GOALS_PER_START {
            let Some(start) = self.try_start(world, far, rng) else { break };
            if let Some(goal) = self.try_goal(world, start.position, GOALS_PER_START, rng) {
                return (start, goal);
            }
        }
        let start = self.listed_start(world, &counts, self.body_clearance, rng);
        (start, self.goal(world, start.position, rng))
    }

    /// A place for a body that is put elsewhere, at least `clearance` from every body that
    /// `counts`, its heading uniform, and a goal for it. Where no place is so far from all of them,
    /// it is the farthest.
    pub fn respawn(
        &self,
        world: &World,
        counts: impl Fn(usize) -> bool,
        clearance: f32,
        rng: &mut impl Rng,
    ) -> (Pose, Vec2) {
        let holds = |point: Vec2| {
            is_far(world, &counts, point, clearance)
                && self.region(point).is_some_and(|region| self.space.has_goal(region, point))
        };
        let start = self.try_start(world, holds, rng);
        let start = start.unwrap_or_else(|| self.listed_start(world, &counts, clearance, rng));
        (start, self.goal(world, start.position, rng))
    }

    /// A goal for a body at `start`: it keeps the wall clearance and the goal distance and can be
    /// reached. Where no place is a goal distance away, it is the farthest.
    pub fn goal(&self, world: &World, start: Vec2, rng: &mut impl Rng) -> Vec2 {
        let region = self.nearest_region(start);
        if !self.space.has_goal(region, start) {
            return self.space.farthest(region, start);
        }
        self.try_goal(world, start, TRIES, rng).unwrap_or_else(|| self.listed_goal(world, region, start, rng))
    }

    /// True if a body gets from one point to the other without a crash into a wall or an obstacle.
    pub fn connects(&self, a: Vec2, b: Vec2) -> bool {
        self.open || self.space.connects(a, b)
    }

    fn try_start(&self, world: &World, holds: impl Fn(Vec2) -> bool, rng: &mut impl Rng) -> Option<Pose> {
        for _ in 0..TRIES {
            let point = self.point(rng);
            if holds(point) && self.is_place(world, point) {
                return Some(Pose::new(point, self.heading.sample(rng)));
            }
        }
        None
    }

    fn try_goal(&self, world: &World, start: Vec2, tries: u32, rng: &mut impl Rng) -> Option<Vec2> {
        let (reach, region) = (self.goal_distance.powi(2), self.nearest_region(start));
        (0..tries).map(|_| self.point(rng)).find(|point| {
            point.distance_squared(start) >= reach
                && self.is_place(world, *point)
                && self.region(*point) == Some(region)
        })
    }

    /// A start in one of the enumerated places that are at least `clearance` from all bodies, or in
    /// the farthest.
    fn listed_start(
        &self,
        world: &World,
        counts: &impl Fn(usize) -> bool,
        clearance: f32,
        rng: &mut impl Rng,
    ) -> Pose {
        let far = |point: Vec2| is_far(world, counts, point, clearance);
        let cells = self.space.places().filter(|cell| far(self.space.centre(*cell)));
        let position = match pick(cells, rng) {
            Some(cell) => self.within(cell, rng, |point| {
                let has_goal = |region| self.space.has_goal(region, point);
                far(point) && self.is_place(world, point) && self.region(point).is_some_and(has_goal)
            }),
            None => self.freest(world, counts),
        };
        Pose::new(position, self.heading.sample(rng))
    }

    /// The place that is farthest from all bodies; the first of several.
    fn freest(&self, world: &World, counts: &impl Fn(usize) -> bool) -> Vec2 {
        let nearest_body = |point: Vec2| {
            let bodies = (0..world.n_bodies()).filter(|body| counts(*body));
            let distances = bodies.map(|body| world.pose(body).position.distance_squared(point));
            distances.fold(f32::INFINITY, f32::min)
        };
        let further = |best: (f32, Vec2), point: Vec2| {
            let found = nearest_body(point);
            if found > best.0 { (found, point) } else { best }
        };
        let centres = self.space.places().map(|cell| self.space.centre(cell));
        centres.fold((f32::NEG_INFINITY, Vec2::ZERO), further).1
    }

    /// A goal in one of the enumerated places of a region that are far enough from `start`, or in
    /// the farthest.
    fn listed_goal(&self, world: &World, region: u32, start: Vec2, rng: &mut impl Rng) -> Vec2 {
        let reach = self.goal_distance.powi(2);
        let far = |point: Vec2| point.distance_squared(start) >= reach;
        let in_region = |point: Vec2| self.region(point) == Some(region);
        let cells = self.space.places().filter(|cell| {
            let centre = self.space.centre(*cell);
            far(centre) && in_region(centre)
        });
        match pick(cells, rng) {
            Some(cell) => {
                self.within(cell, rng, |point| far(point) && self.is_place(world, point) && in_region(point))
            }
            None => self.space.farthest(region, start),
        }
    }

    /// A uniform point of a cell that holds, or its middle, which is known to hold.
    fn within(&self, cell: usize, rng: &mut impl Rng, holds: impl Fn(Vec2) -> bool) -> Vec2 {
        let (centre, size) = (self.space.centre(cell), self.space.cell());
        let mut part = || rng.random::<f32>() - 0.5;
        let mut points = (0..TRIES_PER_CELL).map(|_| centre + size * Vec2::new(part(), part()));
        points.find(|point| holds(*point)).unwrap_or(centre)
    }

    fn point(&self, rng: &mut impl Rng) -> Vec2 {
        let x = self.x.sample(rng);
        Vec2::new(x, self.y.sample(rng))
    }

    /// Points are drawn within the walls' clearance, so only obstacles remain to be tested.
    fn is_place(&self, world: &World, point: Vec2) -> bool {
        let measured = || world.clearance(point) >= self.wall_clearance * (1.0 - 1e-6);
        self.open
            || (self.space.region(point).is_some() && self.space.is_clear(point).unwrap_or_else(measured))
    }

    /// The region of a point that was drawn; an open room is one region, up to its walls.
    fn region(&self, point: Vec2) -> Option<u32> {
        if self.open { Some(0) } else { self.space.region(point) }
    }

    fn nearest_region(&self, point: Vec2) -> u32 {
        if self.open { 0 } else { self.space.nearest_region(point) }
    }
}

/// True if every body that counts has its centre at least `clearance` away from a point.
fn is_far(world: &World, counts: &impl Fn(usize) -> bool, point: Vec2, clearance: f32) -> bool {
    let far = |body: usize| world.pose(body).position.distance_squared(point) >= clearance * clearance;
    (0..world.n_bodies()).all(|body| !counts(body) || far(body))
}

/// One of the cells, each as likely as any other.
fn pick(mut cells: impl Iterator<Item = usize> + Clone, rng: &mut impl Rng) -> Option<usize> {
    let n = cells.clone().count();
    (n > 0).then(|| rng.random_range(0..n)).and_then(|k| cells.nth(k))
}

/// The error for a room without a start.
fn no_places(config: &SimConfig, space: &FreeSpace) -> SimError {
    if space.diameter == 0.0 {
        return SimError::field(
            "spawn.wall_clearance",
            config.spawn.wall_clearance,
            "a distance from walls and obstacles that leaves free places in the room",
        );
    }
    SimError::GoalTooFar { found: config.spawn.goal_distance, largest: space.diameter }
}
