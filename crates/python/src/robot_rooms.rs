//! Several robots in one room, all of whose episodes begin together: what `PettingZoo` calls a parallel environment.
//!
//! The room is that of training (`jostle_sim::Rooms`), but for one thing: a robot whose episode has ended is not placed anew.
//! It leaves the room with its body, and the others go on until the last has left.

use jostle_sim::{Rooms, Scenario, SimConfig, SimError, Streams, Transition};

use crate::crowd_rooms::bounds;

/// A room of N robots.
pub struct RobotRoom {
    rooms: Rooms,
    present: Vec<bool>,
}

impl RobotRoom {
    /// Places the robots; each draws a behaviour token below `n_behaviours`.
    ///
    /// # Errors
    ///
    /// As [`Rooms::new`].
    pub fn new(config: &SimConfig, n_agents: usize, n_behaviours: u32, seed: u64) -> Result<Self, SimError> {
        let rooms = Rooms::new(config, 1, n_agents, n_behaviours, &Streams::new(seed))?;
        Ok(Self { present: vec![true; n_agents], rooms })
    }

    /// Behaviour token of each robot.
    pub fn tokens(&self) -> &[u32] {
        self.rooms.tokens()
    }

    /// Which robots are still in the room.
    pub fn present(&self) -> &[bool] {
        &self.present
    }

    /// What a robot sees, or saw when its episode ended in the last step. The row of one that left before means nothing.
    pub fn observation(&self, agent: usize) -> &[f32] {
        if self.rooms.transitions()[agent].end.is_running() {
            let width = self.rooms.config().observation_len();
            return &self.rooms.observations()[agent * width..][..width];
        }
        self.rooms.final_observation(agent)
    }

    /// One control period. Robots whose episode ends in it leave the room. The actions of robots that have left are not
    /// looked at.
    ///
    /// # Errors
    ///
    /// Actions of another number or that are not finite; nothing moves then.
    pub fn step(&mut self, actions: &[[f32; 2]]) -> Result<&[Transition], SimError> {
        let n = self.present.len();
        let refuse = |found: String, expected: String| {
            Err(SimError::Field { field: "actions".to_owned(), found, expected })
        };
        if actions.len() != n {
            return refuse(format!("{} rows", actions.len()), format!("{n}, one for each robot"));
        }
        let mut executed = vec![[0.0; 2]; n];
        for (agent, action) in actions.iter().enumerate().filter(|(agent, _)| self.present[*agent]) {
            let [v, w] = *action;
            if !(v.is_finite() && w.is_finite()) {
                return refuse(format!("({v}, {w}) for robot {agent}"), "finite numbers".to_owned());
            }
            executed[agent] = *action;
        }
        self.rooms.step(&executed);
        for agent in 0..n {
            if !self.rooms.transitions()[agent].end.is_running() {
                self.present[agent] = false;
                self.rooms.remove(agent);
            }
        }
        Ok(self.rooms.transitions())
    }

    /// The least and the largest observation row.
    ///
    /// # Errors
    ///
    /// When the map file can no longer be read.
    pub fn bounds(&self) -> Result<[Vec<f32>; 2], SimError> {
        let config = self.rooms.config();
        Ok(bounds(config, &Scenario::new(&config.room)?))
    }
}
