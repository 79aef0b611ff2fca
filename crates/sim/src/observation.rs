//! The observation row: three scans (oldest first), the goal in the robot's frame, the velocity.

use crate::config::{EXTRAS, FRAMES, SimConfig};
use crate::geometry::Pose;
use crate::laser::NoiseSource;
use crate::rng::StreamRng;
use glam::Vec2;

/// Writes one robot's observation rows. The row itself holds the scans of the past: the same row
/// must be passed to an observer every time.
///
/// # Shapes
///
/// A row is `[scan oldest … newest (3·beams) | goal x, goal y | v, ω]`; ranges are range/10 − ½,
/// the rest in SI units.
#[derive(Clone, Debug)]
pub struct Observer {
    noise: NoiseSource,
    beams: usize,
    range: f32,
    noise_std: f32,
}

impl Observer {
    /// An observer whose noise comes from `noise`.
    pub fn new(config: &SimConfig, noise: StreamRng) -> Self {
        let laser = &config.laser;
        let noise = NoiseSource::new(noise, laser.beams);
        Self { noise, beams: laser.beams, range: laser.range, noise_std: laser.noise_std }
    }

    /// The first scan of an episode: it fills all three frames.
    pub fn begin(&mut self, ranges: &[f32], row: &mut [f32]) {
        let newest = self.newest(row);
        self.noise.frame(ranges, self.noise_std, self.range, &mut row[newest.clone()]);
        for frame in 0..FRAMES - 1 {
            row.copy_within(newest.clone(), frame * self.beams);
        }
    }

    /// A later scan: the oldest frame goes.
    pub fn push(&mut self, ranges: &[f32], row: &mut [f32]) {
        let newest = self.newest(row);
        row.copy_within(self.beams..FRAMES * self.beams, 0);
        self.noise.frame(ranges, self.noise_std, self.range, &mut row[newest]);
    }

    /// Goal (in the robot's frame) and velocity (v, ω).
    pub fn write_motion(&self, pose: Pose, goal: Vec2, velocity: [f32; 2], row: &mut [f32]) {
        let goal_in_robot = pose.point_in_frame(goal);
        let [v, w] = velocity;
        row[FRAMES * self.beams..].copy_from_slice(&[goal_in_robot.x, goal_in_robot.y, v, w]);
    }

    /// Position of the noise stream, in words.
    pub fn noise_position(&self) -> u64 {
        self.noise.position()
    }

    /// Goes to a position of [`Observer::noise_position`].
    pub fn seek_noise(&mut self, position: u64) {
        self.noise.seek(position);
    }

    fn newest(&self, row: &[f32]) -> std::ops::Range<usize> {
        assert_eq!(row.len(), FRAMES * self.beams + EXTRAS, "length of an observation row");
        (FRAMES - 1) * self.beams..FRAMES * self.beams
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Streams;

    #[test]
    fn frames_run_from_oldest_to_newest() {
        let mut config = SimConfig::default();
        (config.laser.beams, config.laser.noise_std) = (2, 0.0);
        let mut observer = Observer::new(&config, Streams::new(0).stream("noise", &[]));
        let mut row = vec![9.0; config.observation_len()];
        observer.begin(&[10.0, 5.0], &mut row);
        let pose = Pose::new(Vec2::new(1.0, 1.0), std::f32::consts::PI);
        observer.write_motion(pose, Vec2::new(0.0, 1.0), [0.5, -0.25], &mut row);
        assert_eq!(row[..6], [0.5, 0.0, 0.5, 0.0, 0.5, 0.0]);
        assert!((row[6] - 1.0).abs() < 1e-6 && row[7].abs() < 1e-6);
        assert_eq!(row[8..], [0.5, -0.25]);
        observer.push(&[0.0, 10.0], &mut row);
        observer.push(&[2.5, 10.0], &mut row);
        assert_eq!(row[..6], [0.5, 0.0, -0.5, 0.5, -0.25, 0.5]);
    }
}
