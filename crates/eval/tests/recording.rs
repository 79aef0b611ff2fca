//! Recorded people in episodes: where they were, whatever the robot does; paired and repeatable.

use std::path::PathBuf;

use crate::common::{brief, seek};
use glam::Vec2;
use jostle_arena::recording::RecordingConfig;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{ArenaConfig, PerRow, PolicyIdentity, Pools};
use jostle_eval::{Protocol, Subject};
use jostle_peds::recorded::{Recording, RecordingOptions};
use jostle_peds::{Command, CrowdKind};
use jostle_sim::Laser;

fn sample() -> RecordingConfig {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../recordings/sample.txt");
    RecordingConfig::read(&path, None, None, 0.1).unwrap()
}

fn config(step_limit: u32) -> ArenaConfig {
    sample().config(&brief(step_limit)).unwrap()
}

/// Places of people and robot in an episode, step by step, while the robot repeats an action.
fn places(episode: u64, action: [f32; 2]) -> Vec<(Vec<Vec2>, Vec2)> {
    let config = config(150);
    let plan = RoomPlan::new(&config, CrowdKind::Recorded).unwrap();
    let laser = Laser::new(&config.sim.laser).unwrap();
    let mut room = ArenaRoom::new(&plan, &laser, episode).unwrap();
    let still = vec![Command::STILL; config.n_pedestrians()];
    let mut steps = Vec::new();
    loop {
        steps.push((room.pedestrians().iter().map(|p| p.position).collect(), room.robot().position));
        if room.step(&plan, action, &still).unwrap().is_some() {
            return steps;
        }
    }
}

/// Within the walls; others wait beyond them.
fn is_there(place: Vec2) -> bool {
    place.abs().max_element() < 50.0
}

#[test]
fn people_are_where_they_were_whatever_the_robot_does() {
    let recording = sample().recording().clone();
    let mut n_seen = 0;
    for episode in 0..4 {
        let (still, moving) = (places(episode, [0.0; 2]), places(episode, [1.0, 0.5]));
        // The step of the recording at which the episode starts: the one that has everyone there.
        let everyone = |step: u32| -> Vec<Vec2> {
            (0..recording.n_slots())
                .filter_map(|slot| Some(recording.at(slot, step, 0.1)?.position))
                .collect()
        };
        let seen = |step: &(Vec<Vec2>, Vec2)| -> Vec<Vec2> {
            step.0.iter().copied().filter(|place| is_there(*place)).collect()
        };
        let first = (0..recording.n_steps()).find(|step| everyone(*step) == seen(&still[0])).unwrap();
        for run in [&still, &moving] {
            for (k, step) in run.iter().enumerate() {
                let recorded = everyone(first + k as u32);
                for place in seen(step) {
                    assert!(recorded.contains(&place), "episode {episode}, step {k}: {place}");
                    n_seen += 1;
                }
                for place in recorded {
                    // Only those who come in too near to the robot are held back.
                    let too_near = k > 0 && place.distance(step.1) < 1.5;
                    assert!(step.0.contains(&place) || too_near, "episode {episode}, step {k}: {place}");
                }
            }
        }
        assert_eq!(still[0], moving[0]);
    }
    assert!(n_seen > 1000, "{n_seen}");
}

#[test]
fn nobody_comes_out_of_nothing_beside_the_robot() {
    let mut n_came = 0;
    for episode in 0..12 {
        let steps = places(episode, [1.0, 0.3]);
        for pair in steps.windows(2) {
            for (before, now) in pair[0].0.iter().zip(&pair[1].0) {
                if is_there(*now) && before.distance(*now) > 0.5 {
                    n_came += 1;
                    assert!(now.distance(pair[1].1) >= 1.5 - 1e-5, "episode {episode}");
                }
            }
        }
    }
    assert!(n_came > 5, "{n_came} came");
}

#[test]
fn episodes_are_paired_and_repeat_at_any_lock_step() {
    let identity = PolicyIdentity::custom("seek", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let run = |lock_step, action: Option<[f32; 2]>| {
        let protocol = Protocol::new(ArenaConfig { lock_step, ..config(60) }, Pools::default()).unwrap();
        let mut robot = PerRow::new(move |row: &[f32]| action.unwrap_or_else(|| seek(row)));
        protocol.evaluate(&mut robot, subject, CrowdKind::Recorded, 12, None, |_| ()).unwrap()
    };
    let reference = run(12, None);
    assert_eq!(reference.records, run(5, None).records);
    for (a, b) in reference.records.iter().zip(&run(12, Some([0.0; 2])).records) {
        assert_eq!((a.start, a.goal), (b.start, b.goal));
    }
    // The robot starts apart from everyone, and within the room of 20 m by 16 m.
    for record in &reference.records {
        assert!(record.start[0].abs() <= 9.0 && record.start[1].abs() <= 7.0 && record.steps > 1);
    }
}

/// A pedestrian that is seen for 0.4 s at the start and never again.
#[test]
fn who_is_not_there_is_not_measured() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.txt");
    std::fs::write(&path, "0 1 0 0\n10 1 0 0.1\n0 2 6 8\n10 2 6 8\n").unwrap();
    let recording = RecordingConfig::read(&path, None, None, 0.1).unwrap();
    let protocol = Protocol::new(recording.config(&brief(10)).unwrap(), Pools::default()).unwrap();
    let identity = PolicyIdentity::custom("still", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let mut robot = PerRow::new(|_: &[f32]| [0.0; 2]);
    let run = protocol.evaluate(&mut robot, subject, CrowdKind::Recorded, 20, None, |_| ()).unwrap();
    let least: Vec<Option<f64>> =
        run.records.iter().map(|record| record.driving.unwrap().min_clearance).collect();
    // An episode that starts at the last moment in which they are seen has nobody from its first
    // step on.
    assert!(least.contains(&None) && least.iter().any(Option::is_some), "{least:?}");
    assert!(least.iter().flatten().all(|clearance| *clearance < 15.0), "{least:?}");
}

#[test]
fn the_key_has_what_is_in_the_file() {
    let base = config(60);
    let text = serde_json::to_string(&base).unwrap();
    assert!(text.contains(&sample().sha256) && !text.contains("sample.txt"), "{text}");
    let other = Recording::read(
        &PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../recordings/sample.txt"),
        &RecordingOptions { interval: Some(0.5), ..RecordingOptions::default() },
    );
    let other = RecordingConfig::new(other.unwrap()).config(&brief(60)).unwrap();
    assert_ne!(other.settings_hash(None), base.settings_hash(None));
}

#[test]
fn what_does_not_fit_is_refused() {
    let error = RoomPlan::new(&ArenaConfig::default(), CrowdKind::Recorded).unwrap_err().to_string();
    assert_eq!(error, "recording: found none, expected people to play back (crowd recorded)");
    let wrong = ArenaConfig { n_agents: 5, ..config(60) };
    let n = config(60).n_agents;
    assert_eq!(
        wrong.validate().unwrap_err().to_string(),
        format!("n_agents: found 5, expected the recording's {n}")
    );
    // Read back from its written form, a setting has lost its tracks.
    let read: ArenaConfig = serde_json::from_str(&serde_json::to_string(&config(60)).unwrap()).unwrap();
    assert_eq!(
        read.validate().unwrap_err().to_string(),
        "recording: found no pedestrian, expected at least one"
    );
}
