//! The configuration of a training run: every key with its unit, range and origin.
//!
//! The defaults are those of the paper's Table of hyper-parameters ("paper" below) or, where it is
//! silent, of the code that it builds on, Acmece/rl-collision-avoidance ("lineage"). Reading order:
//! this file; `config/load.rs` (TOML, overrides, error locations); `config/check.rs` (ranges).

use jostle_diversity::{DiscriminatorConfig, IntrinsicReward};
use jostle_policy::encoder::motion::MotionInputs;
use jostle_policy::{Backend, Device, Engine, NetworkConfig};
use jostle_sim::{SimConfig, TrainingCrowd};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;

mod check;
mod load;
mod population;

pub(crate) use check::refuse;
pub use population::PopulationConfig;

/// Keys that do not change the learning curve: they are part of neither the hash nor a checkpoint.
const KEYS_WITHOUT_EFFECT: [&str; 3] = ["updates", "checkpoint_every", "threads"];

/// A training run. [`Config::load`] gives a validated one.
///
/// # Examples
///
/// ```
/// use jostle_ppo::Config;
/// let config = Config::parse("N = 10\nalpha = 0.05", "example.toml", &["sim.laser.noise_std=0"])?;
/// assert_eq!((config.n_agents, config.alpha, config.sim.laser.noise_std), (10, 0.05, 0.0));
/// let error = Config::parse("n_agent = 10", "example.toml", &[] as &[&str]).unwrap_err();
/// assert!(error.to_string().starts_with("example.toml:1:1: n_agent: found an unknown key, expected n_agents"));
/// # Ok::<(), jostle_ppo::PpoError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Root seed of every random stream; 0 to 2⁶³ − 1. Default 1.
    pub seed: u64,
    /// Updates of the whole run; ≥ 1. Default 5000 (paper). Does not change the curve, only its
    /// length.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = i64::MAX, "origin" = "paper")))]
    pub updates: u64,
    /// Updates between checkpoints; 0 writes one at the end alone. Default 100. Does not change the
    /// curve.
    pub checkpoint_every: u64,
    /// Worker threads; 0 takes one for each core. Default 0. Does not change a bit of the curve.
    #[cfg_attr(feature = "schema", schemars(extend("maximum" = 1024)))]
    pub threads: usize,
    /// Back end of the networks: `fast` (own kernels on the CPU) or `reference` (candle). Default
    /// `fast`.
    pub backend: Backend,
    /// Where the back end `reference` computes: `cpu`, `cuda:N` or `metal:N`, the latter two in
    /// builds with the feature of that name. The simulator stays on the CPU. Default `cpu`.
    #[cfg_attr(feature = "schema", schemars(extend("default" = "cpu")))]
    #[serde(skip_serializing_if = "is_default")]
    pub device: Device,
    /// Agents in a room, the paper's N (alias `N`); 1 to 1000. Default 5 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 1000, "origin" = "paper")))]
    #[serde(alias = "N")]
    pub n_agents: usize,
    /// Behaviours, the paper's M (alias `M`); 1 to 1000; 1 is the baseline without diversity.
    /// Default 5 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 1000, "origin" = "paper")))]
    #[serde(alias = "M")]
    pub n_behaviours: usize,
    /// Rooms that are simulated side by side (alias `R`); ≥ 1. Default 1: the paper trains in one.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536)))]
    #[serde(alias = "R")]
    pub n_rooms: usize,
    /// Parts that the rooms are dealt to, each with sums and random numbers of its own, so that up
    /// to as many processes can make the run together (`mpirun`); a power of two of which `n_rooms`
    /// is a multiple. How many processes there are changes no bit of the curve, this number does.
    /// Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 4096, "default" = 1)))]
    #[serde(skip_serializing_if = "is_one")]
    pub shards: usize,
    /// Steps that each agent collects for an update; ≥ 1. Default 128 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536, "origin" = "lineage")))]
    pub horizon: usize,
    /// Transitions in a minibatch; 1 to `horizon · n_agents · n_rooms`; an epoch's last may be
    /// shorter. Default 256.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1)))]
    pub minibatch: usize,
    /// Epochs over a rollout for the policy; ≥ 1. Default 3 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 1000, "origin" = "paper")))]
    pub epochs_policy: usize,
    /// Epochs over a rollout for the value function; ≥ 1. Default 3 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 1000, "origin" = "paper")))]
    pub epochs_value: usize,
    /// Epochs over a rollout for both discriminators; ≥ 0. Default 1 (paper; another of its rows
    /// can be read as 3).
    #[cfg_attr(feature = "schema", schemars(extend("maximum" = 1000, "origin" = "paper; another of its rows can be read as 3")))]
    pub epochs_discriminator: usize,
    /// Adam's step size for policy and value function; > 0. Default 5e-5 (paper). The
    /// discriminators have their own in `[discriminator]`.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "origin" = "paper")))]
    pub learning_rate: f64,
    /// Updates in which the step size of policy and value function halves, smoothly; ≥ 0, 0 keeps
    /// it. Counted in updates done, so that a run that is made longer goes on as it was. Default 0
    /// (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "default" = 0.0, "origin" = "paper")))]
    #[serde(skip_serializing_if = "is_default")]
    pub learning_rate_half_life: f64,
    /// Discount γ; 0 to 1. Default 0.99 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0, "origin" = "paper")))]
    pub gamma: f64,
    /// Trace decay λ of generalised advantage estimation; 0 to 1. Default 0.95 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0, "origin" = "paper")))]
    pub gae_lambda: f64,
    /// Half-width ε of the trust interval around ratio 1; > 0. Default 0.1 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0.0, "origin" = "paper")))]
    pub clip_coef: f64,
    /// Weight of the entropy bonus; ≥ 0. Default 5e-4 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "origin" = "lineage")))]
    pub ent_coef: f64,
    /// Gradients longer than this (L2 norm over a network) are scaled down; ≥ 0, 0 is off. Default
    /// 0 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "origin" = "lineage")))]
    pub max_grad_norm: f64,
    /// Weight α of the intrinsic reward; ≥ 0. Default 0.1 (paper; its ablations use 0.01 for
    /// `state_action` and 0.03 for `state`).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "origin" = "paper; its ablations use 0.01 for `state_action` and 0.03 for `state`")))]
    pub alpha: f64,
    /// Target of α: the intrinsic `reward` of a step (the paper's Algorithm 1, line 8) or the
    /// intrinsic `advantage` (the paper's table calls α "advantage weight"). Default `reward`.
    pub alpha_weighs: AlphaWeighs,
    /// With more than one behaviour, those whose mean return (of the task, over an episode) is
    /// further than this below the best so far learn the task alone, as if their α were 0; ≥ 0, 0
    /// is off. Default 0 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "default" = 0.0, "origin" = "paper")))]
    #[serde(skip_serializing_if = "is_default")]
    pub diversity_margin: f64,
    /// `difference` (paper), `state_action`, `state` (DIAYN) or `none`.
    pub intrinsic_reward: IntrinsicReward,
    /// Adds log M to the rewards `state_action` and `state`, as DIAYN does. Default false.
    pub add_log_m: bool,
    /// Bootstraps with V of the episode's last observation where the time limit cuts it. Default
    /// false (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("origin" = "lineage")))]
    pub bootstrap_truncation: bool,
    /// The simulator.
    pub sim: SimConfig,
    /// Agents of the training rooms that are not learners. Left out where all are.
    #[serde(skip_serializing_if = "is_default")]
    pub training_crowd: TrainingCrowd,
    /// The frozen policies of `training_crowd.opponents`.
    #[serde(skip_serializing_if = "is_default")]
    pub population: PopulationConfig,
    /// Sizes of actor and critic.
    pub network: NetworkSection,
    /// Both discriminators.
    pub discriminator: DiscriminatorConfig,
}

/// The quantity that α weighs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum AlphaWeighs {
    /// The intrinsic reward of each step: r + α·`r_int`, one advantage, one value function of both.
    #[default]
    Reward,
    /// The intrinsic advantage: `Â + α·Â_int`, each normalised over the rollout, so that α is a
    /// share whatever the scale of the rewards. `Â_int` is the sum of intrinsic rewards to the
    /// episode's end, discounted by γλ, without a value function; V is that of the task.
    Advantage,
}

impl AlphaWeighs {
    /// Its name in configuration files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reward => "reward",
            Self::Advantage => "advantage",
        }
    }
}

/// The sizes of actor and critic that do not follow from other sections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct NetworkSection {
    /// Length of a behaviour's embedding; ≥ 1. Default 32 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536, "origin" = "paper")))]
    pub embedding: usize,
    /// Standard deviation of the embeddings at the start; ≥ 0. Default 1 (PyTorch's): how far apart
    /// the behaviours are before anything is learned. With `inputs = "motion"`, where a token is
    /// one of M ones, the factor on what its weights start as.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "origin" = "PyTorch's")))]
    pub embedding_std: f32,
    /// Length of the laser feature; ≥ 1. Default 256 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536, "origin" = "lineage")))]
    pub laser_feature: usize,
    /// Length of the last hidden layer; ≥ 1. Default 128 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "maximum" = 65536, "origin" = "lineage")))]
    pub hidden: usize,
    /// Initial log standard deviation of both action dimensions. Default 0 (lineage).
    #[cfg_attr(feature = "schema", schemars(extend("origin" = "lineage")))]
    pub log_std_init: f32,
    /// Inputs of the network: every beam of the `scans` (paper), or `motion`, the bodies around
    /// with their velocities and when each way would meet them, which takes a laser that sees all
    /// round. Default `scans`.
    #[cfg_attr(feature = "schema", schemars(extend("default" = "scans")))]
    #[serde(skip_serializing_if = "is_default")]
    pub inputs: NetworkInputs,
    /// With `scans`, the network reads the nearest of each this many neighbouring beams; a divisor
    /// of `sim.laser.beams`. The robot keeps all its beams. Default 1 (paper).
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1, "default" = 1, "origin" = "paper")))]
    #[serde(skip_serializing_if = "is_one")]
    pub scan_pool: usize,
}

/// The inputs of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum NetworkInputs {
    /// The observation row: three scans, goal, velocity.
    #[default]
    Scans,
    /// Bodies with their velocities, and when each way would meet them
    /// ([`jostle_policy::encoder::motion`]).
    Motion,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_one(value: &usize) -> bool {
    *value == 1
}

impl Default for NetworkSection {
    fn default() -> Self {
        let NetworkConfig { embedding, embedding_std, laser_feature, hidden, log_std_init, .. } =
            NetworkConfig::default();
        let inputs = NetworkInputs::default();
        Self { embedding, embedding_std, laser_feature, hidden, log_std_init, inputs, scan_pool: 1 }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 1,
            updates: 5000,
            checkpoint_every: 100,
            threads: 0,
            backend: Backend::default(),
            device: Device::default(),
            n_agents: 5,
            n_behaviours: 5,
            n_rooms: 1,
            shards: 1,
            horizon: 128,
            minibatch: 256,
            epochs_policy: 3,
            epochs_value: 3,
            epochs_discriminator: 1,
            learning_rate: 5e-5,
            learning_rate_half_life: 0.0,
            gamma: 0.99,
            gae_lambda: 0.95,
            clip_coef: 0.1,
            ent_coef: 5e-4,
            max_grad_norm: 0.0,
            alpha: 0.1,
            alpha_weighs: AlphaWeighs::default(),
            diversity_margin: 0.0,
            intrinsic_reward: IntrinsicReward::default(),
            add_log_m: false,
            bootstrap_truncation: false,
            sim: SimConfig::default(),
            training_crowd: TrainingCrowd::default(),
            population: PopulationConfig::default(),
            network: NetworkSection::default(),
            discriminator: DiscriminatorConfig::default(),
        }
    }
}

impl Config {
    /// Agents of all rooms.
    pub fn agents_total(&self) -> usize {
        self.n_agents * self.n_rooms
    }

    /// What computes the networks.
    pub fn engine(&self) -> Engine {
        Engine { backend: self.backend, device: self.device }
    }

    /// Transitions of one update.
    pub fn rollout_len(&self) -> usize {
        self.horizon * self.agents_total()
    }

    /// Adam's step size for policy and value function in an update, counted from 1.
    ///
    /// # Formula
    ///
    /// `learning_rate` · ½^((update − 1) / `learning_rate_half_life`)
    pub fn learning_rate_at(&self, update: u64) -> f64 {
        if self.learning_rate_half_life == 0.0 {
            return self.learning_rate;
        }
        self.learning_rate * libm::exp2(-((update - 1) as f64) / self.learning_rate_half_life)
    }

    /// Actor and critic in full: this section's sizes, the laser's and M.
    pub fn network_config(&self) -> NetworkConfig {
        NetworkConfig {
            frames: jostle_sim::FRAMES,
            beams: self.sim.laser.beams,
            n_behaviours: self.n_behaviours,
            embedding: self.network.embedding,
            laser_feature: self.network.laser_feature,
            hidden: self.network.hidden,
            embedding_std: self.network.embedding_std,
            log_std_init: self.network.log_std_init,
            scan_pool: self.network.scan_pool,
            motion: (self.network.inputs == NetworkInputs::Motion).then_some(MotionInputs {
                dt: self.sim.episode.dt,
                v_max: self.sim.robot.v_max,
                w_max: self.sim.robot.w_max,
            }),
        }
    }

    /// The resolved configuration as TOML, without `updates`, `checkpoint_every` and `threads`:
    /// what a checkpoint holds. Reading it back gives this configuration with those three at their
    /// defaults. `alpha_weighs`, which is younger than the first shipped policies, is left out at
    /// its default, so that theirs keep their hash.
    ///
    /// # Panics
    ///
    /// Never for a validated configuration: all its numbers fit TOML.
    pub fn canonical_toml(&self) -> String {
        let mut table = toml::Table::try_from(self).expect("a validated configuration fits TOML");
        for key in KEYS_WITHOUT_EFFECT {
            table.remove(key);
        }
        if self.alpha_weighs == AlphaWeighs::default() {
            table.remove("alpha_weighs");
        }
        self.leave_out_defaults(&mut table);
        toml::to_string(&table).expect("a table is TOML")
    }

    /// Leaves training crowd and population out where they are off, else those of their keys that
    /// have their default.
    fn leave_out_defaults(&self, table: &mut toml::Table) {
        if self.training_crowd.is_off() {
            table.remove("training_crowd");
        }
        if self.training_crowd.opponents <= 0.0 {
            table.remove("population");
        }
        let sections = [
            ("training_crowd", toml::Table::try_from(TrainingCrowd::default())),
            ("population", toml::Table::try_from(PopulationConfig::default())),
        ];
        for (name, defaults) in sections {
            let defaults = defaults.expect("a default section fits TOML");
            if let Some(toml::Value::Table(section)) = table.get_mut(name) {
                section.retain(|key, value| defaults.get(key) != Some(value));
            }
        }
    }

    /// Says that a file in `folder` names the maps and the population's files: relative paths start
    /// there.
    pub fn named_in(&mut self, folder: &Path) {
        self.sim.room.named_in(folder);
        self.training_crowd.named_in(folder);
        self.population.named_in(folder);
    }

    /// As [`Self::named_in`], for what this program has written. Earlier versions wrote paths as
    /// they were given, relative to the working directory: they are taken from there if nothing
    /// lies where the folder says.
    pub fn stored_in(&mut self, folder: &Path) {
        self.sim.room.stored_in(folder);
        self.training_crowd.named_in(folder);
        self.population.stored_in(folder);
    }

    /// The configuration as a file in `folder` names it: relative paths lead from there to the same
    /// files.
    #[must_use]
    pub fn as_named_in(&self, folder: &Path) -> Self {
        let mut config = self.clone();
        config.sim.room = self.sim.room.as_named_in(folder);
        config.training_crowd = self.training_crowd.as_named_in(folder);
        config.population = self.population.as_named_in(folder);
        config
    }

    /// SHA-256 of [`Self::canonical_toml`] in hexadecimal: two runs of the same hash have the same
    /// curve. Of the paths of maps and of the population's files only names count, since the
    /// folders are others on each machine; what is in the files is known by
    /// [`jostle_sim::maps::sha256`] and [`crate::OpponentRecord`], which a checkpoint holds beside
    /// this hash.
    pub fn hash(&self) -> String {
        let mut named = self.clone();
        named.population = self.population.by_name();
        named.training_crowd = self.training_crowd.by_name();
        named.sim.room = self.sim.room.by_name();
        named.hash_with_path()
    }

    /// As [`Self::hash`], with all paths as they are written: the hash of earlier versions.
    pub(crate) fn hash_with_path(&self) -> String {
        jostle_policy::hex(&Sha256::digest(self.canonical_toml().as_bytes()))
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_canonical_form_reads_back() {
        let config = Config { seed: 9, alpha: 0.03, updates: 7, threads: 3, ..Config::default() };
        let text = config.canonical_toml();
        let read = Config::parse(&text, "canonical", &["updates=7", "threads=3"]).unwrap();
        assert_eq!(read, config);
        assert!(!text.contains("checkpoint_every"));
    }

    #[test]
    fn the_step_size_halves_in_a_half_life() {
        let config = Config { learning_rate: 0.5, learning_rate_half_life: 10.0, ..Config::default() };
        let rates = [1, 11, 21].map(|update| config.learning_rate_at(update));
        assert_eq!(rates, [0.5, 0.25, 0.125]);
        assert!(rates[1] < config.learning_rate_at(6) && config.learning_rate_at(6) < rates[0]);
        assert_eq!(Config::default().learning_rate_at(5000), 5e-5);
    }

    #[test]
    fn what_stands_before_the_network_is_left_out_at_its_default() {
        let text = Config::default().canonical_toml();
        for key in ["inputs", "scan_pool", "learning_rate_half_life"] {
            assert!(!text.contains(key), "{key}");
        }
        let read = Config::parse("[network]\ninputs = \"motion\"", "a file", &[] as &[&str]).unwrap();
        assert_eq!(read.network_config().input_len(), jostle_policy::encoder::motion::INPUT_LEN);
        assert_ne!(read.hash(), Config::default().hash());
        let refusal = Config::parse("[network]\nscan_pool = 3", "a file", &[] as &[&str]).unwrap_err();
        assert!(refusal.to_string().contains("network.scan_pool: found 3"), "{refusal}");
        let refusal = Config::parse("[network]\nscan_pool = 0", "a file", &[] as &[&str]).unwrap_err();
        assert!(refusal.to_string().contains("network.scan_pool: found 0"), "{refusal}");
    }

    #[test]
    fn a_name_is_what_a_file_says() {
        for weighs in [AlphaWeighs::Reward, AlphaWeighs::Advantage] {
            let read = Config::parse("", "empty", &[format!("alpha_weighs={}", weighs.name())]).unwrap();
            assert_eq!(read.alpha_weighs, weighs);
        }
    }

    #[test]
    fn of_a_map_only_the_name_is_part_of_the_hash() {
        let with = |map: &str| Config::parse("", "a", &[format!("sim.room.map=\"{map}\"")]).unwrap().hash();
        assert_eq!(with("maps/office.toml"), with("/somewhere/else/office.toml"));
        assert_ne!(with("office.toml"), with("hall.toml"));
        assert_ne!(with("office.toml"), Config::default().hash());
    }

    #[test]
    fn of_a_population_names_are_part_of_the_hash() {
        let with = |files: &[&str]| {
            let set = [format!("population.files={files:?}"), "training_crowd.opponents=0.5".to_owned()];
            Config::parse("", "a", &set).unwrap().hash()
        };
        let hash = with(&["pool/a.safetensors", "b.safetensors"]);
        assert_eq!(with(&["/elsewhere/a.safetensors", "../b.safetensors"]), hash);
        assert_ne!(
            with(&["b.safetensors", "a.safetensors"]),
            hash,
            "which of them drives is drawn by its place"
        );
        // Every run has such a checkpoint: which run is told.
        let of_run = with(&["runs/m1-seed3/checkpoints/005000.safetensors"]);
        assert_eq!(with(&["/elsewhere/m1-seed3/checkpoints/005000.safetensors"]), of_run);
        assert_eq!(with(&["runs/m1-seed3/../m1-seed3/checkpoints/005000.safetensors"]), of_run);
        assert_ne!(with(&["runs/m1-seed2/checkpoints/005000.safetensors"]), of_run);
        assert_ne!(with(&["runs/m1-seed3/milestones/005000.safetensors"]), of_run);
        // The folder that names them does not matter.
        let mut named = Config::default();
        (named.training_crowd.opponents, named.population.files) =
            (0.5, vec!["../m1-seed3/checkpoints/005000.safetensors".into()]);
        named.named_in(Path::new("/elsewhere/m9"));
        assert_eq!(named.hash(), of_run);
    }

    #[test]
    fn the_hash_follows_the_curve_alone() {
        let hash = Config::default().hash();
        assert_eq!(hash.len(), 64);
        let same = Config { updates: 1, checkpoint_every: 7, threads: 8, ..Config::default() };
        assert_eq!(same.hash(), hash);
        assert_ne!(Config { alpha: 0.2, ..Config::default() }.hash(), hash);
        assert_ne!(Config { seed: 2, ..Config::default() }.hash(), hash);
        assert_ne!(Config { alpha_weighs: AlphaWeighs::Advantage, ..Config::default() }.hash(), hash);
        assert!(!Config::default().canonical_toml().contains("alpha_weighs"));
    }

    #[test]
    fn a_training_crowd_is_part_of_the_hash_once_there_is_one() {
        let with = |training_crowd| Config { training_crowd, ..Config::default() };
        let off = with(TrainingCrowd { speed_max: 1.5, ..TrainingCrowd::default() });
        assert_eq!(off.hash(), Config::default().hash(), "nobody has that speed");
        assert!(!toml::to_string(&Config::default()).unwrap().contains("training_crowd"));
        let on = with(TrainingCrowd { blind: 0.5, speed_max: 1.5, ..TrainingCrowd::default() });
        assert_ne!(on.hash(), Config::default().hash());
        let text = on.canonical_toml();
        let (_, section) = text.split_once("[training_crowd]\n").expect("a section");
        assert_eq!(section, "blind = 0.5\nspeed_max = 1.5\n", "keys at their default are left out");
        let none: &[&str] = &[];
        assert_eq!(Config::parse(&text, "canonical", none).unwrap(), on);
        let maps = |folder: &str| {
            let maps = vec![format!("{folder}/a.toml").into()];
            with(TrainingCrowd { maps, ..TrainingCrowd::default() }).hash()
        };
        assert_ne!(maps("x"), Config::default().hash());
        assert_eq!(maps("x"), maps("/elsewhere"), "a map is known by its name and its content");
        let two = TrainingCrowd { maps: vec!["a.toml".into(), "b.toml".into()], ..TrainingCrowd::default() };
        let refused = Config { n_rooms: 1, ..with(two) }.validate().unwrap_err().to_string();
        assert!(
            refused.ends_with("training_crowd.maps: found 2 maps, expected at most n_rooms = 1"),
            "{refused}"
        );
        let mut population = with(TrainingCrowd::default());
        population.population.past = 3;
        assert_eq!(population.hash(), Config::default().hash(), "nobody is an opponent");
        population.training_crowd.opponents = 0.5;
        let text = population.canonical_toml();
        assert!(text.contains("[population]\npast = 3\n") && !text.contains("past_every"), "{text}");
        assert_eq!(Config::parse(&text, "canonical", none).unwrap(), population);
        let error = Config::parse("", "empty", &["training_crowd.blind=2"]).unwrap_err().to_string();
        let expected =
            "--set training_crowd.blind=2: training_crowd.blind: found 2, expected a number in [0, 1]";
        assert_eq!(error, expected);
    }
}
