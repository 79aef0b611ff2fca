//! The world: a rapier scene of walls, obstacles and kinematic bodies, moved the way Stage moves
//! its models; bodies with a base ([`World::set_base`]) are moved by rapier's solver instead
//! (`dynamics`).
//!
//! One body after the other takes its Euler step; if it would then touch a body, a wall or an
//! obstacle, its whole pose is restored and it is stalled. None of rapier's ready body types does
//! that: dynamic bodies penetrate, slide, turn and push each other, velocity-based kinematic ones
//! pass through. So rapier keeps the scene (position-based kinematic bodies with colliders) and
//! parry decides on overlaps, but no velocity solver runs.
//!
//! Architecture invariant: the poses, and where there are bases their [`DriveState`]s, are the
//! whole physical state. Nothing here has a memory of the past (no contact cache, no sleeping
//! islands), so a world that is given the same state behaves the same to the last bit. The world
//! knows no goal, no episode and no reward.

use crate::config::BaseConfig;
use crate::dynamics::{Drive, DriveState};
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::motion::Motion;
use crate::solid::Solid;
use crate::trig::wrap_angle;
use glam::Vec2;
use rapier2d::prelude::{ColliderBuilder, ColliderSet, RigidBodyBuilder, RigidBodySet, SharedShape};

/// Most sub-steps of one move; a command that would need more (over 1 km for a half-metre body) is
/// refused as a stall.
const SUB_STEPS_MAX: f32 = 4096.0;

/// A room with everything in it.
#[derive(Clone, Default)]
pub struct World {
    rigid_bodies: RigidBodySet,
    colliders: ColliderSet,
    bodies: Vec<Solid>,
    obstacles: Vec<Solid>,
    walls: Option<Walls>,
    /// For each body its base; empty where no body has one.
    drives: Vec<Option<Drive>>,
}

/// The thing that stopped a body's move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// A wall.
    Wall,
    /// An obstacle, by its index.
    Obstacle(usize),
    /// Another body, by its index.
    Body(usize),
    /// Nothing in the world: the command is not finite, or its way too long to be tested.
    Command,
}

/// The inner faces of an axis-parallel room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Walls {
    pub(crate) min: Vec2,
    pub(crate) max: Vec2,
}

impl World {
    /// An endless plain with nothing in it.
    pub fn new() -> Self {
        Self::default()
    }

    /// Surrounds the world by four walls with the given inner faces, solid as far as one can go
    /// beyond them.
    ///
    /// # Errors
    ///
    /// When `min` is not below `max` or a coordinate is not finite, or when the world has walls
    /// already.
    pub fn set_walls(&mut self, min: Vec2, max: Vec2) -> Result<(), SimError> {
        if self.walls.is_some() {
            return Err(SimError::field("walls", "a second set", "one set of walls"));
        }
        if !(min.is_finite() && max.is_finite() && min.x < max.x && min.y < max.y) {
            return Err(SimError::field("walls", format!("{min} to {max}"), "finite corners, min below max"));
        }
        for (point, inwards) in [(min, Vec2::X), (min, Vec2::Y), (max, -Vec2::X), (max, -Vec2::Y)] {
            self.colliders.insert(ColliderBuilder::new(SharedShape::halfspace(inwards)).translation(point));
        }
        self.walls = Some(Walls { min, max });
        Ok(())
    }

    /// Adds a static obstacle and returns its index. It may overlap others and stick through walls.
    ///
    /// # Errors
    ///
    /// When the shape or the pose is refused by [`Shape::validate`] or is not finite.
    pub fn add_obstacle(&mut self, shape: &Shape, pose: Pose) -> Result<usize, SimError> {
        let field = format!("obstacle {}", self.obstacles.len());
        check(shape, pose, &field)?;
        let (shape, pose) = centred(shape, pose);
        let mut solid = Solid::new(&shape, pose);
        solid.collider =
            self.colliders.insert(ColliderBuilder::new(solid.parry.clone()).position(solid.parry_pose()));
        self.obstacles.push(solid);
        Ok(self.obstacles.len() - 1)
    }

    /// Adds a body and returns its index. Nothing is tested: a body may start inside another or
    /// beyond a wall.
    ///
    /// # Errors
    ///
    /// When the shape is refused by [`Shape::validate`], is a segment, or the pose is not finite.
    pub fn add_body(&mut self, shape: &Shape, pose: Pose) -> Result<usize, SimError> {
        let mut solid = body_solid(shape, pose, self.bodies.len())?;
        let rigid = RigidBodyBuilder::kinematic_position_based().pose(solid.parry_pose());
        let handle = self.rigid_bodies.insert(rigid);
        let collider = ColliderBuilder::new(solid.parry.clone());
        solid.collider = self.colliders.insert_with_parent(collider, handle, &mut self.rigid_bodies);
        solid.body = Some(handle);
        self.bodies.push(solid);
        Ok(self.bodies.len() - 1)
    }

    /// Number of bodies; their indices are 0 up to this.
    pub fn n_bodies(&self) -> usize {
        self.bodies.len()
    }

    /// Number of obstacles.
    pub fn n_obstacles(&self) -> usize {
        self.obstacles.len()
    }

    /// The pose of a body.
    pub fn pose(&self, body: usize) -> Pose {
        self.bodies[body].pose
    }

    /// The shape of a body.
    pub fn shape(&self, body: usize) -> &Shape {
        &self.bodies[body].shape
    }

    /// The walls' inner corners (least, largest), if there are walls.
    pub fn walls(&self) -> Option<(Vec2, Vec2)> {
        self.walls.map(|w| (w.min, w.max))
    }

    /// Gives a body another shape where it is, even one that overlaps others: for spawning and
    /// restoring.
    ///
    /// # Errors
    ///
    /// As [`World::add_body`]; the body keeps its shape then.
    pub fn set_shape(&mut self, body: usize, shape: &Shape) -> Result<(), SimError> {
        let old = &self.bodies[body];
        let mut solid = body_solid(shape, old.pose, body)?;
        (solid.collider, solid.body) = (old.collider, old.body);
        if let Some(collider) = self.colliders.get_mut(solid.collider) {
            collider.set_shape(solid.parry.clone());
        }
        self.bodies[body] = solid;
        Ok(())
    }

    /// Puts a body anywhere, even onto another: for spawning and restoring. One with a base stands
    /// still there, and no command is under way.
    ///
    /// # Panics
    ///
    /// When the pose is not finite.
    pub fn set_pose(&mut self, body: usize, pose: Pose) {
        assert!(pose.is_finite(), "pose of body {body}: found {pose:?}, expected finite numbers");
        self.bodies[body].place(pose);
        self.publish(body);
        if let Some(drive) = self.drive_mut(body) {
            drive.state = DriveState::default();
        }
    }

    /// Puts a body on a base: from now on its [`Motion::Drive`] is a command to motors, and rapier
    /// moves it. It stands still. [`Motion::Still`] leaves it where it is, whatever its velocity.
    ///
    /// # Errors
    ///
    /// When the base is refused by [`BaseConfig::validate`], or rapier's solver is not part of this
    /// build.
    pub fn set_base(&mut self, body: usize, base: &BaseConfig) -> Result<(), SimError> {
        base.validate()?;
        if cfg!(not(feature = "dynamics")) {
            return Err(SimError::field("robot.dynamics", "rapier", crate::config::WITHOUT_DYNAMICS));
        }
        self.drives.resize(self.bodies.len(), None);
        self.drives[body] = Some(Drive::new(base.clone()));
        Ok(())
    }

    /// Velocity along the heading, m/s, and turn rate, rad/s, of a body with a base, as its
    /// odometry measures them; `None` for any other body, which has what it was commanded.
    pub fn measured(&self, body: usize) -> Option<[f32; 2]> {
        self.drive(body).map(|drive| drive.measured(self.pose(body)))
    }

    /// What a body's base keeps from one control period to the next; `None` without a base.
    pub fn drive_state(&self, body: usize) -> Option<&DriveState> {
        self.drive(body).map(|drive| &drive.state)
    }

    /// Gives a base a state, to be called after [`World::set_pose`]; a body without a base has
    /// none.
    ///
    /// # Panics
    ///
    /// When a number is not finite.
    pub fn set_drive_state(&mut self, body: usize, state: DriveState) {
        assert!(state.is_finite(), "base of body {body}: found {state:?}, expected finite numbers");
        if let Some(drive) = self.drive_mut(body) {
            drive.state = state;
        }
    }

    pub(crate) fn drive(&self, body: usize) -> Option<&Drive> {
        self.drives.get(body)?.as_ref()
    }

    pub(crate) fn drive_mut(&mut self, body: usize) -> Option<&mut Drive> {
        self.drives.get_mut(body)?.as_mut()
    }

    /// Where a base got to in a control period.
    #[cfg(feature = "dynamics")]
    pub(crate) fn move_base(&mut self, body: usize, pose: Pose, velocity: Vec2, turn: f32) {
        self.bodies[body].place(pose);
        self.publish(body);
        if let Some(drive) = self.drive_mut(body) {
            (drive.state.velocity, drive.state.turn) = (velocity, turn);
        }
    }

    /// Moves every body for `dt`, in index order, and notes in `stalled` which of them had to stay
    /// where they were.
    ///
    /// Each move is tested along the way in sub-steps no longer than the body's half width (turning
    /// counts at the body's outermost point), so that no speed and no `dt` lets a body pass through
    /// anything. A body that already overlaps something before its move (it was put there) stalls
    /// until it is put elsewhere or turns free in one step.
    ///
    /// Bodies with a base move after the others, all at the same time, and count as stalled if they
    /// touched something.
    ///
    /// # Panics
    ///
    /// When `motions` or `stalled` does not have one entry per body.
    pub fn advance(&mut self, motions: &[Motion], dt: f32, stalled: &mut [bool]) {
        assert_eq!(motions.len(), self.bodies.len(), "one motion per body");
        assert_eq!(stalled.len(), self.bodies.len(), "one stall flag per body");
        if self.drives.is_empty() {
            for (body, (motion, stalled)) in motions.iter().zip(stalled).enumerate() {
                *stalled = self.try_move(body, *motion, dt).is_some();
            }
            return;
        }
        let mut stops = vec![None; stalled.len()];
        self.advance_to_stops(motions, dt, &mut stops);
        for (stalled, stop) in stalled.iter_mut().zip(stops) {
            *stalled = stop.is_some();
        }
    }

    /// As [`World::advance`], and tells of every body what stopped it; of several things the first
    /// in the order wall, body, obstacle. `None` for those that moved.
    ///
    /// # Panics
    ///
    /// When `motions` or `stops` does not have one entry per body.
    pub fn advance_to_stops(&mut self, motions: &[Motion], dt: f32, stops: &mut [Option<Stop>]) {
        assert_eq!(motions.len(), self.bodies.len(), "one motion per body");
        assert_eq!(stops.len(), self.bodies.len(), "one stop per body");
        let before: Vec<Pose> = if self.drives.is_empty() {
            Vec::new()
        } else {
            self.bodies.iter().map(|solid| solid.pose).collect()
        };
        for (body, (motion, stop)) in motions.iter().zip(&mut *stops).enumerate() {
            let motion = if self.drive(body).is_some() { Motion::Still } else { *motion };
            *stop = self.try_move(body, motion, dt);
        }
        #[cfg(not(feature = "dynamics"))]
        debug_assert!(before.is_empty(), "no body has a base");
        #[cfg(feature = "dynamics")]
        if !before.is_empty() {
            crate::dynamics::advance(self, motions, dt, &before, stops);
        }
    }

    /// One body's move; what stopped it, and the pose untouched, when it is blocked.
    fn try_move(&mut self, body: usize, motion: Motion, dt: f32) -> Option<Stop> {
        let solid = &self.bodies[body];
        let start = solid.pose;
        let (shift, turn) = match motion {
            Motion::Still => return None,
            Motion::Drive { v, w } => (solid.rotation * (v * dt), w * dt),
            Motion::Walk { velocity } => (velocity * dt, 0.0),
        };
        if shift == Vec2::ZERO && turn == 0.0 {
            return None;
        }
        let reach = shift.length() + turn.abs().min(std::f32::consts::TAU) * solid.circumradius;
        let n_steps = (reach / solid.half_width).ceil().max(1.0);
        // A command that is not finite ends here too: its count of sub-steps is NaN or infinite.
        if n_steps > SUB_STEPS_MAX || n_steps.is_nan() || !turn.is_finite() {
            return Some(Stop::Command);
        }
        let n_steps = n_steps as u32;
        let stop = (1..=n_steps).find_map(|step| self.stop_at(body, start, shift, turn, step, n_steps));
        if stop.is_some() {
            self.bodies[body].place(start);
        } else {
            self.publish(body);
        }
        stop
    }

    /// Puts a body `step`/`n_steps` of the way along its move and tells what stops it there.
    fn stop_at(
        &mut self,
        body: usize,
        start: Pose,
        shift: Vec2,
        turn: f32,
        step: u32,
        n_steps: u32,
    ) -> Option<Stop> {
        let part = if step == n_steps { 1.0 } else { step as f32 / n_steps as f32 };
        let heading = wrap_angle(f64::from(start.heading) + f64::from(turn * part));
        let pose = Pose { position: start.position + shift * part, heading };
        if !pose.is_finite() {
            return Some(Stop::Command);
        }
        self.bodies[body].place(pose);
        self.blocker(body)
    }

    /// True if a body touches another body, an obstacle or a wall at its pose.
    pub fn is_blocked(&self, body: usize) -> bool {
        self.blocker(body).is_some()
    }

    /// The thing that a body touches at its pose: the first in the order wall, body, obstacle.
    fn blocker(&self, body: usize) -> Option<Stop> {
        let solid = &self.bodies[body];
        if self.walls.is_some_and(|walls| walls.block(solid)) {
            return Some(Stop::Wall);
        }
        let hits_body = |(i, other): (usize, &Solid)| i != body && solid.overlaps(other);
        let other = self.bodies.iter().enumerate().position(hits_body).map(Stop::Body);
        other.or_else(|| self.obstacles.iter().position(|o| solid.overlaps(o)).map(Stop::Obstacle))
    }

    /// Distance from a point to the nearest obstacle or wall, m: 0 inside an obstacle or beyond a
    /// wall, infinite where there is neither.
    pub fn clearance(&self, point: Vec2) -> f32 {
        let to_walls =
            self.walls.map_or(f32::INFINITY, |w| (point - w.min).min(w.max - point).min_element().max(0.0));
        let to_obstacle = |solid: &Solid| solid.parry.distance_to_point(&solid.parry_pose(), point, true);
        self.obstacles.iter().map(to_obstacle).fold(to_walls, f32::min)
    }

    /// Distance between the outlines of two bodies, m: 0 where they touch or overlap.
    pub fn body_distance(&self, one: usize, other: usize) -> f32 {
        self.bodies[one].distance(&self.bodies[other], f32::INFINITY)
    }

    /// Distance from a body's outline to the nearest other body, obstacle or wall, m: 0 where it
    /// touches or overlaps one, infinite where there is none.
    pub fn body_clearance(&self, body: usize) -> f32 {
        let solid = &self.bodies[body];
        let others = self.bodies.iter().enumerate().filter(|(i, _)| *i != body).map(|(_, other)| other);
        let to_walls = self.walls.map_or(f32::INFINITY, |walls| walls.distance(solid));
        others.chain(&self.obstacles).fold(to_walls, |least, other| solid.distance(other, least))
    }

    /// The rapier scene, for debug rendering or queries of one's own.
    pub fn rapier_scene(&self) -> (&RigidBodySet, &ColliderSet) {
        (&self.rigid_bodies, &self.colliders)
    }

    pub(crate) fn bodies(&self) -> &[Solid] {
        &self.bodies
    }

    pub(crate) fn obstacles(&self) -> &[Solid] {
        &self.obstacles
    }

    pub(crate) fn walls_box(&self) -> Option<Walls> {
        self.walls
    }

    /// Carries a body's pose over to rapier's sets.
    fn publish(&mut self, body: usize) {
        let solid = &self.bodies[body];
        let pose = solid.parry_pose();
        if let Some(rigid) = solid.body.and_then(|handle| self.rigid_bodies.get_mut(handle)) {
            rigid.set_position(pose, false);
        }
        if let Some(collider) = self.colliders.get_mut(solid.collider) {
            collider.set_position(pose);
        }
    }
}

impl Walls {
    /// Distance from a solid to the nearest inner face, m; 0 where it reaches one.
    fn distance(&self, solid: &Solid) -> f32 {
        let aabb = solid.parry.compute_aabb(&solid.parry_pose());
        (aabb.mins - self.min).min(self.max - aabb.maxs).min_element().max(0.0)
    }

    /// True if a solid reaches a wall's inner face.
    fn block(&self, solid: &Solid) -> bool {
        let position = solid.pose.position;
        let room = (position - self.min).min(self.max - position).min_element();
        if room > solid.circumradius {
            return false;
        }
        let aabb = solid.parry.compute_aabb(&solid.parry_pose());
        aabb.mins.x <= self.min.x
            || aabb.mins.y <= self.min.y
            || aabb.maxs.x >= self.max.x
            || aabb.maxs.y >= self.max.y
    }
}

fn check(shape: &Shape, pose: Pose, field: &str) -> Result<(), SimError> {
    if !pose.is_finite() {
        let found = format!("{}, heading {} rad", pose.position, pose.heading);
        return Err(SimError::field(format!("{field}.pose"), found, "finite numbers"));
    }
    shape.validate(field)
}

/// A body of this index, not yet in rapier's sets.
fn body_solid(shape: &Shape, pose: Pose, body: usize) -> Result<Solid, SimError> {
    let field = format!("body {body}");
    check(shape, pose, &field)?;
    if matches!(shape, Shape::Segment { .. }) {
        return Err(SimError::field(field, "a segment", "a shape with an area"));
    }
    Ok(Solid::new(shape, pose))
}

/// The same segment or polygon around the mean of its vertices, so that its circumradius culls
/// well.
fn centred(shape: &Shape, pose: Pose) -> (Shape, Pose) {
    let vertices = shape.vertices();
    let centre = vertices.iter().map(|v| v.as_dvec2()).sum::<glam::DVec2>() / vertices.len().max(1) as f64;
    let moved = |v: &Vec2| (v.as_dvec2() - centre).as_vec2();
    let shape = match shape {
        Shape::Circle { .. } | Shape::Box { .. } => return (shape.clone(), pose),
        Shape::Segment { a, b } => Shape::Segment { a: moved(a), b: moved(b) },
        Shape::Polygon { vertices } => Shape::Polygon { vertices: vertices.iter().map(moved).collect() },
    };
    let position = pose.point_in_world(centre.as_vec2());
    (shape, Pose { position, heading: pose.heading })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> World {
        let mut world = World::new();
        world.set_walls(Vec2::splat(-10.0), Vec2::splat(10.0)).expect("walls");
        world
    }

    fn add(world: &mut World, x: f32, y: f32, heading: f32) -> usize {
        world.add_body(&Shape::square(0.5), Pose::new(Vec2::new(x, y), heading)).expect("body")
    }

    #[track_caller]
    fn advance(world: &mut World, motions: &[Motion], dt: f32) -> Vec<bool> {
        let mut stalled = vec![false; motions.len()];
        world.advance(motions, dt, &mut stalled);
        stalled
    }

    #[test]
    fn drive_is_one_euler_step_along_the_old_heading() {
        let mut world = room();
        add(&mut world, 0.0, 0.0, std::f32::consts::FRAC_PI_2);
        assert_eq!(advance(&mut world, &[Motion::Drive { v: 1.0, w: 1.0 }], 0.1), [false]);
        let pose = world.pose(0);
        assert!((pose.position - Vec2::new(0.0, 0.1)).length() < 1e-7);
        assert!((pose.heading - (std::f32::consts::FRAC_PI_2 + 0.1)).abs() < 1e-6);
    }

    #[test]
    fn a_blocked_body_keeps_its_whole_pose() {
        let mut world = room();
        add(&mut world, 0.0, 0.0, 0.0);
        add(&mut world, 0.55, 0.0, 0.0);
        let before = world.pose(0);
        let stalled = advance(&mut world, &[Motion::Drive { v: 1.0, w: 1.0 }, Motion::Still], 0.1);
        assert_eq!((stalled, world.pose(0)), (vec![true, false], before));
    }

    #[test]
    fn bodies_move_one_after_the_other() {
        let drive = Motion::Drive { v: 1.0, w: 0.0 };
        let mut world = room();
        add(&mut world, 0.0, 0.0, 0.0);
        add(&mut world, 0.55, 0.0, 0.0);
        assert_eq!(advance(&mut world, &[drive, drive], 0.1), [true, false]);
        let mut world = room();
        add(&mut world, 0.55, 0.0, 0.0);
        add(&mut world, 0.0, 0.0, 0.0);
        assert_eq!(advance(&mut world, &[drive, drive], 0.1), [false, false]);
    }

    #[test]
    fn nothing_tunnels_at_any_speed() {
        let wall = Shape::Segment { a: Vec2::new(2.0, -5.0), b: Vec2::new(2.0, 5.0) };
        for v in [1.0, 30.0, 100.0, 5000.0, 1e9, f32::INFINITY, f32::NAN] {
            let mut world = World::new();
            add(&mut world, 0.0, 0.0, 0.0);
            world.add_obstacle(&wall, Pose::default()).expect("obstacle");
            let stalled = advance(&mut world, &[Motion::Drive { v, w: 0.0 }], 4.0);
            assert_eq!((stalled[0], world.pose(0).position), (true, Vec2::ZERO), "v = {v}");
        }
        let mut world = room();
        add(&mut world, 0.0, 0.0, 0.0);
        assert_eq!(advance(&mut world, &[Motion::Walk { velocity: Vec2::new(500.0, 0.0) }], 0.1), [true]);
    }

    #[test]
    fn clearance_is_measured_between_outlines() {
        let mut world = World::new();
        add(&mut world, 0.0, 0.0, 0.0);
        assert_eq!(world.body_clearance(0), f32::INFINITY);
        let near = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        // Turned by an eighth, its corner points at the first: 2 − 0.25 − 0.25·√2.
        add(&mut world, 2.0, 0.0, std::f32::consts::FRAC_PI_4);
        near(world.body_clearance(0), 1.75 - 0.25 * std::f32::consts::SQRT_2);
        world
            .add_obstacle(&Shape::Circle { radius: 0.5 }, Pose::new(Vec2::new(0.0, -1.5), 0.0))
            .expect("disc");
        near(world.body_clearance(0), 0.75);
        world.set_walls(Vec2::new(-0.4, -9.0), Vec2::new(9.0, 9.0)).expect("walls");
        near(world.body_clearance(0), 0.15);
        world.set_pose(1, Pose::new(Vec2::new(0.4, 0.0), 0.0));
        assert_eq!(world.body_clearance(0), 0.0);
        assert_eq!(world.clone().body_clearance(1), 0.0);
    }

    #[test]
    fn rapier_holds_the_same_poses() {
        let mut world = room();
        add(&mut world, 0.0, 0.0, 0.3);
        advance(&mut world, &[Motion::Drive { v: 1.0, w: 0.5 }], 0.1);
        let (bodies, colliders) = world.rapier_scene();
        let (_, body) = bodies.iter().next().expect("one body");
        let collider = colliders.iter().find(|(_, c)| c.parent().is_some()).expect("one collider").1;
        assert_eq!(body.position().translation, world.pose(0).position);
        assert_eq!(collider.position().translation, world.pose(0).position);
        assert!(body.is_kinematic());
    }

    #[test]
    fn another_shape_is_a_body_of_that_shape() {
        let mut world = room();
        add(&mut world, 0.0, 0.0, 0.0);
        add(&mut world, 1.0, 0.0, 0.0);
        assert!(!world.is_blocked(0));
        world.set_shape(0, &Shape::square(1.6)).expect("a shape");
        assert!(world.is_blocked(0) && world.is_blocked(1));
        assert_eq!((world.shape(0), world.pose(0).position), (&Shape::square(1.6), Vec2::ZERO));
        let (_, colliders) = world.rapier_scene();
        let cuboid = |c: &rapier2d::prelude::Collider| c.shape().as_cuboid().map(|c| c.half_extents.x);
        let extents: Vec<f32> = colliders.iter().filter_map(|(_, c)| cuboid(c)).collect();
        assert_eq!(extents, [0.8, 0.25]);
        world.set_shape(0, &Shape::square(0.5)).expect("a shape");
        assert!(!world.is_blocked(0));
        assert!(world.set_shape(0, &Shape::square(-1.0)).is_err());
        assert_eq!(world.shape(0), &Shape::square(0.5));
    }

    #[test]
    fn clearance_is_the_distance_to_walls_and_obstacles() {
        let mut world = room();
        world.add_obstacle(&Shape::square(2.0), Pose::default()).expect("obstacle");
        assert!((world.clearance(Vec2::new(3.0, 0.0)) - 2.0).abs() < 1e-6);
        assert!((world.clearance(Vec2::new(0.0, 9.5)) - 0.5).abs() < 1e-6);
        assert_eq!(world.clearance(Vec2::new(0.5, 0.5)), 0.0);
        assert_eq!(world.clearance(Vec2::new(30.0, 0.5)), 0.0);
    }
}
