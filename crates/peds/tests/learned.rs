//! Learned crowds with a network of known answers.

use glam::Vec2;
use jostle_peds::{Command, Crowd, CrowdKind, LearnedConfig, LearnedCrowd, Pedestrian, RoomView, Visibility};
use jostle_policy::{Backend, Batch, Layout, Network, NetworkConfig, Parameters, actor};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// Answers (scale · first value, second value) for rows of two values.
struct Scaled {
    scale: f32,
    layout: Layout,
}

impl Network for Scaled {
    fn layout(&self) -> &Layout {
        &self.layout
    }
    fn n_outputs(&self) -> usize {
        2
    }
    fn infer(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        for (i, output) in outputs.chunks_exact_mut(2).enumerate() {
            let row = batch.observation(i, 2);
            output.copy_from_slice(&[self.scale * row[0], row[1]]);
        }
    }
    fn forward(&mut self, _: Batch<'_>, _: &mut [f32]) {
        unreachable!("a crowd does not learn");
    }
    fn backward(&mut self, _: &[f32]) {
        unreachable!("a crowd does not learn");
    }
    fn parameters_and_gradient(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut [], &mut [])
    }
    fn parameters_changed(&mut self) {}
    fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        native.to_vec()
    }
    fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        canonical.to_vec()
    }
}

fn pool() -> Vec<Box<dyn Network>> {
    [1.0, 10.0].map(|scale| Box::new(Scaled { scale, layout: Layout::new() }) as Box<dyn Network>).into()
}

const SOMEONE: Pedestrian =
    Pedestrian { position: Vec2::ZERO, velocity: Vec2::ZERO, heading: 0.0, goal: Vec2::ZERO };

fn room<'a>(people: &'a [Pedestrian], observations: &'a [f32], speed_factor: &'a [f32]) -> RoomView<'a> {
    RoomView { pedestrians: people, others: &[], observations, speed_factor }
}

#[test]
fn policies_are_cycled_clipped_and_scaled_by_the_factor_in_va_alone() {
    let people = [SOMEONE; 3];
    let first = [0.1, 0.5, 0.05, -3.0, 0.2, 0.0];
    let second = [0.7, 0.1];
    let rooms = [room(&people, &first, &[0.5, 1.0, 1.5]), room(&people[..1], &second, &[])];
    let decide = |kind| {
        let mut commands = [Command::STILL; 4];
        let mut crowd =
            LearnedCrowd::new(kind, Visibility::ALL, &LearnedConfig::default(), 2, pool()).unwrap();
        crowd.decide(&rooms, &mut commands).unwrap();
        commands
    };
    let drive = |v, w| Command::Drive { v, w };
    let plain = [drive(0.1, 0.5), drive(0.5, -1.0), drive(0.2, 0.0), drive(0.7, 0.1)];
    assert_eq!(decide(CrowdKind::Nh), plain);
    assert_eq!(decide(CrowdKind::So), plain);
    assert_eq!(decide(CrowdKind::Va), [drive(0.05, 0.5), plain[1], drive(0.2 * 1.5, 0.0), plain[3]]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let limits = LearnedConfig::default();
    assert!(LearnedCrowd::new(CrowdKind::Vo, Visibility::ALL, &limits, 2, pool()).is_err());
    assert!(LearnedCrowd::new(CrowdKind::Nh, Visibility::ALL, &limits, 2, Vec::new()).is_err());
    let people = [SOMEONE; 2];
    let mut crowd = LearnedCrowd::new(CrowdKind::Nh, Visibility::ALL, &limits, 2, pool()).unwrap();
    let mut decide = |observations: &[f32], factor: &[f32], n: usize| {
        crowd.decide(&[room(&people, observations, factor)], &mut vec![Command::STILL; n])
    };
    assert!(decide(&[0.0; 4], &[], 2).is_ok());
    assert!(decide(&[0.0; 3], &[], 2).is_err());
    assert!(decide(&[0.0; 4], &[1.0], 2).is_err());
    assert!(decide(&[0.0; 4], &[], 1).is_err());
    assert!(decide(&[0.0, f32::NAN, 0.0, 0.0], &[], 2).is_err());
    assert!(decide(&[f32::MAX; 4], &[], 2).is_err(), "10 · MAX is infinite");
}

#[test]
fn real_policies_answer_as_they_do_alone() {
    let config = NetworkConfig { n_behaviours: 1, ..NetworkConfig::default() };
    let policy = |seed| Parameters::actor(&config, &mut ChaCha8Rng::seed_from_u64(seed));
    let network = |seed| actor(&config, Backend::Reference, &policy(seed)).unwrap();
    let len = config.observation_len();
    let people = [SOMEONE; 3];
    let rows: Vec<f32> = (0..3 * len).map(|i| (i as f32 * 0.37).sin() * 0.5).collect();
    let mut commands = [Command::STILL; 3];
    let pool = vec![network(1), network(2)];
    let mut crowd =
        LearnedCrowd::new(CrowdKind::In, Visibility::PEDESTRIANS, &LearnedConfig::default(), len, pool)
            .unwrap();
    crowd.decide(&[room(&people, &rows, &[])], &mut commands).unwrap();
    for (i, seed) in [1, 2, 1].into_iter().enumerate() {
        let mut mean = [0.0; 2];
        network(seed).infer(Batch::new(&rows[i * len..(i + 1) * len], &[0]), &mut mean);
        let Command::Drive { v, w } = commands[i] else { panic!("{:?}", commands[i]) };
        assert!((v - mean[0]).abs() < 1e-6 && (w - mean[1]).abs() < 1e-6, "{i}: {v} {w} {mean:?}");
    }
}
