//! A robot's driver by name: a trained policy, or a planner.

use crate::config::ArenaConfig;
use crate::crowds::check_observation;
use crate::error::ArenaError;
use crate::identity::PolicyIdentity;
use crate::loaded::LoadedPolicy;
use crate::planners::Planner;
use crate::robot::{Robot, TrainedRobot};
use crate::room::RoomPlan;

/// A trained policy or a planner.
#[derive(Clone, Debug)]
pub enum Driver {
    /// A policy from a checkpoint.
    Trained(Box<LoadedPolicy>),
    /// A planner by its name.
    Planner(Planner),
}

impl Driver {
    /// Its identity in records and reports.
    pub fn identity(&self) -> PolicyIdentity {
        match self {
            Self::Trained(policy) => policy.identity.clone(),
            Self::Planner(planner) => planner.identity(),
        }
    }

    /// A report's remark on it; `None` for a trained policy.
    pub fn remark(&self) -> Option<String> {
        match self {
            Self::Trained(_) => None,
            Self::Planner(planner) => {
                Some(format!("{planner} is a planner, not learned: {}.", planner.description()))
            }
        }
    }

    /// The policy's file, if there is one.
    pub fn trained(&self) -> Option<&LoadedPolicy> {
        match self {
            Self::Trained(policy) => Some(policy),
            Self::Planner(_) => None,
        }
    }

    /// Settings of a test in the world that a policy was trained in; a planner's is the paper's.
    ///
    /// # Errors
    ///
    /// As [`LoadedPolicy::sim_config`].
    pub fn config(&self) -> Result<ArenaConfig, ArenaError> {
        let Self::Trained(policy) = self else { return Ok(ArenaConfig::default()) };
        Ok(ArenaConfig {
            sim: policy.sim_config()?,
            n_agents: policy.file.provenance.n_agents as usize,
            ..ArenaConfig::default()
        })
    }

    /// Refuses a policy that reads other observations than the room gives; a planner reads any.
    ///
    /// # Errors
    ///
    /// As [`check_observation`].
    pub fn check_observation(&self, config: &ArenaConfig) -> Result<(), ArenaError> {
        self.trained().map_or(Ok(()), |policy| check_observation(config, policy))
    }

    /// The robot of a plan's rooms. A planner knows one behaviour, token 0.
    ///
    /// # Errors
    ///
    /// A token that the driver does not know; a back end that cannot be had.
    pub fn robot(&self, token: u32, plan: &RoomPlan) -> Result<Box<dyn Robot>, ArenaError> {
        match self {
            Self::Trained(policy) => Ok(Box::new(TrainedRobot::new(policy, token, plan.config.backend)?)),
            Self::Planner(planner) if token == 0 => planner.robot(plan),
            Self::Planner(planner) => Err(ArenaError::Setting {
                field: "token",
                found: token.to_string(),
                expected: format!("0: the planner {planner} knows no behaviours"),
            }),
        }
    }
}
