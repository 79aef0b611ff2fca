//! The robot's possible ways: one path for each direction and speed, and the first time at which
//! something is met on it.
//!
//! A path turns towards its direction at the largest turning rate and goes on straight; while it
//! turns, its speed is that of the path times the cosine of the angle that is left (0 beyond a
//! right angle). All paths are fixed in the robot's frame.

#![allow(clippy::inline_always, reason = "what Isa::run compiles anew must be inlined into it")]

use std::f64::consts::{PI, TAU};

/// Directions of the paths, evenly spaced; the first is straight ahead.
pub const DIRECTIONS: usize = 24;
/// Speeds of the paths as shares of the largest.
pub const SPEEDS: [f64; 2] = [1.0, 0.5];
/// Number of paths; path `speed · DIRECTIONS + direction`.
pub const PATHS: usize = DIRECTIONS * SPEEDS.len();
/// Points on a path.
pub const STEPS: usize = 18;
/// Time between two points, s.
pub const STEP: f64 = 0.25;
/// Time that paths look ahead, s.
pub const HORIZON: f32 = (STEPS as f64 * STEP) as f32;
/// Length of an Euler step of the turning part, s.
const FINE: f64 = 0.05;

/// The points of all paths.
#[derive(Debug, Clone)]
pub struct Paths {
    x: Box<[[f32; PATHS]; STEPS]>,
    y: Box<[[f32; PATHS]; STEPS]>,
    /// Largest distance of a step's points from the robot, m.
    reach: [f32; STEPS],
}

/// The time at which each path first meets something, in steps (1 to [`STEPS`]); [`FREE`] where it
/// meets nothing.
pub type Meetings = [f32; PATHS];

/// A path that meets nothing within its horizon.
pub const FREE: f32 = (STEPS + 1) as f32;

impl Paths {
    /// Paths of a robot with these limits, m/s and rad/s.
    pub fn new(v_max: f32, w_max: f32) -> Self {
        let (mut x, mut y) = (Box::new([[0.0; PATHS]; STEPS]), Box::new([[0.0; PATHS]; STEPS]));
        for path in 0..PATHS {
            let speed = SPEEDS[path / DIRECTIONS] * f64::from(v_max);
            let points = points(direction(path % DIRECTIONS), speed, f64::from(w_max));
            for (step, [px, py]) in points.into_iter().enumerate() {
                (x[step][path], y[step][path]) = (px as f32, py as f32);
            }
        }
        let reach = std::array::from_fn(|step| {
            let points = x[step].iter().zip(&y[step]);
            points.map(|(x, y): (&f32, &f32)| (x * x + y * y).sqrt()).fold(0.0, f32::max)
        });
        Self { x, y, reach }
    }

    /// Brings in a disc that moves in a straight line: paths that come within a radius of its
    /// centre meet it. Each of `meetings` has its own radius.
    ///
    /// `centre` (m) and `velocity` (m/s) are in the robot's frame as it is now, which stays.
    #[inline(always)]
    pub fn meet<const N: usize>(
        &self,
        centre: [f32; 2],
        velocity: [f32; 2],
        radii: [f32; N],
        meetings: &mut [Meetings; N],
    ) {
        let radii_sq = radii.map(|radius| radius * radius);
        let widest = radii.into_iter().fold(0.0, f32::max);
        for step in 0..STEPS {
            let time = (step + 1) as f32 * STEP as f32;
            let (cx, cy) = (centre[0] + velocity[0] * time, centre[1] + velocity[1] * time);
            // No path is there yet.
            let far = self.reach[step] + widest;
            if cx * cx + cy * cy > far * far {
                continue;
            }
            let (xs, ys) = (&self.x[step], &self.y[step]);
            let mark = (step + 1) as f32;
            for path in 0..PATHS {
                let (dx, dy) = (xs[path] - cx, ys[path] - cy);
                let distance_sq = dx * dx + dy * dy;
                for (meetings, radius_sq) in meetings.iter_mut().zip(radii_sq) {
                    let found = if distance_sq < radius_sq { mark } else { FREE };
                    let earlier = meetings[path];
                    meetings[path] = if found < earlier { found } else { earlier };
                }
            }
        }
    }
}

/// The angle of a direction, in (−π, π].
fn direction(index: usize) -> f64 {
    let angle = TAU * index as f64 / DIRECTIONS as f64;
    if angle > PI { angle - TAU } else { angle }
}

/// The points of one path.
fn points(direction: f64, speed: f64, w_max: f64) -> [[f64; 2]; STEPS] {
    let mut found = [[0.0; 2]; STEPS];
    let (mut x, mut y, mut heading) = (0.0_f64, 0.0_f64, 0.0_f64);
    let fine_steps = (STEP / FINE).round() as usize;
    for point in &mut found {
        for _ in 0..fine_steps {
            let left = direction - heading;
            let v = speed * libm::cos(left).max(0.0);
            x += v * libm::cos(heading) * FINE;
            y += v * libm::sin(heading) * FINE;
            heading += left.clamp(-w_max * FINE, w_max * FINE);
        }
        *point = [x, y];
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL_FREE: Meetings = [FREE; PATHS];

    /// The time at which each path meets one disc, in steps.
    fn meet(centre: [f32; 2], velocity: [f32; 2], radius: f32) -> Meetings {
        let mut meetings = [ALL_FREE];
        Paths::new(1.0, 1.0).meet(centre, velocity, [radius], &mut meetings);
        meetings[0]
    }

    #[test]
    fn straight_ahead_is_straight() {
        let points = points(0.0, 1.0, 1.0);
        assert!((points[3][0] - 1.0).abs() < 1e-12 && points[3][1] == 0.0);
    }

    #[test]
    fn behind_is_reached_by_turning_first() {
        let [x, y] = points(PI, 1.0, 1.0)[5];
        assert!(x.abs() < 1e-6 && y.abs() < 1e-6, "1.5 s are spent turning on the spot: {x} {y}");
    }

    #[test]
    fn a_standing_disc_is_met_when_it_is_reached() {
        let meetings = meet([2.0, 0.0], [0.0, 0.0], 0.8);
        // Straight on at 1 m/s the rim, 1.2 m ahead, is passed at 1.25 s; at half speed at 2.5 s;
        // backwards never.
        assert_eq!((meetings[0], meetings[DIRECTIONS], meetings[DIRECTIONS / 2]), (5.0, 10.0, FREE));
    }

    #[test]
    fn one_that_crosses_is_met_where_it_will_be() {
        // From the left, 2 m ahead: both are at (2, 0) after 2 s.
        let met = meet([2.0, 2.0], [0.0, -1.0], 0.5)[0] * STEP as f32;
        assert!((1.4..=2.0).contains(&met), "{met}");
        // If it did not move, straight on would be free.
        assert_eq!(meet([2.0, 2.0], [0.0, 0.0], 0.5)[0], FREE);
    }

    #[test]
    fn a_wider_berth_is_met_no_later() {
        let mut both = [ALL_FREE; 2];
        Paths::new(1.0, 1.0).meet([2.0, 0.5], [-0.5, 0.0], [0.8, 1.2], &mut both);
        assert_eq!(both[0], meet([2.0, 0.5], [-0.5, 0.0], 0.8));
        assert!(both[0].iter().zip(&both[1]).all(|(near, wide)| wide <= near) && both[0] != both[1]);
    }

    #[test]
    fn left_and_right_mirror_each_other() {
        let (left, right) = (meet([1.5, 1.0], [-0.5, 0.25], 0.8), meet([1.5, -1.0], [-0.5, -0.25], 0.8));
        for (path, meeting) in left.iter().enumerate() {
            let mirrored = path / DIRECTIONS * DIRECTIONS + (DIRECTIONS - path % DIRECTIONS) % DIRECTIONS;
            // Straight back is turned to the left by either.
            if path % DIRECTIONS != DIRECTIONS / 2 {
                assert_eq!(*meeting, right[mirrored], "path {path}");
            }
        }
    }
}
