//! The configurations that ship.

use std::path::Path;

use jostle_ppo::Config;

fn load(name: &str) -> Config {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(name);
    Config::load(&path, &[] as &[&str]).expect("a shipped configuration is valid")
}

#[test]
fn every_shipped_configuration_is_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let names =
        std::fs::read_dir(folder).expect("configs/").map(|entry| entry.expect("readable").file_name());
    let names: Vec<_> = names.filter_map(|name| name.into_string().ok()).collect();
    let training = names.iter().filter(|name| Path::new(name).extension().is_some_and(|e| e == "toml"));
    assert!(training.inspect(|name| drop(load(name))).count() >= 4);
}

#[test]
fn the_file_that_spells_every_key_out_spells_the_defaults() {
    assert_eq!(load("diversity_m5.toml"), Config::default());
}

#[test]
fn the_strong_recipe_is_the_studys_with_its_crowd() {
    let crowd = [
        "training_crowd.blind=0.5",
        "training_crowd.straight=0.1",
        "training_crowd.standing=0.03",
        "training_crowd.speed_min=0.4",
        "training_crowd.speed_max=1.6",
        "training_crowd.walk_on=true",
        "training_crowd.new_goal_every=10",
        "training_crowd.turn_at_once=true",
    ];
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/study.toml");
    let study = Config::load(&path, &crowd).expect("a shipped configuration is valid");
    let strong = load("strong.toml");
    // One run is a policy of both.
    assert_eq!((study.hash(), study.updates), (strong.hash(), strong.updates));
}
