//! Crowds by which settings are chosen: walkers who ignore everyone. They are not of the paper and
//! in none of its tables.
//!
//! A straight walker goes towards its goal at a speed of its own and steers around nothing. A
//! stop-and-go walker does the same, walking and standing in turns. Neither sees the robot or
//! anyone else, so that only the robot avoids collisions.
//!
//! Two of them that meet do not pass through each other: as everywhere, a body that would push into
//! another keeps its pose. It then counts as crashed, and the room puts it elsewhere with a new
//! goal (`jostle_arena::room`). Rejected: letting them wait for each other, since two that meet
//! head on would stand until the episode's end and a room would fill with standing pairs.

use rand::{Rng, RngExt as _};
use rand_distr::{Distribution, Uniform};
use serde::{Deserialize, Serialize};

use crate::{
    Command, Crowd, CrowdKind, CrowdName, PedsError, RoomView, Visibility,
    crowd::{check_commands, with_commands},
    error::{checked, require},
};

/// Parameters of the straight and the stop-and-go walkers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WalkersConfig {
    /// Range of a walker's speed, drawn uniformly per pedestrian and episode, m/s. Default 0.5 to
    /// 1.5: half to one and a half times the robot's.
    pub speed: [f32; 2],
    /// Range of the time that a stop-and-go walker walks without a stop, drawn uniformly each time,
    /// s. Default 2 to 6.
    pub walk_time: [f32; 2],
    /// Range of the time that it then stands, drawn uniformly each time, s. Default 1 to 4.
    pub stand_time: [f32; 2],
}

impl Default for WalkersConfig {
    fn default() -> Self {
        Self { speed: [0.5, 1.5], walk_time: [2.0, 6.0], stand_time: [1.0, 4.0] }
    }
}

impl WalkersConfig {
    /// True if everything is at its default, so that a configuration leaves it out.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first range that is reversed or leaves 0 to 100 (m/s, s).
    pub fn validate(&self) -> Result<(), PedsError> {
        let ranges = [
            (self.speed, ["walkers.speed[0]", "walkers.speed[1]"]),
            (self.walk_time, ["walkers.walk_time[0]", "walkers.walk_time[1]"]),
            (self.stand_time, ["walkers.stand_time[0]", "walkers.stand_time[1]"]),
        ];
        for ([low, high], fields) in ranges {
            require((0.0..=100.0).contains(&low), fields[0], low.into(), "0 to 100")?;
            require((low..=100.0).contains(&high), fields[1], high.into(), "the range's start to 100")?;
        }
        Ok(())
    }

    /// A walker's speed for an episode, m/s. The ranges must be valid.
    pub(crate) fn draw_speed(&self, rng: &mut impl Rng) -> f32 {
        draw(self.speed, rng)
    }
}

fn draw([low, high]: [f32; 2], rng: &mut impl Rng) -> f32 {
    Uniform::new_inclusive(low, high).expect("a validated range").sample(rng)
}

/// The phase of a stop-and-go walker, walking or standing, and the number of steps that are left of
/// it. It depends on its draws only, never on what happens to the walker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gait {
    walks: bool,
    steps_left: u32,
}

impl Gait {
    /// The gait at an episode's start: walking or standing with equal chance, somewhere within the
    /// drawn time. `dt` is the control period (s); the configuration must be valid.
    pub fn draw(config: &WalkersConfig, dt: f32, rng: &mut impl Rng) -> Self {
        let walks = rng.random_bool(0.5);
        let part: f32 = rng.random();
        Self { walks, steps_left: n_steps(part * Self::draw_time(walks, config, rng), dt) }
    }

    /// One control period later.
    pub fn advance(&mut self, config: &WalkersConfig, dt: f32, rng: &mut impl Rng) {
        self.steps_left -= 1;
        if self.steps_left == 0 {
            self.walks = !self.walks;
            self.steps_left = n_steps(Self::draw_time(self.walks, config, rng), dt);
        }
    }

    /// True if it walks during the next control period.
    pub fn walks(&self) -> bool {
        self.walks
    }

    fn draw_time(walks: bool, config: &WalkersConfig, rng: &mut impl Rng) -> f32 {
        draw(if walks { config.walk_time } else { config.stand_time }, rng)
    }
}

/// The number of control periods nearest to a time, at least one.
fn n_steps(time: f32, dt: f32) -> u32 {
    // The cast saturates.
    ((time / dt).round() as u32).max(1)
}

/// Crowds `straight` and `stop-and-go`: each pedestrian walks straight to its goal at 1 m/s times
/// its factor. They differ in the factor, which the room sets to 0 while a stop-and-go walker
/// stands.
#[derive(Debug, Clone, Copy)]
pub struct WalkersCrowd {
    kind: CrowdKind,
}

impl WalkersCrowd {
    /// One of the two.
    ///
    /// # Errors
    /// Any other crowd.
    pub fn new(kind: CrowdKind) -> Result<Self, PedsError> {
        match kind {
            CrowdKind::Straight | CrowdKind::StopAndGo => Ok(Self { kind }),
            found => Err(PedsError::WrongKind { found: found.name(), expected: "straight, stop-and-go" }),
        }
    }
}

impl Crowd for WalkersCrowd {
    fn name(&self) -> CrowdName {
        self.kind.into()
    }

    fn senses_by_laser(&self) -> bool {
        false
    }

    fn visibility(&self) -> Visibility {
        Visibility::NONE
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError> {
        check_commands(rooms, commands)?;
        for (room, commands) in with_commands(rooms, commands) {
            room.check_factors()?;
            for (i, (pedestrian, command)) in room.pedestrians.iter().zip(commands).enumerate() {
                let to_goal =
                    checked("goal", pedestrian.goal)? - checked("pedestrian position", pedestrian.position)?;
                *command = Command::Walk { velocity: to_goal.normalize_or_zero() * room.factor(i) };
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    use super::*;
    use crate::Pedestrian;

    #[test]
    fn a_walker_goes_straight_at_its_speed_whoever_stands_there() {
        let walker = |position, goal| Pedestrian { position, velocity: Vec2::ZERO, heading: 1.0, goal };
        let people = [
            walker(Vec2::ZERO, Vec2::new(6.0, 8.0)),
            walker(Vec2::new(0.6, 0.8), Vec2::new(-9.0, 0.8)),
            walker(Vec2::ONE, Vec2::ONE),
        ];
        let room = RoomView {
            pedestrians: &people,
            others: &people[1..2],
            observations: &[],
            speed_factor: &[1.5, 0.5, 1.0],
        };
        let mut commands = [Command::STILL; 3];
        let mut crowd = WalkersCrowd::new(CrowdKind::Straight).unwrap();
        crowd.decide(&[room], &mut commands).unwrap();
        let expected = [Vec2::new(0.9, 1.2), Vec2::new(-0.5, 0.0), Vec2::ZERO];
        for (command, expected) in commands.into_iter().zip(expected) {
            let Command::Walk { velocity } = command else { panic!("{command:?}") };
            assert!(velocity.distance(expected) < 1e-6, "{velocity}");
        }
        let lost = [walker(Vec2::NAN, Vec2::ZERO)];
        let room = RoomView { pedestrians: &lost, speed_factor: &[], ..room };
        assert!(crowd.decide(&[room], &mut commands[..1]).is_err());
        assert!(WalkersCrowd::new(CrowdKind::Sf).is_err());
    }

    /// Times of phases between their bounds, in steps of 0.1 s; the first one may be shorter.
    #[test]
    fn a_gait_walks_and_stands_in_turns_for_drawn_times() {
        let config = WalkersConfig::default();
        let mut shares = [0, 0];
        for seed in 0..40 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut gait = Gait::draw(&config, 0.1, &mut rng);
            let (mut phases, mut now) = (Vec::new(), (gait.walks(), 0));
            for _ in 0..400 {
                if gait.walks() != now.0 {
                    phases.push(now);
                    now = (gait.walks(), 0);
                }
                now.1 += 1;
                shares[usize::from(gait.walks())] += 1;
                gait.advance(&config, 0.1, &mut rng);
            }
            assert!(phases.len() >= 5, "{phases:?}");
            assert!((1..=60).contains(&phases[0].1), "{phases:?}");
            for (walks, n_steps) in &phases[1..] {
                let expected = if *walks { 20..=60 } else { 10..=40 };
                assert!(expected.contains(n_steps), "{phases:?}");
            }
        }
        // Phases last 4 s and 2.5 s on average.
        let walking = f64::from(shares[1]) / f64::from(shares[0] + shares[1]);
        assert!((walking - 4.0 / 6.5).abs() < 0.05, "{walking}");
    }

    #[test]
    fn ranges_are_checked_and_a_phase_lasts_a_step_at_least() {
        let config = WalkersConfig::default();
        assert_eq!(config.validate(), Ok(()));
        for bad in [
            WalkersConfig { speed: [-0.1, 1.0], ..config },
            WalkersConfig { speed: [1.0, 0.5], ..config },
            WalkersConfig { walk_time: [0.0, 101.0], ..config },
            WalkersConfig { stand_time: [f32::NAN, 1.0], ..config },
        ] {
            assert!(bad.validate().is_err(), "{bad:?}");
        }
        let instant = WalkersConfig { walk_time: [0.0; 2], stand_time: [0.0; 2], ..config };
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut gait = Gait::draw(&instant, 0.1, &mut rng);
        for _ in 0..4 {
            let before = gait.walks();
            gait.advance(&instant, 0.1, &mut rng);
            assert_ne!(gait.walks(), before);
        }
    }
}
