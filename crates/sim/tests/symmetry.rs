//! A room and its image under a symmetry, driven by the same commands: what robots see, earn and
//! how they end is the same.
//!
//! The room is square and centred, so a quarter turn and a mirror map it onto itself. Unlike
//! `properties.rs`, which asks each part by itself, this goes through whole rooms: stacked scans,
//! goal, velocity, reward and outcome of every robot over many steps. A one-sided clamp or a sign
//! in one of them would show.

use jostle_sim::{Rooms, RoomsState, SimConfig, Streams};
use rand::RngExt;
use serde_json::{Value, json};

const BEAMS: usize = 512;
const FRAMES: usize = 3;
const N_AGENTS: usize = 5;
const STEPS: u64 = 60;
/// Beams of a row of 1,536 that may differ: an edge that is grazed is hit on one side and missed on
/// the other.
const GRAZED: usize = 12;

/// A symmetry of the square room.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Symmetry {
    /// (x, y) → (x, −y).
    Mirror,
    /// A quarter turn, counter-clockwise.
    Turn,
}

impl Symmetry {
    fn point(self, at: &Value) -> Value {
        let [x, y] = [0, 1].map(|i| at[i].as_f64().unwrap());
        match self {
            Self::Mirror => json!([x, -y]),
            Self::Turn => json!([-y, x]),
        }
    }

    fn heading(self, heading: f64) -> f64 {
        match self {
            Self::Mirror => -heading,
            Self::Turn => heading + std::f64::consts::FRAC_PI_2,
        }
    }

    fn command(self, [v, w]: [f32; 2]) -> [f32; 2] {
        match self {
            Self::Mirror => [v, -w],
            Self::Turn => [v, w],
        }
    }

    /// The observation that the image's robot should have. A turned robot sees the same; a mirrored
    /// one sees left and right exchanged.
    fn observation(self, row: &[f32]) -> Vec<f32> {
        let mut image = row.to_vec();
        if self == Self::Mirror {
            for frame in 0..FRAMES {
                for beam in 0..BEAMS {
                    image[frame * BEAMS + beam] = row[frame * BEAMS + (BEAMS - beam) % BEAMS];
                }
            }
            image[FRAMES * BEAMS + 1] *= -1.0;
            image[FRAMES * BEAMS + 3] *= -1.0;
        }
        image
    }

    /// The image of a whole room.
    fn state(self, state: &RoomsState) -> RoomsState {
        let mut image = serde_json::to_value(state).unwrap();
        for agent in image["agents"].as_array_mut().unwrap() {
            agent["pose"]["position"] = self.point(&agent["pose"]["position"]);
            let heading = self.heading(agent["pose"]["heading"].as_f64().unwrap());
            agent["pose"]["heading"] = json!(heading.sin().atan2(heading.cos()) as f32);
            agent["episode"]["goal"] = self.point(&agent["episode"]["goal"]);
        }
        let rows: Vec<f32> = serde_json::from_value(image["observations"].clone()).unwrap();
        let width = rows.len() / N_AGENTS;
        image["observations"] =
            json!(rows.chunks_exact(width).flat_map(|row| self.observation(row)).collect::<Vec<f32>>());
        serde_json::from_value(image).unwrap()
    }
}

fn room(seed: u64, side: f32) -> Rooms {
    let mut config = SimConfig::default();
    config.laser.noise_std = 0.0;
    (config.room.width, config.room.height) = (side, side);
    config.spawn.goal_distance = 0.5 * side;
    Rooms::new(&config, 1, N_AGENTS, 1, &Streams::new(seed)).unwrap()
}

/// Steps both rooms until an episode ends; returns how many steps and ends were compared.
fn compare(symmetry: Symmetry, seed: u64, side: f32) -> (u64, u64) {
    let mut plain = room(seed, side);
    let mut image = room(seed, side);
    image.restore(symmetry.state(&plain.state())).unwrap();
    for step in 0..STEPS {
        let mut rng = Streams::new(seed).stream("commands", &[step]);
        let commands: [[f32; 2]; N_AGENTS] =
            std::array::from_fn(|_| [rng.random_range(-0.3..1.6), rng.random_range(-1.6..1.6)]);
        plain.step(&commands);
        image.step(&commands.map(|command| symmetry.command(command)));
        let mut ends = 0;
        for agent in 0..N_AGENTS {
            let (a, b) = (&plain.transitions()[agent], &image.transitions()[agent]);
            let name = format!("{symmetry:?}, seed {seed}, step {step}, robot {agent}");
            assert_eq!(a.end, b.end, "{name}");
            assert_eq!(symmetry.command(a.executed), b.executed, "{name}: the command as executed");
            assert!((a.reward - b.reward).abs() < 1e-3, "{name}: reward {} {}", a.reward, b.reward);
            // A robot that was placed anew has its place from a stream, which knows no symmetry.
            ends += u64::from(!a.end.is_running());
            let rows = |rooms: &Rooms| {
                let width = rooms.observations().len() / N_AGENTS;
                if a.end.is_running() {
                    rooms.observations()[agent * width..][..width].to_vec()
                } else {
                    rooms.final_observation(agent).to_vec()
                }
            };
            let (expected, found) = (symmetry.observation(&rows(&plain)), rows(&image));
            let (scans, motion) = expected.split_at(FRAMES * BEAMS);
            let far = scans.iter().zip(&found).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
            assert!(far <= GRAZED, "{name}: {far} of {} ranges differ", scans.len());
            for (a, b) in motion.iter().zip(&found[FRAMES * BEAMS..]) {
                assert!((a - b).abs() < 2e-4, "{name}: goal and velocity {motion:?}");
            }
        }
        if ends > 0 {
            return (step + 1, ends);
        }
    }
    (STEPS, 0)
}

#[test]
fn a_mirrored_or_turned_room_behaves_alike() {
    for symmetry in [Symmetry::Mirror, Symmetry::Turn] {
        let (mut steps, mut ends) = (0, 0);
        for seed in 0..24 {
            // Small rooms as well: they are full of contacts and crashes.
            let side = if seed % 2 == 0 { 20.0 } else { 9.0 };
            let compared = compare(symmetry, seed, side);
            (steps, ends) = (steps + compared.0, ends + compared.1);
        }
        println!("{symmetry:?}: {steps} steps of {N_AGENTS} robots, {ends} ends of episodes");
        assert!(steps > 300 && ends > 8, "{symmetry:?}: only {steps} steps and {ends} ends were compared");
    }
}
