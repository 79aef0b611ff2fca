//! Several robots in one room, all of whose episodes begin together: what `PettingZoo` calls a
//! parallel environment.
//!
//! The room is that of training (`jostle_sim::Rooms`), but for one thing: a robot whose episode has
//! ended is not placed anew. It leaves the room with its body, and the others go on until the last
//! has left.

use jostle_sim::{Rooms, Scenario, Shape, SimConfig, SimError, Streams, Transition, Whereabouts, maps};
use serde::{Deserialize, Serialize};

use crate::crowd_rooms::bounds;
use crate::picture::{Painter, Picture, ROBOTS};

/// A room of N robots.
#[derive(Clone)]
pub struct RobotRoom {
    rooms: Rooms,
    scenario: Scenario,
    present: Vec<bool>,
    min_clearance: Vec<f32>,
    seed: u64,
    n_behaviours: u32,
    /// The actions executed since the episodes began.
    actions: Vec<Vec<[f32; 2]>>,
}

/// The snapshot with which a room goes on where another was: it is deterministic, so that this is
/// all of its state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    settings: String,
    seed: u64,
    n_agents: usize,
    n_behaviours: u32,
    actions: Vec<Vec<[f32; 2]>>,
}

impl RobotRoom {
    /// Places the robots; each draws a behaviour token below `n_behaviours`.
    ///
    /// # Errors
    ///
    /// As [`Rooms::new`].
    pub fn new(config: &SimConfig, n_agents: usize, n_behaviours: u32, seed: u64) -> Result<Self, SimError> {
        let rooms = Rooms::new(config, 1, n_agents, n_behaviours, &Streams::new(seed))?;
        let (scenario, actions) = (maps::scenario(&config.room)?, Vec::new());
        let min_clearance = (0..n_agents).map(|agent| rooms.whereabouts(agent).clearance).collect();
        Ok(Self {
            present: vec![true; n_agents],
            min_clearance,
            rooms,
            scenario,
            seed,
            n_behaviours,
            actions,
        })
    }

    /// The snapshot with which another room goes on as this one does. `settings` tells its
    /// configuration from others.
    pub fn snapshot(&self, settings: String) -> Snapshot {
        let (seed, n_agents, n_behaviours) = (self.seed, self.present.len(), self.n_behaviours);
        Snapshot { settings, seed, n_agents, n_behaviours, actions: self.actions.clone() }
    }

    /// The room where another was when its snapshot was taken, by driving through its episodes
    /// again.
    ///
    /// # Errors
    ///
    /// A snapshot of other settings, numbers of robots or of behaviours.
    pub fn from_snapshot(
        config: &SimConfig,
        (n_agents, n_behaviours): (usize, u32),
        settings: &str,
        snapshot: &Snapshot,
    ) -> Result<Self, SimError> {
        let found = (&*snapshot.settings, snapshot.n_agents, snapshot.n_behaviours);
        if found != (settings, n_agents, n_behaviours) {
            return Err(SimError::Field {
                field: "snapshot".to_owned(),
                found: "other settings or another number of robots or behaviours".to_owned(),
                expected: "those of this room: a file that it was made from has changed".to_owned(),
            });
        }
        let mut room = Self::new(config, n_agents, n_behaviours, snapshot.seed)?;
        for actions in &snapshot.actions {
            room.step(actions)?;
        }
        Ok(room)
    }

    /// Walls and obstacles.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The configuration.
    pub fn config(&self) -> &SimConfig {
        self.rooms.config()
    }

    /// The place of a robot, or its place when its episode ended in the last step.
    pub fn whereabouts(&self, agent: usize) -> Whereabouts {
        self.rooms.whereabouts(agent)
    }

    /// The least clearance of a robot's episode until now, m.
    pub fn min_clearance(&self, agent: usize) -> f32 {
        self.min_clearance[agent]
    }

    /// Behaviour token of each robot.
    pub fn tokens(&self) -> &[u32] {
        self.rooms.tokens()
    }

    /// The robots that are still in the room.
    pub fn present(&self) -> &[bool] {
        &self.present
    }

    /// A robot's observation, or its last when its episode ended in the last step. The row of one
    /// that left before means nothing.
    pub fn observation(&self, agent: usize) -> &[f32] {
        if self.rooms.transitions()[agent].end.is_running() {
            let width = self.rooms.config().observation_len();
            return &self.rooms.observations()[agent * width..][..width];
        }
        self.rooms.final_observation(agent)
    }

    /// One control period. Robots whose episode ends in it leave the room. The actions of robots
    /// that have left are not looked at.
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
        for agent in (0..n).filter(|agent| self.present[*agent]) {
            self.min_clearance[agent] = self.min_clearance[agent].min(self.whereabouts(agent).clearance);
        }
        self.actions.push(executed);
        for agent in 0..n {
            if !self.rooms.transitions()[agent].end.is_running() {
                self.present[agent] = false;
                self.rooms.remove(agent);
            }
        }
        Ok(self.rooms.transitions())
    }

    /// The room from above: each robot that is there with its goal, in a colour of its own.
    pub fn picture(&self) -> Picture {
        let (mut painter, sim) = (Painter::new(&self.scenario), self.config());
        let body = Shape::Box { length: sim.robot.length, width: sim.robot.width };
        let there = || (0..self.present.len()).filter(|agent| self.present[*agent]);
        for agent in there() {
            let at = self.whereabouts(agent);
            painter.goal(at.goal, sim.episode.goal_radius, ROBOTS[agent % ROBOTS.len()]);
        }
        for agent in there() {
            painter.body(&body, self.whereabouts(agent).pose, ROBOTS[agent % ROBOTS.len()]);
        }
        painter.finish()
    }

    /// The least and the largest observation row.
    pub fn bounds(&self) -> [Vec<f32>; 2] {
        bounds(self.rooms.config(), &self.scenario)
    }
}
