//! Where robots and goals appear: uniform in the room, by rejection with a bound on the tries.

use crate::config::SpawnConfig;
use crate::error::SimError;
use crate::geometry::Pose;
use crate::world::World;
use glam::Vec2;
use rand::Rng;
use rand_distr::{Distribution, Uniform};

/// Candidates tried for one start, one goal, or one pair of them.
const TRIES: u32 = 20_000;
/// Goals tried for one start before another start is drawn.
const GOALS_PER_START: u32 = 64;
/// Cells along each side of the grid on which [`Spawner::check_room`] measures the free area.
const GRID: u32 = 32;

/// Draws starts and goals for a world with walls.
#[derive(Clone, Debug)]
pub struct Spawner {
    config: SpawnConfig,
    x: Uniform<f32>,
    y: Uniform<f32>,
    heading: Uniform<f32>,
    inner: (Vec2, Vec2),
}

impl Spawner {
    /// A spawner for the room of `world`.
    ///
    /// # Errors
    ///
    /// When the world has no walls, or the walls are nearer to each other than twice the wall clearance.
    pub fn new(config: &SpawnConfig, world: &World) -> Result<Self, SimError> {
        let (min, max) =
            world.walls().ok_or_else(|| SimError::field("room", "no walls", "walls to spawn within"))?;
        let (low, high) = (min + config.wall_clearance, max - config.wall_clearance);
        let axis = |low: f32, high: f32| {
            Uniform::new_inclusive(low, high).ok().filter(|_| low < high).ok_or_else(|| {
                SimError::field(
                    "spawn.wall_clearance",
                    config.wall_clearance,
                    format!("less than half of the room's {} m by {} m", max.x - min.x, max.y - min.y),
                )
            })
        };
        let pi = std::f32::consts::PI;
        let heading = Uniform::new(-pi, pi).expect("a finite interval");
        let (x, y) = (axis(low.x, high.x)?, axis(low.y, high.y)?);
        Ok(Self { config: config.clone(), x, y, heading, inner: (low, high) })
    }

    /// A free start: at least the wall clearance from walls and obstacles and at least `clearance` from the centre
    /// of every body that `counts`; the heading is uniform.
    ///
    /// # Errors
    ///
    /// [`SimError::NoSpace`] when the bound on tries is reached.
    pub fn start(
        &self,
        world: &World,
        counts: impl Fn(usize) -> bool,
        clearance: f32,
        rng: &mut impl Rng,
    ) -> Result<Pose, SimError> {
        for _ in 0..TRIES {
            let point = self.point(rng);
            let far = |i: usize| world.pose(i).position.distance_squared(point) >= clearance * clearance;
            if (0..world.n_bodies()).all(|i| !counts(i) || far(i)) && self.is_clear(world, point) {
                return Ok(Pose::new(point, self.heading.sample(rng)));
            }
        }
        Err(SimError::NoSpace { what: "a start".into(), tries: TRIES })
    }

    /// A goal: at least the wall clearance from walls and obstacles, at least the goal distance from `start`.
    ///
    /// # Errors
    ///
    /// [`SimError::NoSpace`] when the bound on tries is reached.
    pub fn goal(&self, world: &World, start: Vec2, rng: &mut impl Rng) -> Result<Vec2, SimError> {
        self.try_goal(world, start, TRIES, rng)
            .ok_or_else(|| SimError::NoSpace { what: "a goal".into(), tries: TRIES })
    }

    /// A start with the configured body clearance and a goal for it. A start without a goal (in the middle of a small
    /// room) is drawn anew.
    ///
    /// # Errors
    ///
    /// [`SimError::NoSpace`] when the bound on tries is reached.
    pub fn start_and_goal(
        &self,
        world: &World,
        counts: impl Fn(usize) -> bool,
        rng: &mut impl Rng,
    ) -> Result<(Pose, Vec2), SimError> {
        for _ in 0..TRIES / GOALS_PER_START {
            let start = self.start(world, &counts, self.config.body_clearance, rng)?;
            if let Some(goal) = self.try_goal(world, start.position, GOALS_PER_START, rng) {
                return Ok((start, goal));
            }
        }
        Err(SimError::NoSpace { what: "a start with a goal".into(), tries: TRIES })
    }

    /// Tells before anything runs whether `n_bodies` will always find a place.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] when the other bodies' discs could cover 80 % of the free area, or when fewer than one in
    /// a thousand pairs of free points are a goal distance apart (measured on a grid of 32 by 32 points).
    pub fn check_room(&self, world: &World, n_bodies: usize) -> Result<(), SimError> {
        let (low, high) = self.inner;
        let cell = (high - low) / GRID as f32;
        let centre = |i: u32| low + cell * (Vec2::new((i % GRID) as f32, (i / GRID) as f32) + 0.5);
        let free: Vec<Vec2> = (0..GRID * GRID).map(centre).filter(|p| self.is_clear(world, *p)).collect();
        let area = free.len() as f32 * cell.x * cell.y;
        let covered =
            n_bodies.saturating_sub(1) as f32 * std::f32::consts::PI * self.config.body_clearance.powi(2);
        if covered >= 0.8 * area {
            return Err(SimError::field(
                "n_agents",
                n_bodies,
                format!(
                    "so few that their spawn clearances cover less than 80 % of {area:.1} m² of free area"
                ),
            ));
        }
        let reach = self.config.goal_distance.powi(2);
        let goals = |a: &Vec2| free.iter().filter(|b| a.distance_squared(**b) >= reach).count();
        let pairs: usize = free.iter().map(goals).sum();
        if pairs * 1000 < free.len() * free.len() {
            return Err(SimError::field(
                "spawn.goal_distance",
                self.config.goal_distance,
                "a distance that fits into the room",
            ));
        }
        Ok(())
    }

    fn try_goal(&self, world: &World, start: Vec2, tries: u32, rng: &mut impl Rng) -> Option<Vec2> {
        let reach = self.config.goal_distance.powi(2);
        (0..tries)
            .map(|_| self.point(rng))
            .find(|point| point.distance_squared(start) >= reach && self.is_clear(world, *point))
    }

    fn point(&self, rng: &mut impl Rng) -> Vec2 {
        let x = self.x.sample(rng);
        Vec2::new(x, self.y.sample(rng))
    }

    /// Points are drawn within the walls' clearance, so only obstacles remain to be tested.
    fn is_clear(&self, world: &World, point: Vec2) -> bool {
        world.n_obstacles() == 0 || world.clearance(point) >= self.config.wall_clearance * (1.0 - 1e-6)
    }
}
