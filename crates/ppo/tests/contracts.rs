//! The promises of a training run: the same bytes at any number of threads, after a resume, on both
//! back ends.

use crate::common;
use std::path::Path;

use crate::common::{tiny, trainer};
use jostle_ppo::checkpoint::previous_path;
use jostle_ppo::{PpoError, Trainer, UpdateReport};

fn run(trainer: &mut Trainer, updates: usize) -> Vec<UpdateReport> {
    (0..updates).map(|_| trainer.update().expect("finite numbers").without_clock()).collect()
}

/// The bytes of a checkpoint, part by part, so that a failure names the part that moved.
fn saved(trainer: &mut Trainer, folder: &Path) -> Vec<(String, Vec<u8>)> {
    let path = folder.join("checkpoint.safetensors");
    trainer.save(&path).expect("a writable folder");
    let file = jostle_policy::TensorFile::read(&path).expect("a readable checkpoint");
    let mut parts: Vec<_> = file
        .names()
        .map(|name| (name.to_owned(), file.raw(name).expect("it is listed").1.to_vec()))
        .collect();
    parts.push(("whole file".to_owned(), std::fs::read(&path).expect("a readable file")));
    parts
}

#[track_caller]
fn assert_same(found: &[(String, Vec<u8>)], expected: &[(String, Vec<u8>)], what: &str) {
    assert_eq!(found.len(), expected.len());
    let moved: Vec<&str> =
        found.iter().zip(expected).filter(|(f, e)| f != e).map(|(f, _)| f.0.as_str()).collect();
    assert!(moved.is_empty(), "{what}: other bytes in {moved:?}");
}

/// A run that stops after `at` updates and goes on from its checkpoint `half` makes the reports and
/// the checkpoint of the `whole` one, at any number of threads.
#[track_caller]
fn assert_goes_on(
    settings: &[&str],
    threads: &[usize],
    at: usize,
    reports: &[UpdateReport],
    whole: &[(String, Vec<u8>)],
    half: &Path,
) {
    for &threads in threads {
        let config = jostle_ppo::Config { threads, ..tiny(settings) };
        let mut first = Trainer::new(config.clone()).expect("valid");
        assert_eq!(run(&mut first, at), reports[..at]);
        first.save(half).expect("writable");
        drop(first);
        let mut second = Trainer::resume_with(half, config).expect("a good checkpoint");
        assert_eq!(run(&mut second, reports.len() - at), reports[at..]);
        let found = saved(&mut second, half.parent().expect("a folder"));
        assert_same(&found, whole, &format!("{settings:?}, {threads} threads"));
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for backend in ["backend=fast", "backend=reference"] {
        let result = |threads: &str| {
            let mut trainer = trainer(&[backend, threads]);
            let reports = run(&mut trainer, 5);
            (reports, saved(&mut trainer, folder.path()))
        };
        let (reports, bytes) = result("threads=1");
        for threads in ["threads=2", "threads=8"] {
            let (other_reports, other_bytes) = result(threads);
            assert_eq!(other_reports, reports, "{backend} {threads}");
            assert_same(&other_bytes, &bytes, &format!("{backend} {threads}"));
        }
    }
}

#[test]
fn a_resumed_run_ends_with_the_bytes_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let half = folder.path().join("half.safetensors");
    for backend in ["backend=fast", "backend=reference"] {
        let mut whole = trainer(&[backend, "threads=2", "bootstrap_truncation=true"]);
        let reports = run(&mut whole, 6);
        let whole = saved(&mut whole, folder.path());

        let config = tiny(&[backend, "threads=1", "bootstrap_truncation=true"]);
        let mut first = Trainer::new(config.clone()).expect("valid");
        run(&mut first, 3);
        first.save(&half).expect("writable");
        drop(first);
        for threads in [1, 8] {
            let config = jostle_ppo::Config { threads, ..config.clone() };
            let mut second = Trainer::resume_with(&half, config).expect("a good checkpoint");
            assert_eq!(run(&mut second, 3), reports[3..], "{backend}");
            assert_same(&saved(&mut second, folder.path()), &whole, backend);
        }
        let mut by_file_alone = Trainer::resume(&half).expect("a good checkpoint");
        run(&mut by_file_alone, 3);
        assert_same(&saved(&mut by_file_alone, folder.path()), &whole, backend);
    }
}

/// The keys that switch a training crowd on in the tiny run.
const CROWD: [&str; 11] = [
    "n_agents=3",
    "training_crowd.blind=0.2",
    "training_crowd.straight=0.2",
    "training_crowd.stop_and_go=0.1",
    "training_crowd.size_max=1.2",
    "training_crowd.obstacles_max=1",
    "training_crowd.agents_min=2",
    "training_crowd.renew_steps=20",
    "training_crowd.speed_min=0.5",
    "training_crowd.speed_max=1.5",
    "bootstrap_truncation=true",
];

#[test]
fn a_training_crowd_keeps_the_promises() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let half = folder.path().join("half.safetensors");
    let mut whole = trainer(&CROWD);
    let reports = run(&mut whole, 6);
    let whole = saved(&mut whole, folder.path());
    assert_goes_on(&CROWD, &[1, 2, 8], 3, &reports, &whole, &half);
}

/// A room of 8 m with a pillar, as a map of the training crowd.
const PILLAR: &str = "walls = { min = [-4.0, -4.0], max = [4.0, 4.0] }\n[[obstacle]]\ncircle = { centre = [0.0, 0.0], radius = 0.4 }\n";

#[test]
fn rooms_with_maps_keep_the_promises_and_refuse_other_maps() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let (half, map) = (at("half.safetensors"), at("pillar.toml"));
    std::fs::write(&map, PILLAR).expect("writable");
    std::fs::write(at("empty.toml"), PILLAR.split("[[").next().expect("walls")).expect("writable");
    let maps = format!("training_crowd.maps=[\"{}\", \"{}\"]", map.display(), at("empty.toml").display());
    let settings = [maps.as_str(), "bootstrap_truncation=true"];
    let mut whole = trainer(&settings);
    let reports = run(&mut whole, 6);
    assert_ne!(run(&mut trainer(&settings[1..]), 1), reports[..1], "the rooms are others");
    let whole = saved(&mut whole, folder.path());
    assert_goes_on(&settings, &[1, 2], 3, &reports, &whole, &half);
    std::fs::write(&map, PILLAR.replace("0.4", "0.5")).expect("writable");
    let error = Trainer::resume(&half).err().expect("another pillar").to_string();
    let expected = format!("training_maps_sha256: found another content in {}", map.display());
    assert!(error.contains(&expected) && error.lines().count() == 1, "{error}");
}

/// Tests run in the crate's folder, which holds none of the files.
#[test]
fn a_run_and_its_maps_go_on_from_wherever_they_are_moved_to_together() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (here, there) = (folder.path().join("here"), folder.path().join("there"));
    for path in ["configs", "maps", "runs/a/checkpoints"] {
        std::fs::create_dir_all(here.join(path)).expect("a folder");
    }
    std::fs::write(here.join("maps/pillar.toml"), PILLAR).expect("writable");
    let config = format!("{}[training_crowd]\nmaps = [\"../maps/pillar.toml\"]\n", common::TINY);
    std::fs::write(here.join("configs/a.toml"), config).expect("writable");
    let load = |root: &Path| {
        let none: &[&str] = &[];
        jostle_ppo::Config::load(&root.join("configs/a.toml"), none).expect("a configuration")
    };
    let mut whole = Trainer::new(load(&here)).expect("a map");
    let reports = run(&mut whole, 4);
    let mut first = Trainer::new(load(&here)).expect("a map");
    run(&mut first, 2);
    first.save(&here.join("runs/a/checkpoints/2.safetensors")).expect("writable");
    let hash = load(&here).hash();
    std::fs::rename(&here, &there).expect("a move");
    let half = there.join("runs/a/checkpoints/2.safetensors");
    let mut by_file_alone = Trainer::resume(&half).expect("the map is found from the checkpoint");
    assert_eq!(run(&mut by_file_alone, 2), reports[2..]);
    let mut by_both = Trainer::resume_with(&half, load(&there)).expect("the same run");
    assert_eq!((run(&mut by_both, 2), load(&there).hash()), (reports[2..].to_vec(), hash));
}

#[test]
fn encoded_inputs_keep_the_promises() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let half = folder.path().join("half.safetensors");
    for inputs in ["network.inputs=motion", "network.scan_pool=4"] {
        let settings = [
            "n_agents=3",
            "bootstrap_truncation=true",
            "sim.laser.beams=64",
            "learning_rate_half_life=4",
            inputs,
        ];
        let mut whole = trainer(&settings);
        let reports = run(&mut whole, 6);
        let whole = saved(&mut whole, folder.path());
        assert_goes_on(&settings, &[1, 2], 3, &reports, &whole, &half);
    }
}

#[test]
fn constrained_diversity_keeps_the_promises() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let half = folder.path().join("half.safetensors");
    // Episodes of a few steps, so that enough of them end: the gate then closes for some behaviour.
    let settings =
        ["diversity_margin=0.01", "sim.episode.step_limit=3", "horizon=160", "n_agents=4", "alpha=0.5"];
    let mut whole = trainer(&settings);
    let reports = run(&mut whole, 12);
    let paid: Vec<u64> = reports.iter().map(|report| report.paid_behaviours.expect("constrained")).collect();
    assert!(paid.contains(&2) && paid.iter().any(|&paid| paid < 2), "{paid:?}");
    let free = run(&mut trainer(&settings[1..]), 12);
    assert!(free.iter().all(|report| report.paid_behaviours.is_none()));
    assert_ne!(free.last().map(|r| r.policy_loss), reports.last().map(|r| r.policy_loss));
    let whole = saved(&mut whole, folder.path());
    assert_goes_on(&settings, &[1, 2], 7, &reports, &whole, &half);
}

#[test]
fn a_population_keeps_the_promises() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (half, other) = (folder.path().join("half.safetensors"), folder.path().join("other.safetensors"));
    let write_other = |seed: &str| trainer(&["n_behaviours=3", seed]).save(&other).expect("writable");
    write_other("seed=5");
    let files = format!("population.files=[{:?}]", other.display().to_string());
    let population = [
        "n_agents=3",
        "training_crowd.opponents=0.6",
        &files,
        "population.past=2",
        "population.past_every=2",
    ];
    let mut whole = trainer(&population);
    let reports = run(&mut whole, 8);
    let whole = saved(&mut whole, folder.path());
    assert_goes_on(&population, &[1, 2, 8], 5, &reports, &whole, &half);
    assert_ne!(run(&mut trainer(&["n_agents=3"]), 8), reports, "opponents act in their own way");

    let metadata = jostle_policy::PolicyFile::load(&half).expect("a checkpoint").metadata;
    let sha256 = |path: &Path| {
        jostle_policy::hex(&sha2::Digest::finalize(sha2::Digest::chain_update(
            <sha2::Sha256 as sha2::Digest>::new(),
            std::fs::read(path).expect("a file"),
        )))
    };
    let records: Vec<jostle_ppo::OpponentRecord> =
        serde_json::from_str(&metadata["opponents"]).expect("JSON of the opponents");
    assert_eq!((records.len(), records[0].seed, records[0].update), (1, 5, 0));
    assert_eq!(records[0].sha256, sha256(&other));
    write_other("seed=6");
    let Err(error) = Trainer::resume(&half) else { panic!("another opponent is accepted") };
    assert!(error.to_string().contains("metadata opponents: found opponents [{"), "{error}");
}

/// Tests run in the crate's folder, which holds none of the files.
#[test]
fn a_run_and_its_population_go_on_from_wherever_they_are_moved_to_together() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (here, there) = (folder.path().join("here"), folder.path().join("there"));
    for path in ["configs", "pool", "runs/a/checkpoints"] {
        std::fs::create_dir_all(here.join(path)).expect("a folder");
    }
    trainer(&["seed=5"]).save(&here.join("pool/other.safetensors")).expect("writable");
    let population =
        "[training_crowd]\nopponents = 0.6\n[population]\nfiles = [\"../pool/other.safetensors\"]\n";
    let config = format!("{}{population}", common::TINY);
    std::fs::write(here.join("configs/a.toml"), config).expect("writable");
    let load = |root: &Path| {
        let none: &[&str] = &[];
        jostle_ppo::Config::load(&root.join("configs/a.toml"), none).expect("a configuration")
    };
    let mut whole = Trainer::new(load(&here)).expect("a population");
    let reports = run(&mut whole, 6);
    let mut first = Trainer::new(load(&here)).expect("a population");
    run(&mut first, 3);
    first.save(&here.join("runs/a/checkpoints/3.safetensors")).expect("writable");
    std::fs::rename(&here, &there).expect("a move");
    let half = there.join("runs/a/checkpoints/3.safetensors");
    let mut by_file_alone = Trainer::resume(&half).expect("the population is found from the checkpoint");
    assert_eq!(run(&mut by_file_alone, 3), reports[3..]);
    let mut by_both = Trainer::resume_with(&half, load(&there)).expect("the same run");
    assert_eq!(run(&mut by_both, 3), reports[3..]);
}

#[test]
fn a_report_keeps_learners_and_crowd_apart() {
    let mut crowded = trainer(&CROWD);
    let (mut away, mut transitions, mut ended, mut learners_ended) = (0, 0, 0, 0);
    for update in 1..=20 {
        let report = crowded.update().expect("finite numbers");
        let crowd = report.crowd.expect("there is a crowd");
        assert_eq!(report.transitions, update * 2 * 3 * 16, "all of them");
        transitions += crowd.transitions;
        away += crowd.away;
        ended += crowd.episodes.ended;
        learners_ended += report.episodes.ended;
        let line = serde_json::to_string(&report).expect("JSON");
        assert!(line.contains("\"crowd\":{") && line.find("\"crowd\"") < line.find("\"clock\""));
    }
    // Two of three agents, or one of two, are members half of the time, and an episode takes at
    // most 12 steps.
    let there = 20 * 96 - away;
    let share = transitions as f64 / there as f64;
    assert!((share - 0.3).abs() < 0.1, "{share}");
    assert!(ended >= transitions / 12 - 4 && learners_ended >= (there - transitions) / 12 - 6);
    // The third of three agents is away half of the time.
    assert!((160..480).contains(&away), "{away}");
    let report = trainer(&[]).update().expect("finite numbers");
    assert!(report.crowd.is_none() && !serde_json::to_string(&report).expect("JSON").contains("crowd"));
}

#[test]
fn both_back_ends_start_alike() {
    let first = |backend: &str| run(&mut trainer(&[backend]), 1).remove(0);
    let (fast, reference) = (first("backend=fast"), first("backend=reference"));
    let close = |a: f64, b: f64| (a - b).abs() < 1e-4 * (1.0 + b.abs());
    assert!(close(fast.task_reward, reference.task_reward), "{fast:?}\n{reference:?}");
    assert!(close(fast.value_loss, reference.value_loss), "{fast:?}\n{reference:?}");
    assert!(close(fast.discriminator_state.loss, reference.discriminator_state.loss));
    assert!(close(fast.diversity, reference.diversity));
}

#[test]
fn seeds_and_configurations_part_ways() {
    let reports = |overrides: &[&str]| run(&mut trainer(overrides), 2);
    let base = reports(&[]);
    assert_eq!(base, reports(&[]));
    assert_ne!(base, reports(&["seed=2"]));
    assert_ne!(base, reports(&["alpha=0.5"]));
    assert_ne!(base, reports(&["discriminator.noise=off"]));
    assert_ne!(base, reports(&["max_grad_norm=0.001"]));
}

#[test]
fn discriminators_do_not_touch_a_baseline() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let result = |discriminator: &[&str]| {
        let baseline = ["n_behaviours=1", "intrinsic_reward=none", "alpha=0"];
        let mut trainer = trainer(&[&baseline[..], discriminator].concat());
        let reports = run(&mut trainer, 4);
        let parts = saved(&mut trainer, folder.path()).into_iter();
        let policy: Vec<_> =
            parts.filter(|(name, _)| name.contains("actor") || name.contains("critic")).collect();
        (reports, policy)
    };
    let (reports, policy) = result(&[]);
    assert!(policy.len() > 2 * 10, "weights and Adam's moments of both networks: {}", policy.len());
    let (other_reports, other) = result(&[
        "discriminator.noise=absolute",
        "discriminator.noise_scale=0.3",
        "discriminator.noise_on_action=false",
        "discriminator.action_scale=10",
        "discriminator.action=raw",
        "discriminator.learning_rate=1e-3",
        "discriminator.hidden=64",
        "epochs_discriminator=3",
    ]);
    assert_eq!(other_reports, reports);
    assert_same(&other, &policy, "another discriminator");
}

#[test]
fn the_previous_checkpoint_is_kept() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.safetensors");
    let mut trainer = trainer(&[]);
    run(&mut trainer, 1);
    trainer.save(&path).expect("writable");
    let first = std::fs::read(&path).expect("readable");
    assert!(!previous_path(&path).exists());
    run(&mut trainer, 1);
    trainer.save(&path).expect("writable");
    assert_eq!(std::fs::read(previous_path(&path)).expect("kept"), first);
    assert_ne!(std::fs::read(&path).expect("readable"), first);
    assert_eq!(Trainer::resume(&previous_path(&path)).expect("good").updates_done(), 1);
    let names = std::fs::read_dir(folder.path()).expect("readable").count();
    assert_eq!(names, 2, "no partial file stays");
}

#[test]
fn damaged_and_foreign_checkpoints_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.safetensors");
    let mut trainer = trainer(&[]);
    trainer.save(&path).expect("writable");
    let good = std::fs::read(&path).expect("readable");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("writable");
        let error = Trainer::resume(&path).err().expect("refused").to_string();
        assert!(error.starts_with(&path.display().to_string()) && error.lines().count() == 1, "{error}");
    };
    refused(b"");
    refused(&good[..good.len() / 2]);
    refused(&good[..100]);
    let mut flipped = good.clone();
    *flipped.last_mut().expect("not empty") ^= 1;
    refused(&flipped);
    let mut claims_much = good.clone();
    claims_much[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    refused(&claims_much);

    std::fs::write(&path, &good).expect("writable");
    let other = Trainer::resume_with(&path, tiny(&["alpha=0.5"])).err().expect("refused");
    assert!(matches!(other, PpoError::Checkpoint { ref field, .. } if field == "config_hash"), "{other}");
    assert!(Trainer::resume(&folder.path().join("missing")).is_err());
}
