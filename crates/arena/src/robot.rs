//! Drivers of the robot: a trained policy, any function of the observation, or one that knows
//! everyone's position.
//!
//! Every [`RobotPolicy`] is a [`Robot`]. What reads more than the observation row implements
//! [`Robot`] itself.

use jostle_peds::Pedestrian;
use jostle_policy::{Backend, Batch, Network, actor};

use crate::error::ArenaError;
use crate::loaded::LoadedPolicy;

/// Everything that can be known of a room at one step.
#[derive(Clone, Copy, Debug)]
pub struct RobotView<'a> {
    /// The robot's observation row: all that a policy may read.
    pub row: &'a [f32],
    /// The robot with its goal, in the world's frame: ground truth.
    pub robot: Pedestrian,
    /// The pedestrians, in the world's frame: ground truth.
    pub pedestrians: &'a [Pedestrian],
}

/// Views of rooms, one after the other.
pub type Views<'r, 'v> = &'r mut dyn Iterator<Item = RobotView<'v>>;

/// The driver of the robots of many rooms.
pub trait Robot: Send {
    /// Answers one action (v, ω) for each room. An action must be a function of its own room's
    /// view. `memory` is for gathering rows.
    ///
    /// # Errors
    ///
    /// A view that the robot cannot work with.
    fn drive(
        &mut self,
        rooms: Views<'_, '_>,
        memory: &mut Vec<f32>,
        actions: &mut [[f32; 2]],
    ) -> Result<(), ArenaError>;
}

impl<P: RobotPolicy + ?Sized> Robot for P {
    fn drive(
        &mut self,
        rooms: Views<'_, '_>,
        memory: &mut Vec<f32>,
        actions: &mut [[f32; 2]],
    ) -> Result<(), ArenaError> {
        self.act_rows(&mut rooms.map(|room| room.row), memory, actions);
        Ok(())
    }
}

/// A policy for the robot: a function of the observation row.
///
/// Rows of one call belong to different episodes, and which ones stand side by side depends on the
/// lock step: the action of a row must be a function of that row alone.
///
/// # Examples
///
/// ```
/// use jostle_arena::robot::{PerRow, RobotPolicy};
/// // Straight on at full speed, whatever is seen.
/// let mut blind = PerRow::new(|_row: &[f32]| [1.0, 0.0]);
/// let mut actions = [[0.0; 2]; 2];
/// blind.act(&[0.0; 2 * 1540], &mut actions);
/// assert_eq!(actions, [[1.0, 0.0]; 2]);
/// ```
pub trait RobotPolicy: Send {
    /// Answers one action (v, ω) for each observation. Actions are clipped to the robot's limits by
    /// the caller.
    ///
    /// # Shapes
    ///
    /// `observations` [B, row], row-major: scans oldest first, then the goal in the robot's frame
    /// and (v, ω), which are the row's last four numbers. `actions` `[B]`.
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]);

    /// As [`Self::act`], for rows that do not lie side by side; `memory` is for gathering them. A
    /// policy that has a place of its own for its batch overrides this and saves a copy.
    fn act_rows(&mut self, rows: Rows<'_, '_>, memory: &mut Vec<f32>, actions: &mut [[f32; 2]]) {
        memory.clear();
        rows.for_each(|row| memory.extend_from_slice(row));
        self.act(memory, actions);
    }
}

impl<P: RobotPolicy + ?Sized> RobotPolicy for Box<P> {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        (**self).act(observations, actions);
    }

    fn act_rows(&mut self, rows: Rows<'_, '_>, memory: &mut Vec<f32>, actions: &mut [[f32; 2]]) {
        (**self).act_rows(rows, memory, actions);
    }
}

/// Observation rows, one after the other.
pub type Rows<'r, 'o> = &'r mut dyn Iterator<Item = &'o [f32]>;

/// A policy made of a function of one observation.
pub struct PerRow<F>(F);

impl<F: FnMut(&[f32]) -> [f32; 2] + Send> PerRow<F> {
    /// Wraps the function.
    pub fn new(function: F) -> Self {
        Self(function)
    }
}

impl<F: FnMut(&[f32]) -> [f32; 2] + Send> RobotPolicy for PerRow<F> {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        let row_len = observations.len() / actions.len().max(1);
        for (row, action) in observations.chunks_exact(row_len.max(1)).zip(actions) {
            *action = (self.0)(row);
        }
    }
}

/// A trained policy with one behaviour token; it acts on the mean.
pub struct TrainedRobot {
    network: Box<dyn Network>,
    token: u32,
    tokens: Vec<u32>,
}

impl TrainedRobot {
    /// Prepares a policy for inference.
    ///
    /// # Errors
    ///
    /// A token beyond the policy's behaviours; a back end that cannot be had.
    pub fn new(policy: &LoadedPolicy, token: u32, backend: Backend) -> Result<Self, ArenaError> {
        let n_behaviours = policy.file.network.n_behaviours;
        if token as usize >= n_behaviours {
            return Err(ArenaError::Setting {
                field: "token",
                found: token.to_string(),
                expected: format!("less than the policy's {n_behaviours} behaviours"),
            });
        }
        let network = actor(&policy.file.network, backend, &policy.file.actor)?;
        Ok(Self { network, token, tokens: Vec::new() })
    }
}

impl RobotPolicy for TrainedRobot {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        self.tokens.resize(actions.len(), self.token);
        self.network.infer(Batch::new(observations, &self.tokens), actions.as_flattened_mut());
    }
}
