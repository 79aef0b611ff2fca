//! Robots that were not learned, by name: what a learned policy is to be measured against. Not of
//! the paper.
//!
//! Reading order: this file (names), [`reader`] and [`each_row`] (what a planner of the row is),
//! [`each_room`] (one that knows where everyone is), one file for each planner, [`tracks`] (what
//! moves in a scan).
//!
//! Architecture invariant: a planner has no memory of earlier steps, as the learned policies have
//! none beyond the three scans of the row.

mod brake;
mod dwa;
pub mod each_room;
pub mod each_row;
mod goal_seeker;
mod orca;
pub mod reader;
mod rollouts;
#[cfg(test)]
pub(crate) mod scene;
mod social_force;
mod steering;
mod straight;
pub mod tracks;

use std::fmt;
use std::str::FromStr;

use jostle_policy::did_you_mean;
use jostle_sim::SimConfig;

pub use brake::Brake;
pub use dwa::{Dwa, DwaConfig, DwaScratch};
pub use goal_seeker::GoalSeeker;
pub use orca::{OrcaRobot, OrcaRobotConfig};
pub use social_force::{SocialForceRobot, SocialForceRobotConfig};
pub use straight::Straight;

use self::each_room::EachRoom;
use self::each_row::EachRow;
use crate::error::ArenaError;
use crate::identity::{PolicyIdentity, hex_sha256};
use crate::robot::{Robot, RobotPolicy};
use crate::room::RoomPlan;

/// A planner by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Planner {
    /// To the goal as if nobody were there.
    Straight,
    /// To the goal, more slowly the nearer something is ahead.
    Brake,
    /// To the free direction nearest to the goal's.
    GoalSeeker,
    /// A dynamic window among things that move.
    Dwa,
    /// Optimal reciprocal collision avoidance; knows positions.
    Orca,
    /// Social forces; knows positions.
    SocialForce,
}

impl Planner {
    /// All of them: those of the observation row, the simplest first, then those that know
    /// positions.
    pub const ALL: [Self; 6] =
        [Self::Straight, Self::Brake, Self::GoalSeeker, Self::Dwa, Self::Orca, Self::SocialForce];

    /// Those that have a row in the tables of `reproduce`. `brake` has none: it is `straight` with
    /// a slower approach, and shows nothing that the other two do not.
    pub const IN_TABLES: [Self; 5] =
        [Self::Straight, Self::GoalSeeker, Self::Dwa, Self::Orca, Self::SocialForce];

    /// Its name wherever a policy is named.
    pub fn name(self) -> &'static str {
        match self {
            Self::Straight => "straight",
            Self::Brake => "brake",
            Self::GoalSeeker => "goal-seeker",
            Self::Dwa => "dwa",
            Self::Orca => "orca",
            Self::SocialForce => "social-force",
        }
    }

    /// Its method, in a line.
    pub fn description(self) -> &'static str {
        match self {
            Self::Straight => "drives to its goal as if nobody were there",
            Self::Brake => "turns to its goal and slows down for what is near ahead",
            Self::GoalSeeker => "turns to the free direction nearest to its goal",
            Self::Dwa => "rolls out commands among things whose velocities it reads from the last two scans",
            Self::Orca => "optimal reciprocal collision avoidance; knows everyone's position and velocity",
            Self::SocialForce => "social forces; knows everyone's position and velocity",
        }
    }

    /// True if it reads everyone's true position and velocity, which no laser tells, instead of the
    /// observation row.
    pub fn knows_positions(self) -> bool {
        matches!(self, Self::Orca | Self::SocialForce)
    }

    /// Its name as tables have it: whoever knows positions says so.
    pub fn label(self) -> String {
        if self.knows_positions() { format!("{self} (knows positions)") } else { self.to_string() }
    }

    /// Raised whenever the planner may act otherwise on some row with the same settings: stored
    /// episodes are then not used again.
    fn version(self) -> u32 {
        match self {
            Self::Straight | Self::Brake | Self::GoalSeeker | Self::Dwa | Self::Orca | Self::SocialForce => 1,
        }
    }

    /// The settings that it is run with, as JSON.
    fn settings(self) -> String {
        let json = match self {
            Self::Straight | Self::Brake | Self::GoalSeeker => Ok(String::new()),
            Self::Dwa => serde_json::to_string(&DwaConfig::default()),
            Self::Orca => serde_json::to_string(&OrcaRobotConfig::default()),
            Self::SocialForce => serde_json::to_string(&SocialForceRobotConfig::default()),
        };
        json.expect("plain settings are always JSON")
    }

    /// Its identity in records and reports: a function of its name, its version and its settings.
    pub fn identity(self) -> PolicyIdentity {
        let settings = hex_sha256(self.settings().as_bytes());
        PolicyIdentity::custom(self.name(), &format!("planner {} {settings}", self.version()))
    }

    /// The planner as a function of observation rows.
    ///
    /// # Errors
    ///
    /// [`ArenaError::KnowsPositions`] for a planner that reads more than rows.
    pub fn policy(self, sim: &SimConfig) -> Result<Box<dyn RobotPolicy>, ArenaError> {
        Ok(match self {
            Self::Straight => Box::new(EachRow::new(Straight::new(sim))),
            Self::Brake => Box::new(EachRow::new(Brake::new(sim))),
            Self::GoalSeeker => Box::new(EachRow::new(GoalSeeker::new(sim))),
            Self::Dwa => Box::new(EachRow::new(Dwa::new(sim, DwaConfig::default())?)),
            Self::Orca | Self::SocialForce => {
                return Err(ArenaError::KnowsPositions { planner: self.name() });
            }
        })
    }

    /// The planner as the robot of a plan's rooms.
    ///
    /// # Errors
    ///
    /// Walls or obstacles that the models of ORCA and social force refuse.
    pub fn robot(self, plan: &RoomPlan) -> Result<Box<dyn Robot>, ArenaError> {
        Ok(match self {
            Self::Orca => Box::new(EachRoom::new(OrcaRobot::new(plan, &OrcaRobotConfig::default())?)),
            Self::SocialForce => {
                Box::new(EachRoom::new(SocialForceRobot::new(plan, &SocialForceRobotConfig::default())?))
            }
            _ => Box::new(self.policy(&plan.config.sim)?),
        })
    }
}

impl fmt::Display for Planner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Planner {
    type Err = ArenaError;

    /// # Errors
    ///
    /// [`ArenaError::UnknownPlanner`] with the names that are most like it.
    fn from_str(name: &str) -> Result<Self, ArenaError> {
        let unknown = || ArenaError::UnknownPlanner {
            name: name.to_owned(),
            hint: did_you_mean(name, Self::ALL.map(Self::name)),
        };
        Self::ALL.into_iter().find(|planner| planner.name() == name).ok_or_else(unknown)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_read_back_and_slips_are_answered_with_the_nearest() {
        for planner in Planner::ALL {
            assert_eq!(planner.to_string().parse::<Planner>().unwrap(), planner);
        }
        let message = "dwb".parse::<Planner>().unwrap_err().to_string();
        assert_eq!(
            message,
            "planner: found dwb, expected straight, brake, goal-seeker, dwa, orca or social-force; did you mean dwa?"
        );
    }

    #[test]
    fn identities_differ_and_do_not_change_by_themselves() {
        let hashes: BTreeSet<String> = Planner::ALL.iter().map(|planner| planner.identity().sha256).collect();
        assert_eq!(hashes.len(), Planner::ALL.len());
        // Stored cells are found by these.
        let straight = PolicyIdentity::custom("straight", &format!("planner 1 {}", hex_sha256(b"")));
        assert_eq!(Planner::Straight.identity(), straight);
    }

    #[test]
    fn who_knows_positions_says_so_and_drives_no_rows() {
        assert_eq!(Planner::Orca.label(), "orca (knows positions)");
        assert_eq!(Planner::Dwa.label(), "dwa");
        for planner in [Planner::Orca, Planner::SocialForce] {
            let refused = planner.policy(&SimConfig::default()).map(|_| ()).unwrap_err().to_string();
            assert!(refused.starts_with(&format!("planner {planner}: found observation rows")), "{refused}");
        }
    }

    #[test]
    fn a_batch_is_planned_for_row_by_row() {
        let sim = SimConfig::default();
        let scenes = [
            scene::Scene::empty(),
            scene::Scene::empty().with_disc([1.2, 0.2], 0.3),
            scene::Scene::empty().with_goal(-3.0, 2.0),
        ];
        for planner in Planner::ALL.into_iter().filter(|planner| !planner.knows_positions()) {
            let mut policy = planner.policy(&sim).unwrap();
            let alone: Vec<[f32; 2]> = scenes
                .iter()
                .map(|scene| {
                    let mut action = [[9.0; 2]];
                    policy.act(&scene.row(), &mut action);
                    action[0]
                })
                .collect();
            let rows: Vec<f32> = (0..60).flat_map(|k| scenes[k % 3].row()).collect();
            let mut actions = [[9.0; 2]; 60];
            policy.act(&rows, &mut actions);
            let expected: Vec<[f32; 2]> = (0..60).map(|k| alone[k % 3]).collect();
            assert_eq!(actions.to_vec(), expected, "{planner}");
        }
    }
}
