//! Ranges of the configuration's values.

use std::fmt::Display;

use jostle_diversity::DiversityError;
use jostle_policy::PolicyError;
use jostle_sim::SimError;

use super::{Config, NetworkInputs};
use crate::PpoError;

/// Most transitions of one update in a shard: row numbers are 32 bits, and this many default
/// observations are 6 GiB.
const ROLLOUT_MAX: usize = 1 << 20;
/// Most shards, each of which a machine of its own may have.
const SHARDS_MAX: usize = 4096;
/// Most values in the observations of one update in a shard: 8 GiB.
const OBSERVATIONS_MAX: usize = 1 << 31;

impl Config {
    /// Checks every value's range, and the ranges that depend on one another.
    ///
    /// # Errors
    ///
    /// [`PpoError::Config`] for the first key that is out of range, located at `configuration`.
    pub fn validate(&self) -> Result<(), PpoError> {
        let top = i64::MAX as u64;
        within("seed", self.seed, 0, top)?;
        within("updates", self.updates, 1, top)?;
        within("checkpoint_every", self.checkpoint_every, 0, top)?;
        within("threads", self.threads, 0, 1024)?;
        within("n_agents", self.n_agents, 1, 1000)?;
        within("n_behaviours", self.n_behaviours, 1, 1000)?;
        within("n_rooms", self.n_rooms, 1, 65_536)?;
        within("horizon", self.horizon, 1, 65_536)?;
        self.check_shards()?;
        let (rollout, of_shard) = (self.rollout_len(), self.rollout_len() / self.shards);
        if of_shard > ROLLOUT_MAX {
            let expected =
                format!("at most {ROLLOUT_MAX} transitions (horizon · n_agents · n_rooms / shards)");
            return Err(refuse("horizon", format!("{of_shard} transitions an update"), expected));
        }
        if self.minibatch == 0 || self.minibatch > rollout {
            let expected = format!("1 to {rollout} (horizon · n_agents · n_rooms)");
            return Err(refuse("minibatch", self.minibatch, expected));
        }
        within("epochs_policy", self.epochs_policy, 1, 1000)?;
        within("epochs_value", self.epochs_value, 1, 1000)?;
        within("epochs_discriminator", self.epochs_discriminator, 0, 1000)?;
        positive("learning_rate", self.learning_rate)?;
        not_negative("learning_rate_half_life", self.learning_rate_half_life)?;
        share("gamma", self.gamma)?;
        share("gae_lambda", self.gae_lambda)?;
        positive("clip_coef", self.clip_coef)?;
        not_negative("ent_coef", self.ent_coef)?;
        not_negative("max_grad_norm", self.max_grad_norm)?;
        not_negative("alpha", self.alpha)?;
        not_negative("diversity_margin", self.diversity_margin)?;
        self.sim.validate().map_err(|error| in_section("sim", error))?;
        let crowd = &self.training_crowd;
        crowd
            .validate()
            .and_then(|()| crowd.check_rooms(self.n_rooms))
            .map_err(|error| in_section("training_crowd", error))?;
        self.check_population()?;
        self.check_view()?;
        self.engine().validate().map_err(of_run)?;
        self.network_config().validate().map_err(in_network)?;
        // A network that is not valid has no length of its input.
        let values = of_shard.saturating_mul(self.network_config().input_len());
        if values > OBSERVATIONS_MAX {
            let expected = format!("at most {OBSERVATIONS_MAX} (transitions · length of an observation)");
            return Err(refuse("horizon", format!("{values} values an update"), expected));
        }
        self.discriminator.validate().map_err(in_discriminator)
    }
}

impl Config {
    /// Every shard has as many rooms as the others, and a row in every minibatch.
    fn check_shards(&self) -> Result<(), PpoError> {
        let Self { shards, n_rooms, minibatch, .. } = *self;
        if !shards.is_power_of_two() || shards > SHARDS_MAX || !n_rooms.is_multiple_of(shards) {
            let expected =
                format!("a power of two of at most {SHARDS_MAX} of which n_rooms = {n_rooms} is a multiple");
            return Err(refuse("shards", shards, expected));
        }
        if shards > 1 && minibatch < shards {
            return Err(refuse("minibatch", minibatch, format!("at least {shards} (shards)")));
        }
        Ok(())
    }

    fn check_population(&self) -> Result<(), PpoError> {
        within("population.past", self.population.past, 0, 64)?;
        within("population.past_every", self.population.past_every, 1, i64::MAX as u64)?;
        if self.training_crowd.opponents > 0.0 && self.population.is_empty() {
            let expected = "at least one, or population.past of at least 1, for training_crowd.opponents";
            return Err(refuse("population.files", "no file", expected));
        }
        Ok(())
    }

    /// Bodies are read out of scans that go all round from straight ahead.
    fn check_view(&self) -> Result<(), PpoError> {
        let laser = &self.sim.laser;
        let usual = laser.is_full_circle() && laser.angle_min == 0.0;
        if usual || self.network.inputs != NetworkInputs::Motion {
            return Ok(());
        }
        let found = format!("motion, with a laser that sees {}", laser.view());
        Err(refuse("network.inputs", found, "scans, or a laser that sees all round from 0 rad"))
    }
}

pub(crate) fn refuse(field: impl Into<String>, found: impl Display, expected: impl Into<String>) -> PpoError {
    let location = "configuration".to_owned();
    PpoError::Config { location, field: field.into(), found: found.to_string(), expected: expected.into() }
}

fn within<T: PartialOrd + Display + Copy>(field: &str, value: T, low: T, high: T) -> Result<(), PpoError> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(refuse(field, value, format!("an integer from {low} to {high}")))
}

fn positive(field: &str, value: f64) -> Result<(), PpoError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(refuse(field, value, "a finite number > 0")) }
}

fn not_negative(field: &str, value: f64) -> Result<(), PpoError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(refuse(field, value, "a finite number ≥ 0"))
    }
}

fn share(field: &str, value: f64) -> Result<(), PpoError> {
    if (0.0..=1.0).contains(&value) { Ok(()) } else { Err(refuse(field, value, "a number from 0 to 1")) }
}

fn in_section(section: &str, error: SimError) -> PpoError {
    match error.setting() {
        Some((field, found, expected)) => refuse(format!("{section}.{field}"), found, expected),
        None => PpoError::Sim(error),
    }
}

fn in_network(error: PolicyError) -> PpoError {
    match error {
        PolicyError::Config { field: "beams", found, expected } => refuse("sim.laser.beams", found, expected),
        PolicyError::Config { field, found, expected } => refuse(format!("network.{field}"), found, expected),
        other => PpoError::Policy(other),
    }
}

fn of_run(error: PolicyError) -> PpoError {
    match error {
        PolicyError::Config { field, found, expected } => refuse(field, found, expected),
        other => PpoError::Policy(other),
    }
}

fn in_discriminator(error: DiversityError) -> PpoError {
    match error {
        DiversityError::Config { field, found, expected } => {
            refuse(format!("discriminator.{field}"), found, expected)
        }
        other => PpoError::Diversity(other),
    }
}
