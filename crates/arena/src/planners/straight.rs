//! `straight`: to the goal as if nobody were there.

use jostle_sim::SimConfig;

use super::each_row::RowPlanner;
use super::reader::{RowReader, angle_of};

/// Turning rate for each radian off the goal's direction (1/s).
const TURN_GAIN: f32 = 2.0;

/// Turns to the goal and drives at full speed; drives more slowly the less it heads there.
#[derive(Clone, Debug)]
pub struct Straight {
    reader: RowReader,
    v_max: f32,
    w_max: f32,
}

impl Straight {
    /// The planner of a robot.
    pub fn new(sim: &SimConfig) -> Self {
        Self { reader: RowReader::new(sim), v_max: sim.robot.v_max, w_max: sim.robot.w_max }
    }
}

impl RowPlanner for Straight {
    type Scratch = ();

    fn reader(&self) -> &RowReader {
        &self.reader
    }

    fn plan(&self, row: &[f32], (): &mut ()) -> [f32; 2] {
        let turn = angle_of(self.reader.goal(row));
        let v = self.v_max * libm::cosf(turn).max(0.0);
        [v, (TURN_GAIN * turn).clamp(-self.w_max, self.w_max)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;

    #[test]
    fn it_drives_to_the_goal_and_sees_nothing() {
        let planner = Straight::new(&SimConfig::default());
        let to = |x: f32, y: f32| planner.plan(&Scene::empty().with_goal(x, y).row(), &mut ());
        assert_eq!(to(8.0, 0.0), [1.0, 0.0]);
        let [v, w] = to(0.0, 8.0);
        assert!(v < 1e-6 && w == 1.0);
        assert_eq!(to(-8.0, -0.1), [0.0, -1.0]);
        let walled = Scene::empty().with_disc([1.0, 0.0], 0.3).row();
        assert_eq!(planner.plan(&walled, &mut ()), [1.0, 0.0], "whatever is in its way");
    }
}
