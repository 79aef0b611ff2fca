//! How long a cell takes: `cargo run --release -p jostle-eval --example cell_timing -- [CROWD [EPISODES [LOCK_STEP]]]`.
//!
//! All networks have fresh parameters and are paid for, but robot and pedestrians are steered by other means, so that
//! episodes have the lengths of trained policies: the robot seeks its goal, whatever its network answers.

use std::collections::BTreeMap;
use std::time::Instant;

use jostle_eval::{
    EvalConfig, LoadedPolicy, PolicyIdentity, Pools, Protocol, RobotPolicy, Subject, TrainedRobot,
};
use jostle_peds::CrowdKind;
use jostle_policy::{NetworkConfig, Parameters, PolicyFile, Provenance};
use jostle_sim::Streams;

/// Asks a network, and then goes straight for the goal.
struct Seeker(TrainedRobot);

impl RobotPolicy for Seeker {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        self.0.act(observations, actions);
        for (row, action) in observations.chunks_exact(1540).zip(actions) {
            let turn = row[1537].atan2(row[1536]);
            *action = [turn.cos().max(0.0), (2.0 * turn).clamp(-1.0, 1.0)];
        }
    }
}

fn untrained(seed: u64) -> LoadedPolicy {
    let network = NetworkConfig::default();
    let actor = Parameters::actor(&network, &mut Streams::new(seed).stream("parameters", &[]));
    let (config_hash, commit) = (String::new(), String::new());
    let provenance =
        Provenance { config_hash, seed, commit, update: 0, transitions: 0, n_agents: 5, n_rooms: 1 };
    let file = PolicyFile { actor, network, provenance, metadata: BTreeMap::new() };
    LoadedPolicy::from_file(file, "untrained", format!("{seed:064x}"))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let crowd: CrowdKind = arguments.next().map_or(Ok(CrowdKind::Nh), |name| name.parse())?;
    let episodes: u64 = arguments.next().map_or(Ok(1000), |count| count.parse())?;
    let mut config = EvalConfig::default();
    if let Some(lock_step) = arguments.next() {
        config.lock_step = lock_step.parse()?;
    }
    let pool: Vec<LoadedPolicy> = (1..=4).map(untrained).collect();
    let backend = config.backend;
    let protocol = Protocol::new(config, Pools { full: pool.clone(), half: pool })?;
    let mut robot = Seeker(TrainedRobot::new(&untrained(0), 0, backend)?);
    let identity = PolicyIdentity::custom("timing", "1");
    let start = Instant::now();
    let subject = Subject { identity: &identity, token: 0 };
    let run = protocol.evaluate(&mut robot, subject, crowd, episodes, None, |_| ())?;
    let seconds = start.elapsed().as_secs_f64();
    let steps: u64 = run.records.iter().map(|record| record.steps).sum();
    println!(
        "{crowd}: {episodes} episodes, {steps} steps, {seconds:.2} s, {:.0} steps/s",
        steps as f64 / seconds
    );
    Ok(())
}
