//! The encoder's reading of an observation row, on scenes made by hand, and the networks
//! behind it.

use std::f32::consts::TAU;

use jostle_policy::encoder::EncoderScratch;
use jostle_policy::encoder::motion::{self, MotionEncoder, MotionInputs, MotionScratch, Track};
use jostle_policy::encoder::paths::{DIRECTIONS, PATHS};
use jostle_policy::{
    Backend, Batch, Encoder, Layout, Network, NetworkConfig, Parameters, PolicyError, actor, backend, critic,
};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

const BEAMS: usize = 512;
const INPUTS: MotionInputs = MotionInputs { dt: 0.1, v_max: 1.0, w_max: 1.0 };

/// Circles (centre, radius) in the world, and the half width of a square room around the origin.
struct Scene {
    circles: Vec<([f32; 2], f32)>,
    room: f32,
}

impl Scene {
    /// A noise-free scan from a pose, as a row holds it.
    fn scan(&self, [px, py]: [f32; 2], heading: f32) -> Vec<f32> {
        (0..BEAMS).map(|beam| self.range([px, py], heading + TAU * beam as f32 / BEAMS as f32)).collect()
    }

    fn range(&self, [px, py]: [f32; 2], angle: f32) -> f32 {
        let (sin, cos) = angle.sin_cos();
        let wall =
            |p: f32, d: f32| if d.abs() < 1e-6 { f32::INFINITY } else { (self.room * d.signum() - p) / d };
        let mut range = wall(px, cos).min(wall(py, sin)).min(10.0);
        for ([cx, cy], radius) in &self.circles {
            let (x, y) = (cx - px, cy - py);
            let along = x * cos + y * sin;
            let off_sq = x * x + y * y - along * along;
            if along > 0.0 && off_sq < radius * radius {
                range = range.min(along - (radius * radius - off_sq).sqrt());
            }
        }
        range / 10.0 - 0.5
    }
}

/// The row of a robot that drove from the origin, straight ahead, with (v, ω) for one step, while
/// `before` became `now`.
fn row(before: &Scene, now: &Scene, [v, w]: [f32; 2], goal: [f32; 2]) -> Vec<f32> {
    let scan = before.scan([0.0, 0.0], 0.0);
    let mut row = [scan.clone(), scan, now.scan([v * INPUTS.dt, 0.0], w * INPUTS.dt)].concat();
    row.extend([goal[0], goal[1], v, w]);
    row
}

fn tracks(row: &[f32]) -> Vec<Track> {
    MotionEncoder::new(&INPUTS, BEAMS).tracks(row, &mut MotionScratch::default()).to_vec()
}

fn config() -> NetworkConfig {
    let widths = NetworkConfig { laser_feature: 64, hidden: 32, n_behaviours: 3, ..Default::default() };
    NetworkConfig { motion: Some(INPUTS), ..widths }
}

fn encode(row: &[f32]) -> Vec<f32> {
    let mut input = vec![f32::NAN; motion::INPUT_LEN];
    Encoder::new(&config()).encode(row, &mut EncoderScratch::default(), &mut input);
    input
}

fn person(x: f32, y: f32) -> Scene {
    Scene { circles: vec![([x, y], 0.25)], room: 100.0 }
}

#[test]
fn a_person_has_the_velocity_it_walks_with_however_the_robot_moves() {
    for velocity in [[0.0, 0.0], [0.0, -1.0], [-1.2, 0.4]] {
        for own in [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [1.0, -1.0]] {
            let [vx, vy] = velocity;
            let row = row(&person(3.0, 1.0), &person(3.0 + 0.1 * vx, 1.0 + 0.1 * vy), own, [5.0, 0.0]);
            let found = tracks(&row);
            assert_eq!(found.len(), 1);
            // The frame of now is turned by ω·dt.
            let (sin, cos) = (own[1] * INPUTS.dt).sin_cos();
            let expected = [vx * cos + vy * sin, -vx * sin + vy * cos];
            let off = (found[0].velocity[0] - expected[0]).hypot(found[0].velocity[1] - expected[1]);
            // Beams at 3 m are 0.037 m apart: in either scan each edge of what is seen may be off
            // by half of that, and the mean of its points by as much; over 0.1 s that is 0.37 m/s
            // at the very worst.
            assert!(off < 0.3, "{velocity:?} {own:?}: found {:?}, expected {expected:?}", found[0].velocity);
        }
    }
}

#[test]
fn walls_are_no_persons() {
    let room = || Scene { circles: vec![], room: 3.0 };
    assert!(tracks(&row(&room(), &room(), [1.0, 0.3], [1.0, 0.0])).is_empty());
}

#[test]
fn persons_are_listed_by_distance() {
    let scene =
        || Scene { circles: vec![([4.0, 0.0], 0.25), ([0.0, 2.0], 0.25), ([-3.0, 0.0], 0.25)], room: 100.0 };
    let found = tracks(&row(&scene(), &scene(), [0.0, 0.0], [1.0, 0.0]));
    let nearest: Vec<f32> = found.iter().map(|track| track.nearest).collect();
    let near = |found: f32, expected: f32| (found - expected).abs() < 0.01;
    assert!(
        near(nearest[0], 1.75) && near(nearest[1], 2.75) && near(nearest[2], 3.75),
        "nearest ranges {nearest:?}"
    );
}

#[test]
fn who_crosses_makes_the_way_ahead_urgent_and_not_the_way_behind() {
    // From the left, 3 m ahead: both would be at (3, 0) after 3 s.
    let crossing = encode(&row(&person(3.0, 3.0), &person(3.0, 2.9), [0.0, 0.0], [5.0, 0.0]));
    let standing = encode(&row(&person(3.0, 3.0), &person(3.0, 3.0), [0.0, 0.0], [5.0, 0.0]));
    let (ahead, behind) = (32, 32 + DIRECTIONS / 2);
    assert!(crossing[ahead] > 0.2, "{}", crossing[ahead]);
    assert_eq!([crossing[behind], standing[ahead]], [0.0, 0.0]);
    // The goal is straight ahead, so that ways counted from it are the same ways.
    assert_eq!(crossing[32..32 + DIRECTIONS], crossing[32 + 2 * PATHS..32 + 2 * PATHS + DIRECTIONS]);
}

#[test]
fn a_wall_ahead_is_urgent() {
    let near = || Scene { circles: vec![], room: 2.0 };
    let input = encode(&row(&near(), &near(), [0.0, 0.0], [1.0, 0.0]));
    assert!(input[32] > 0.5, "straight ahead: {}", input[32]);
    assert!(input.iter().all(|value| value.is_finite()));
}

#[test]
fn hostile_rows_stay_finite() {
    let mut random = vec![0.5; 1540];
    for (i, value) in random[..1536].iter_mut().enumerate() {
        *value = ((i * 7919) % 1000) as f32 / 1000.0 - 0.5;
    }
    let at_the_goal = [vec![0.5; 1536], vec![0.0; 4]].concat();
    for row in [random, vec![-0.5; 1540], vec![0.5; 1540], at_the_goal] {
        let input = encode(&row);
        assert!(input.iter().all(|value| value.is_finite() && value.abs() < 100.0));
    }
}

type Make = fn(&NetworkConfig, Backend, &Parameters) -> Result<Box<dyn Network>, PolicyError>;

/// Both back ends, with every encoder before a network.
#[test]
fn back_ends_agree_behind_every_encoder() {
    let pooled = NetworkConfig { scan_pool: 4, laser_feature: 32, hidden: 32, ..NetworkConfig::default() };
    for config in [config(), pooled] {
        let n_rows = 37;
        let scene = |row: usize| person(2.0 + 0.1 * row as f32, 0.05 * row as f32);
        let rows: Vec<f32> =
            (0..n_rows).flat_map(|i| row(&scene(i), &scene(i + 1), [0.5, 0.2], [3.0, 1.0])).collect();
        let tokens: Vec<u32> = (0..n_rows as u32).map(|row| row % config.n_behaviours as u32).collect();
        let makers: [(Layout, Make); 2] =
            [(Layout::actor(&config), actor), (Layout::critic(&config), critic)];
        for (layout, make) in makers {
            let parameters = Parameters::init(layout, &mut ChaCha8Rng::seed_from_u64(3));
            let run = |backend| {
                let mut network: Box<dyn Network> = make(&config, backend, &parameters).unwrap();
                let n = n_rows * network.n_outputs();
                let mut outputs = vec![0.0; n];
                network.forward(Batch::new(&rows, &tokens), &mut outputs);
                network.backward(&(0..n).map(|i| (i % 7) as f32 - 3.0).collect::<Vec<_>>());
                let native = network.parameters_and_gradient().1.to_vec();
                (outputs, network.to_canonical(&native))
            };
            let (fast, reference) = (run(Backend::Fast), run(Backend::Reference));
            for (found, expected) in [(fast.0, reference.0), (fast.1, reference.1)] {
                let largest = expected.iter().fold(1e-3_f32, |largest, value| largest.max(value.abs()));
                for (found, expected) in found.iter().zip(&expected) {
                    assert!((found - expected).abs() <= 2e-4 * largest, "{found} {expected} of {largest}");
                }
                assert!(expected.iter().any(|value| *value != 0.0), "the test sees something");
            }
        }
    }
}

#[test]
fn encoded_rows_give_what_observation_rows_give() {
    let config = config();
    let parameters = Parameters::init(Layout::actor(&config), &mut ChaCha8Rng::seed_from_u64(1));
    let rows = row(&person(2.0, 0.5), &person(2.0, 0.4), [1.0, 0.0], [3.0, 0.0]);
    let (mut whole, mut part) = ([0.0; 2], [0.0; 2]);
    actor(&config, Backend::Fast, &parameters).unwrap().infer(Batch::new(&rows, &[2]), &mut whole);
    let mut network = backend::actor_of_inputs(&config, Backend::Fast, &parameters).unwrap();
    network.infer(Batch::new(&encode(&rows), &[2]), &mut part);
    assert_eq!(whole, part);
    network.infer(Batch::new(&encode(&rows), &[1]), &mut part);
    assert_ne!(whole, part, "the token is read");
}

#[test]
fn what_cannot_stand_before_a_network_is_refused() {
    let check = |config: NetworkConfig, message: &str| {
        let found = config.validate().unwrap_err();
        assert!(matches!(found, PolicyError::Config { .. }));
        assert!(found.to_string().contains(message), "{found}");
    };
    let good = NetworkConfig::default();
    check(NetworkConfig { scan_pool: 0, ..good.clone() }, "scan_pool: found 0");
    check(
        NetworkConfig { scan_pool: 3, ..good.clone() },
        "scan_pool: found 3, expected 1 to 170 (a divisor of the 512",
    );
    check(NetworkConfig { scan_pool: 256, ..good.clone() }, "scan_pool: found 256");
    check(NetworkConfig { scan_pool: 2, ..config() }, "scan_pool: found 2, expected 1");
    check(NetworkConfig { frames: 1, ..config() }, "motion: found 1 frames");
    let still = MotionInputs { v_max: 0.0, ..INPUTS };
    check(NetworkConfig { motion: Some(still), ..good.clone() }, "motion: found v_max = 0");
    assert!(good.validate().is_ok() && config().validate().is_ok());
}
