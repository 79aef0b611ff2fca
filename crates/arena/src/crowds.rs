//! The built-in crowds, made from settings, room and pool.

use std::sync::Arc;

use glam::Vec2;
use jostle_peds::orca::{Obstacles, OrcaCrowd};
use jostle_peds::recorded::RecordedCrowd;
use jostle_peds::social_force::{Border, SocialForceCrowd};
use jostle_peds::validation::WalkersCrowd;
use jostle_peds::{Crowd, CrowdKind, LearnedCrowd};
use jostle_policy::PolicyFile;
use serde::{Deserialize, Serialize};

use crate::config::ArenaConfig;
use crate::error::ArenaError;
use crate::identity::PolicyIdentity;
use crate::loaded::LoadedPolicy;

/// The policies of learned pedestrians: the baseline ones, and the same at half their training
/// (crowd SO).
#[derive(Clone, Debug, Default)]
pub struct Pools {
    /// NH, IN, VA and cross-play.
    pub full: Vec<LoadedPolicy>,
    /// SO.
    pub half: Vec<LoadedPolicy>,
}

impl Pools {
    /// The policies that drive `n_pedestrians` of a crowd, in their order; empty for crowds
    /// without.
    ///
    /// Pedestrian i is driven by policy i modulo the pool's length; policies beyond the pedestrians
    /// are not used.
    pub fn drivers(&self, crowd: CrowdKind, n_pedestrians: usize) -> &[LoadedPolicy] {
        let pool = match crowd {
            CrowdKind::Nh | CrowdKind::In | CrowdKind::Va | CrowdKind::CrossPlay => &self.full[..],
            CrowdKind::So => &self.half,
            CrowdKind::Vo
            | CrowdKind::Sf
            | CrowdKind::Straight
            | CrowdKind::StopAndGo
            | CrowdKind::Recorded => &[],
        };
        &pool[..pool.len().min(n_pedestrians)]
    }

    /// The report's note on a crowd's pool; `None` for crowds without.
    pub fn note(&self, crowd: CrowdKind, n_pedestrians: usize) -> Option<PoolNote> {
        crowd.is_learned().then(|| PoolNote {
            policies: self
                .drivers(crowd, n_pedestrians)
                .iter()
                .map(|policy| policy.identity.clone())
                .collect(),
            n_pedestrians,
        })
    }
}

/// The policies that drove the pedestrians.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoolNote {
    /// In their order; pedestrian i is driven by policy i modulo their number.
    pub policies: Vec<PolicyIdentity>,
    /// Number of pedestrians in a room.
    pub n_pedestrians: usize,
}

impl PoolNote {
    /// True if there are more pedestrians than policies, so that some share one.
    pub fn is_cycled(&self) -> bool {
        self.policies.len() < self.n_pedestrians
    }
}

/// Makes a crowd for rooms with the given polygons (clockwise around free space, counter-clockwise
/// around obstacles).
///
/// # Errors
///
/// An empty pool, a policy whose observation is not the room's, settings out of range.
pub fn make_crowd(
    config: &ArenaConfig,
    kind: CrowdKind,
    pools: &Pools,
    polygons: &[Vec<Vec2>],
) -> Result<Box<dyn Crowd>, ArenaError> {
    let (crowds, dt) = (&config.crowds, config.sim.episode.dt);
    let visibility = crowds.visibility.row(kind);
    Ok(match kind {
        CrowdKind::Vo => {
            let obstacles = Arc::new(Obstacles::new(polygons)?);
            Box::new(OrcaCrowd::new(&crowds.orca, visibility, dt, obstacles)?)
        }
        CrowdKind::Sf => {
            let borders = Border::from_polygons(polygons)?.into();
            Box::new(SocialForceCrowd::new(&crowds.social_force, visibility, dt, borders)?)
        }
        CrowdKind::Straight | CrowdKind::StopAndGo => Box::new(WalkersCrowd::new(kind)?),
        CrowdKind::Recorded => Box::new(RecordedCrowd),
        CrowdKind::Nh | CrowdKind::In | CrowdKind::Va | CrowdKind::So | CrowdKind::CrossPlay => {
            // An empty room needs no policies, but the crowd must exist.
            let pool = pools.drivers(kind, config.n_pedestrians().max(1));
            if pool.is_empty() {
                return Err(ArenaError::EmptyPool { crowd: kind });
            }
            for policy in pool {
                check_observation(config, policy)?;
            }
            let files: Vec<PolicyFile> = pool.iter().map(|policy| policy.file.clone()).collect();
            Box::new(LearnedCrowd::from_files(kind, visibility, &crowds.learned, config.backend, &files)?)
        }
    })
}

/// Refuses a policy that reads other observations than the room gives: rows of another length, or
/// beams that point elsewhere. Where its beams pointed in training is told by the settings in its
/// file; a file without says nothing.
///
/// # Errors
///
/// [`ArenaError::Setting`] names both lengths, or both lasers.
pub fn check_observation(config: &ArenaConfig, policy: &LoadedPolicy) -> Result<(), ArenaError> {
    let name = &policy.identity.name;
    let (found, expected) = (policy.file.network.observation_len(), config.sim.observation_len());
    if found != expected {
        return Err(ArenaError::Setting {
            field: "observation of the policy",
            found: format!("{found} numbers in {name}"),
            expected: format!("{expected}, as the simulator's laser gives"),
        });
    }
    if !policy.file.metadata.contains_key("sim") {
        return Ok(());
    }
    let (trained, laser) = (policy.sim_config()?.laser, &config.sim.laser);
    if trained.points_as(laser) {
        return Ok(());
    }
    Err(ArenaError::Setting {
        field: "laser of the policy",
        found: format!("{name}, trained with a laser that sees {}", trained.view()),
        expected: format!("one trained with the room's, which sees {}", laser.view()),
    })
}
