//! Training rooms with maps: who is placed where, and what is seen of the maps.

use std::path::{Path, PathBuf};

use glam::Vec2;
use jostle_sim::{Rooms, SimConfig, SimError, Streams, TrainingCrowd};

fn map(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../maps").join(name)
}

/// The two maps of Table 5, dealt to rooms of three robots that can be 5 m from their goals there.
fn mapped(n_rooms: usize, more: TrainingCrowd) -> Result<Rooms, SimError> {
    let mut config = SimConfig::default();
    config.laser.noise_std = 0.0;
    config.spawn.goal_distance = 5.0;
    config.episode.step_limit = 12;
    let maps = ["warehouse.toml", "hospital.toml"].map(map).to_vec();
    Rooms::with_crowd(&config, &TrainingCrowd { maps, ..more }, n_rooms, 3, 1, &Streams::new(7))
}

#[test]
fn maps_are_dealt_in_turn_and_everyone_starts_clear_of_them() {
    let furniture = TrainingCrowd { obstacles_max: 3, renew_steps: 20, ..TrainingCrowd::default() };
    for more in [TrainingCrowd::default(), furniture] {
        let (mut rooms, mut again) = (mapped(5, more.clone()).unwrap(), mapped(5, more).unwrap());
        let (snapshot, mut begun) = (rooms.state(), 0);
        for step in 0..120 {
            for agent in 0..15 {
                // The half extents of the warehouse and of the hospital.
                let half = if agent / 3 % 2 == 0 { Vec2::new(6.5, 6.0) } else { Vec2::splat(6.0) };
                let at = rooms.whereabouts(agent);
                assert!(at.pose.position.abs().cmple(half).all() && at.goal.abs().cmple(half - 0.99).all());
                if step == 0 {
                    assert!(at.clearance > 0.6, "agent {agent}: {}", at.clearance);
                    assert!(at.pose.position.distance(at.goal) >= 5.0);
                }
                begun += usize::from(!rooms.transitions()[agent].end.is_running());
            }
            rooms.step(&[[0.7, 0.2]; 15]);
            again.step(&[[0.7, 0.2]; 15]);
            assert_eq!(rooms.observations(), again.observations(), "step {step}");
        }
        assert!(begun > 100, "{begun}");
        again.restore(snapshot).unwrap();
        (0..120).for_each(|_| again.step(&[[0.7, 0.2]; 15]));
        assert_eq!(again.observations(), rooms.observations(), "from a snapshot the same again");
    }
}

#[test]
fn the_laser_sees_the_map_that_was_dealt_to_a_room() {
    let folder = tempfile::tempdir().unwrap();
    let pillar = folder.path().join("pillar.toml");
    let text = "walls = { min = [-5.0, -5.0], max = [5.0, 5.0] }\n[[obstacle]]\ncircle = { centre = [0.0, 0.0], radius = 0.4 }\n";
    std::fs::write(&pillar, text).unwrap();
    let mut config = SimConfig::default();
    (config.laser.noise_std, config.spawn.goal_distance) = (0.0, 3.0);
    let empty = folder.path().join("empty.toml");
    std::fs::write(&empty, text.lines().next().unwrap()).unwrap();
    let crowd = TrainingCrowd { maps: vec![pillar, empty], ..TrainingCrowd::default() };
    let rooms = Rooms::with_crowd(&config, &crowd, 8, 1, 1, &Streams::new(3)).unwrap();
    for agent in 0..8 {
        let pose = rooms.whereabouts(agent).pose;
        let bearing = (-pose.position).to_angle() - pose.heading;
        let beam = (bearing.rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU * 512.0).round()
            as usize
            % 512;
        let range = (rooms.observations()[agent * 1540 + 1024 + beam] + 0.5) * 10.0;
        let expected = pose.position.length() - 0.4;
        // The second of the two maps has no pillar.
        let seen = (range - expected).abs() < 0.01;
        assert!(seen == (agent % 2 == 0), "agent {agent}: {range}, {expected}");
    }
}

#[test]
fn maps_that_no_room_can_have_are_refused_by_name() {
    let error = mapped(1, TrainingCrowd::default()).err().unwrap().to_string();
    assert_eq!(error, "maps: found 2 maps, expected at most n_rooms = 1");
    let refused = |map: PathBuf| {
        let crowd = TrainingCrowd { maps: vec![map], ..TrainingCrowd::default() };
        assert!(!crowd.is_off());
        let mut config = SimConfig::default();
        config.spawn.goal_distance = 30.0;
        let rooms = Rooms::with_crowd(&config, &crowd, 2, 3, 1, &Streams::new(7));
        rooms.err().unwrap().to_string()
    };
    assert!(refused("nowhere.toml".into()).starts_with("nowhere.toml: "));
    // The hall has no two places so far apart, and is named.
    let hall = map("hospital.toml");
    let error = refused(hall.clone());
    assert!(error.starts_with(&format!("{}: spawn.goal_distance: found 30", hall.display())), "{error}");
}
