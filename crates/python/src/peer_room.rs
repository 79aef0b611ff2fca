//! Episodes of the test for a robot that another simulator moves: the pedestrians and the robot's
//! observations are here, its wheels and its laser are there.

use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::{PolicyIdentity, RoomStepper};
use jostle_eval::{EvalError, Protocol, Subject};
use jostle_peds::Crowd;
use jostle_sim::{Laser, Pose};

use crate::settings::Settings;

/// The call that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    Begin,
    Look,
    Walk,
    Follow,
}

impl Due {
    fn name(self) -> &'static str {
        match self {
            Self::Begin => "begin",
            Self::Look | Self::Follow => "observe",
            Self::Walk => "walk",
        }
    }
}

/// One room at a time.
pub struct PeerRoom {
    protocol: Protocol,
    plan: RoomPlan,
    crowd: Box<dyn Crowd>,
    laser: Laser,
    stepper: RoomStepper,
    room: ArenaRoom,
    due: Due,
}

impl PeerRoom {
    /// Rooms of these settings; `respawn_clearance` (m) replaces the usual one.
    ///
    /// # Errors
    ///
    /// A crowd without its policies; a room that is too small; a robot that has mass here as well.
    pub fn new(mut settings: Settings, respawn_clearance: Option<f32>) -> Result<Self, EvalError> {
        let config = &mut settings.config;
        config.respawn_clearance = respawn_clearance.unwrap_or(config.respawn_clearance);
        config.check_robot_moves_elsewhere()?;
        let protocol = Protocol::new(settings.config, settings.pools)?;
        let plan = RoomPlan::new(protocol.config(), settings.crowd)?;
        let crowd = protocol.crowd(&plan)?;
        let laser = Laser::new(&plan.config.sim.laser)?;
        let room = ArenaRoom::new(&plan, &laser, 0)?;
        let stepper = RoomStepper::default();
        Ok(Self { protocol, plan, crowd, laser, stepper, room, due: Due::Begin })
    }

    /// What all episodes have in common.
    pub fn plan(&self) -> &RoomPlan {
        &self.plan
    }

    /// The room as it is now.
    pub fn room(&self) -> &ArenaRoom {
        &self.room
    }

    /// Hash of all settings that decide an episode, by which a cell of a table is known.
    pub fn settings_hash(&self) -> String {
        let identity = PolicyIdentity::custom("", "");
        self.protocol.key(Subject { identity: &identity, token: 0 }, self.plan.crowd).settings
    }

    /// Goes to the start of an episode of the test of a seed.
    ///
    /// # Errors
    ///
    /// As [`ArenaRoom::seeded`].
    pub fn begin(&mut self, seed: u64, episode: u64) -> Result<(), EvalError> {
        self.room = ArenaRoom::seeded(&self.plan, &self.laser, seed, episode)?;
        self.due = Due::Look;
        Ok(())
    }

    /// Moves the pedestrians for a control period.
    ///
    /// # Errors
    ///
    /// Refusals of the crowd; a call out of turn.
    pub fn walk(&mut self) -> Result<(), EvalError> {
        self.expect("walk", &[Due::Walk])?;
        self.stepper.walk(&self.plan, &mut *self.crowd, &mut self.room)?;
        self.due = Due::Follow;
        Ok(())
    }

    /// The robot as the other simulator has it: at the episode's start, or at the end of the
    /// control period in which the pedestrians have walked.
    ///
    /// # Errors
    ///
    /// As [`ArenaRoom::follow`]; a call out of turn.
    pub fn observe(&mut self, pose: Pose, velocity: [f32; 2], ranges: &[f32]) -> Result<(), EvalError> {
        self.expect("observe", &[Due::Look, Due::Follow])?;
        if self.due == Due::Look {
            self.room.look(&self.plan, ranges)?;
        } else {
            self.room.follow(&self.plan, pose, velocity, ranges)?;
        }
        self.due = Due::Walk;
        Ok(())
    }

    fn expect(&self, call: &'static str, due: &[Due]) -> Result<(), EvalError> {
        if due.contains(&self.due) {
            return Ok(());
        }
        let (found, expected) = ("a call out of turn".to_owned(), format!("{} next", self.due.name()));
        Err(EvalError::Setting { field: call, found, expected })
    }
}
