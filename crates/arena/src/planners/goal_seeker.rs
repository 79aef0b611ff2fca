//! `goal-seeker`: turns to the free direction nearest to its goal, and slows down where its way is
//! blocked.

use glam::Vec2;
use jostle_sim::SimConfig;

use super::each_row::RowPlanner;
use super::reader::{RowReader, angle_of};

/// Metres that it wants to be free on either side of its way.
const HALF_WIDTH: f32 = 0.75;
/// Look-ahead (m).
const LOOK_AHEAD: f32 = 3.0;
/// Directions that it considers, from −120° to 120°.
const CANDIDATES: usize = 41;
/// The spread of these directions (rad).
const SPREAD: f32 = 240.0 * std::f32::consts::PI / 180.0;
/// Cost of a way that is blocked at once; a radian off the goal's direction costs 1.
const BLOCKED: f32 = 4.0;
/// Cost of a radian off straight ahead: it decides between the sides of an obstacle.
const TURN: f32 = 0.1;
/// Share of the full speed for each metre that is free ahead (1/m).
const SPEED_GAIN: f32 = 0.8;
/// Turning rate for each radian off the chosen direction (1/s).
const TURN_GAIN: f32 = 2.0;

/// Weighs directions by how far they are free and how far they lead off the goal's.
#[derive(Clone, Debug)]
pub struct GoalSeeker {
    reader: RowReader,
    v_max: f32,
    w_max: f32,
    /// Angle and unit vector of each direction.
    candidates: Vec<(f32, Vec2)>,
}

impl GoalSeeker {
    /// The planner of a robot.
    pub fn new(sim: &SimConfig) -> Self {
        let candidate = |k: usize| {
            let angle = SPREAD * (k as f32 / (CANDIDATES - 1) as f32 - 0.5);
            (angle, Vec2::new(libm::cosf(angle), libm::sinf(angle)))
        };
        Self {
            reader: RowReader::new(sim),
            v_max: sim.robot.v_max,
            w_max: sim.robot.w_max,
            candidates: (0..CANDIDATES).map(candidate).collect(),
        }
    }
}

impl RowPlanner for GoalSeeker {
    /// Returns that are near enough to matter.
    type Scratch = Vec<Vec2>;

    fn reader(&self) -> &RowReader {
        &self.reader
    }

    fn plan(&self, row: &[f32], points: &mut Vec<Vec2>) -> [f32; 2] {
        points.clear();
        let beams = self.reader.ranges(row, 0).zip(self.reader.directions());
        let near = beams.filter(|(range, _)| *range < LOOK_AHEAD + HALF_WIDTH);
        points.extend(near.map(|(range, direction)| range * *direction));
        let goal = self.reader.goal(row);
        let (to_goal, reach) = (angle_of(goal), goal.length().min(LOOK_AHEAD));
        let cost = |angle: f32, direction: Vec2| {
            let off = jostle_sim::wrap_angle(f64::from(to_goal - angle)).abs();
            let blocked = 1.0 - free(points, direction).min(reach) / reach.max(1e-3);
            off + BLOCKED * blocked + TURN * angle.abs()
        };
        let costs = self.candidates.iter().map(|(angle, direction)| (cost(*angle, *direction), *angle));
        let (_, angle) = costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0.0));
        let share = (SPEED_GAIN * free(points, Vec2::X)).clamp(0.0, 1.0);
        let v = self.v_max * share * libm::cosf(angle).max(0.0);
        [v, (TURN_GAIN * angle).clamp(-self.w_max, self.w_max)]
    }
}

/// Length of the free way in a direction, up to the look-ahead (m).
fn free(points: &[Vec2], direction: Vec2) -> f32 {
    let blocked = points.iter().filter_map(|point| {
        let (along, across) = (direction.dot(*point), direction.perp_dot(*point));
        (along > 0.0 && across.abs() < HALF_WIDTH).then_some(along - HALF_WIDTH)
    });
    blocked.fold(LOOK_AHEAD, f32::min).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;

    #[test]
    fn it_drives_to_a_free_goal_and_turns_from_a_wall() {
        let planner = GoalSeeker::new(&SimConfig::default());
        let plan = |scene: Scene| planner.plan(&scene.row(), &mut Vec::new());
        let [v, w] = plan(Scene::empty());
        assert!(v > 0.99 && w.abs() < 0.01);
        assert_eq!(plan(Scene::empty().with_goal(0.0, 8.0))[1], 1.0);
        let [v, w] = plan(Scene::empty().with_wall([1.0, -0.5], [1.0, 0.5]));
        assert!(v < 0.3 && w.abs() > 0.5, "({v}, {w})");
    }
}
