//! Scenes: a floor with walls and blocks, and regions in which robot and pedestrians start and have
//! their goals.
//!
//! A scene takes the place of the usual room in an episode. Everything else stays: streams named by
//! episode, crowds that drive the pedestrians, crashes, metrics. Reading order: [`SceneConfig`]
//! (data), [`SceneConfig::validate`], [`SceneConfig::place`] (starts and goals of an episode),
//! [`SceneConfig::next_goal`] and [`SceneConfig::restart`] (what happens to pedestrians later).

use std::fmt;

use glam::Vec2;
use jostle_sim::{Pose, Scenario, Shape, SimConfig, Spawner, World};
use rand::{Rng, RngExt as _};
use serde::{Deserialize, Serialize};

use crate::error::ArenaError;

/// Points drawn for one start before the best of them is taken.
const TRIES: u32 = 1000;
/// Cells along each side of the grid on which the free area of a region is measured.
const GRID: u32 = 32;
/// Distance that starts and goals keep from walls and blocks beyond a body's radius and the crash
/// range (m).
const MARGIN: f32 = 0.1;
/// Free floor that a region must offer to each body that starts in it (m²).
const AREA_OF_BODY: f32 = 1.0;

/// A rectangle along the axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Least corner (m).
    pub min: Vec2,
    /// Largest corner (m).
    pub max: Vec2,
}

impl Region {
    /// A uniform point of it.
    fn draw(&self, rng: &mut impl Rng) -> Vec2 {
        let part = Vec2::new(rng.random(), rng.random());
        self.min + part * (self.max - self.min)
    }

    fn centre(&self) -> Vec2 {
        (self.min + self.max) / 2.0
    }

    /// Those centres of the cells of a grid that keep `clearance` from walls and blocks.
    fn free_points(&self, world: &World, clearance: f32) -> impl Iterator<Item = Vec2> {
        let (min, cell) = (self.min, (self.max - self.min) / GRID as f32);
        let centre =
            move |i: u32| min + cell * (Vec2::new((i % GRID) as f32, (i / GRID) as f32) + Vec2::splat(0.5));
        (0..GRID * GRID).map(centre).filter(move |point| world.clearance(*point) >= clearance)
    }

    fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }

    fn is_sound(&self) -> bool {
        self.min.is_finite() && self.max.is_finite() && self.min.cmplt(self.max).all()
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", self.min, self.max)
    }
}

/// Conduct of a group's pedestrians on top of the crowd's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Manner {
    /// Nothing: the crowd drives them.
    #[default]
    Walks,
    /// They stand on a circle and face each other, whatever the crowd says. Its centre is drawn in
    /// the group's start region.
    Stands {
        /// Radius of the circle (m).
        circle: f32,
    },
    /// The crowd drives them until a time drawn uniformly from this range (s), from which on they
    /// stand.
    StopsDead([f32; 2]),
}

/// Some pedestrians with the same regions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroupConfig {
    /// Number of pedestrians.
    pub count: usize,
    /// The region of their starts.
    pub start: Region,
    /// The region of their goals. A pedestrian that arrives turns back to the start region, and so
    /// on.
    pub goal: Region,
    /// Their conduct on top of the crowd's.
    #[serde(default)]
    pub manner: Manner,
}

/// The robot's start and goal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotWay {
    /// The region of its start; it faces its goal.
    pub start: Region,
    /// The region of its goal.
    pub goal: Region,
}

/// A scene as data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// The floor, with walls around it.
    pub floor: Region,
    /// Solid parts of it.
    #[serde(default)]
    pub blocks: Vec<Region>,
    /// The robot's regions.
    pub robot: RobotWay,
    /// The pedestrians, in their order.
    pub groups: Vec<GroupConfig>,
}

/// Starts, goals and stops of an episode; the robot's are the first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Placing {
    /// The starts of the bodies.
    pub poses: Vec<Pose>,
    /// Their goals.
    pub goals: Vec<Vec2>,
    /// For each pedestrian: from which time on it stands (s), if it does.
    pub stands_from: Vec<Option<f32>>,
}

impl SceneConfig {
    /// Number of pedestrians.
    pub fn n_pedestrians(&self) -> usize {
        self.groups.iter().map(|group| group.count).sum()
    }

    /// Walls and obstacles.
    pub fn scenario(&self) -> Scenario {
        let block = |block: &Region| {
            let size = block.max - block.min;
            (Shape::Box { length: size.x, width: size.y }, Pose::new(block.centre(), 0.0))
        };
        Scenario {
            walls: (self.floor.min, self.floor.max),
            obstacles: self.blocks.iter().map(block).collect(),
            traced: None,
        }
    }

    /// Checks the data for bodies of a simulator's settings.
    ///
    /// # Errors
    ///
    /// A rectangle without an area or outside the floor, a region without room for those who start
    /// in it, a group of nobody, a range of times that is reversed.
    pub fn validate(&self, sim: &SimConfig) -> Result<(), ArenaError> {
        if !self.floor.is_sound() {
            return refuse("scene.floor", self.floor, "a rectangle with an area");
        }
        for block in &self.blocks {
            if !block.is_sound() || !self.floor.contains(block) {
                return refuse("scene.blocks", block, "rectangles with an area, within the floor");
            }
        }
        let world = self.scenario().build()?;
        let clearance = clearance(sim);
        self.check_region("scene.robot.start", &self.robot.start, &world, clearance, 1)?;
        self.check_region("scene.robot.goal", &self.robot.goal, &world, clearance, 1)?;
        for group in &self.groups {
            if group.count == 0 {
                return refuse("scene.groups.count", 0, "at least 1");
            }
            let range = |low: f32, high: f32| (0.0..=1e4).contains(&low) && (low..=1e4).contains(&high);
            match group.manner {
                Manner::Walks => {}
                Manner::StopsDead([low, high]) if range(low, high) => {}
                Manner::StopsDead([low, high]) => {
                    let found = format!("{low} to {high}");
                    return refuse("scene.groups.manner.stops_dead", found, "a range of times, s");
                }
                Manner::Stands { circle } if range(0.0, circle) => {
                    self.check_region("scene.groups.start", &group.start, &world, clearance + circle, 1)?;
                    continue;
                }
                Manner::Stands { circle } => {
                    return refuse("scene.groups.manner.stands.circle", circle, "a radius, m");
                }
            }
            self.check_region("scene.groups.start", &group.start, &world, clearance, group.count)?;
            self.check_region("scene.groups.goal", &group.goal, &world, clearance, 1)?;
        }
        Ok(())
    }

    /// Refuses a region that is not on the floor or has too little of it free.
    fn check_region(
        &self,
        field: &'static str,
        region: &Region,
        world: &World,
        clearance: f32,
        n_bodies: usize,
    ) -> Result<(), ArenaError> {
        if !region.is_sound() || !self.floor.contains(region) {
            return refuse(field, region, "a rectangle with an area, within the floor");
        }
        let n_free = region.free_points(world, clearance).count();
        let cell = (region.max - region.min) / GRID as f32;
        let area = n_free as f32 * cell.x * cell.y;
        if n_free == 0 || (n_bodies > 1 && area < AREA_OF_BODY * n_bodies as f32) {
            let expected = format!("{AREA_OF_BODY} m² for each body, {clearance:.2} m from walls and blocks");
            return refuse(field, format!("{n_bodies} bodies in {area:.2} m² of {region}"), &expected);
        }
        Ok(())
    }

    /// Refuses ways that nobody can go: from every free place of a start region one has to get to
    /// every free place of its goal region without a crash into walls and blocks. The spawner is
    /// that of the scene's room.
    ///
    /// # Errors
    ///
    /// The first goal region that cannot be reached.
    pub fn check_ways(&self, sim: &SimConfig, world: &World, spawner: &Spawner) -> Result<(), ArenaError> {
        let clearance = clearance(sim);
        let check = |field: &'static str, start: &Region, goal: &Region| {
            let mut ends = start.free_points(world, clearance).chain(goal.free_points(world, clearance));
            let first = ends.next();
            if first.is_none_or(|first| ends.all(|end| spawner.connects(first, end))) {
                return Ok(());
            }
            refuse(field, goal, &format!("a region that can be reached from all of {start}"))
        };
        check("scene.robot.goal", &self.robot.start, &self.robot.goal)?;
        let walking = self.groups.iter().filter(|group| !matches!(group.manner, Manner::Stands { .. }));
        walking.into_iter().try_for_each(|group| check("scene.groups.goal", &group.start, &group.goal))
    }

    /// Draws an episode's starts and goals: the robot first, so that its own do not depend on the
    /// pedestrians, then group by group. Starts keep the body clearance from each other where they
    /// can; where none of 1000 points does, the best is taken.
    pub fn place(&self, sim: &SimConfig, world: &World, rng: &mut impl Rng) -> Placing {
        let mut placing = Placing::default();
        let apart = sim.spawn.body_clearance;
        let clearance = clearance(sim);
        let start = free_point(&self.robot.start, world, clearance, apart, &placing, rng);
        let goal = free_point(&self.robot.goal, world, clearance, 0.0, &Placing::default(), rng);
        placing.push(Pose::new(start, (goal - start).to_angle()), goal);
        for group in &self.groups {
            match group.manner {
                Manner::Stands { circle } => {
                    let (from_walls, from_others) = (clearance + circle, apart + circle);
                    let centre = free_point(&group.start, world, from_walls, from_others, &placing, rng);
                    let phase = rng.random::<f32>() * std::f32::consts::TAU;
                    for k in 0..group.count {
                        let angle = phase + std::f32::consts::TAU * k as f32 / group.count as f32;
                        let place = centre + circle * Pose::new(Vec2::ZERO, angle).direction();
                        placing.push(Pose::new(place, (centre - place).to_angle()), place);
                        placing.stands_from.push(Some(0.0));
                    }
                }
                manner => {
                    for _ in 0..group.count {
                        let start = free_point(&group.start, world, clearance, apart, &placing, rng);
                        let goal = free_point(&group.goal, world, clearance, 0.0, &Placing::default(), rng);
                        placing.push(Pose::new(start, (goal - start).to_angle()), goal);
                        placing.stands_from.push(match manner {
                            Manner::StopsDead([low, high]) => Some(low + rng.random::<f32>() * (high - low)),
                            _ => None,
                        });
                    }
                }
            }
        }
        placing
    }

    /// The goal of a pedestrian that has arrived: in whichever of its two regions is farther away.
    pub fn next_goal(
        &self,
        pedestrian: usize,
        position: Vec2,
        sim: &SimConfig,
        world: &World,
        rng: &mut impl Rng,
    ) -> Option<Vec2> {
        let group = self.group(pedestrian)?;
        let distance = |region: &Region| region.centre().distance_squared(position);
        let back = distance(&group.start) > distance(&group.goal);
        let region = if back { &group.start } else { &group.goal };
        Some(free_point(region, world, clearance(sim), 0.0, &Placing::default(), rng))
    }

    /// A new place for a pedestrian that crashed, in its start region, and a goal: `apart` from all
    /// bodies in `others`, or as far from them as 1000 points are.
    pub fn restart(
        &self,
        pedestrian: usize,
        others: Vec<Pose>,
        apart: f32,
        sim: &SimConfig,
        world: &World,
        rng: &mut impl Rng,
    ) -> Option<(Pose, Vec2)> {
        let group = self.group(pedestrian)?;
        let clearance = clearance(sim);
        let taken = Placing { poses: others, ..Placing::default() };
        let start = free_point(&group.start, world, clearance, apart, &taken, rng);
        let goal = free_point(&group.goal, world, clearance, 0.0, &Placing::default(), rng);
        Some((Pose::new(start, (goal - start).to_angle()), goal))
    }

    /// The group of a pedestrian; `None` beyond the last.
    fn group(&self, pedestrian: usize) -> Option<&GroupConfig> {
        let mut first = 0;
        self.groups.iter().find(|group| {
            first += group.count;
            pedestrian < first
        })
    }
}

impl Placing {
    fn push(&mut self, pose: Pose, goal: Vec2) {
        self.poses.push(pose);
        self.goals.push(goal);
    }
}

/// Distance that everyone keeps from walls and blocks at their start and their goal: enough that
/// nobody has crashed there, by contact or by their scan.
fn clearance(sim: &SimConfig) -> f32 {
    let radius = Vec2::new(sim.robot.length, sim.robot.width).length() / 2.0;
    radius.max(sim.episode.crash_range) + MARGIN
}

/// A point of a region that keeps `clearance` from walls and blocks and `apart` from all who are
/// placed. The first of 1000 that does, else the one that breaks the demands least: walls and
/// blocks first, then the distance from the others.
fn free_point(
    region: &Region,
    world: &World,
    clearance: f32,
    apart: f32,
    taken: &Placing,
    rng: &mut impl Rng,
) -> Vec2 {
    let mut best = ((f32::NEG_INFINITY, f32::NEG_INFINITY), region.centre());
    for _ in 0..TRIES {
        let point = region.draw(rng);
        let walls = (world.clearance(point) - clearance).min(0.0);
        let nearest = taken.poses.iter().map(|pose| pose.position.distance(point));
        let bodies = (nearest.fold(f32::INFINITY, f32::min) - apart).min(0.0);
        if walls == 0.0 && bodies == 0.0 {
            return point;
        }
        if (walls, bodies) > best.0 {
            best = ((walls, bodies), point);
        }
    }
    best.1
}

fn refuse(field: &'static str, found: impl fmt::Display, expected: &str) -> Result<(), ArenaError> {
    Err(ArenaError::Setting { field, found: found.to_string(), expected: expected.to_owned() })
}

#[cfg(test)]
mod tests {
    use jostle_peds::CrowdKind;
    use jostle_sim::Streams;

    use super::*;
    use crate::config::ArenaConfig;
    use crate::room::RoomPlan;

    fn region(min: [f32; 2], max: [f32; 2]) -> Region {
        Region { min: min.into(), max: max.into() }
    }

    /// A corridor with a block in its middle, two walkers, a group of three and one who stops.
    fn scene() -> SceneConfig {
        let walkers = GroupConfig {
            count: 2,
            start: region([6.0, -1.0], [9.0, 1.0]),
            goal: region([-9.0, -1.0], [-6.0, 1.0]),
            manner: Manner::Walks,
        };
        let group = GroupConfig {
            count: 3,
            start: region([-1.0, 4.0], [1.0, 6.0]),
            manner: Manner::Stands { circle: 0.7 },
            ..walkers
        };
        let stopping = GroupConfig { count: 1, manner: Manner::StopsDead([2.0, 3.0]), ..walkers };
        SceneConfig {
            floor: region([-10.0, -8.0], [10.0, 8.0]),
            blocks: vec![region([-1.0, -2.0], [1.0, 2.0])],
            robot: RobotWay {
                start: region([-9.0, -1.0], [-7.0, 1.0]),
                goal: region([7.0, -1.0], [9.0, 1.0]),
            },
            groups: vec![walkers, group, stopping],
        }
    }

    #[test]
    fn everyone_starts_in_their_region_apart_from_everyone() {
        let (scene, sim) = (scene(), SimConfig::default());
        scene.validate(&sim).unwrap();
        assert_eq!(scene.n_pedestrians(), 6);
        let world = scene.scenario().build().unwrap();
        let mut seen = Vec::new();
        for episode in 0..50 {
            let mut rng = Streams::new(0).stream("test", &[episode]);
            let placing = scene.place(&sim, &world, &mut rng);
            let inside =
                |region: &Region, point: Vec2| region.min.cmple(point).all() && region.max.cmpge(point).all();
            assert!(inside(&scene.robot.start, placing.poses[0].position));
            assert!(inside(&scene.robot.goal, placing.goals[0]));
            assert!(placing.poses[0].heading.abs() < 0.2, "the robot faces its goal");
            for walker in [1, 2, 6] {
                assert!(inside(&scene.groups[0].start, placing.poses[walker].position));
                assert!(inside(&scene.groups[0].goal, placing.goals[walker]));
            }
            let standing: Vec<Vec2> = (3..6).map(|i| placing.poses[i].position).collect();
            let centre = standing.iter().sum::<Vec2>() / 3.0;
            assert!(inside(&scene.groups[1].start, centre));
            for (place, i) in standing.iter().zip(3..) {
                assert!((place.distance(centre) - 0.7).abs() < 1e-5 && placing.goals[i] == *place);
                assert!(placing.poses[i].direction().distance((centre - *place).normalize()) < 1e-5);
            }
            let stands: Vec<Option<f32>> = placing.stands_from.clone();
            assert_eq!(stands[..5], [None, None, Some(0.0), Some(0.0), Some(0.0)]);
            assert!((2.0..=3.0).contains(&stands[5].unwrap()));
            for (i, a) in placing.poses.iter().enumerate() {
                assert!(world.clearance(a.position) >= 0.6 - 1e-6);
                let apart = if (3..6).contains(&i) { 0.0 } else { 1.0 };
                for b in &placing.poses[..i] {
                    assert!(a.position.distance(b.position) >= apart, "{i}");
                }
            }
            seen.push(placing.poses[0].position);
        }
        seen.dedup();
        assert_eq!(seen.len(), 50);
    }

    #[test]
    fn who_arrives_turns_back_and_who_crashed_starts_again() {
        let (scene, sim) = (scene(), SimConfig::default());
        let world = scene.scenario().build().unwrap();
        let mut rng = Streams::new(0).stream("test", &[]);
        let at_goal = scene.next_goal(0, Vec2::new(-8.0, 0.0), &sim, &world, &mut rng).unwrap();
        assert!(at_goal.x >= 6.0);
        let at_start = scene.next_goal(0, Vec2::new(8.0, 0.0), &sim, &world, &mut rng).unwrap();
        assert!(at_start.x <= -6.0);
        let others = vec![Pose::new(Vec2::new(6.5, 0.0), 0.0)];
        let (pose, goal) = scene.restart(1, others, 1.5, &sim, &world, &mut rng).unwrap();
        assert!(pose.position.distance(Vec2::new(6.5, 0.0)) >= 1.5 && goal.x <= -6.0);
        // Nobody can be 50 m away; the farthest of the points is taken.
        let others = vec![Pose::new(Vec2::new(6.0, 0.0), 0.0)];
        let (pose, _) = scene.restart(1, others, 50.0, &sim, &world, &mut rng).unwrap();
        assert!(pose.position.x > 8.5, "{pose:?}");
        assert!(scene.next_goal(6, Vec2::ZERO, &sim, &world, &mut rng).is_none());
    }

    #[test]
    fn ways_that_nobody_can_go_are_refused() {
        let check = |change: &dyn Fn(&mut SceneConfig)| {
            let mut scene = scene();
            change(&mut scene);
            let config = ArenaConfig { n_agents: 7, scene: Some(scene), ..ArenaConfig::default() };
            RoomPlan::new(&config, CrowdKind::Sf).err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert_eq!(check(&|_| ()), "");
        // From wall to wall, and with a door that is too narrow for the crash range on both sides.
        let wall = region([4.0, -8.0], [4.2, 8.0]);
        let message = check(&|scene| scene.blocks.push(wall));
        assert!(
            message.starts_with("scene.robot.goal: found [7, -1] to [9, 1], expected a region that"),
            "{message}"
        );
        let door =
            |width: f32| [region([4.0, -8.0], [4.2, -width / 2.0]), region([4.0, width / 2.0], [4.2, 8.0])];
        assert!(check(&|scene| scene.blocks.extend(door(0.9))).starts_with("scene.robot.goal: found"));
        assert_eq!(check(&|scene| scene.blocks.extend(door(1.2))), "");
        // A part of the pedestrians' start region is cut off.
        let message = check(&|scene| scene.blocks.push(region([7.9, -8.0], [8.1, 8.0])));
        assert!(message.starts_with("scene.robot.goal: found"), "{message}");
        let cut = |scene: &mut SceneConfig| {
            scene.robot.goal = region([4.0, -1.0], [5.0, 1.0]);
            scene.blocks.push(region([7.4, -8.0], [7.6, 8.0]));
        };
        assert!(check(&cut).starts_with("scene.groups.goal: found"));
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let sim = SimConfig::default();
        let check = |change: &dyn Fn(&mut SceneConfig), field: &str| {
            let mut changed = scene();
            change(&mut changed);
            let message = changed.validate(&sim).unwrap_err().to_string();
            assert!(message.starts_with(field) && message.lines().count() == 1, "{message}");
        };
        check(&|s| s.floor.max.x = f32::NAN, "scene.floor: found");
        check(&|s| s.blocks[0].max = Vec2::splat(30.0), "scene.blocks: found");
        check(&|s| s.robot.start = region([-9.0, 0.0], [-9.0, 1.0]), "scene.robot.start: found");
        check(
            &|s| s.robot.goal = region([-0.5, -0.5], [0.5, 0.5]),
            "scene.robot.goal: found 1 bodies in 0.00 m²",
        );
        check(&|s| s.groups[0].count = 7, "scene.groups.start: found 7 bodies in 6.00 m²");
        check(&|s| s.groups[0].count = 0, "scene.groups.count: found 0");
        check(&|s| s.groups[0].goal.max.y = 9.0, "scene.groups.goal: found");
        check(&|s| s.groups[1].manner = Manner::Stands { circle: -1.0 }, "scene.groups.manner.stands.circle");
        check(&|s| s.groups[2].manner = Manner::StopsDead([3.0, 2.0]), "scene.groups.manner.stops_dead");
    }
}
