//! A population: frozen policies that drive a share of the agents, read from files or kept from the
//! run's own past.
//!
//! `training_crowd.opponents` is the share of opponents; the rooms draw who is one in an episode,
//! and which. An opponent sees everyone and acts on the mean of its policy, as pedestrians of a
//! test do, at the crowd's speed.
//!
//! The run's own past is a ring of snapshots. Until one is taken its place holds the policy that
//! the run began with. A snapshot replaces the oldest; whoever is driven by that one goes on with
//! the new one.

use std::path::Path;

use jostle_policy::{Batch, Network, Parameters, PolicyFile, actor, excerpt, hex};
use jostle_sim::{Role, Rooms, SimConfig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::config::{Config, PopulationConfig};
use crate::learner::Learner;
use crate::{PpoError, config};

/// A policy that was read from a file, as checkpoints name it: enough to tell later whom a run was
/// trained against.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpponentRecord {
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Hash of the configuration that it was trained with.
    pub config_hash: String,
    /// Its training seed.
    pub seed: u64,
    /// Updates it had done.
    pub update: u64,
}

/// The opponents of a run: those of the files, then the ring of the past.
pub(crate) struct Population {
    opponents: Vec<Opponent>,
    records: Vec<OpponentRecord>,
    past_every: u64,
}

/// A frozen policy, with the rows that it decides for in one step.
struct Opponent {
    network: Box<dyn Network>,
    n_behaviours: u32,
    agents: Vec<usize>,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    means: Vec<[f32; 2]>,
}

impl Opponent {
    fn new(network: Box<dyn Network>, n_behaviours: usize) -> Self {
        Self {
            network,
            n_behaviours: n_behaviours as u32,
            agents: Vec::new(),
            observations: Vec::new(),
            tokens: Vec::new(),
            means: Vec::new(),
        }
    }

    fn clear(&mut self) {
        self.agents.clear();
        self.observations.clear();
        self.tokens.clear();
    }

    /// Takes over an agent. The run's token is one of the opponent's, too, whatever their numbers.
    fn push(&mut self, agent: usize, observation: &[f32], token: u32) {
        self.agents.push(agent);
        self.observations.extend_from_slice(observation);
        self.tokens.push(token % self.n_behaviours);
    }

    fn infer(&mut self) {
        self.means.clear();
        self.means.resize(self.agents.len(), [0.0; 2]);
        if !self.agents.is_empty() {
            let batch = Batch::new(&self.observations, &self.tokens);
            self.network.infer(batch, self.means.as_flattened_mut());
        }
    }
}

impl Population {
    /// The population of a run that begins with the policy `theta`; `None` where nobody is an
    /// opponent.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or is no policy for the run's laser.
    pub(crate) fn new(config: &Config, theta: &Parameters) -> Result<Option<Self>, PpoError> {
        if config.training_crowd.opponents <= 0.0 {
            return Ok(None);
        }
        let PopulationConfig { past, past_every, .. } = &config.population;
        let (mut opponents, mut records) = (Vec::new(), Vec::new());
        for (i, path) in config.population.located().iter().enumerate() {
            let (file, record) = read(config, i, path)?;
            let network = actor(&file.network, config.engine(), &file.actor)?;
            opponents.push(Opponent::new(network, file.network.n_behaviours));
            records.push(record);
        }
        let own = config.network_config();
        for _ in 0..*past {
            opponents.push(Opponent::new(actor(&own, config.engine(), theta)?, own.n_behaviours));
        }
        Ok(Some(Self { opponents, records, past_every: *past_every }))
    }

    /// Overwrites the actions of all agents that an opponent drives in this step with the means of
    /// its policy.
    pub(crate) fn act(&mut self, rooms: &Rooms, actions: &mut [[f32; 2]]) {
        self.opponents.iter_mut().for_each(Opponent::clear);
        let (width, n) = (rooms.config().observation_len(), self.opponents.len() as u64);
        for agent in (0..rooms.len()).filter(|agent| rooms.role(*agent) == Role::Opponent) {
            // The upper half of the product: each policy gets the same share of the 2³² numbers, to
            // within one.
            let which = (u64::from(rooms.opponent(agent)) * n) >> 32;
            let observation = &rooms.observations()[agent * width..(agent + 1) * width];
            self.opponents[which as usize].push(agent, observation, rooms.tokens()[agent]);
        }
        self.opponents.par_iter_mut().for_each(Opponent::infer);
        for opponent in &self.opponents {
            for (&agent, &mean) in opponent.agents.iter().zip(&opponent.means) {
                actions[agent] = mean;
            }
        }
    }

    /// After an update: takes a snapshot of the actor where one is due.
    pub(crate) fn after(&mut self, update: u64, actor: &mut Learner) {
        let n_past = self.past_mut().len() as u64;
        if n_past == 0 || !update.is_multiple_of(self.past_every) {
            return;
        }
        let which = (update / self.past_every - 1) % n_past;
        let parameters = actor.parameters();
        self.past_mut()[which as usize].take(&parameters);
    }

    /// The files' policies, in their order.
    pub(crate) fn records(&self) -> &[OpponentRecord] {
        &self.records
    }

    /// The parameters of each snapshot in canonical order, with the tensor that a checkpoint keeps
    /// them in.
    pub(crate) fn snapshots(&mut self) -> Vec<(String, Vec<f32>)> {
        let named = |(k, opponent): (usize, &mut Opponent)| {
            let native = opponent.network.parameters_and_gradient().0.to_vec();
            (snapshot_name(k), opponent.network.to_canonical(&native))
        };
        self.past_mut().iter_mut().enumerate().map(named).collect()
    }

    /// Takes the snapshots of a checkpoint, read by `get` from the tensor of a name and a length.
    pub(crate) fn restore(
        &mut self,
        get: impl Fn(&str, usize) -> Result<Vec<f32>, PpoError>,
    ) -> Result<(), PpoError> {
        for (k, opponent) in self.past_mut().iter_mut().enumerate() {
            let len = opponent.network.layout().len();
            opponent.take(&get(&snapshot_name(k), len)?);
        }
        Ok(())
    }

    fn past_mut(&mut self) -> &mut [Opponent] {
        &mut self.opponents[self.records.len()..]
    }
}

impl Opponent {
    /// Becomes the policy of these parameters, in canonical order.
    fn take(&mut self, parameters: &[f32]) {
        let native = self.network.to_native(parameters);
        self.network.parameters_and_gradient().0.copy_from_slice(&native);
        self.network.parameters_changed();
    }
}

fn snapshot_name(k: usize) -> String {
    format!("population.past.{k}")
}

/// Reads file `i` of the population.
fn read(config: &Config, i: usize, path: &Path) -> Result<(PolicyFile, OpponentRecord), PpoError> {
    let file = PolicyFile::load(path)?;
    let io = |reason| PpoError::Io { path: path.to_path_buf(), action: "read", reason };
    let sha256 = hex(&Sha256::digest(std::fs::read(path).map_err(io)?));
    let (found, expected) = (file.network.observation_len(), config.sim.observation_len());
    if found != expected {
        let found = format!("{} with observations of {found} numbers", path.display());
        let expected = format!("{expected}, as the simulator's laser gives");
        return Err(config::refuse(format!("population.files[{i}]"), found, expected));
    }
    if let Some(text) = file.metadata.get("sim") {
        let refuse = |found: String, expected: String| {
            let found = format!("{} {found}", path.display());
            config::refuse(format!("population.files[{i}]"), found, expected)
        };
        let trained: SimConfig = serde_json::from_str(text).map_err(|error| {
            let error = excerpt(&error.to_string());
            refuse(
                format!("with unreadable settings ({error})"),
                "JSON of the simulator's settings".to_owned(),
            )
        })?;
        if !trained.laser.points_as(&config.sim.laser) {
            let found = format!("trained with a laser that sees {}", trained.laser.view());
            return Err(refuse(found, format!("one that sees {}", config.sim.laser.view())));
        }
    }
    let config_hash = file.provenance.config_hash.clone();
    let record =
        OpponentRecord { sha256, config_hash, seed: file.provenance.seed, update: file.provenance.update };
    Ok((file, record))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clock, Trainer};

    /// Two rooms of three agents with 16 beams; all but the first of a room are opponents.
    const TINY: &str = r"
N = 3
M = 2
R = 2
horizon = 4
minibatch = 16
learning_rate = 1e-2
network = { laser_feature = 32, hidden = 32, embedding = 4 }
discriminator = { hidden = 32 }
training_crowd = { opponents = 1.0 }
[sim]
room = { width = 6.0, height = 6.0 }
laser = { beams = 16 }
spawn = { goal_distance = 2.0 }
";

    fn trainer(overrides: &[&str]) -> Trainer {
        Trainer::new(Config::parse(TINY, "tiny", overrides).expect("valid")).expect("rooms")
    }

    #[test]
    fn opponents_act_on_the_means_of_their_own_policies() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        // One behaviour and two: an opponent's number of them is its own affair.
        let saved: Vec<String> = ["M=1", "M=2"]
            .iter()
            .enumerate()
            .map(|(i, behaviours)| {
                let path = folder.path().join(format!("{i}.safetensors"));
                let mut other = trainer(&[behaviours, "seed=9", "training_crowd.opponents=0"]);
                other.save(&path).expect("writable");
                path.display().to_string()
            })
            .collect();
        let files = format!("population.files=[{:?}, {:?}]", saved[0], saved[1]);
        let mut run = trainer(&[&files]);
        let mut seen = [0; 2];
        for step in 0..40 {
            let (rooms, tokens) = (&run.shards[0].rooms, run.shards[0].rooms.tokens().to_vec());
            let width = rooms.config().observation_len();
            let mut expected = vec![None; rooms.len()];
            for agent in (0..rooms.len()).filter(|agent| agent % 3 > 0) {
                assert_eq!(rooms.role(agent), Role::Opponent);
                let which = usize::from(rooms.opponent(agent) >= 1 << 31);
                seen[which] += 1;
                let file = PolicyFile::load(&saved[which]).expect("a policy");
                let token = [if which == 0 { 0 } else { tokens[agent] }];
                let row = &rooms.observations()[agent * width..(agent + 1) * width];
                let mut network = actor(&file.network, run.config.engine(), &file.actor).expect("an actor");
                let mut mean = [0.0; 2];
                network.infer(Batch::new(row, &token), &mut mean);
                expected[agent] = Some(mean);
            }
            run.shards[0].rollout.clear();
            run.act(step, &mut Clock::default()).expect("finite numbers");
            for (agent, action) in run.shards[0].rollout.actions.iter().enumerate() {
                let near = |mean: [f32; 2]| mean.iter().zip(action).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(expected[agent].is_none_or(near), "agent {agent}: {action:?}, {:?}", expected[agent]);
            }
            run.shards[0].rollout.keep_learners();
            assert_eq!(run.shards[0].rollout.observations().len(), 2 * width, "the learners' rows alone");
        }
        assert!(seen.iter().all(|n| *n > 20), "{seen:?}");
    }

    #[test]
    fn the_past_is_a_ring_of_snapshots() {
        let mut run = trainer(&["population.past=2", "population.past_every=2"]);
        let mut expected = vec![run.actor_parameters(); 2];
        for update in 1..=7 {
            run.update().expect("finite numbers");
            if update % 2 == 0 {
                expected[(update / 2 - 1) % 2] = run.actor_parameters();
            }
            let found = run.population.as_mut().expect("a population").snapshots();
            let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, ["population.past.0", "population.past.1"]);
            assert!(found.iter().map(|(_, values)| values).eq(&expected), "after update {update}");
        }
        assert_ne!(expected[0], expected[1]);
    }

    #[test]
    fn what_is_no_population_is_refused() {
        let none: &[&str] = &[];
        let message = Config::parse(TINY, "tiny", none).unwrap_err().to_string();
        let expected = "tiny: population.files: found no file, expected at least one, or population.past of at least 1, \
            for training_crowd.opponents";
        assert_eq!(message, expected);

        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("other.safetensors");
        trainer(&["training_crowd.opponents=0", "sim.laser.beams=20"]).save(&path).expect("writable");
        let config = |path: &Path| {
            Config::parse(TINY, "tiny", &[format!("population.files=[{:?}]", path.display().to_string())])
        };
        let refusal = |path: &Path| match Trainer::new(config(path).expect("valid")) {
            Ok(_) => panic!("{} is accepted", path.display()),
            Err(error) => error.to_string(),
        };
        let found = format!("found {} with observations of 64 numbers, expected 52", path.display());
        assert!(refusal(&path).contains(&found), "{}", refusal(&path));
        trainer(&["training_crowd.opponents=0", "sim.laser.fov=3.0"]).save(&path).expect("writable");
        let found =
            "trained with a laser that sees 3 rad from 0 rad, expected one that sees all round from 0 rad";
        assert!(refusal(&path).contains(found), "{}", refusal(&path));
        let missing = folder.path().join("missing.safetensors");
        assert!(refusal(&missing).contains("missing.safetensors"));
    }
}
