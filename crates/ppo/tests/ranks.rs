//! One run on one, two and four ranks: the same bytes. The ranks are threads here.

use crate::common;
use std::path::Path;
use std::sync::Arc;

use crate::common::tiny;
use jostle_ppo::ranks::{Communicator, group};
use jostle_ppo::{PpoError, Trainer, UpdateReport};

const UPDATES: usize = 4;

/// Keys of all runs here.
const SHARDS: [&str; 2] = ["R=4", "shards=4"];

/// The kinds of a run, by what its ranks have to agree on.
const KINDS: [(&str, &[&str]); 7] = [
    ("the baseline", &["M=1"]),
    ("five behaviours", &["M=5"]),
    ("a pooled network", &["M=5", "network.scan_pool=2", "max_grad_norm=0.5"]),
    ("bodies", &["M=2", "sim.laser.beams=64", "network.inputs=motion", "bootstrap_truncation=true"]),
    ("weighed advantages", &["M=3", "alpha_weighs=advantage", "discriminator.noise=absolute"]),
    ("constrained diversity", &["M=2", "diversity_margin=0.5", "sim.episode.step_limit=4", "horizon=64"]),
    // Shards with unequal numbers of rows, and policies of the run's past.
    (
        "a training crowd",
        &[
            "M=2",
            "N=3",
            "training_crowd.opponents=0.5",
            "training_crowd.blind=0.3",
            "population.past=2",
            "population.past_every=1",
        ],
    ),
];

fn settings<'a>(kind: &[&'a str]) -> Vec<&'a str> {
    [&SHARDS[..], kind, &["threads=1"]].concat()
}

/// What `work` makes of each of `size` ranks.
fn on_ranks<T: Send>(size: usize, work: impl Fn(Arc<dyn Communicator>) -> T + Sync) -> Vec<T> {
    std::thread::scope(|scope| {
        let work = &work;
        let started: Vec<_> =
            group(size).into_iter().map(|member| scope.spawn(move || work(Arc::new(member)))).collect();
        started.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    })
}

/// Makes updates on so many ranks, from nothing or from a checkpoint, and saves the run; every rank
/// must report the same.
#[track_caller]
fn made(settings: &[&str], size: usize, from: Option<&Path>, updates: usize, to: &Path) -> Vec<UpdateReport> {
    let mut reports = on_ranks(size, |ranks| {
        let config = tiny(settings);
        let mut trainer = match from {
            Some(from) => Trainer::resume_among(from, config, ranks),
            None => Trainer::among(config, ranks),
        }
        .expect("valid");
        let reports: Vec<_> =
            (0..updates).map(|_| trainer.update().expect("finite numbers").without_clock()).collect();
        trainer.save(to).expect("writable");
        reports
    });
    assert!(reports.iter().all(|found| *found == reports[0]), "{settings:?}: ranks report different things");
    reports.swap_remove(0)
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("a checkpoint")
}

#[test]
fn the_number_of_ranks_changes_no_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (alone, ranks) = (folder.path().join("alone"), folder.path().join("ranks"));
    for (name, kind) in KINDS {
        let settings = settings(kind);
        // The plain run of one process, with two threads at that.
        let mut trainer = Trainer::new(tiny(&[&settings[..], &["threads=2"]].concat())).expect("valid");
        let expected: Vec<_> =
            (0..UPDATES).map(|_| trainer.update().expect("finite numbers").without_clock()).collect();
        trainer.save(&alone).expect("writable");
        for size in [1, 2, 4] {
            let found = made(&settings, size, None, UPDATES, &ranks);
            assert_eq!(found, expected, "{name} on {size} ranks");
            assert!(bytes(&ranks) == bytes(&alone), "{name} on {size} ranks: other bytes");
        }
    }
}

#[test]
fn a_run_goes_on_with_another_number_of_ranks() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [whole, half, rest] = ["whole", "half", "rest"].map(|name| folder.path().join(name));
    for (name, kind) in [KINDS[1], KINDS[6]] {
        let settings = settings(kind);
        let expected = made(&settings, 1, None, UPDATES, &whole);
        for (before, after) in [(4, 2), (2, 1), (1, 4)] {
            let first = made(&settings, before, None, UPDATES / 2, &half);
            let second = made(&settings, after, Some(&half), UPDATES - UPDATES / 2, &rest);
            assert_eq!([first, second].concat(), expected, "{name}: {before} ranks, then {after}");
            assert!(bytes(&rest) == bytes(&whole), "{name}: {before} ranks, then {after}: other bytes");
        }
    }
}

#[test]
fn a_run_in_shards_learns_as_well() {
    // As `a_policy_learns_to_reach_its_goal` of `learning.rs`.
    let overrides = ["N=1", "M=1", "R=16", "horizon=32", "minibatch=128", "sim.episode.step_limit=64"];
    let mut trainer = common::trainer(&[&overrides[..], &["shards=4"]].concat());
    let reports: Vec<_> = (0..60).map(|_| trainer.update().expect("finite numbers")).collect();
    let reward = |reports: &[UpdateReport]| {
        reports.iter().map(|report| report.task_reward).sum::<f64>() / reports.len() as f64
    };
    let (before, after) = (reward(&reports[..10]), reward(&reports[50..]));
    assert!(after > before + 0.1, "task reward {before} → {after}");
    assert!(reports.iter().all(|report| report.first_ratio_deviation == 0.0), "π is π_old at first");
}

#[test]
fn shards_that_do_not_fit_are_refused() {
    for (settings, expected) in [
        (&["R=4", "shards=3"][..], "shards: found 3, expected a power of two"),
        (&["R=4", "shards=8"], "of which n_rooms = 4 is a multiple"),
        (&["R=4", "shards=0"], "shards: found 0"),
        (&["R=4", "shards=4", "minibatch=2"], "minibatch: found 2, expected at least 4 (shards)"),
    ] {
        let error = jostle_ppo::Config::parse(common::TINY, "tiny", settings).unwrap_err().to_string();
        assert!(error.contains(expected), "{settings:?}: {error}");
    }
    let refusals = on_ranks(4, |ranks| match Trainer::among(tiny(&["R=2", "shards=2"]), ranks) {
        Ok(_) => panic!("a rank without rooms"),
        Err(error @ PpoError::Ranks { .. }) => error.to_string(),
        Err(error) => panic!("{error}"),
    });
    assert_eq!(refusals[3], "found 4 ranks, expected a power of two of at most 2 (shards)");
}

#[test]
fn shards_are_part_of_the_curve_and_ranks_are_not() {
    assert_ne!(tiny(&["R=4", "shards=2"]).hash(), tiny(&["R=4"]).hash());
    assert_eq!(tiny(&["R=4", "shards=1"]).hash(), tiny(&["R=4"]).hash());
    assert!(!tiny(&[]).canonical_toml().contains("shards"));
}

#[test]
fn a_number_that_is_not_finite_ends_every_rank_with_the_same_error() {
    let errors = on_ranks(2, |ranks| {
        let mut trainer =
            Trainer::among(tiny(&["R=4", "shards=4", "learning_rate=1e38"]), ranks).expect("valid");
        (0..3).find_map(|_| trainer.update().err()).expect("parameters overflow").to_string()
    });
    assert!(errors[0].contains("is not finite"), "{errors:?}");
    assert_eq!(errors[0], errors[1]);
}
