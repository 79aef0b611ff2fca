//! The sum of the terms, and the Euler step.

use glam::DVec2;

use super::{
    Border, SocialForceConfig,
    forces::{goal_force, pair_force, view_weight, wall_force},
};
use crate::PedsError;

/// A pedestrian of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walker {
    /// m.
    pub position: DVec2,
    /// m/s.
    pub velocity: DVec2,
    /// m.
    pub goal: DVec2,
    /// m/s.
    pub desired_speed: f64,
}

/// All terms for n walkers among k borders, m/s².
#[derive(Debug, Clone, PartialEq)]
pub struct Forces {
    /// `[n]`: drive to the goal.
    pub goal: Vec<DVec2>,
    /// `[n][n]`: repulsion of a by b, not weighted; 0 for a = b.
    pub pair: Vec<Vec<DVec2>>,
    /// `[n][n]`: its weight; 0 for a = b.
    pub weight: Vec<Vec<f64>>,
    /// `[n]`: weighted sum over the others.
    pub pedestrian: Vec<DVec2>,
    /// `[n][k]`: repulsion by each border.
    pub wall_each: Vec<Vec<DVec2>>,
    /// `[n]`: sum over the borders.
    pub wall: Vec<DVec2>,
    /// `[n]`: goal + pedestrian + wall.
    pub total: Vec<DVec2>,
}

/// The model with validated parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SocialForce {
    config: SocialForceConfig,
}

impl SocialForce {
    /// The model.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(config: &SocialForceConfig) -> Result<Self, PedsError> {
        config.validate()?;
        Ok(Self { config: *config })
    }

    /// Its parameters.
    pub fn config(&self) -> &SocialForceConfig {
        &self.config
    }

    /// Drive of a walker to its goal.
    pub fn goal_force(&self, walker: &Walker) -> DVec2 {
        goal_force(&self.config, walker)
    }

    /// Repulsion of `a` by `b`, and its weight.
    pub fn pair_force(&self, a: &Walker, b: &Walker) -> (DVec2, f64) {
        let force = pair_force(&self.config, a, b);
        (force, view_weight(&self.config, a, b, force))
    }

    /// Repulsion by a border.
    pub fn wall_force(&self, position: DVec2, border: &Border) -> DVec2 {
        wall_force(&self.config, position, border)
    }

    /// Total force on walker `a` of a list. Summed in the order of the lists.
    pub fn total_force(&self, a: usize, walkers: &[Walker], borders: &[Border]) -> DVec2 {
        let walker = &walkers[a];
        let others = walkers.iter().enumerate().filter(|(b, _)| *b != a);
        let pedestrian: DVec2 = others
            .map(|(_, other)| self.pair_force(walker, other))
            .map(|(force, weight)| weight * force)
            .sum();
        let wall: DVec2 = borders.iter().map(|border| self.wall_force(walker.position, border)).sum();
        self.goal_force(walker) + pedestrian + wall
    }

    /// Every term by itself.
    pub fn forces(&self, walkers: &[Walker], borders: &[Border]) -> Forces {
        let pairs: Vec<Vec<(DVec2, f64)>> = walkers
            .iter()
            .enumerate()
            .map(|(a, walker)| {
                let pair =
                    |(b, other)| if a == b { (DVec2::ZERO, 0.0) } else { self.pair_force(walker, other) };
                walkers.iter().enumerate().map(pair).collect()
            })
            .collect();
        let wall_each: Vec<Vec<DVec2>> = walkers
            .iter()
            .map(|walker| borders.iter().map(|border| self.wall_force(walker.position, border)).collect())
            .collect();
        Forces {
            goal: walkers.iter().map(|walker| self.goal_force(walker)).collect(),
            pedestrian: pairs
                .iter()
                .map(|row| row.iter().map(|(force, weight)| *weight * *force).sum())
                .collect(),
            wall: wall_each.iter().map(|row| row.iter().sum()).collect(),
            total: (0..walkers.len()).map(|a| self.total_force(a, walkers, borders)).collect(),
            pair: pairs.iter().map(|row| row.iter().map(|(force, _)| *force).collect()).collect(),
            weight: pairs.iter().map(|row| row.iter().map(|(_, weight)| *weight).collect()).collect(),
            wall_each,
        }
    }

    /// Velocity of walker `a` after `dt`, at most the speed limit.
    ///
    /// # Formula
    /// w = v + dt·F, v' = w·min(1, limit/|w|), limit = factor × desired speed.
    pub fn next_velocity(&self, a: usize, walkers: &[Walker], borders: &[Border], dt: f64) -> DVec2 {
        let w = walkers[a].velocity + dt * self.total_force(a, walkers, borders);
        let limit = self.config.max_speed_factor * walkers[a].desired_speed;
        let speed = w.length();
        if speed > limit { w * (limit / speed) } else { w }
    }

    /// Explicit Euler step of all walkers: positions move with the old velocities, and velocities
    /// with the old forces.
    ///
    /// Crowd SF moves with the *new* velocities instead (velocity, limit, position), for there the
    /// world moves the bodies by what the crowd decides.
    pub fn step(&self, walkers: &mut [Walker], borders: &[Border], dt: f64) {
        let next: Vec<DVec2> =
            (0..walkers.len()).map(|a| self.next_velocity(a, walkers, borders, dt)).collect();
        for (walker, velocity) in walkers.iter_mut().zip(next) {
            walker.position += dt * walker.velocity;
            walker.velocity = velocity;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walker(x: f64, velocity: DVec2, goal: DVec2) -> Walker {
        Walker { position: DVec2::new(x, 0.0), velocity, goal, desired_speed: 1.0 }
    }

    fn model() -> SocialForce {
        SocialForce::new(&SocialForceConfig::default()).unwrap()
    }

    #[test]
    fn the_pair_force_is_minus_the_potentials_gradient() {
        let b = walker(0.0, DVec2::new(0.5, 0.3), DVec2::new(4.0, 3.0));
        let potential = |position: DVec2| {
            let s = b.velocity.length() * 2.0 * DVec2::new(0.8, 0.6);
            let sum = position.length() + (position - s).length();
            2.1 * (-0.5 * (sum * sum - s.length_squared()).sqrt() / 0.3).exp()
        };
        let h = 1e-6;
        for position in [DVec2::new(0.4, -0.5), DVec2::new(1.2, 0.1), DVec2::new(-0.3, 0.4)] {
            let a = Walker { position, ..walker(0.0, DVec2::ZERO, DVec2::X) };
            let slope =
                |axis: DVec2| (potential(position + h * axis) - potential(position - h * axis)) / (2.0 * h);
            let (force, _) = model().pair_force(&a, &b);
            let expected = -DVec2::new(slope(DVec2::X), slope(DVec2::Y));
            assert!(force.distance(expected) < 1e-7, "{force} {expected}");
        }
    }

    #[test]
    fn singular_places_are_finite() {
        let still = walker(0.0, DVec2::ZERO, DVec2::ZERO);
        let moving = walker(0.0, DVec2::X, DVec2::new(5.0, 0.0));
        let ahead = walker(1.0, DVec2::ZERO, DVec2::X);
        let wall = Border::new(&[[DVec2::ZERO, DVec2::X]]).unwrap();
        let walkers = [still, moving, moving, ahead];
        for a in 0..walkers.len() {
            assert!(
                model().next_velocity(a, &walkers, std::slice::from_ref(&wall), 0.1).length() <= 1.3 + 1e-12
            );
        }
    }

    #[test]
    fn one_behind_counts_half() {
        let a = walker(0.0, DVec2::X, DVec2::new(5.0, 0.0));
        let behind = walker(-0.8, DVec2::ZERO, DVec2::new(-5.0, 0.0));
        let ahead = walker(0.8, DVec2::ZERO, DVec2::new(5.0, 0.0));
        assert_eq!(model().pair_force(&a, &behind).1, 0.5);
        assert_eq!(model().pair_force(&a, &ahead).1, 1.0);
    }

    #[test]
    fn a_step_moves_with_the_old_velocity() {
        let mut walkers = [walker(0.0, DVec2::new(0.5, 0.0), DVec2::new(9.0, 0.0))];
        model().step(&mut walkers, &[], 0.1);
        // F = (1 − 0.5) / 0.5 = 1.
        assert_eq!(walkers[0].position, DVec2::new(0.05, 0.0));
        assert!((walkers[0].velocity.x - 0.6).abs() < 1e-15);
    }
    #[test]
    fn one_exactly_behind_is_in_a_view_all_around() {
        let config = SocialForceConfig {
            variant: super::super::Variant::Package,
            field_of_view_degrees: 360.0,
            ..SocialForceConfig::default()
        };
        let a = walker(0.0, DVec2::X, DVec2::new(5.0, 0.0));
        let behind = walker(-0.8, DVec2::ZERO, DVec2::new(-5.0, 0.0));
        assert_eq!(SocialForce::new(&config).unwrap().pair_force(&a, &behind).1, 1.0);
    }

    #[test]
    fn every_term_by_itself_is_the_term_alone() {
        let walkers = [
            walker(0.0, DVec2::X, DVec2::new(5.0, 0.0)),
            walker(0.9, DVec2::new(-0.2, 0.1), DVec2::new(-5.0, 1.0)),
            walker(-1.2, DVec2::Y, DVec2::new(0.0, 5.0)),
        ];
        let at = |y: f64| Border::new(&[[DVec2::new(-3.0, y), DVec2::new(3.0, y)]]).unwrap();
        let borders = [at(-0.5), at(0.7)];
        let forces = model().forces(&walkers, &borders);
        for (a, walker) in walkers.iter().enumerate() {
            assert_eq!(forces.goal[a], model().goal_force(walker));
            assert_eq!((forces.pair[a][a], forces.weight[a][a]), (DVec2::ZERO, 0.0));
            let mut sum = DVec2::ZERO;
            for (b, other) in walkers.iter().enumerate().filter(|(b, _)| *b != a) {
                let (force, weight) = model().pair_force(walker, other);
                assert_eq!((forces.pair[a][b], forces.weight[a][b]), (force, weight));
                sum += weight * force;
            }
            assert_eq!(forces.pedestrian[a], sum);
            let walls = [0, 1].map(|k| model().wall_force(walker.position, &borders[k]));
            assert_eq!(forces.wall_each[a], walls);
            assert_eq!(forces.wall[a], walls[0] + walls[1]);
            assert!(forces.total[a].distance(forces.goal[a] + sum + forces.wall[a]) < 1e-12);
        }
    }
}
