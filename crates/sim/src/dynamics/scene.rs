//! One control period of all bases of a world, in a rapier scene that is made for it.
//!
//! The scene has the bases as dynamic bodies, the other bodies as kinematic ones on their way from
//! where they were, and whatever of walls and obstacles is within a base's reach. A step is at most
//! [`STEP`] long: the wheels push, then rapier integrates and solves the contacts.

use super::DriveState;
use super::wheels::{Twist, push};
use crate::geometry::Pose;
use crate::motion::Motion;
use crate::solid::Solid;
use crate::trig::wrap_angle;
use crate::world::{Stop, World};
use glam::Vec2;
use rapier2d::math::{Pose as RapierPose, Rotation};
use rapier2d::parry::mass_properties::MassProperties;
use rapier2d::prelude::{
    ColliderBuilder, ColliderHandle, PhysicsWorld, RigidBody, RigidBodyBuilder, RigidBodyHandle, SharedShape,
};

/// Longest step, s.
const STEP: f32 = 0.005;
/// Steps of a control period at most.
const STEPS_MAX: f32 = 4096.0;
/// A base keeps so far from what it leans on, m: outlines that touch would count as overlapping.
const SKIN: f32 = 0.01;
/// What is farther from a base than its way and this is not in the scene, m.
const MARGIN: f32 = 1.0;

/// A base in the scene.
struct Mover {
    body: usize,
    rigid: RigidBodyHandle,
    collider: ColliderHandle,
    /// The command of each step's turn, as far as it has arrived.
    commands: Vec<[f32; 2]>,
    /// Where it was at the end of each step so far.
    poses: Vec<Pose>,
    /// The first thing that it touched, in the order of [`rank`].
    touched: Option<Stop>,
}

/// Moves all bodies that have a base by their commands for `dt`, and notes what they touched.
/// `before` holds the poses that the bodies had when the period began; those without a base have
/// moved already.
pub(crate) fn advance(
    world: &mut World,
    motions: &[Motion],
    dt: f32,
    before: &[Pose],
    stops: &mut [Option<Stop>],
) {
    let n_steps = n_steps(world, motions, dt);
    let mut scene = PhysicsWorld::new();
    scene.gravity = Vec2::ZERO;
    scene.integration_parameters.dt = dt / n_steps as f32;
    let mut movers = Vec::new();
    for (body, stop) in stops.iter_mut().enumerate() {
        if let Some(command) = command(world, motions, body) {
            *stop = command.is_none().then_some(Stop::Command);
            movers.push(insert(&mut scene, world, body, command.unwrap_or([0.0; 2]), n_steps, dt));
        }
    }
    if movers.is_empty() {
        return;
    }
    let mut things = surroundings(&mut scene, world, &movers, dt);
    let others = bystanders(&mut scene, world, &movers, before, dt);
    things.extend(others.iter().map(|(body, _, collider)| (*collider, Stop::Body(*body))));
    things.extend(movers.iter().map(|mover| (mover.collider, Stop::Body(mover.body))));
    for step in 0..n_steps {
        for (body, rigid, _) in &others {
            let share = (step + 1) as f32 / n_steps as f32;
            scene.bodies[*rigid].set_next_kinematic_position(rapier_pose(between(
                before[*body],
                world.pose(*body),
                share,
            )));
        }
        for mover in &movers {
            if let Some(drive) = world.drive(mover.body) {
                let dt = scene.integration_parameters.dt;
                let rigid = &mut scene.bodies[mover.rigid];
                let next = push(&drive.base, twist(rigid), mover.commands[step], dt);
                rigid.set_linvel(direction(rigid).rotate(next.velocity), true);
                rigid.set_angvel(next.turn, true);
            }
        }
        scene.step();
        for mover in &mut movers {
            mover.touched = touched(&scene, mover, &things);
            mover.poses.push(pose_of(&scene.bodies[mover.rigid]));
        }
    }
    for mover in &movers {
        let rigid = &scene.bodies[mover.rigid];
        stops[mover.body] = mover.touched.or(stops[mover.body]);
        world.move_base(mover.body, pose_of(rigid), rigid.linvel(), rigid.angvel());
    }
    for mover in &movers {
        back_out(world, mover, before[mover.body]);
    }
}

/// Takes a base back to where it was last without an overlap. Contacts give way for some steps
/// where something hits them at many m/s, and a control period may end in one of these. Its
/// velocity stays.
fn back_out(world: &mut World, mover: &Mover, start: Pose) {
    let earlier = mover.poses.iter().rev().skip(1).copied().chain([start]);
    for pose in earlier {
        if !world.is_blocked(mover.body) {
            return;
        }
        let Some(DriveState { velocity, turn, .. }) = world.drive_state(mover.body).cloned() else { return };
        world.move_base(mover.body, pose, velocity, turn);
    }
}

/// The command of a body that has a base and is in use: `Some(None)` for one that is not finite.
#[expect(
    clippy::option_option,
    reason = "a body without a base is neither told something nor something wrong"
)]
fn command(world: &World, motions: &[Motion], body: usize) -> Option<Option<[f32; 2]>> {
    world.drive(body)?;
    match motions[body] {
        Motion::Still => None,
        Motion::Drive { v, w } => Some((v.is_finite() && w.is_finite()).then_some([v, w])),
        Motion::Walk { .. } => Some(None),
    }
}

/// So many steps that none is longer than [`STEP`] and nobody gets farther in one than half its
/// least width.
fn n_steps(world: &World, motions: &[Motion], dt: f32) -> usize {
    let of_body = |body: usize| {
        let reach = reach(world, motions, body, dt)?;
        Some(reach / world.bodies()[body].half_width)
    };
    let by_reach = (0..world.n_bodies()).filter_map(of_body).fold(0.0, f32::max);
    // A period of 0.1 s has 20 steps, whichever way the quotient is rounded.
    (dt / STEP - 1e-3).max(by_reach).ceil().clamp(1.0, STEPS_MAX) as usize
}

/// How far a base may get in a control period by itself, m.
fn reach(world: &World, motions: &[Motion], body: usize, dt: f32) -> Option<f32> {
    let [v, _] = command(world, motions, body)?.unwrap_or_default();
    let state = &world.drive(body)?.state;
    let told = state.commands.iter().map(|[v, _]| v.abs()).fold(v.abs(), f32::max);
    Some(dt * state.velocity.length().max(told))
}

/// Puts a base into the scene, the newest command behind those under way, and takes from the queue
/// what is of the past.
fn insert(
    scene: &mut PhysicsWorld,
    world: &mut World,
    body: usize,
    command: [f32; 2],
    n_steps: usize,
    dt: f32,
) -> Mover {
    let solid = &world.bodies()[body];
    let (pose, shape) = (solid.parry_pose(), solid.parry.clone());
    let drive = world.drive_mut(body).expect("a mover has a base");
    let late = (drive.base.latency / dt * n_steps as f32).round() as usize;
    // A command of `age` periods ago is in force from the step on that is `late` steps behind it.
    let age = |step: usize| late.saturating_sub(step).div_ceil(n_steps);
    drive.state.commands.push(command);
    let told = &drive.state.commands;
    let of_age = |age: usize| told.len().checked_sub(1 + age).map_or([0.0; 2], |at| told[at]);
    let commands = (0..n_steps).map(|step| of_age(age(step))).collect();
    let surplus = drive.state.commands.len().saturating_sub(age(0));
    drive.state.commands.drain(..surplus);
    let rigid = RigidBodyBuilder::dynamic()
        .pose(pose)
        .linvel(drive.state.velocity)
        .angvel(drive.state.turn)
        .additional_mass_properties(MassProperties::new(Vec2::ZERO, drive.base.mass, drive.base.inertia))
        .can_sleep(false)
        .ccd_enabled(true);
    let collider = ColliderBuilder::new(shape).density(0.0).friction(drive.base.friction).contact_skin(SKIN);
    let (rigid, collider) = scene.insert(rigid, collider);
    Mover { body, rigid, collider, commands, poses: Vec::with_capacity(n_steps), touched: None }
}

/// Puts walls and obstacles near a base into the scene.
fn surroundings(
    scene: &mut PhysicsWorld,
    world: &World,
    movers: &[Mover],
    dt: f32,
) -> Vec<(ColliderHandle, Stop)> {
    let mut things = Vec::new();
    if let Some((min, max)) = world.walls() {
        let sides = [(min, Vec2::X), (min, Vec2::Y), (max, -Vec2::X), (max, -Vec2::Y)];
        for (point, inwards) in sides {
            let near = |mover: &Mover| {
                (world.pose(mover.body).position - point).dot(inwards) <= range(scene, world, mover, dt)
            };
            if movers.iter().any(near) {
                let wall = ColliderBuilder::new(SharedShape::halfspace(inwards)).translation(point);
                things.push((scene.insert_collider(wall, None), Stop::Wall));
            }
        }
    }
    for (index, obstacle) in world.obstacles().iter().enumerate() {
        if movers.iter().any(|mover| is_near(scene, world, mover, obstacle, dt)) {
            let collider = ColliderBuilder::new(obstacle.parry.clone()).position(obstacle.parry_pose());
            things.push((scene.insert_collider(collider, None), Stop::Obstacle(index)));
        }
    }
    things
}

/// Puts the bodies that move by themselves and are near a base into the scene, where they were when
/// the period began.
fn bystanders(
    scene: &mut PhysicsWorld,
    world: &World,
    movers: &[Mover],
    before: &[Pose],
    dt: f32,
) -> Vec<(usize, RigidBodyHandle, ColliderHandle)> {
    let mut others = Vec::new();
    for (body, solid) in world.bodies().iter().enumerate() {
        if movers.iter().any(|mover| mover.body == body) {
            continue;
        }
        let way = before[body].position.distance(solid.pose.position);
        let near = |mover: &Mover| {
            let apart = world.pose(mover.body).position.distance(solid.pose.position);
            apart <= range(scene, world, mover, dt) + solid.circumradius + way
        };
        if movers.iter().any(near) {
            let rigid = RigidBodyBuilder::kinematic_position_based().pose(rapier_pose(before[body]));
            let (rigid, collider) = scene.insert(rigid, ColliderBuilder::new(solid.parry.clone()));
            others.push((body, rigid, collider));
        }
    }
    others
}

fn is_near(scene: &PhysicsWorld, world: &World, mover: &Mover, thing: &Solid, dt: f32) -> bool {
    thing.distance_to(world.pose(mover.body).position) <= range(scene, world, mover, dt)
}

/// How far from its centre a base may touch something within the period, m.
fn range(scene: &PhysicsWorld, world: &World, mover: &Mover, dt: f32) -> f32 {
    let told = mover.commands.iter().map(|[v, _]| v.abs()).fold(0.0, f32::max);
    let speed = scene.bodies[mover.rigid].linvel().length().max(told);
    world.bodies()[mover.body].circumradius + speed * dt + MARGIN
}

/// What a base has touched so far: the first in the order wall, body, obstacle.
fn touched(scene: &PhysicsWorld, mover: &Mover, things: &[(ColliderHandle, Stop)]) -> Option<Stop> {
    let pairs = scene.narrow_phase.contact_pairs_with(mover.collider);
    let pressing = pairs.filter(|pair| pair.total_impulse_magnitude() > 0.0);
    let thing =
        |handle: ColliderHandle| things.iter().find(|(other, _)| *other == handle).map(|(_, stop)| *stop);
    let others = pressing.filter_map(|pair| {
        thing(if pair.collider1 == mover.collider { pair.collider2 } else { pair.collider1 })
    });
    others.chain(mover.touched).min_by_key(|stop| rank(*stop))
}

fn rank(stop: Stop) -> (u8, usize) {
    match stop {
        Stop::Wall => (0, 0),
        Stop::Body(index) => (1, index),
        Stop::Obstacle(index) => (2, index),
        Stop::Command => (3, 0),
    }
}

/// A body's motion in its own frame.
fn twist(rigid: &RigidBody) -> Twist {
    let (along, velocity) = (direction(rigid), rigid.linvel());
    Twist { velocity: Vec2::new(along.dot(velocity), along.perp_dot(velocity)), turn: rigid.angvel() }
}

fn direction(rigid: &RigidBody) -> Vec2 {
    let rotation = rigid.position().rotation;
    Vec2::new(rotation.re, rotation.im)
}

fn pose_of(rigid: &RigidBody) -> Pose {
    let along = direction(rigid);
    let heading = wrap_angle(f64::from(libm::atan2f(along.y, along.x)));
    Pose { position: rigid.position().translation, heading }
}

fn rapier_pose(pose: Pose) -> RapierPose {
    let along = pose.direction();
    RapierPose::from_parts(pose.position, Rotation::from_cos_sin_unchecked(along.x, along.y))
}

/// A pose on the way from one to another.
fn between(from: Pose, to: Pose, share: f32) -> Pose {
    let turn = wrap_angle(f64::from(to.heading) - f64::from(from.heading));
    Pose::new(from.position.lerp(to.position, share), from.heading + turn * share)
}
