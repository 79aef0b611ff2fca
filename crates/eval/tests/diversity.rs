//! The metric D.

use crate::common::untrained;
use jostle_arena::ArenaConfig;
use jostle_eval::EvalError;
use jostle_eval::diversity::{diversity, trajectory};
use jostle_sim::SimConfig;

#[test]
fn d_is_the_mean_pairwise_divergence_on_a_trajectory() {
    let (sim, backend) = (SimConfig::default(), ArenaConfig::default().backend);
    let states = trajectory(&untrained(1), &sim, backend, 3, 7, 50).unwrap();
    assert_eq!(states.len(), 50 * 1540);
    assert_eq!(states, trajectory(&untrained(1), &sim, backend, 3, 7, 50).unwrap());
    assert_ne!(states, trajectory(&untrained(1), &sim, backend, 3, 8, 50).unwrap());

    let mut policy = untrained(2);
    let two = diversity(&policy, backend, &states).unwrap();
    assert_eq!((two.n_states, two.sigma, two.pairwise.len()), (50, [1.0, 1.0], 4));
    // With one σ for all, KL is symmetric and grows with 1/σ².
    assert!(two.d > 0.0 && (two.d - two.pairwise[1]).abs() < 1e-12 && two.pairwise[0] == 0.0);
    let log_std = policy.file.actor.layout().range("log_std").unwrap();
    policy.file.actor.flat_mut()[log_std].fill(-1.0);
    let narrow = diversity(&policy, backend, &states).unwrap();
    assert!((narrow.d / two.d - 1.0_f64.exp().powi(2)).abs() < 1e-6);
    // Two tokens that share an embedding are one behaviour.
    let embedding = policy.file.actor.layout().range("embedding.weight").unwrap();
    policy.file.actor.flat_mut()[embedding].fill(0.5);
    assert_eq!(diversity(&policy, backend, &states).unwrap().d, 0.0);
    assert!(matches!(
        diversity(&policy, backend, &states[..7]),
        Err(EvalError::Diversity(_) | EvalError::Policy(_))
    ));
}
