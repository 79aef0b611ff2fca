//! Hand-made scenes for tests: what a laser without noise sees of discs and walls, in three scans.

use glam::Vec2;
use jostle_sim::SimConfig;

const BEAMS: usize = 512;
const LIMIT: f32 = 10.0;
const DT: f32 = 0.1;

/// A robot at the origin, heading along x, and what is around it now; the past follows from the
/// velocities.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    goal: [f32; 2],
    velocity: [f32; 2],
    /// Centre, radius, velocity over ground in the robot's frame.
    discs: Vec<(Vec2, f32, Vec2)>,
    walls: Vec<(Vec2, Vec2)>,
}

impl Scene {
    /// Nothing in sight, the goal 8 m straight ahead.
    pub(crate) fn empty() -> Self {
        Self { goal: [8.0, 0.0], velocity: [0.0; 2], discs: Vec::new(), walls: Vec::new() }
    }

    pub(crate) fn with_goal(self, x: f32, y: f32) -> Self {
        Self { goal: [x, y], ..self }
    }

    /// The robot has driven with (v, ω) between the last scans.
    pub(crate) fn with_velocity(self, v: f32, w: f32) -> Self {
        Self { velocity: [v, w], ..self }
    }

    pub(crate) fn with_disc(self, centre: [f32; 2], radius: f32) -> Self {
        self.with_walker(centre, radius, [0.0; 2])
    }

    pub(crate) fn with_walker(mut self, centre: [f32; 2], radius: f32, velocity: [f32; 2]) -> Self {
        self.discs.push((centre.into(), radius, velocity.into()));
        self
    }

    pub(crate) fn with_wall(mut self, a: [f32; 2], b: [f32; 2]) -> Self {
        self.walls.push((a.into(), b.into()));
        self
    }

    /// The same scene turned over: left is right.
    pub(crate) fn mirrored(mut self) -> Self {
        let flip = |v: Vec2| Vec2::new(v.x, -v.y);
        self.goal[1] = -self.goal[1];
        self.velocity[1] = -self.velocity[1];
        for (centre, _, velocity) in &mut self.discs {
            (*centre, *velocity) = (flip(*centre), flip(*velocity));
        }
        for (a, b) in &mut self.walls {
            (*a, *b) = (flip(*a), flip(*b));
        }
        self
    }

    /// The observation row of the default simulator.
    pub(crate) fn row(&self) -> Vec<f32> {
        assert_eq!(SimConfig::default().observation_len(), 3 * BEAMS + 4);
        let mut row: Vec<f32> = (0..3).rev().flat_map(|age| self.scan(age)).collect();
        row.extend(self.goal.iter().chain(&self.velocity));
        row
    }

    fn scan(&self, age: u16) -> Vec<f32> {
        // One step back: turned back first, as a step moves along the old heading and turns then.
        let (mut position, mut heading) = (Vec2::ZERO, 0.0);
        for _ in 0..age {
            heading -= self.velocity[1] * DT;
            position -= Vec2::from_angle(heading) * self.velocity[0] * DT;
        }
        let ago = f32::from(age) * DT;
        let beam = |k: usize| {
            let direction = Vec2::from_angle(heading + std::f32::consts::TAU * k as f32 / BEAMS as f32);
            let discs =
                self.discs.iter().filter_map(|(c, r, u)| to_disc(position, direction, *c - *u * ago, *r));
            let walls = self.walls.iter().filter_map(|(a, b)| to_wall(position, direction, *a, *b));
            discs.chain(walls).fold(LIMIT, f32::min) / LIMIT - 0.5
        };
        (0..BEAMS).map(beam).collect()
    }
}

fn to_disc(from: Vec2, direction: Vec2, centre: Vec2, radius: f32) -> Option<f32> {
    let (along, across) = (direction.dot(centre - from), direction.perp_dot(centre - from));
    let half_sq = radius * radius - across * across;
    (half_sq >= 0.0 && along > 0.0).then(|| (along - half_sq.sqrt()).max(0.0))
}

fn to_wall(from: Vec2, direction: Vec2, a: Vec2, b: Vec2) -> Option<f32> {
    let edge = b - a;
    let det = direction.perp_dot(edge);
    let (range, part) = ((a - from).perp_dot(edge) / det, (a - from).perp_dot(direction) / det);
    (det != 0.0 && range >= 0.0 && (0.0..=1.0).contains(&part)).then_some(range)
}
