//! Table 5: two realistic maps, a Jackal's body and limits, 3 to 8 social-force pedestrians.

use anyhow::Result;
use jostle_arena::Driver;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_eval::compact::CompactEpisode;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;
use jostle_sim::{AccelerationLimits, Dynamics, SimConfig};

use super::cells::{Cells, Wanted};
use super::evaluator::TOKEN;
use super::mujoco::Pilot;
use super::policies::Found;
use jostle_runs::provenance::workspace;

/// The maps, files of these names in `maps/`.
pub(super) const MAPS: [&str; 2] = ["warehouse", "hospital"];
/// Episodes on each map (paper, V-G).
const EPISODES: u64 = 100;
/// Pedestrians (paper, V-G).
const PEDESTRIANS: std::ops::RangeInclusive<usize> = 3..=8;

/// The note below the table.
pub(super) const NOTE: &str = "100 episodes a map and seed, as evenly as possible over 3 to 8 social-force pedestrians; our own \
    maps (maps/warehouse.toml, maps/hospital.toml) and simulator stand for the paper's Gazebo worlds. The robot has a Jackal's \
    body and acceleration limits, which do not bind at 1 m/s; goals are at least 5 m away. The interval of one seed is Wilson's.";

/// The maps' names where robots have mass.
pub(super) const MAPS_WITH_MASS: [&str; 2] = ["warehouse, rapier", "hospital, rapier"];

/// What has to be said of the table with mass.
pub(super) const NOTE_WITH_MASS: &str = "The maps and episodes of Table 5. kinematic: as there; rapier: the same robot with a Jackal's mass, wheels, \
    motors and latency; mujoco: a Jackal on four wheels in MuJoCo, which casts its rays, moves it and finds its contacts \
    (docs/how-to-dynamics.md). No policy was trained with them. The maps are our own; their open floors of 10 m × 10 m follow \
    the paper's text.";

/// The maps' names in MuJoCo.
pub(super) const MAPS_IN_MUJOCO: [&str; 2] = ["warehouse, mujoco", "hospital, mujoco"];

/// The episodes of a policy on each map.
pub(super) fn run(cells: &mut Cells, found: &Found) -> Result<Vec<(String, Vec<CompactEpisode>)>> {
    run_with(cells, found, Dynamics::Kinematic)
}

/// As [`run`], in a robot that moves so.
pub(super) fn run_with(
    cells: &mut Cells,
    found: &Found,
    dynamics: Dynamics,
) -> Result<Vec<(String, Vec<CompactEpisode>)>> {
    let driver = Driver::Trained(Box::new(found.policy.clone()));
    on_maps(cells, &driver, &found.policy.sim_config()?, dynamics)
}

/// The maps' names where robots move so.
pub(super) fn sites(dynamics: Dynamics) -> [&'static str; 2] {
    match dynamics {
        Dynamics::Kinematic => MAPS,
        Dynamics::Rapier => MAPS_WITH_MASS,
    }
}

/// The episodes of a driver on each map, in its own world but for map and robot.
pub(super) fn on_maps(
    cells: &mut Cells,
    driver: &Driver,
    sim: &SimConfig,
    dynamics: Dynamics,
) -> Result<Vec<(String, Vec<CompactEpisode>)>> {
    let mut sim = sim.clone();
    sim.robot.dynamics = dynamics;
    let maps = MAPS.iter().zip(sites(dynamics));
    maps.map(|(map, site)| Ok((site.to_owned(), on_map(cells, driver, &sim, map)?))).collect()
}

fn on_map(cells: &mut Cells, driver: &Driver, sim: &SimConfig, map: &str) -> Result<Vec<CompactEpisode>> {
    let mut all = Vec::new();
    for (protocol, episodes) in protocols(sim, map)? {
        let cell = cells.get(&wanted(&protocol, driver, episodes))?;
        all.extend(cell.episodes(episodes as usize));
    }
    Ok(all)
}

/// The episodes of a driver on each map in MuJoCo; none where MuJoCo has not run them all.
pub(super) fn in_mujoco(
    cells: &mut Cells,
    driver: &Driver,
    pilot: Pilot<'_>,
    sim: &SimConfig,
) -> Result<Vec<(String, Vec<CompactEpisode>)>> {
    let mut sites = Vec::new();
    for (map, site) in MAPS.iter().zip(MAPS_IN_MUJOCO) {
        let mut all = Vec::new();
        for (protocol, episodes) in protocols(sim, map)? {
            let Some(cell) = cells.get_in_mujoco(&wanted(&protocol, driver, episodes), pilot)? else {
                return Ok(Vec::new());
            };
            all.extend(cell.episodes(episodes as usize));
        }
        sites.push((site.to_owned(), all));
    }
    Ok(sites)
}

/// As [`in_mujoco`], of a policy.
pub(super) fn run_in_mujoco(cells: &mut Cells, found: &Found) -> Result<Vec<(String, Vec<CompactEpisode>)>> {
    let driver = Driver::Trained(Box::new(found.policy.clone()));
    in_mujoco(cells, &driver, Pilot::Policy(&found.path), &found.policy.sim_config()?)
}

fn wanted<'a>(protocol: &'a Protocol, driver: &'a Driver, episodes: u64) -> Wanted<'a> {
    Wanted { protocol, driver, token: TOKEN, crowd: CrowdKind::Sf, episodes }
}

/// The settings of a map with each number of pedestrians, and their episodes.
fn protocols(sim: &SimConfig, map: &str) -> Result<Vec<(Protocol, u64)>> {
    let counts = PEDESTRIANS.count() as u64;
    let of = |(i, n_pedestrians): (usize, usize)| {
        let config = ArenaConfig {
            sim: world(sim.clone(), map),
            n_agents: 1 + n_pedestrians,
            // In so small a place 3 m around every body would leave none.
            respawn_clearance: 1.5,
            ..ArenaConfig::default()
        };
        let episodes = EPISODES / counts + u64::from((i as u64) < EPISODES % counts);
        Ok((Protocol::new(config, Pools::default())?, episodes))
    };
    PEDESTRIANS.enumerate().map(of).collect()
}

/// The policy's own world but for map and robot.
fn world(mut sim: SimConfig, map: &str) -> SimConfig {
    sim.room.map = Some(workspace().join("maps").join(format!("{map}.toml")));
    // Clearpath Robotics, Jackal data sheet: 508 mm long, 430 mm wide, at most 2 m/s. The policy
    // asks for at most 1 m/s, so `v_max` stays the policy's.
    (sim.robot.length, sim.robot.width) = (0.508, 0.430);
    // Repository jackal/jackal, jackal_control/config/control.yaml: max_acceleration of linear.x
    // and angular.z.
    sim.robot.acceleration = Some(AccelerationLimits { v: 20.0, w: 25.0 });
    // Half of the open area's side: the training room's 10 m do not fit.
    sim.spawn.goal_distance = 5.0;
    sim
}

#[cfg(test)]
mod tests {
    use jostle_arena::room::RoomPlan;

    use super::*;

    #[test]
    fn the_maps_hold_a_robot_and_eight_pedestrians() {
        for map in MAPS {
            let config = ArenaConfig {
                sim: world(SimConfig::default(), map),
                n_agents: 9,
                respawn_clearance: 1.5,
                ..ArenaConfig::default()
            };
            RoomPlan::new(&config, CrowdKind::Sf).unwrap();
        }
    }
}
