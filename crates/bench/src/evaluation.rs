//! A cell of the paper's tables: hundreds of episodes in lock step.
//!
//! All networks have fresh parameters and are paid for, but the robot seeks its goal whatever its
//! network answers, so that episodes have the lengths of a trained policy's.

use std::collections::BTreeMap;

use jostle_arena::{ArenaConfig, LoadedPolicy, PolicyIdentity, Pools, RobotPolicy, TrainedRobot};
use jostle_eval::{Protocol, Subject};
use jostle_peds::CrowdKind;
use jostle_policy::{NetworkConfig, Parameters, PolicyFile, Provenance};
use jostle_sim::{OBSERVATION_LEN, Streams};

use crate::error::BenchError;

/// Place of the goal's x in an observation row; y follows.
const GOAL: usize = OBSERVATION_LEN - 4;

/// Asks a network, and then goes straight for the goal.
struct Seeker(TrainedRobot);

impl RobotPolicy for Seeker {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        self.0.act(observations, actions);
        for (row, action) in observations.chunks_exact(OBSERVATION_LEN).zip(actions) {
            let turn = row[GOAL + 1].atan2(row[GOAL]);
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

/// A protocol with four pedestrians' policies and a robot's.
pub struct Cells {
    protocol: Protocol,
    robot: LoadedPolicy,
}

impl Cells {
    /// The default protocol: N = 5.
    ///
    /// # Errors
    ///
    /// When the evaluation refuses its settings.
    pub fn new() -> Result<Self, BenchError> {
        let pool: Vec<LoadedPolicy> = (1..=4).map(untrained).collect();
        let pools = Pools { full: pool.clone(), half: pool };
        Ok(Self { protocol: Protocol::new(ArenaConfig::default(), pools)?, robot: untrained(0) })
    }

    /// Runs a cell and returns the number of steps of all its episodes.
    ///
    /// # Errors
    ///
    /// When the crowd cannot be made.
    pub fn run(&self, crowd: CrowdKind, episodes: u64) -> Result<u64, BenchError> {
        let mut robot = Seeker(TrainedRobot::new(&self.robot, 0, self.protocol.config().backend)?);
        let identity = PolicyIdentity::custom("seeker", "1");
        let subject = Subject { identity: &identity, token: 0 };
        let run = self.protocol.evaluate(&mut robot, subject, crowd, episodes, None, |_| ())?;
        Ok(run.records.iter().map(|record| record.steps).sum())
    }
}
