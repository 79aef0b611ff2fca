//! Crowds VO and SF as the rooms use them: many rooms at once, who sees whom, a corridor, free
//! speed.

use std::sync::Arc;

use glam::Vec2;
use jostle_peds::{
    Command, Crowd, CrowdKind, CrowdName, Pedestrian, RoomView, Visibility,
    orca::{Obstacles, OrcaConfig, OrcaCrowd},
    social_force::{Border, DesiredSpeed, SocialForceConfig, SocialForceCrowd},
};

const DT: f32 = 0.1;
const BLIND: Visibility = Visibility { pedestrians: false, robot: false };
const ROBOT_ONLY: Visibility = Visibility { pedestrians: false, robot: true };

fn room() -> Vec<Vec2> {
    vec![Vec2::new(-10.0, -10.0), Vec2::new(-10.0, 10.0), Vec2::new(10.0, 10.0), Vec2::new(10.0, -10.0)]
}

fn crowds_in(polygons: &[Vec<Vec2>], visibility: Visibility) -> Vec<Box<dyn Crowd>> {
    let obstacles = Arc::new(Obstacles::new(polygons).unwrap());
    let borders: Arc<[Border]> = Border::from_polygons(polygons).unwrap().into();
    vec![
        Box::new(OrcaCrowd::new(&OrcaConfig::default(), visibility, DT, obstacles).unwrap()),
        Box::new(SocialForceCrowd::new(&SocialForceConfig::default(), visibility, DT, borders).unwrap()),
    ]
}

fn pedestrian(x: f32, y: f32, velocity: Vec2, goal: Vec2) -> Pedestrian {
    Pedestrian { position: Vec2::new(x, y), velocity, heading: 0.0, goal }
}

fn view<'a>(pedestrians: &'a [Pedestrian], others: &'a [Pedestrian]) -> RoomView<'a> {
    RoomView { pedestrians, others, observations: &[], speed_factor: &[] }
}

fn decide(crowd: &mut dyn Crowd, rooms: &[RoomView<'_>]) -> Vec<Vec2> {
    let mut commands = vec![Command::STILL; rooms.iter().map(|room| room.pedestrians.len()).sum()];
    crowd.decide(rooms, &mut commands).unwrap();
    let velocity = |command: &Command| match command {
        Command::Walk { velocity } => *velocity,
        Command::Drive { .. } => panic!("pedestrians of the pure models walk"),
    };
    commands.iter().map(velocity).collect()
}

/// Walks to the goals; returns positions.
fn walk(crowd: &mut dyn Crowd, people: &mut [Pedestrian], steps: usize) {
    for _ in 0..steps {
        let velocities = decide(crowd, &[view(people, &[])]);
        for (person, velocity) in people.iter_mut().zip(velocities) {
            person.velocity = velocity;
            person.position += DT * velocity;
        }
    }
}

fn passing() -> [Pedestrian; 3] {
    let east = Vec2::new(5.0, 0.0);
    [
        pedestrian(-2.0, 0.1, Vec2::X, east),
        pedestrian(0.5, -0.1, -Vec2::X, -east),
        pedestrian(1.0, 1.5, -Vec2::Y, Vec2::new(1.0, -5.0)),
    ]
}

#[test]
fn rooms_do_not_mix() {
    let people = passing();
    for mut crowd in crowds_in(&[room()], Visibility::PEDESTRIANS) {
        let together = decide(
            &mut *crowd,
            &[view(&people, &[]), view(&people[..2], &[]), view(&[], &[]), view(&people, &[])],
        );
        let three = decide(&mut *crowd, &[view(&people, &[])]);
        let two = decide(&mut *crowd, &[view(&people[..2], &[])]);
        assert_eq!(together, [&three[..], &two, &three].concat(), "{}", crowd.name());
    }
}

#[test]
fn the_matrix_says_who_is_seen() {
    let people = passing();
    let robot = [pedestrian(-1.0, 0.0, Vec2::ZERO, Vec2::ZERO)];
    let decisions = |visibility, others: &[Pedestrian]| -> Vec<Vec<Vec2>> {
        let crowds = crowds_in(&[room()], visibility);
        crowds.into_iter().map(|mut crowd| decide(&mut *crowd, &[view(&people, others)])).collect()
    };
    let alone: Vec<Vec<Vec2>> = crowds_in(&[room()], Visibility::ALL)
        .into_iter()
        .map(|mut crowd| people.iter().flat_map(|one| decide(&mut *crowd, &[view(&[*one], &[])])).collect())
        .collect();
    for (i, alone) in alone.iter().enumerate() {
        let pedestrians = &decisions(Visibility::PEDESTRIANS, &robot)[i];
        assert_eq!(*pedestrians, decisions(Visibility::ALL, &[])[i]);
        assert_ne!(*pedestrians, decisions(Visibility::ALL, &robot)[i]);
        assert_ne!(pedestrians, alone);
        assert_eq!(decisions(BLIND, &robot)[i], *alone);
        assert_ne!(decisions(ROBOT_ONLY, &robot)[i], *alone);
    }
}

#[test]
fn free_speed_is_the_desired_speed() {
    for mut crowd in crowds_in(&[room()], Visibility::PEDESTRIANS) {
        let mut people = [pedestrian(-8.0, 0.0, Vec2::ZERO, Vec2::new(8.0, 0.0))];
        walk(&mut *crowd, &mut people, 60);
        assert!(people[0].velocity.distance(Vec2::X) < 1e-3, "{}: {}", crowd.name(), people[0].velocity);
    }
}

#[test]
fn a_corridor_is_traversed() {
    let corridor =
        vec![Vec2::new(0.0, -1.5), Vec2::new(0.0, 1.5), Vec2::new(20.0, 1.5), Vec2::new(20.0, -1.5)];
    for mut crowd in crowds_in(&[corridor], Visibility::PEDESTRIANS) {
        let goal = Vec2::new(17.0, 0.0);
        let mut people =
            [pedestrian(1.0, -0.7, Vec2::ZERO, goal), pedestrian(3.0, 0.8, Vec2::ZERO, goal - Vec2::X)];
        walk(&mut *crowd, &mut people, 250);
        for person in people {
            assert!(
                person.position.x > 14.0 && person.position.y.abs() < 1.2,
                "{}: {person:?}",
                crowd.name()
            );
        }
    }
}

#[test]
fn a_speed_factor_multiplies_the_desired_speed_of_sf() {
    let config = SocialForceConfig { desired_speed: DesiredSpeed::HELBING, ..SocialForceConfig::default() };
    let mut crowd = SocialForceCrowd::new(&config, Visibility::ALL, DT, Vec::new().into()).unwrap();
    // At rest the force is v⁰/τ, so that one step gives v⁰ · 0.1 / 0.5.
    let people = [pedestrian(0.0, 0.0, Vec2::ZERO, Vec2::X)];
    let rooms = [RoomView { speed_factor: &[0.5], ..view(&people, &[]) }];
    assert!((decide(&mut crowd, &rooms)[0].x - 0.5 * 1.34 * 0.2).abs() < 1e-6);
}

#[test]
fn bad_views_are_refused() {
    let people = passing();
    for mut crowd in crowds_in(&[room()], Visibility::ALL) {
        let mut check = |people: &[Pedestrian], others: &[Pedestrian], n: usize| {
            crowd.decide(&[view(people, others)], &mut vec![Command::STILL; n]).is_ok()
        };
        assert!(check(&people, &[], 3));
        assert!(!check(&people, &[], 2));
        for bad in [Vec2::NAN, Vec2::new(f32::INFINITY, 0.0)] {
            assert!(!check(&[Pedestrian { position: bad, ..people[0] }], &[], 1));
            assert!(!check(&[Pedestrian { velocity: bad, ..people[0] }], &[], 1));
            assert!(!check(&[Pedestrian { goal: bad, ..people[0] }], &[], 1));
            assert!(!check(&people[..1], &[Pedestrian { position: bad, ..people[1] }], 1));
        }
    }
}

#[test]
fn the_pure_crowds_say_what_they_are() {
    let crowds = crowds_in(&[room()], Visibility::ALL);
    let names: Vec<CrowdName> = crowds.iter().map(|crowd| crowd.name()).collect();
    assert_eq!(names, [CrowdKind::Vo, CrowdKind::Sf]);
    assert!(crowds.iter().all(|crowd| !crowd.senses_by_laser()));
}

#[test]
fn time_steps_out_of_range_are_refused() {
    let sf = |time_step| {
        SocialForceCrowd::new(&SocialForceConfig::default(), Visibility::ALL, time_step, Vec::new().into())
            .is_ok()
    };
    // (Single precision holds 1e-4 a little below itself.)
    assert!(sf(1.1e-4) && sf(10.0) && !sf(0.9e-4) && !sf(10.1) && !sf(f32::NAN));
}
