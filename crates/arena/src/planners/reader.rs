//! A planner's reading of an observation row: ranges in metres, directions of beams, the goal, the
//! velocity.

use glam::Vec2;
use jostle_sim::{FRAMES, SimConfig};

/// Reads the rows of one simulator.
///
/// # Shapes
///
/// A row is `[scan oldest … newest (3·beams) | goal x, goal y | v, ω]`; a scan holds range/limit −
/// ½.
#[derive(Clone, Debug)]
pub struct RowReader {
    directions: Vec<Vec2>,
    limit: f32,
    dt: f32,
}

impl RowReader {
    /// A reader of the rows that the simulator writes. The settings must be valid.
    pub fn new(sim: &SimConfig) -> Self {
        let direction = |angle: f64| Vec2::new(libm::cos(angle) as f32, libm::sin(angle) as f32);
        let directions = sim.laser.beam_angles().map(direction).collect();
        Self { directions, limit: sim.laser.range, dt: sim.episode.dt }
    }

    /// Unit vectors along the beams, in the robot's frame, counter-clockwise.
    pub fn directions(&self) -> &[Vec2] {
        &self.directions
    }

    /// The laser's range: what a beam reads that meets nothing (m).
    pub fn limit(&self) -> f32 {
        self.limit
    }

    /// Control period (s).
    pub fn dt(&self) -> f32 {
        self.dt
    }

    /// Length of a row.
    pub fn row_len(&self) -> usize {
        FRAMES * self.directions.len() + 4
    }

    /// The ranges (m) of a scan, by its age: 0 is the newest, 1 the one before it.
    ///
    /// # Panics
    ///
    /// When the row is too short or there is no scan that old.
    pub fn ranges<'r>(
        &self,
        row: &'r [f32],
        age: usize,
    ) -> impl ExactSizeIterator<Item = f32> + Clone + use<'r> {
        let (beams, limit) = (self.directions.len(), self.limit);
        let start = (FRAMES - 1 - age) * beams;
        row[start..start + beams].iter().map(move |value| (value + 0.5) * limit)
    }

    /// The goal in the robot's frame (m).
    ///
    /// # Panics
    ///
    /// When the row is too short.
    pub fn goal(&self, row: &[f32]) -> Vec2 {
        let [x, y, ..] = self.tail(row);
        Vec2::new(x, y)
    }

    /// The velocity (v, ω) that the robot executed between the last two scans.
    ///
    /// # Panics
    ///
    /// When the row is too short.
    pub fn velocity(&self, row: &[f32]) -> [f32; 2] {
        let [.., v, w] = self.tail(row);
        [v, w]
    }

    fn tail(&self, row: &[f32]) -> [f32; 4] {
        let start = FRAMES * self.directions.len();
        row[start..start + 4].try_into().expect("four numbers")
    }
}

/// The angle of a vector (rad), the same bits on every machine.
pub(super) fn angle_of(vector: Vec2) -> f32 {
    libm::atan2f(vector.y, vector.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_read_as_the_simulator_writes_it() {
        let mut sim = SimConfig::default();
        (sim.laser.beams, sim.laser.range) = (4, 20.0);
        let reader = RowReader::new(&sim);
        let mut row = vec![0.5; reader.row_len()];
        (row[8], row[5]) = (-0.25, 0.0);
        row[12..].copy_from_slice(&[3.0, -4.0, 0.5, 0.25]);
        assert_eq!(reader.ranges(&row, 0).collect::<Vec<_>>(), [5.0, 20.0, 20.0, 20.0]);
        assert_eq!(reader.ranges(&row, 1).collect::<Vec<_>>(), [20.0, 10.0, 20.0, 20.0]);
        assert_eq!((reader.goal(&row), reader.velocity(&row)), (Vec2::new(3.0, -4.0), [0.5, 0.25]));
        assert!(reader.directions()[1].distance(Vec2::Y) < 1e-7, "the second beam of four points left");
        assert_eq!((reader.limit(), reader.dt(), reader.row_len()), (20.0, 0.1, 16));
    }
}
