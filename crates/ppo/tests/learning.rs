//! The effects of an update: ratios, rewards, discriminators, and a policy that improves.

use crate::common::trainer;
use jostle_ppo::{BehaviourReport, Trainer, UpdateReport};

fn mean(reports: &[UpdateReport], of: impl Fn(&UpdateReport) -> f64) -> f64 {
    reports.iter().map(of).sum::<f64>() / reports.len() as f64
}

fn run(trainer: &mut Trainer, updates: usize) -> Vec<UpdateReport> {
    (0..updates).map(|_| trainer.update().expect("finite numbers")).collect()
}

#[test]
fn the_first_minibatch_has_ratio_one() {
    // Fast kernels sum a row in one order whatever the batch; candle's products may not.
    let exact = run(&mut trainer(&["backend=fast"]), 3);
    assert!(exact.iter().all(|r| r.first_ratio_deviation == 0.0), "{:?}", exact[0].first_ratio_deviation);
    let close = run(&mut trainer(&["backend=reference"]), 3);
    assert!(close.iter().all(|r| r.first_ratio_deviation < 1e-5));
}

#[test]
fn a_policy_learns_to_reach_its_goal() {
    // One robot in each of 16 small rooms. With the sign of the surrogate turned round, the second
    // half is worse.
    let overrides = ["N=1", "M=1", "R=16", "horizon=32", "minibatch=128", "sim.episode.step_limit=64"];
    let mut trainer = trainer(&overrides);
    let reports = run(&mut trainer, 60);
    let (first, last) = (&reports[..10], &reports[50..]);
    let reward = |r: &UpdateReport| r.task_reward;
    let success = |r: &UpdateReport| r.episodes.success as f64 / r.episodes.ended.max(1) as f64;
    let (before, after) = (mean(first, reward), mean(last, reward));
    assert!(after > before + 0.1, "task reward {before} → {after}");
    assert!(
        mean(last, success) > mean(first, success) + 0.15,
        "{} → {}",
        mean(first, success),
        mean(last, success)
    );
    assert!(mean(last, |r| r.explained_variance) > 0.2, "the critic learns, too");
}

#[test]
fn discriminators_learn_what_tells_tokens_apart() {
    // The tokens' policies differ from the start (embeddings are N(0, 1)); a small σ makes that
    // visible in actions.
    let overrides =
        ["R=8", "network.log_std_init=-4", "discriminator.noise=off", "discriminator.action_scale=10"];
    let mut trainer =
        trainer(&[&overrides[..], &["learning_rate=1e-6", "discriminator.learning_rate=3e-3"]].concat());
    let reports = run(&mut trainer, 60);
    let (first, last) = (&reports[..5], &reports[55..]);
    let loss = |r: &UpdateReport| r.discriminator_state_action.loss;
    assert!(mean(last, loss) < mean(first, loss) - 0.1, "{} → {}", mean(first, loss), mean(last, loss));
    assert!(mean(last, |r| r.discriminator_state_action.accuracy) > 0.6);
    assert!(mean(last, |r| r.intrinsic_reward) > 0.05);
}

#[test]
fn one_behaviour_leaves_the_discriminators_untouched() {
    let report = run(&mut trainer(&["M=1"]), 2).remove(1);
    assert_eq!(report.discriminator_state_action.loss, 0.0);
    assert_eq!(report.discriminator_state.accuracy, 1.0);
    assert_eq!((report.intrinsic_reward, report.diversity), (0.0, 0.0));
}

#[test]
fn without_weight_the_intrinsic_reward_has_no_say() {
    let first_curve = run(&mut trainer(&["alpha=0"]), 3);
    let second_curve = run(&mut trainer(&["intrinsic_reward=none", "alpha=7"]), 3);
    for (a, b) in first_curve.iter().zip(&second_curve) {
        assert_eq!((a.value_loss, a.policy_loss, a.log_std), (b.value_loss, b.policy_loss, b.log_std));
    }
}

#[test]
fn a_report_counts_and_survives_json() {
    let reports = run(&mut trainer(&[]), 4);
    for (i, report) in reports.iter().enumerate() {
        assert_eq!((report.update, report.transitions), (i as u64 + 1, (i as u64 + 1) * 64));
        let e = report.episodes;
        assert_eq!(e.ended, e.success + e.collision_wall + e.collision_agent + e.timeout);
        assert!(report.episode_length.is_none_or(|length| (1.0..=12.0).contains(&length)));
        assert!(report.clock.total >= report.clock.learning && report.clock.learning > 0.0);
        let text = serde_json::to_string(report).expect("plain numbers");
        assert_eq!(&serde_json::from_str::<UpdateReport>(&text).expect("the same fields"), report);
    }
    assert!(reports.iter().any(|r| r.episodes.timeout > 0), "12 steps are too few for most");
}

#[test]
fn the_bootstrap_switch_changes_value_targets_alone_where_episodes_are_cut() {
    let run_with = |switch: &str| run(&mut trainer(&[switch]), 1).remove(0);
    let (without, with) = (run_with("bootstrap_truncation=false"), run_with("bootstrap_truncation=true"));
    assert_eq!(without.task_reward, with.task_reward);
    assert!(without.episodes.timeout > 0);
    assert_ne!(without.value_loss, with.value_loss);
}

#[test]
fn numbers_that_are_not_finite_stop_the_run_with_their_name() {
    for (overrides, tensor) in [
        (["learning_rate=1e38", "minibatch=64"], "policy loss"),
        (["discriminator.learning_rate=1e38", "minibatch=64"], "discriminator.state"),
    ] {
        let error = trainer(&overrides).update().expect_err("parameters overflow").to_string();
        assert!(error.starts_with("update 1: ") && error.contains(tensor), "{error}");
        assert!(error.ends_with("is not finite"), "{error}");
    }
    let one_step = ["learning_rate=1e38", "minibatch=64", "epochs_policy=1", "epochs_value=1"];
    let error = trainer(&one_step).update().expect_err("parameters overflow").to_string();
    assert!(error.starts_with("update 1: actor."), "{error}");
}

#[test]
fn behaviours_are_the_next_update_token_by_token() {
    for variant in ["intrinsic_reward=difference", "intrinsic_reward=state"] {
        let overrides = ["M=3", "R=4", variant, "network.log_std_init=-3"];
        let after_ten = || {
            let mut trainer = trainer(&overrides);
            run(&mut trainer, 10);
            trainer
        };
        let expected = after_ten().update().expect("finite numbers");
        let found = after_ten().behaviours(1).expect("finite numbers");
        assert_eq!(found.len(), 3);
        let n: u64 = found.iter().map(|report| report.transitions).sum();
        assert_eq!(n, 16 * 2 * 4);
        let mean = |of: fn(&BehaviourReport) -> f64| {
            found.iter().map(|report| report.transitions as f64 * of(report)).sum::<f64>() / n as f64
        };
        let close =
            |found: f64, expected: f64| assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        close(mean(|report| report.task_reward), expected.task_reward);
        close(mean(|report| report.intrinsic_reward), expected.intrinsic_reward);
        close(mean(|report| -report.log_q_state_action), expected.discriminator_state_action.loss);
        close(mean(|report| -report.log_q_state), expected.discriminator_state.loss);
        let count = |of: fn(&BehaviourReport) -> u64| found.iter().map(of).sum::<u64>();
        assert!(expected.episodes.ended > 0);
        assert_eq!(count(|report| report.episodes.ended), expected.episodes.ended);
        assert_eq!(count(|report| report.episodes.success), expected.episodes.success);
        assert_eq!(count(|report| report.episodes.timeout), expected.episodes.timeout);
        assert!(found.iter().all(|report| (0.0..=1.0).contains(&report.speed)));
    }
}
