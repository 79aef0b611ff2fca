//! Crowds NH, IN, VA, SO and cross-play: pedestrians that sense by laser and are driven by trained
//! policies (feature `learned`).
//!
//! They differ in what they are given: the policies of the pool (SO: half-trained ones; cross-play:
//! any), the scans, with or without the robot (`visibility`), and the speed factors (VA).

use jostle_policy::{Backend, Batch, Network, NetworkConfig, PolicyError, PolicyFile, actor};
use rayon::prelude::*;

use crate::{
    Command, Crowd, CrowdKind, CrowdName, LearnedConfig, PedsError, RoomView, Visibility,
    crowd::check_commands,
};

/// Pedestrian i of every room acts on the mean of policy i mod pool length, clipped to the command
/// limits; in crowd VA its linear velocity is then multiplied by its speed factor.
pub struct LearnedCrowd {
    kind: CrowdKind,
    visibility: Visibility,
    limits: LearnedConfig,
    observation_len: usize,
    pool: Vec<Member>,
}

/// A policy of the pool, with the rows that it decides for in one call.
struct Member {
    network: Box<dyn Network>,
    /// Indices into the commands.
    decides: Vec<usize>,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    means: Vec<f32>,
}

impl Member {
    fn infer(&mut self) {
        self.tokens.clear();
        self.tokens.resize(self.decides.len(), 0);
        self.means.clear();
        self.means.resize(2 * self.decides.len(), 0.0);
        if !self.decides.is_empty() {
            self.network.infer(Batch::new(&self.observations, &self.tokens), &mut self.means);
        }
    }
}

impl LearnedCrowd {
    /// A crowd of policies that read rows of `observation_len` values. Behaviour token 0
    /// throughout. `visibility` says which bodies the scans in the rows show.
    ///
    /// # Errors
    /// A crowd that is not learned, an empty pool, a network that is no actor, limits out of range.
    pub fn new(
        kind: CrowdKind,
        visibility: Visibility,
        limits: &LearnedConfig,
        observation_len: usize,
        pool: Vec<Box<dyn Network>>,
    ) -> Result<Self, PedsError> {
        limits.validate()?;
        if !kind.is_learned() {
            let expected = "NH, IN, VA, SO, cross-play";
            return Err(PedsError::WrongKind { found: kind.name(), expected });
        }
        if pool.is_empty() {
            return Err(PedsError::EmptyPool);
        }
        if let Some(policy) = pool.iter().position(|network| network.n_outputs() != 2) {
            return Err(PedsError::PoolOutputs { policy, found: pool[policy].n_outputs() });
        }
        let member = |network| Member {
            network,
            decides: Vec::new(),
            observations: Vec::new(),
            tokens: Vec::new(),
            means: Vec::new(),
        };
        let pool = pool.into_iter().map(member).collect();
        Ok(Self { kind, visibility, limits: *limits, observation_len, pool })
    }

    /// A crowd of policies read from files, which must all have the same observation.
    ///
    /// # Errors
    /// As [`Self::new`]; policies whose frames or beams differ; a back end that cannot be had.
    pub fn from_files(
        kind: CrowdKind,
        visibility: Visibility,
        limits: &LearnedConfig,
        backend: Backend,
        files: &[PolicyFile],
    ) -> Result<Self, PedsError> {
        let observation_len = files.first().map_or(0, |file| file.network.observation_len());
        let mut pool = Vec::with_capacity(files.len());
        for (policy, PolicyFile { actor: parameters, network, .. }) in files.iter().enumerate() {
            check_shape(policy, network, &files[0].network)?;
            let made = actor(network, backend, parameters);
            let refused = |error: PolicyError| PedsError::PoolBackend { policy, reason: error.to_string() };
            pool.push(made.map_err(refused)?);
        }
        Self::new(kind, visibility, limits, observation_len, pool)
    }

    /// Number of policies; rooms with more pedestrians cycle through them.
    pub fn pool_len(&self) -> usize {
        self.pool.len()
    }

    /// Hands every pedestrian's observation to its policy.
    fn gather(&mut self, rooms: &[RoomView<'_>]) -> Result<(), PedsError> {
        for member in &mut self.pool {
            member.decides.clear();
            member.observations.clear();
        }
        let n_members = self.pool.len();
        let mut first = 0;
        for room in rooms {
            room.check_factors()?;
            let expected = room.pedestrians.len() * self.observation_len;
            let found = room.observations.len();
            if found != expected {
                return Err(PedsError::Length { what: "observations", found, expected });
            }
            if let Some(&value) = room.observations.iter().find(|value| !value.is_finite()) {
                let found = f64::from(value);
                return Err(PedsError::OutOfRange { field: "observation", found, expected: "finite values" });
            }
            for (i, row) in room.observations.chunks_exact(self.observation_len).enumerate() {
                let member = &mut self.pool[i % n_members];
                member.decides.push(first + i);
                member.observations.extend_from_slice(row);
            }
            first += room.pedestrians.len();
        }
        Ok(())
    }

    fn command(&self, mean: [f32; 2], factor: f32) -> Command {
        let factor = if self.kind == CrowdKind::Va { factor } else { 1.0 };
        Command::Drive {
            v: mean[0].clamp(0.0, self.limits.v_max) * factor,
            w: mean[1].clamp(-self.limits.w_max, self.limits.w_max),
        }
    }
}

fn check_shape(policy: usize, found: &NetworkConfig, expected: &NetworkConfig) -> Result<(), PedsError> {
    let [found, expected] = [found, expected].map(|network| [network.frames, network.beams]);
    if found == expected { Ok(()) } else { Err(PedsError::PoolObservation { policy, found, expected }) }
}

impl Crowd for LearnedCrowd {
    fn name(&self) -> CrowdName {
        self.kind.into()
    }

    fn visibility(&self) -> Visibility {
        self.visibility
    }

    fn senses_by_laser(&self) -> bool {
        true
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError> {
        check_commands(rooms, commands)?;
        self.gather(rooms)?;
        self.pool.par_iter_mut().for_each(Member::infer);

        let factors: Vec<f32> =
            rooms.iter().flat_map(|room| (0..room.pedestrians.len()).map(|i| room.factor(i))).collect();
        for (policy, member) in self.pool.iter().enumerate() {
            for (mean, &at) in member.means.as_chunks().0.iter().zip(&member.decides) {
                if !mean.iter().all(|value| value.is_finite()) {
                    return Err(PedsError::PoolAnswer { policy, mean: *mean });
                }
                commands[at] = self.command(*mean, factors[at]);
            }
        }
        Ok(())
    }
}
