//! The diversity metric D of a policy (paper, section "Intrinsic Rewards" and Table III), with its
//! σ.
//!
//! D is measured on states of one trajectory, the same for every policy compared: that of the
//! policy trained without intrinsic reward, in the training room. It depends on the learned σ (for
//! a shared σ it grows with 1/σ²), so σ is reported beside it.

use jostle_diversity::BehaviourActions;
use jostle_policy::{Backend, Batch, actor};
use jostle_sim::{Rooms, SimConfig, Streams};
use serde::{Deserialize, Serialize};

use crate::error::EvalError;
use jostle_arena::loaded::LoadedPolicy;

/// Steps of the trajectory in the paper.
pub const TRAJECTORY_STEPS: usize = 1000;

/// D of a policy and what it rests on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Diversity {
    /// Mean KL over states and ordered pairs of behaviours, in nats; 0 for one behaviour.
    pub d: f64,
    /// Standard deviation of v and ω, the same in all states and for all behaviours.
    pub sigma: [f64; 2],
    /// Mean KL of each ordered pair, row-major [M, M].
    pub pairwise: Vec<f64>,
    /// Number of states.
    pub n_states: usize,
}

/// The observations of agent 0 over a number of steps in one training room whose `n_agents` all
/// follow the policy's mean with token 0. Episodes follow one another; steps are counted across
/// them.
///
/// # Shapes
///
/// Row-major [steps, row].
///
/// # Errors
///
/// A policy that does not fit the room's observation; a back end that cannot be had.
pub fn trajectory(
    policy: &LoadedPolicy,
    sim: &SimConfig,
    backend: Backend,
    n_agents: usize,
    seed: u64,
    steps: usize,
) -> Result<Vec<f32>, EvalError> {
    let mut rooms = Rooms::new(sim, 1, n_agents, 1, &Streams::new(seed))?;
    let row_len = sim.observation_len();
    let mut network = actor(&policy.file.network, backend, &policy.file.actor)?;
    Batch::new(rooms.observations(), &vec![0; n_agents])
        .check(policy.file.network.observation_len(), policy.file.network.n_behaviours)?;
    let tokens = vec![0; n_agents];
    let mut actions = vec![[0.0; 2]; n_agents];
    let mut states = Vec::with_capacity(steps * row_len);
    for _ in 0..steps {
        states.extend_from_slice(&rooms.observations()[..row_len]);
        network.infer(Batch::new(rooms.observations(), &tokens), actions.as_flattened_mut());
        rooms.step(&actions);
    }
    Ok(states)
}

/// D of a policy on the given states.
///
/// # Shapes
///
/// `states` row-major [S, row].
///
/// # Errors
///
/// States that do not fit the policy; a back end that cannot be had.
pub fn diversity(policy: &LoadedPolicy, backend: Backend, states: &[f32]) -> Result<Diversity, EvalError> {
    let (network_config, parameters) = (&policy.file.network, &policy.file.actor);
    let n_behaviours = network_config.n_behaviours;
    let n_states = states.len() / network_config.observation_len();
    let mut network = actor(network_config, backend, parameters)?;
    let mut mean = vec![0.0; n_states * n_behaviours * 2];
    let mut answers = vec![[0.0_f32; 2]; n_states];
    for z in 0..n_behaviours {
        let tokens = vec![z as u32; n_states];
        let batch = Batch::new(states, &tokens);
        batch.check(network_config.observation_len(), n_behaviours)?;
        network.infer(batch, answers.as_flattened_mut());
        for (state, answer) in answers.iter().enumerate() {
            let at = (state * n_behaviours + z) * 2;
            mean[at] = f64::from(answer[0]);
            mean[at + 1] = f64::from(answer[1]);
        }
    }
    let log_std = parameters.get("log_std").expect("every actor has its log-std");
    let log_std = [f64::from(log_std[0]), f64::from(log_std[1])];
    let log_stds = log_std.repeat(n_states * n_behaviours);
    let actions = BehaviourActions::new(&mean, &log_stds, n_behaviours, 2)?;
    Ok(Diversity {
        d: actions.diversity(),
        sigma: log_std.map(f64::exp),
        pairwise: actions.pairwise(),
        n_states,
    })
}
