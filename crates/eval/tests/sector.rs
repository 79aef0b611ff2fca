//! Lasers that see a sector: what pedestrians see, who may be tested in which room, and crashes
//! that no beam shows.

use std::f32::consts::PI;

use crate::common::{brief, pools, untrained};
use jostle_arena::crowds::check_observation;
use jostle_arena::replay::trace_episodes;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{ArenaConfig, LoadedPolicy, Outcome, PerRow, Pools};
use jostle_eval::Protocol;
use jostle_peds::{Command, CrowdKind};
use jostle_sim::{FRAMES, Laser, LaserConfig};

/// 512 beams over half a circle.
fn half_circle() -> ArenaConfig {
    let mut config = brief(60);
    (config.sim.laser.fov, config.sim.laser.angle_min) = (PI, -0.5 * PI);
    config
}

fn trained_with(seed: u64, laser: &LaserConfig) -> LoadedPolicy {
    let mut policy = untrained(seed);
    let sim = jostle_sim::SimConfig { laser: laser.clone(), ..jostle_sim::SimConfig::default() };
    policy.file.metadata.insert("sim".to_owned(), serde_json::to_string(&sim).unwrap());
    policy
}

#[test]
fn a_policy_that_was_trained_with_another_laser_is_refused_in_one_line() {
    let (circle, half) = (ArenaConfig::default(), half_circle());
    let (of_circle, of_half) = (trained_with(1, &circle.sim.laser), trained_with(2, &half.sim.laser));
    check_observation(&circle, &of_circle).unwrap();
    check_observation(&half, &of_half).unwrap();
    let message = check_observation(&half, &of_circle).unwrap_err().to_string();
    assert_eq!(
        message,
        "laser of the policy: found untrained-1, trained with a laser that sees all round from 0 rad, expected one \
         trained with the room's, which sees 3.1415927 rad from -1.5707964 rad"
    );
    let message = check_observation(&circle, &of_half).unwrap_err().to_string();
    assert!(message.contains("untrained-2") && message.lines().count() == 1, "{message}");
    let mut turned = half.clone();
    turned.sim.laser.angle_min = 0.0;
    assert!(check_observation(&turned, &of_half).is_err());

    // The pool of a learned crowd, too.
    let pools = Pools { full: vec![of_circle], half: Vec::new() };
    let protocol = Protocol::new(half.clone(), pools).unwrap();
    let plan = RoomPlan::new(&half, CrowdKind::Nh).unwrap();
    assert!(
        protocol
            .crowd(&plan)
            .err()
            .unwrap()
            .to_string()
            .starts_with("laser of the policy: found untrained-1")
    );
    // A file without settings does not say what it was trained with.
    check_observation(&half, &untrained(3)).unwrap();
}

#[test]
fn learned_pedestrians_see_the_sector_that_the_robot_sees() {
    let mut half = half_circle();
    (half.sim.laser.beams, half.sim.laser.noise_std) = (257, 0.0);
    let mut circle = brief(60);
    circle.sim.laser.noise_std = 0.0;
    let room = |config: &ArenaConfig| {
        let plan = RoomPlan::new(config, CrowdKind::Nh).unwrap();
        let laser = Laser::new(&config.sim.laser).unwrap();
        let mut room = ArenaRoom::new(&plan, &laser, 3).unwrap();
        for _ in 0..5 {
            assert!(room.step(&plan, [0.5, 0.2], &[Command::Drive { v: 0.4, w: 0.3 }; 4]).unwrap().is_none());
        }
        room
    };
    let (half, circle) = (room(&half), room(&circle));
    let (rows, rows_of_circle) = (half.view(&[]).observations, circle.view(&[]).observations);
    let (len, len_of_circle) = (FRAMES * 257 + 4, FRAMES * 512 + 4);
    assert_eq!((rows.len(), rows_of_circle.len()), (4 * len, 4 * len_of_circle));
    let pairs = rows.chunks_exact(len).zip(rows_of_circle.chunks_exact(len_of_circle));
    let own = (half.robot_observation(), circle.robot_observation());
    for (body, (row, of_circle)) in [own].into_iter().chain(pairs).enumerate() {
        assert_eq!(row[FRAMES * 257..], of_circle[FRAMES * 512..], "goal and velocity of body {body}");
        for frame in 0..FRAMES {
            // The half circle begins at the beam that points to the right. A silhouette may be
            // grazed.
            let apart =
                |k: &usize| (row[frame * 257 + k] - of_circle[frame * 512 + (k + 384) % 512]).abs() > 1e-4;
            let apart = (0..257).filter(apart).count();
            assert!(apart <= 3, "frame {frame} of body {body}: {apart} beams differ");
        }
    }
}

#[test]
fn a_robot_is_hit_by_whom_it_does_not_see() {
    let mut config = half_circle();
    (config.sim.laser.fov, config.sim.laser.angle_min) = (0.5, -0.25);
    config.sim.episode.step_limit = 400;
    let protocol = Protocol::new(config, pools()).unwrap();
    let plan = RoomPlan::new(protocol.config(), CrowdKind::Sf).unwrap();
    let mut crowd = protocol.crowd(&plan).unwrap();
    let episodes: Vec<u64> = (0..40).collect();
    let mut standing = PerRow::new(|_: &[f32]| [0.0, 0.0]);
    let traces = trace_episodes(&plan, &mut standing, &mut *crowd, &episodes, 512).unwrap();
    let mut unseen = 0;
    for trace in &traces {
        let last = trace.frames.last().unwrap();
        let hit = trace.finished.outcome == Outcome::CollisionPedestrian;
        assert_eq!(hit, last.min_range < 0.5, "{:?}", trace.finished);
        unseen += u32::from(hit && last.ranges.iter().all(|range| *range > 1.0));
    }
    assert!(unseen > 3, "{unseen} robots were hit by somebody out of sight");
}
