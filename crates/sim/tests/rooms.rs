//! Contracts of the vectorised decision process: same bits at any thread count, exact snapshots,
//! the rules of an episode.

use jostle_sim::{Outcome, Rooms, RoomsState, SimConfig, StepEnd, Streams, TrainingCrowd};
use rand::RngExt;

/// FNV-1a over the bits of everything a step produced.
fn hash(rooms: &Rooms, mut hash: u64) -> u64 {
    let mut eat = |bits: u32| hash = (hash ^ u64::from(bits)).wrapping_mul(0x0100_0000_01B3);
    rooms.observations().iter().for_each(|x| eat(x.to_bits()));
    rooms.tokens().iter().for_each(|t| eat(*t));
    for t in rooms.transitions() {
        eat(t.reward.to_bits());
        eat(u32::from(t.end.is_running()));
        if let Some(e) = t.episode {
            eat(e.steps);
            eat(e.path_length.to_bits() as u32);
        }
    }
    hash
}

/// Steps with random actions from a stream of their own; returns a hash over all steps.
fn run(rooms: &mut Rooms, from: u64, steps: u64) -> u64 {
    (from..from + steps).fold(0, |sum, step| {
        let mut rng = Streams::new(99).stream("action", &[step]);
        let actions: Vec<[f32; 2]> =
            (0..rooms.len()).map(|_| [rng.random_range(-0.5..1.8), rng.random_range(-1.5..1.5)]).collect();
        rooms.step(&actions);
        hash(rooms, sum)
    })
}

fn rooms(config: &SimConfig, n_rooms: usize, n_agents: usize) -> Rooms {
    Rooms::new(config, n_rooms, n_agents, 5, &Streams::new(7)).expect("rooms")
}

#[test]
fn ten_thousand_steps_hash_the_same_at_1_2_and_8_threads() {
    let hashes = [1, 2, 8].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| run(&mut rooms(&SimConfig::default(), 2, 5), 0, 10_000))
    });
    assert_eq!(hashes[0], hashes[1]);
    assert_eq!(hashes[0], hashes[2]);
}

#[test]
fn restoring_a_state_through_json_goes_on_bit_for_bit() {
    let mut whole = rooms(&SimConfig::default(), 2, 5);
    run(&mut whole, 0, 150);
    let text = serde_json::to_string(&whole.state()).expect("JSON");
    let expected = run(&mut whole, 150, 300);
    let mut resumed = rooms(&SimConfig::default(), 2, 5);
    let state: RoomsState = serde_json::from_str(&text).expect("JSON");
    resumed.restore(state).expect("restore");
    assert_eq!(run(&mut resumed, 150, 300), expected);
}

/// Rooms in which every role occurs.
fn crowded_rooms(n_rooms: usize) -> Rooms {
    let crowd = TrainingCrowd {
        blind: 0.2,
        seeing: 0.2,
        straight: 0.2,
        stop_and_go: 0.1,
        standing: 0.1,
        opponents: 0.1,
        size_min: 0.6,
        size_max: 1.4,
        obstacles_min: 1,
        obstacles_max: 4,
        agents_min: 3,
        renew_steps: 70,
        speed_min: 0.5,
        speed_max: 1.5,
        ..TrainingCrowd::default()
    };
    Rooms::with_crowd(&SimConfig::default(), &crowd, n_rooms, 5, 5, &Streams::new(7)).expect("rooms")
}

#[test]
fn a_training_crowd_keeps_the_contracts() {
    let hashes = [1, 2, 8].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| run(&mut crowded_rooms(3), 0, 1_000))
    });
    assert_eq!(hashes[0], hashes[1]);
    assert_eq!(hashes[0], hashes[2]);
    let mut whole = crowded_rooms(2);
    run(&mut whole, 0, 150);
    let text = serde_json::to_string(&whole.state()).expect("JSON");
    let expected = run(&mut whole, 150, 600);
    let mut resumed = crowded_rooms(2);
    resumed.restore(serde_json::from_str(&text).expect("JSON")).expect("restore");
    assert_eq!(run(&mut resumed, 150, 600), expected);
}

#[test]
fn a_crowd_that_is_off_changes_no_bit_and_no_snapshot() {
    let crowd =
        TrainingCrowd { speed_max: 1.5, size_max: 2.0, renew_steps: 5, stall_limit: 1, ..Default::default() };
    let mut off = Rooms::with_crowd(&SimConfig::default(), &crowd, 2, 5, 5, &Streams::new(7)).expect("rooms");
    let mut without = rooms(&SimConfig::default(), 2, 5);
    assert_eq!(run(&mut off, 0, 300), run(&mut without, 0, 300));
    let text = serde_json::to_string(&off.state()).expect("JSON");
    assert_eq!(text, serde_json::to_string(&without.state()).expect("JSON"));
    assert!(!text.contains("crowd"));
    assert!(off.transitions().iter().all(|t| t.role.learns()));
}

#[test]
fn a_snapshot_of_a_room_that_cannot_be_is_refused() {
    let crowd = TrainingCrowd { obstacles_max: 3, ..TrainingCrowd::default() };
    let with_crowd =
        || Rooms::with_crowd(&SimConfig::default(), &crowd, 1, 2, 5, &Streams::new(7)).expect("rooms");
    let text = serde_json::to_string(&with_crowd().state()).expect("JSON");
    let check = |from: &str, to: &str, expected: &str| {
        assert!(text.contains(from), "{text}");
        let state: RoomsState = serde_json::from_str(&text.replace(from, to)).expect("JSON");
        let message = with_crowd().restore(state).expect_err("refused").to_string();
        assert!(message.contains(expected), "{message}");
    };
    let out_of_range = "state.rooms[0]: found a number of agents, obstacles or steps out of range";
    check("\"n_present\":2", "\"n_present\":3", out_of_range);
    let wall = r#""obstacles":[[{"box":{"length":30.0,"width":30.0}},{"position":[0.0,0.0],"heading":0.0}]],"steps_left""#;
    let from = text
        .split_once("\"obstacles\":")
        .expect("obstacles")
        .1
        .split_once(",\"steps_left\"")
        .expect("steps")
        .0;
    check(&format!("\"obstacles\":{from},\"steps_left\""), wall, "spawn.");
    let rooms = text.split_once(",\"rooms\":").expect("rooms").1;
    check(&format!(",\"rooms\":{rooms}"), "}", "state.rooms: found 0 rooms, expected 1");
}

#[test]
fn a_snapshot_without_traits_is_refused_where_there_is_a_crowd() {
    let message = |mut rooms: Rooms, state| rooms.restore(state).expect_err("refused").to_string();
    assert_eq!(
        message(crowded_rooms(2), rooms(&SimConfig::default(), 2, 5).state()),
        "state.agents.crowd: found traits of 0 agents, expected those of every agent"
    );
    assert_eq!(
        message(rooms(&SimConfig::default(), 2, 5), crowded_rooms(2).state()),
        "state.agents.crowd: found traits of 10 agents, expected those of no agent"
    );
}

#[test]
fn a_state_of_another_shape_is_refused() {
    let state = rooms(&SimConfig::default(), 2, 5).state();
    let mut other = rooms(&SimConfig::default(), 2, 4);
    let message = other.restore(state).expect_err("shape").to_string();
    assert_eq!(message, "state.n_agents: found 5, expected 4");
}

#[test]
fn halves_step_as_the_whole() {
    let (mut whole, mut halves, mut ranges) = {
        let make = || rooms(&SimConfig::default(), 4, 3);
        (make(), make(), make())
    };
    for step in 0..50 {
        let actions = vec![[0.9, (step as f32 * 0.1).sin()]; 12];
        whole.step(&actions);
        let (mut a, mut b) = halves.all_mut().split_at(2);
        rayon::join(|| a.step(&actions[..6]), || b.step(&actions[6..]));
        ranges.step_range(1..4, &actions[3..]);
        ranges.step_range(0..1, &actions[..3]);
        assert_eq!(hash(&whole, 0), hash(&halves, 0));
        assert_eq!(hash(&whole, 0), hash(&ranges, 0));
    }
}

#[test]
fn a_room_does_not_know_its_siblings() {
    let (mut one, mut three) = (rooms(&SimConfig::default(), 1, 3), rooms(&SimConfig::default(), 3, 3));
    for _ in 0..100 {
        one.step(&[[0.8, 0.3]; 3]);
        three.step(&[[0.8, 0.3]; 9]);
        assert_eq!(one.observations(), &three.observations()[..one.observations().len()]);
        assert_eq!(one.transitions(), &three.transitions()[..3]);
    }
}

#[test]
fn a_time_limit_truncates_and_keeps_the_last_observation_apart() {
    let mut config = SimConfig::default();
    config.episode.step_limit = 3;
    let mut rooms = rooms(&config, 1, 2);
    for _ in 0..2 {
        rooms.step(&[[0.0, 0.0]; 2]);
        assert!(rooms.transitions().iter().all(|t| t.end.is_running() && t.episode.is_none()));
    }
    let goal_before = rooms.observations()[1536..1538].to_vec();
    rooms.step(&[[0.0, 0.0]; 2]);
    for (i, t) in rooms.transitions().iter().enumerate() {
        assert_eq!((t.end, t.reward), (StepEnd::Ended(Outcome::Timeout), 0.0));
        assert_eq!(t.episode.expect("summary").steps, 3);
        assert_ne!(rooms.final_observation(i), &rooms.observations()[i * 1540..][..1540]);
    }
    assert_eq!(&rooms.final_observation(0)[1536..1538], &goal_before[..]);
    // The new episode's first scan fills all three frames.
    let row = &rooms.observations()[..1536];
    assert_eq!(&row[..512], &row[512..1024]);
    assert_eq!(&row[..512], &row[1024..]);
}

#[test]
fn episodes_end_by_crash_or_goal_and_count_their_path() {
    let mut config = SimConfig::default();
    config.episode.goal_radius = 5.0;
    let mut rooms = rooms(&config, 2, 5);
    let (mut successes, mut crashes) = (0, 0);
    for step in 0..2000_u32 {
        rooms.step(&[[1.0, if step % 2 == 0 { 0.2 } else { 0.0 }]; 10]);
        for t in rooms.transitions() {
            match t.end {
                StepEnd::Ended(Outcome::Success) => {
                    successes += 1;
                    assert_eq!(t.reward, 15.0);
                    let e = t.episode.expect("summary");
                    assert!(e.path_length + 5.0 + 1e-3 >= f64::from(e.straight_distance));
                    assert!(e.path_length <= 0.1 * f64::from(e.steps) + 1e-4);
                }
                StepEnd::Ended(Outcome::CollisionWall | Outcome::CollisionPedestrian) => {
                    crashes += 1;
                    assert_eq!(t.reward, -15.0);
                }
                StepEnd::Ended(Outcome::Timeout) => assert_eq!(t.episode.expect("summary").steps, 400),
                StepEnd::Running => assert!(t.reward.abs() <= 0.25 + 1e-4),
            }
        }
    }
    assert!(successes > 10 && crashes > 10, "{successes} successes, {crashes} crashes");
}

#[test]
fn tokens_are_uniform_and_new_for_every_episode() {
    let mut config = SimConfig::default();
    config.episode.step_limit = 1;
    let mut rooms = rooms(&config, 4, 5);
    let mut counts = [0_u32; 5];
    for _ in 0..500 {
        rooms.step(&[[0.0, 0.0]; 20]);
        rooms.tokens().iter().for_each(|t| counts[*t as usize] += 1);
    }
    assert!(counts.iter().all(|c| (1800..2200).contains(c)), "{counts:?}");
}

#[test]
fn spawns_keep_their_distances() {
    let mut config = SimConfig::default();
    config.episode.step_limit = 1;
    config.laser.noise_std = 0.0;
    let mut rooms = rooms(&config, 1, 20);
    for _ in 0..300 {
        rooms.step(&[[0.0, 0.0]; 20]);
        for row in rooms.observations().chunks_exact(1540) {
            assert!(row[1536].hypot(row[1537]) >= 10.0 - 1e-4);
            let nearest = row[..512].iter().copied().fold(f32::INFINITY, f32::min);
            assert!((nearest + 0.5) * 10.0 >= 1.0 - 0.3536 - 1e-4);
        }
    }
}

#[test]
fn rooms_that_are_too_full_or_empty_are_refused() {
    let make = |width: f32, n_rooms, n_agents, n_behaviours| {
        let mut config = SimConfig::default();
        config.room.width = width;
        config.room.height = width;
        let made = Rooms::new(&config, n_rooms, n_agents, n_behaviours, &Streams::new(0));
        made.err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert_eq!(make(20.0, 1, 5, 0), "n_behaviours: found 0, expected at least 1");
    assert_eq!(make(20.0, 1, 0, 5), "n_agents: found 0, expected at least 1");
    assert_eq!(make(20.0, 0, 5, 5), "n_rooms: found 0, expected at least 1");
    assert!(make(20.0, 1, 200, 5).starts_with("n_agents: found 200, expected so few"));
    assert!(make(6.0, 1, 1, 5).starts_with("spawn.goal_distance: found 10"));
    assert!(make(1.0, 1, 1, 5).starts_with("spawn.wall_clearance: found 1"));
}

#[test]
fn the_others_are_as_if_a_removed_agent_had_never_been() {
    let config = SimConfig::default();
    let (mut alone, mut both) = (rooms(&config, 1, 1), rooms(&config, 1, 2));
    both.remove(1);
    // After three steps nothing of the first scan, in which the other may have stood, is left.
    for step in 0..20 {
        alone.step(&[[0.5, 0.1]]);
        both.step(&[[0.5, 0.1], [1.0, 0.0]]);
        assert_eq!(both.transitions()[..1], alone.transitions()[..]);
        assert_eq!(both.transitions()[1], jostle_sim::Transition::default());
        if step >= 2 {
            assert_eq!(both.observations()[..config.observation_len()], *alone.observations());
        }
    }
}
