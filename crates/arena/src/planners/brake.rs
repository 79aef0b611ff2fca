//! `brake`: to the goal, more slowly the nearer something is ahead. Ten lines by hand that beat
//! much that was learned.

use jostle_sim::SimConfig;

use super::each_row::RowPlanner;
use super::reader::{RowReader, angle_of};

/// Turning rate for each radian off the goal's direction (1/s).
const TURN_GAIN: f32 = 2.0;
/// It stops for what is nearer ahead than this (m).
const STOP: f32 = 0.7;
/// It drives at full speed when what is ahead is farther than [`STOP`] by this (m).
const SLOWING: f32 = 1.0;
/// Cosine of the half angle of "ahead": 45°.
const AHEAD: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Turns to the goal; its speed is bounded by the nearest return within 45° of straight ahead.
#[derive(Clone, Debug)]
pub struct Brake {
    reader: RowReader,
    v_max: f32,
    w_max: f32,
}

impl Brake {
    /// The planner of a robot.
    pub fn new(sim: &SimConfig) -> Self {
        Self { reader: RowReader::new(sim), v_max: sim.robot.v_max, w_max: sim.robot.w_max }
    }
}

impl RowPlanner for Brake {
    type Scratch = ();

    fn reader(&self) -> &RowReader {
        &self.reader
    }

    fn plan(&self, row: &[f32], (): &mut ()) -> [f32; 2] {
        let turn = angle_of(self.reader.goal(row));
        let beams = self.reader.ranges(row, 0).zip(self.reader.directions());
        let ahead = beams.filter(|(_, direction)| direction.x >= AHEAD).map(|(range, _)| range);
        let nearest = ahead.fold(self.reader.limit(), f32::min);
        let share = ((nearest - STOP) / SLOWING).clamp(0.0, 1.0);
        let v = self.v_max * libm::cosf(turn).max(0.0) * share;
        [v, (TURN_GAIN * turn).clamp(-self.w_max, self.w_max)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;

    #[test]
    fn it_slows_down_for_what_is_ahead_alone() {
        let planner = Brake::new(&SimConfig::default());
        let speed = |scene: Scene| planner.plan(&scene.row(), &mut ())[0];
        assert_eq!(speed(Scene::empty()), 1.0);
        // A disc whose edge is 1.2 m ahead: half of the metre between stopping and full speed.
        let half = speed(Scene::empty().with_disc([1.5, 0.0], 0.3));
        assert!((half - 0.5).abs() < 1e-3, "{half}");
        assert_eq!(speed(Scene::empty().with_disc([0.9, 0.0], 0.3)), 0.0);
        assert_eq!(speed(Scene::empty().with_disc([0.0, 0.9], 0.3)), 1.0, "what is beside it does not count");
    }
}
