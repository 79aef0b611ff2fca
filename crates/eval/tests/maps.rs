//! A wall is one thing to the crowds that know walls, however it was cut, sampled or turned.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DVec2, Vec2};
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_arena::room::RoomPlan;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;
use jostle_peds::orca::{AgentParameters, Obstacles, OrcaSimulator};
use jostle_peds::social_force::{Border, SocialForce, SocialForceConfig};
use jostle_sim::{RoomConfig, Scenario, maps};

const WALLS: &str = "walls = { min = [-10.0, -10.0], max = [10.0, 10.0] }\n";

/// A polygon map of the usual walls and some obstacles.
fn polygons(obstacles: &[String]) -> Scenario {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.toml");
    let text = obstacles.iter().fold(WALLS.to_owned(), |mut text, obstacle| {
        writeln!(text, "[[obstacle]]\n{obstacle}").unwrap();
        text
    });
    std::fs::write(&path, text).unwrap();
    maps::load(&path).unwrap()
}

/// A grid of square cells around the origin: free where `is_free` says so of a cell's centre.
fn grid(side: u32, cell: f64, yaw: f64, is_free: impl Fn(DVec2) -> bool) -> Scenario {
    let folder = tempfile::tempdir().unwrap();
    write_grid(folder.path(), side, cell, yaw, is_free);
    maps::load(&folder.path().join("m.yaml")).unwrap()
}

fn write_grid(folder: &Path, side: u32, cell: f64, yaw: f64, is_free: impl Fn(DVec2) -> bool) {
    let half = f64::from(side) / 2.0;
    let mut image = format!("P5 {side} {side} 255\n").into_bytes();
    for y in (0..side).rev() {
        for x in 0..side {
            let at = cell * (DVec2::new(f64::from(x), f64::from(y)) + 0.5 - half);
            image.push(if is_free(at) { 254 } else { 0 });
        }
    }
    let origin = DVec2::from_angle(yaw).rotate(DVec2::splat(-half * cell));
    let yaml = format!(
        "image: m.pgm\nresolution: {cell}\norigin: [{}, {}, {yaw}]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        origin.x, origin.y
    );
    std::fs::write(folder.join("m.pgm"), image).unwrap();
    std::fs::write(folder.join("m.yaml"), yaml).unwrap();
}

/// The social force of all walls on someone at a place, m/s².
fn wall_force(scenario: &Scenario, at: DVec2) -> DVec2 {
    let borders = Border::from_polygons(&scenario.boundary()).unwrap();
    let model = SocialForce::new(&SocialForceConfig::default()).unwrap();
    borders.iter().map(|border| model.wall_force(at, border)).sum()
}

/// The velocity that ORCA chooses for someone who wants to go somewhere.
fn orca_velocity(scenario: &Scenario, at: DVec2, wanted: DVec2) -> DVec2 {
    let obstacles = Arc::new(Obstacles::new(&scenario.boundary()).unwrap());
    let mut simulator = OrcaSimulator::new(0.1, obstacles).unwrap();
    let parameters = AgentParameters {
        neighbour_distance: 10.0,
        max_neighbours: 10,
        time_horizon: 5.0,
        time_horizon_obstacles: 5.0,
        radius: 0.35,
        max_speed: 1.0,
    };
    let agent = simulator.add_agent(at.as_vec2(), wanted.as_vec2(), &parameters).unwrap();
    simulator.set_preferred_velocity(agent, wanted.as_vec2()).unwrap();
    simulator.plan();
    simulator.planned_velocity(agent).as_dvec2()
}

/// Two rooms give the same force and the same velocity at places of the first, turned into the
/// second. Forces may differ by a share `force` of the largest wall's at that place, velocities by
/// `velocity`, m/s.
#[track_caller]
fn alike(a: &Scenario, b: &Scenario, turn: DVec2, places: &[DVec2], force: f64, velocity: f64) {
    for place in places {
        let there = turn.rotate(*place);
        let (in_a, in_b) = (turn.rotate(wall_force(a, *place)), wall_force(b, there));
        let nearest = f64::from(a.build().unwrap().clearance(place.as_vec2()));
        let scale = 50.0 * (-nearest / 0.2).exp();
        assert!(in_a.distance(in_b) <= force * scale, "{place}: {in_a} and {in_b}, one wall gives {scale}");
        for direction in 0..8 {
            // Straight at a wall or a corner, left and right are alike and rounding decides.
            let wanted = DVec2::from_angle(f64::from(direction) * std::f64::consts::FRAC_PI_4 + 0.6);
            let in_a = turn.rotate(orca_velocity(a, *place, wanted));
            let in_b = orca_velocity(b, there, turn.rotate(wanted));
            assert!(in_a.distance(in_b) <= velocity, "{place}, wanted {wanted}: {in_a} and {in_b}");
        }
    }
}

fn places(points: &[(f64, f64)]) -> Vec<DVec2> {
    points.iter().map(|at| DVec2::from(*at)).collect()
}

#[test]
fn a_wall_cut_into_pieces_is_one_wall() {
    let whole = polygons(&["box = { centre = [4.0, 0.0], length = 3.0, width = 12.0 }".into()]);
    let thirds: Vec<String> =
        (3..6).map(|x| format!("box = {{ centre = [{x}.0, 0.0], length = 1.0, width = 12.0 }}")).collect();
    // Pieces that overlap, pieces at whose edges rounding leaves a gap, polygons instead of boxes.
    let rows: Vec<String> = (0..40)
        .map(|i| {
            format!("box = {{ centre = [4.0, {}], length = 3.0, width = 0.3 }}", f64::from(i) * 0.3 - 5.85)
        })
        .collect();
    let overlapping: Vec<String> = (0..5)
        .map(|i| format!("box = {{ centre = [4.0, {}], length = 3.0, width = 4.0 }}", 2 * i - 4))
        .collect();
    let halves = ["[5.5, 6.0]", "[2.5, -6.0]"].map(|third| {
        let [a, b] =
            if third == "[5.5, 6.0]" { ["[2.5, -6.0]", "[5.5, -6.0]"] } else { ["[5.5, 6.0]", "[2.5, 6.0]"] };
        format!("polygon = [{a}, {b}, {third}]")
    });
    let around =
        places(&[(2.2, 0.0), (2.0, 1.95), (2.1, 6.2), (4.0, 6.4), (5.8, -6.3), (6.0, 0.1), (2.4, -5.9)]);
    for cut in [&thirds[..], &rows, &overlapping, &halves] {
        alike(&whole, &polygons(cut), DVec2::X, &around, 1e-3, 1e-3);
    }
    // Three boxes repelled 1.3 times as one; one repels as the model's formula says.
    let force = wall_force(&whole, DVec2::new(2.2, 0.0)).x;
    assert!((force + 50.0 * (-0.3_f64 / 0.2).exp()).abs() < 1e-4, "{force}");
}

#[test]
fn a_thin_wall_of_three_segments_is_one_wall() {
    let segment = |y: [f64; 2]| format!("segment = [[4.0, {:?}], [4.0, {:?}]]", y[0], y[1]);
    let whole = polygons(&[segment([-6.0, 6.0])]);
    let thirds = polygons(&[segment([-6.0, -2.0]), segment([-2.0, 2.0]), segment([2.0, 6.0])]);
    let around = places(&[(3.6, 0.0), (3.5, 2.0), (4.4, -2.1), (4.1, 6.4)]);
    // What touches something is a millimetre thick to either side and longer by one: nothing of it
    // lies further than the diagonal of that from where the segment does. A force falls by
    // exp(−d/0.2 m). In ORCA someone of 0.35 m at a distance d of an end keeps to the tangent,
    // which that end's shift turns by at most shift/√(d² − 0.35²), most of all at the last place;
    // and a velocity straight at the wall is cut to d/5 s.
    let (shift, nearest) = (2.0_f64.sqrt() * 1e-3, 0.1_f64.hypot(0.4));
    let turn = shift / (nearest.powi(2) - 0.35_f64.powi(2)).sqrt();
    alike(&whole, &thirds, DVec2::X, &around, (shift / 0.2).exp_m1(), turn + shift / 5.0);
    assert_eq!(whole.boundary().len(), 2);
}

#[test]
fn a_box_at_the_wall_is_a_part_of_the_wall() {
    // A rim of boxes along all walls: a room of 19 m.
    let rim: Vec<String> =
        [(0.0, 9.75, 20.0, 0.5), (0.0, -9.75, 20.0, 0.5), (9.75, 0.0, 0.5, 20.0), (-9.75, 0.0, 0.5, 20.0)]
            .iter()
            .map(|(x, y, length, width)| {
                format!("box = {{ centre = [{x:?}, {y:?}], length = {length:?}, width = {width:?} }}")
            })
            .collect();
    let mut room = RoomConfig::default();
    (room.width, room.height) = (19.0, 19.0);
    let plain = maps::scenario(&room).unwrap();
    let around = places(&[(9.2, 0.0), (9.1, 9.0), (-9.2, -8.9), (0.0, -9.3), (3.0, 2.0)]);
    alike(&polygons(&rim), &plain, DVec2::X, &around, 1e-4, 1e-4);
}

#[test]
fn a_wall_between_two_rooms_repels_once() {
    // Rooms of 8 m by 10 m, parted by 0.1 m; from the left one the right one's walls are not felt.
    let is_free = |at: DVec2| {
        let (left, right) = (at - DVec2::new(-4.05, 0.0), at - DVec2::new(4.05, 0.0));
        [left, right].iter().any(|own| own.x.abs() < 4.0 && own.y.abs() < 5.0)
    };
    let rooms = grid(400, 0.05, 0.0, is_free);
    let near = DVec2::new(-0.45, 0.0);
    let expected = -50.0 * (-0.4_f64 / 0.2).exp();
    let force = wall_force(&rooms, near).x;
    assert!((force - expected).abs() < 0.05 * expected.abs(), "{force}, expected {expected}");
}

#[test]
fn a_rasterised_room_is_the_same_however_it_is_turned() {
    let plain = maps::scenario(&RoomConfig::default()).unwrap();
    let around =
        places(&[(9.5, 0.0), (9.4, 3.3), (9.3, 9.3), (-9.6, 2.0), (0.0, 0.0), (-9.3, -9.0), (4.0, -9.65)]);
    for degrees in [0.0_f64, 10.0, 30.0, 45.0, 77.0] {
        let turn = DVec2::from_angle(degrees.to_radians());
        let back = DVec2::new(turn.x, -turn.y);
        let raster = |cell: f64| {
            grid((32.0 / cell) as u32, cell, 0.0, |at| back.rotate(at).abs().max_element() < 10.0)
        };
        let (coarse, fine) = (raster(0.1), raster(0.05));
        // The same room, unturned in its image, turned by the map's yaw.
        let yawed = grid(320, 0.1, degrees.to_radians(), |at| at.abs().max_element() < 10.0);
        for room in [&coarse, &fine, &yawed] {
            assert_eq!(room.boundary().len(), 1, "{degrees}°");
        }
        // A wall may lie half a cell elsewhere: exp(0.05/0.2) − 1 = 0.28, exp(0.025/0.2) − 1 =
        // 0.13.
        alike(&plain, &coarse, turn, &around, 0.28, 0.05);
        alike(&plain, &fine, turn, &around, 0.13, 0.03);
        alike(&plain, &yawed, turn, &around, 1e-4, 1e-4);
    }
}

#[test]
fn pillars_and_thin_walls_of_a_grid_are_the_same_however_they_are_turned() {
    // A pillar of 0.6 m and a wall of 0.2 m by 5 m in the usual room.
    let is_free = |at: DVec2| {
        let (pillar, wall) = ((at - DVec2::new(-4.0, 2.0)).abs(), (at - DVec2::new(4.0, 0.0)).abs());
        at.abs().max_element() < 10.0 && pillar.max_element() > 0.3 && (wall.x > 0.1 || wall.y > 2.5)
    };
    let drawn = polygons(&[
        "box = { centre = [-4.0, 2.0], length = 0.6, width = 0.6 }".into(),
        "box = { centre = [4.0, 0.0], length = 0.2, width = 5.0 }".into(),
    ]);
    let around = places(&[(-4.7, 2.1), (-4.7, 2.5), (-4.0, 1.4), (3.5, 0.0), (4.5, 2.0)]);
    for degrees in [0.0_f64, 20.0, 45.0] {
        let turn = DVec2::from_angle(degrees.to_radians());
        let back = DVec2::new(turn.x, -turn.y);
        let room = grid(640, 0.05, 0.0, |at| is_free(back.rotate(at)));
        // A corner may lie two cells elsewhere, a side half a cell.
        alike(&drawn, &room, turn, &around, 0.3, 0.1);
        // The end of the wall has four cells, and may lie askew.
        let end = DVec2::new(4.0, 3.0);
        let (drawn, here) = (wall_force(&drawn, end).length(), wall_force(&room, turn.rotate(end)).length());
        assert!((here - drawn).abs() < 0.28 * drawn, "{degrees}°: {here} for {drawn}");
    }
}

#[test]
fn the_usual_room_is_what_it_was() {
    let room = maps::scenario(&RoomConfig::default()).unwrap().boundary();
    let corners = [(-10.0, -10.0), (-10.0, 10.0), (10.0, 10.0), (10.0, -10.0)];
    assert_eq!(room, [corners.map(Vec2::from).to_vec()]);
}

#[test]
fn a_turned_hall_of_thirty_metres_takes_the_crowds_that_know_walls() {
    let folder = tempfile::tempdir().unwrap();
    let back = DVec2::from_angle(-30.0_f64.to_radians());
    write_grid(folder.path(), 900, 0.05, 0.0, |at| back.rotate(at).abs().max_element() < 15.0);
    let mut config = ArenaConfig { n_agents: 5, ..ArenaConfig::default() };
    config.sim.room.map = Some(folder.path().join("m.yaml"));
    for crowd in [CrowdKind::Vo, CrowdKind::Sf] {
        let plan = RoomPlan::new(&config, crowd).unwrap();
        assert_eq!(plan.scenario.boundary()[0].len(), 4);
        Protocol::new(config.clone(), Pools::default()).unwrap().crowd(&plan).unwrap();
    }
}

#[test]
fn a_grid_of_sixteen_million_cells_is_read_in_seconds() {
    let folder = tempfile::tempdir().unwrap();
    // A building, turned: rooms of 20 m with doors, walls of 0.2 m.
    let back = DVec2::from_angle(-30.0_f64.to_radians());
    write_grid(folder.path(), 4000, 0.05, 0.0, |at| {
        let own = back.rotate(at);
        let wall = (own / 20.0).fract_gl() * 20.0;
        own.abs().max_element() < 60.0 && (wall.x > 0.2 || wall.y < 3.0) && (wall.y > 0.2 || wall.x < 3.0)
    });
    let started = Instant::now();
    let scenario = maps::load(&folder.path().join("m.yaml")).unwrap();
    let loaded = started.elapsed();
    let lines = scenario.boundary();
    println!("loaded in {loaded:?}, lines after {:?}: {}", started.elapsed(), lines.len());
    // Two seconds on a machine that does nothing else.
    assert!(loaded < Duration::from_secs(15), "{loaded:?}");
    assert!(lines.iter().map(Vec::len).sum::<usize>() < 2000);
}

#[test]
fn a_cell_is_known_by_its_maps_content() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("m.toml");
    let settings = |text: &str, path: &Path| {
        std::fs::write(path, text).unwrap();
        let mut config = ArenaConfig::default();
        config.sim.room.map = Some(path.to_owned());
        let protocol = Protocol::new(config, Pools::default()).unwrap();
        let identity = jostle_arena::identity::PolicyIdentity::custom("test", "1");
        let subject = jostle_eval::protocol::Subject { identity: &identity, token: 0 };
        protocol.key(subject, CrowdKind::Sf).hash()
    };
    let first = settings(WALLS, &map);
    assert_eq!(settings(WALLS, &folder.path().join("other.toml")), first);
    assert_ne!(settings(&format!("{WALLS}\n"), &map), first);
}
