//! A policy's room with some of its keys changed: `--set` of the commands that test and show
//! policies.

use anyhow::{Context as _, Result, bail};
use jostle_ppo::Config;
use jostle_sim::SimConfig;

/// The room of a policy with these changes: each the dotted key of a training file and a value,
/// such as `sim.robot.dynamics=rapier`.
///
/// # Errors
///
/// A key that is unknown or none of the room's; a value of the wrong type or out of range.
pub fn changed(mut sim: SimConfig, changes: &[String]) -> Result<SimConfig> {
    if changes.is_empty() {
        return Ok(sim);
    }
    if let Some(change) = changes.iter().find(|change| !change.trim_start().starts_with("sim.")) {
        bail!(
            "--set {change}: found a key of the training, expected one of the room, such as sim.robot.dynamics=rapier"
        );
    }
    // The file that named the map is not known any more behind this.
    sim.room.map = sim.room.map_file();
    let text = toml::to_string(&Config { sim, ..Config::default() }).context("a room that is no TOML")?;
    Ok(Config::parse(&text, "the policy's room", changes)?.sim)
}

#[cfg(test)]
mod tests {
    use jostle_sim::Dynamics;

    use super::*;

    #[test]
    fn a_room_is_changed_key_by_key_and_refusals_name_the_key() {
        let mut trained = SimConfig::default();
        trained.laser.beams = 64;
        trained.room.map = Some("maps/warehouse.toml".into());
        trained.room.named_in(std::path::Path::new("/somewhere"));
        let sets = ["sim.robot.dynamics=rapier", "sim.robot.v_max=0.5"].map(str::to_owned);
        let room = changed(trained.clone(), &sets).unwrap();
        assert_eq!((room.robot.dynamics, room.robot.v_max, room.laser.beams), (Dynamics::Rapier, 0.5, 64));
        assert_eq!(room.room.map_file(), trained.room.map_file());
        assert_eq!(changed(trained.clone(), &[]).unwrap(), trained);
        let refusal = |set: &str| changed(SimConfig::default(), &[set.to_owned()]).unwrap_err().to_string();
        assert!(refusal("alpha=1").starts_with("--set alpha=1: found a key of the training"));
        assert!(
            refusal("sim.robot.dynamics=newton").contains("sim.robot.dynamics"),
            "{}",
            refusal("sim.robot.dynamics=newton")
        );
        assert!(
            refusal("sim.robot.base.mass=-1").contains("sim.robot.base.mass"),
            "{}",
            refusal("sim.robot.base.mass=-1")
        );
    }
}
