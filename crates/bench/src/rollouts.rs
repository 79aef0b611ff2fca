//! Steps of a rollout with inference: all rooms in turn, or one half simulated while the other is
//! inferred.

use jostle_policy::{Backend, Batch, Network, NetworkConfig, Parameters, actor};
use jostle_sim::{Rooms, SimConfig, Streams};

use crate::error::BenchError;
use crate::scenes::stream;

/// Robots of a room.
const N_AGENTS: usize = 5;
/// Behaviours M.
const N_BEHAVIOURS: usize = 5;

/// Order of inference and simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Inference of all rooms, then simulation of all rooms; each is divided over the threads.
    InTurn,
    /// While one half of the rooms is simulated, the actions of the other are inferred.
    Overlapped,
}

/// Rooms of five robots that follow a fresh actor's means.
pub struct Acting {
    rooms: Rooms,
    actor: Box<dyn Network>,
    actions: Vec<[f32; 2]>,
}

impl Acting {
    /// So many rooms of the paper.
    ///
    /// # Errors
    ///
    /// When simulator or network cannot be made.
    pub fn new(n_rooms: usize) -> Result<Self, BenchError> {
        let rooms =
            Rooms::new(&SimConfig::default(), n_rooms, N_AGENTS, N_BEHAVIOURS as u32, &Streams::new(1))?;
        let config = NetworkConfig { n_behaviours: N_BEHAVIOURS, ..NetworkConfig::default() };
        let parameters = Parameters::actor(&config, &mut stream("actor"));
        let actor = actor(&config, Backend::Fast, &parameters)?;
        let mut acting = Self { actions: vec![[0.0; 2]; rooms.len()], rooms, actor };
        acting.infer_all();
        Ok(acting)
    }

    fn infer_all(&mut self) {
        let batch = Batch::new(self.rooms.observations(), self.rooms.tokens());
        self.actor.infer(batch, self.actions.as_flattened_mut());
    }

    /// One step of all robots. Returns their number.
    ///
    /// # Panics
    ///
    /// When there is one room alone and its halves are asked for.
    pub fn step(&mut self, order: Order) -> usize {
        match order {
            Order::InTurn => {
                self.rooms.step(&self.actions);
                self.infer_all();
            }
            Order::Overlapped => {
                let half = self.rooms.n_rooms() / 2;
                assert!(half > 0, "one room has no halves");
                let (actions, others) = self.actions.split_at_mut(half * N_AGENTS);
                let (mut rooms, mut other_rooms) = self.rooms.all_mut().split_at(half);
                let actor = &mut self.actor;
                let mut infer = |observations: &[f32], tokens: &[u32], actions: &mut [[f32; 2]]| {
                    actor.infer(Batch::new(observations, tokens), actions.as_flattened_mut());
                };
                // The other half's actions are behind by half a step: inferred while the first half
                // moves.
                rayon::join(
                    || rooms.step(actions),
                    || infer(other_rooms.observations(), other_rooms.tokens(), others),
                );
                rayon::join(
                    || other_rooms.step(others),
                    || infer(rooms.observations(), rooms.tokens(), actions),
                );
            }
        }
        self.rooms.len()
    }

    /// The present observations of all robots.
    pub fn observations(&self) -> &[f32] {
        self.rooms.observations()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_are_the_same_rollout() {
        let (mut in_turn, mut overlapped) = (Acting::new(3).unwrap(), Acting::new(3).unwrap());
        for _ in 0..20 {
            in_turn.step(Order::InTurn);
            overlapped.step(Order::Overlapped);
            assert_eq!(in_turn.observations(), overlapped.observations());
        }
    }
}
