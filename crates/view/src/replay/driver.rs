//! Drivers of a replay's robot, with what a reader wants to know of them.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, ensure};
use jostle_arena::room::RoomPlan;
use jostle_arena::{LoadedPolicy, Planner, Robot};

use jostle_runs::policies;

/// A trained policy or a planner, as a page names it.
pub struct Driver {
    /// Its name on a page.
    pub name: String,
    /// A reader's note on it: sizes, training, token.
    pub note: String,
    /// `None` for a planner, which has none.
    pub token: Option<u32>,
    who: jostle_arena::Driver,
}

impl Driver {
    /// A checkpoint, a run folder's newest checkpoint, or a planner.
    pub fn open(path: &Path, token: u32) -> Result<Self> {
        let who = policies::driver(path)?;
        let policy = match &who {
            jostle_arena::Driver::Planner(planner) => {
                ensure!(token == 0, "token: found {token}, expected 0: {planner} knows no behaviours");
                return Ok(Self::planner(*planner));
            }
            jostle_arena::Driver::Trained(policy) => policy,
        };
        let provenance = &policy.file.provenance;
        let mut note = format!(
            "M = {}, {} updates, seed {}, token {token}",
            policy.file.network.n_behaviours, provenance.update, provenance.seed
        );
        if let Ok(sim) = policy.sim_config()
            && !sim.laser.is_full_circle()
        {
            let _ = write!(note, ", its laser sees {}", sim.laser.view());
        }
        Ok(Self { name: policy.identity.name.clone(), note, token: Some(token), who })
    }

    /// A planner.
    pub fn planner(planner: Planner) -> Self {
        let note = format!("not learned: {}", planner.description());
        Self {
            name: planner.name().to_owned(),
            note,
            token: None,
            who: jostle_arena::Driver::Planner(planner),
        }
    }

    /// The trained policy, if it is one.
    pub fn policy(&self) -> Option<&LoadedPolicy> {
        self.who.trained()
    }

    /// The robot, ready to act in the plan's rooms.
    pub fn robot(&self, plan: &RoomPlan) -> Result<Box<dyn Robot>> {
        self.robot_with(self.token.unwrap_or(0), plan)
    }

    /// The robot with another token than the driver's own; a planner knows none.
    pub fn robot_with(&self, token: u32, plan: &RoomPlan) -> Result<Box<dyn Robot>> {
        Ok(self.who.robot(self.token.map_or(0, |_| token), plan)?)
    }
}
