//! The way of each candidate command: rolled out once, since in the robot's frame it is the same at
//! every step.

use glam::Vec2;

/// Candidates (v, ω), each held for the whole horizon, with the places that they lead through.
#[derive(Clone, Debug)]
pub(super) struct Rollouts {
    /// The commands.
    pub(super) commands: Vec<[f32; 2]>,
    /// Heading at the end (rad), one for each command.
    pub(super) headings: Vec<f32>,
    /// Time between two places (s).
    pub(super) step: f32,
    /// x, then y, of every command after each step.
    places: Vec<(Vec<f32>, Vec<f32>)>,
}

impl Rollouts {
    /// `speeds` from 0 to `v_max` and `rates` from −`w_max` to `w_max`, both evenly, in all pairs.
    pub(super) fn new(speeds: usize, rates: usize, limits: [f32; 2], steps: usize, step: f32) -> Self {
        let share = |i: usize, n: usize| i as f32 / (n - 1).max(1) as f32;
        let of_speed = |i| {
            let v = limits[0] * share(i, speeds);
            (0..rates).map(move |k| [v, limits[1] * (2.0 * share(k, rates) - 1.0)])
        };
        let commands: Vec<[f32; 2]> = (0..speeds).flat_map(of_speed).collect();
        let places = (1..=steps).map(|k| {
            let ends = commands.iter().map(|command| end_of(*command, k as f32 * step));
            ends.map(|end| (end.x, end.y)).unzip()
        });
        Self {
            headings: commands.iter().map(|[_, w]| w * steps as f32 * step).collect(),
            places: places.collect(),
            commands,
            step,
        }
    }

    /// The places after each step, with the time (s) at which they are reached.
    pub(super) fn steps(&self) -> impl Iterator<Item = (f32, &[f32], &[f32])> {
        let steps = self.places.iter().enumerate();
        steps.map(|(k, (xs, ys))| ((k + 1) as f32 * self.step, &xs[..], &ys[..]))
    }

    /// The end of each command's way.
    pub(super) fn ends(&self) -> impl Iterator<Item = Vec2> {
        let last = self.places.last().into_iter();
        last.flat_map(|(xs, ys)| xs.iter().zip(ys).map(|(x, y)| Vec2::new(*x, *y)))
    }

    /// For how long a command is rolled out (s).
    pub(super) fn horizon(&self) -> f32 {
        self.step * self.places.len() as f32
    }
}

/// The end of the arc that a command follows for a time, from the origin along x.
fn end_of([v, w]: [f32; 2], time: f32) -> Vec2 {
    let turn = w * time;
    if turn.abs() < 1e-4 {
        return Vec2::new(v * time, 0.5 * v * time * turn);
    }
    v / w * Vec2::new(libm::sinf(turn), 1.0 - libm::cosf(turn))
}

/// Lowers each square distance to that between its place and a point, where that is less.
pub(super) fn lower_to(least_sq: &mut [f32], xs: &[f32], ys: &[f32], point: Vec2) {
    for ((least, x), y) in least_sq.iter_mut().zip(xs).zip(ys) {
        let (dx, dy) = (x - point.x, y - point.y);
        let sq = dx * dx + dy * dy;
        // Not `f32::min`: this is one instruction a lane.
        *least = if sq < *least { sq } else { *least };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_lead_along_arcs() {
        let rollouts = Rollouts::new(3, 5, [1.0, 2.0], 4, 0.25);
        assert_eq!(rollouts.commands.len(), 15);
        assert_eq!((rollouts.commands[0], rollouts.commands[14]), ([0.0, -2.0], [1.0, 2.0]));
        assert_eq!((rollouts.horizon(), rollouts.headings[14]), (1.0, 2.0));
        let ends: Vec<Vec2> = rollouts.ends().collect();
        // Straight on, and a circle of radius ½ around (0, ½) turned through 2 rad.
        assert_eq!((rollouts.commands[12], ends[12]), ([1.0, 0.0], Vec2::X));
        let turned = 0.5 * Vec2::new(2.0_f32.sin(), 1.0 - 2.0_f32.cos());
        assert!(ends[14].distance(turned) < 1e-6);
        assert!(ends[10].distance(Vec2::new(turned.x, -turned.y)) < 1e-6, "the other way round, mirrored");
        let times: Vec<f32> = rollouts.steps().map(|(time, ..)| time).collect();
        assert_eq!(times, [0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn a_slow_turn_is_nearly_straight() {
        let (slow, none) = (end_of([1.0, 1e-5], 3.0), end_of([1.0, 0.0], 3.0));
        assert!(slow.distance(none) < 1e-4 && slow.y > 0.0);
        assert!(end_of([1.0, 1.01e-4], 1.0).distance(end_of([1.0, 0.99e-4], 1.0)) < 1e-4);
    }

    #[test]
    fn the_least_distance_stays() {
        let (xs, ys) = ([0.0, 3.0], [0.0, 4.0]);
        let mut least = [f32::INFINITY, 1.0];
        lower_to(&mut least, &xs, &ys, Vec2::ZERO);
        assert_eq!(least, [0.0, 1.0]);
    }
}
