//! Crowds NH, IN, VA, SO and cross-play: pedestrians that sense by laser and are driven by trained policies (feature `learned`).
//!
//! They differ in what they are given: the policies of the pool (SO: half-trained ones; cross-play: any), the scans, with or without
//! the robot (`visibility`), and the speed factors (VA).

use jostle_policy::{Backend, Batch, Network, NetworkConfig, PolicyFile, actor};
use rayon::prelude::*;

use crate::{Crowd, CrowdKind, LearnedConfig, Motion, PedsError, RoomView, crowd::check_motions};

/// Pedestrian i of every room acts on the mean of policy i mod pool length, clipped to the command limits; in crowd VA its linear
/// velocity is then multiplied by its speed factor.
pub struct LearnedCrowd {
    kind: CrowdKind,
    limits: LearnedConfig,
    observation_len: usize,
    pool: Vec<Member>,
}

/// A policy of the pool, with the rows that it decides for in one call.
struct Member {
    network: Box<dyn Network>,
    /// Indices into the motions.
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
    /// A crowd of policies that read rows of `observation_len` values. Behaviour token 0 throughout.
    ///
    /// # Errors
    /// A crowd that is not learned, an empty pool, a network that is no actor, limits out of range.
    pub fn new(
        kind: CrowdKind,
        limits: &LearnedConfig,
        observation_len: usize,
        pool: Vec<Box<dyn Network>>,
    ) -> Result<Self, PedsError> {
        limits.validate()?;
        if !kind.is_learned() {
            return Err(PedsError::WrongKind { found: kind, expected: "NH, IN, VA, SO, cross-play" });
        }
        if pool.is_empty() {
            return Err(PedsError::Pool("it is empty; expected at least one policy".into()));
        }
        if let Some(i) = pool.iter().position(|network| network.n_outputs() != 2) {
            let found = pool[i].n_outputs();
            return Err(PedsError::Pool(format!("network {i} has {found} outputs; expected an actor's 2")));
        }
        let member = |network| Member {
            network,
            decides: Vec::new(),
            observations: Vec::new(),
            tokens: Vec::new(),
            means: Vec::new(),
        };
        let pool = pool.into_iter().map(member).collect();
        Ok(Self { kind, limits: *limits, observation_len, pool })
    }

    /// A crowd of policies read from files, which must all have the same observation.
    ///
    /// # Errors
    /// As [`Self::new`]; policies whose frames or beams differ; a back end that cannot be had.
    pub fn from_files(
        kind: CrowdKind,
        limits: &LearnedConfig,
        backend: Backend,
        files: &[PolicyFile],
    ) -> Result<Self, PedsError> {
        let observation_len = files.first().map_or(0, |file| file.network.observation_len());
        let mut pool = Vec::with_capacity(files.len());
        for (i, PolicyFile { actor: parameters, network, .. }) in files.iter().enumerate() {
            check_shape(i, network, &files[0].network)?;
            let made = actor(network, backend, parameters);
            pool.push(made.map_err(|error| PedsError::Pool(format!("policy {i}: {error}")))?);
        }
        Self::new(kind, limits, observation_len, pool)
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

    fn command(&self, mean: &[f32], factor: f32) -> Motion {
        let factor = if self.kind == CrowdKind::Va { factor } else { 1.0 };
        Motion::Drive {
            v: mean[0].clamp(0.0, self.limits.v_max) * factor,
            w: mean[1].clamp(-self.limits.w_max, self.limits.w_max),
        }
    }
}

fn check_shape(i: usize, found: &NetworkConfig, expected: &NetworkConfig) -> Result<(), PedsError> {
    if (found.frames, found.beams) == (expected.frames, expected.beams) {
        return Ok(());
    }
    let (frames, beams) = (expected.frames, expected.beams);
    let found = format!("policy {i} sees {} frames of {} beams", found.frames, found.beams);
    Err(PedsError::Pool(format!("{found}; expected {frames} of {beams}, as policy 0")))
}

impl Crowd for LearnedCrowd {
    fn kind(&self) -> CrowdKind {
        self.kind
    }

    fn senses_by_laser(&self) -> bool {
        true
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], motions: &mut [Motion]) -> Result<(), PedsError> {
        check_motions(rooms, motions)?;
        self.gather(rooms)?;
        self.pool.par_iter_mut().for_each(Member::infer);

        let factors: Vec<f32> =
            rooms.iter().flat_map(|room| (0..room.pedestrians.len()).map(|i| room.factor(i))).collect();
        for (i, member) in self.pool.iter().enumerate() {
            for (mean, &at) in member.means.chunks_exact(2).zip(&member.decides) {
                if !mean.iter().all(|value| value.is_finite()) {
                    return Err(PedsError::Pool(format!(
                        "policy {i} answers {mean:?}; expected finite means"
                    )));
                }
                motions[at] = self.command(mean, factors[at]);
            }
        }
        Ok(())
    }
}
