//! Training crowds: agents of a training room that are not learners, drawn anew for each episode of
//! each agent.
//!
//! With everything at its default every agent is a learner, in a room that stays as it is, and no
//! number is drawn. Otherwise each episode of each agent begins with a draw of its [`Role`], from
//! the agent's own stream `training_crowd`: by the shares of [`TrainingCrowd`] it is a member of
//! the crowd for that episode, else a learner. A member has the crowd's speed; a learner is always
//! the robot of the configuration. The first agent of each room always learns, so that no room is
//! without a learner.
//!
//! Changes for learners and members alike, in obstacles and the number of agents, are drawn for
//! the room (`renewal`). Rooms may also have maps of their own (`maps`).
//!
//! # Rules for members
//!
//! - A seeing or blind member is driven by the present policy, an opponent by a frozen one; a
//!   walker by a rule ([`Traits::walk`]): it turns on the spot until it faces its goal and goes
//!   straight on, whoever is in its way. Walkers sense nothing and have no rule of crashing.
//! - A blind member's laser shows walls and obstacles only, and so does its rule of crashing. A
//!   learner in its way sees it come and crashes by its own scan; the blind one goes on.
//! - Bodies never overlap, so a member that does not look stands still where it meets another
//!   member. Whoever has been stopped for `stall_limit` steps in a row ends its episode there, as a
//!   collision with what stopped it.
//! - Goal and time limit end a member's episode like a learner's. With `walk_on` a member that
//!   reaches its goal gets another and walks on, and now and then one changes its mind on the way
//!   (`new_goal_every`), as people do; with `turn_at_once` it faces its new goal at once, as people
//!   on two legs can. If its body has no room to turn, it turns as it drives.

use crate::config::check::within;
use crate::config::{NamingFolder, RobotConfig, SimConfig};
use crate::error::SimError;
use crate::geometry::Pose;
use glam::Vec2;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The agents that share the training rooms with the learners; the `[training_crowd]` part of a
/// training file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct TrainingCrowd {
    /// Share of agents that are blind for an episode: driven by the present policy, by a laser that
    /// shows walls and obstacles but no other agent. Nothing is learned from them. The first agent
    /// of a room is never one. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub blind: f32,
    /// Share of agents that are, for an episode, driven by the present policy and see everyone, but
    /// at the crowd's speed. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub seeing: f32,
    /// Share of agents that walk straight to their goal for an episode, at a constant speed,
    /// whoever is in their way: they follow a rule, no policy. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub straight: f32,
    /// Share of agents that walk as the straight ones do, but stand still every now and then.
    /// Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub stop_and_go: f32,
    /// Share of agents that stand still for a whole episode. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub standing: f32,
    /// Share of agents that are driven for an episode by a frozen policy of the `population`. They
    /// see everyone. Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1.0)))]
    pub opponents: f32,
    /// Least factor on the linear velocity that a member of the crowd executes; uniform up to
    /// `speed_max`, drawn for each episode. A walker's speed is this times `sim.robot.v_max`.
    /// Learners keep theirs. Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 100.0)))]
    pub speed_min: f32,
    /// Largest factor on the linear velocity that a member of the crowd executes. Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 100.0)))]
    pub speed_max: f32,
    /// Least time that a stop-and-go walker walks or stands, s; uniform up to `phase_max`, drawn
    /// for each walk and each stop. Default 0.5.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "s")))]
    pub phase_min: f32,
    /// Longest time that a stop-and-go walker walks or stands, s. Default 4.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1000.0, "unit" = "s")))]
    pub phase_max: f32,
    /// Lets a member that reaches its goal walk on to another one; else its episode ends there.
    /// Default false.
    pub walk_on: bool,
    /// Mean time after which a member that walks on changes its goal on the way, s; 0 never.
    /// Default 0.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 1_000_000.0, "unit" = "s")))]
    pub new_goal_every: f32,
    /// Turns a member that gets a new goal on the way to it at once. Default false.
    pub turn_at_once: bool,
    /// Least factor on the length and the width of a member's body; uniform up to `size_max`, drawn
    /// for each episode. Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.1, "maximum" = 10.0)))]
    pub size_min: f32,
    /// Largest factor on the length and the width of a member's body. Above 1 all starts keep a
    /// larger distance. Default 1.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 10.0)))]
    pub size_max: f32,
    /// Fewest obstacles that are put into a room; uniform up to `obstacles_max`. Default 0.
    pub obstacles_min: u32,
    /// Most obstacles that are put into a room: discs and boxes at random places, seen by everyone.
    /// One that finds no place clear of bodies and goals is left out. Default 0.
    pub obstacles_max: u32,
    /// Least extent of an obstacle: a disc's diameter, a box's length and width, m. Default 0.3.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.01, "maximum" = 100.0, "unit" = "m")))]
    pub obstacle_size_min: f32,
    /// Largest extent of an obstacle, m. Default 1.5.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 0.0, "maximum" = 100.0, "unit" = "m")))]
    pub obstacle_size_max: f32,
    /// Fewest agents in a room at a time; uniform up to `n_agents`. 0 keeps all of them there.
    /// Default 0.
    pub agents_min: u32,
    /// Steps after which a room draws its obstacles and its number of agents anew; agents leave as
    /// their episodes end. Default 2000.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1)))]
    pub renew_steps: u32,
    /// A member that something has stopped for this many steps in a row ends its episode. Default
    /// 10: a second.
    #[cfg_attr(feature = "schema", schemars(extend("minimum" = 1)))]
    pub stall_limit: u32,
    /// Maps that are dealt to the training rooms in turn, in place of `sim.room`: at most as many
    /// as there are rooms. Files as for `sim.room.map`, whose rules for relative paths hold here,
    /// too. A test knows nothing of them. Default none.
    pub maps: Vec<PathBuf>,
    /// The folder that relative `maps` start from.
    #[doc(hidden)]
    #[serde(skip)]
    pub folder: NamingFolder,
}

impl Default for TrainingCrowd {
    fn default() -> Self {
        Self {
            blind: 0.0,
            seeing: 0.0,
            straight: 0.0,
            stop_and_go: 0.0,
            standing: 0.0,
            opponents: 0.0,
            speed_min: 1.0,
            speed_max: 1.0,
            phase_min: 0.5,
            phase_max: 4.0,
            walk_on: false,
            new_goal_every: 0.0,
            turn_at_once: false,
            size_min: 1.0,
            size_max: 1.0,
            obstacles_min: 0,
            obstacles_max: 0,
            obstacle_size_min: 0.3,
            obstacle_size_max: 1.5,
            agents_min: 0,
            renew_steps: 2000,
            stall_limit: 10,
            maps: Vec::new(),
            folder: NamingFolder::default(),
        }
    }
}

impl TrainingCrowd {
    /// True if all agents are learners, always, in a room that stays as it is and is that of
    /// `sim.room`.
    pub fn is_off(&self) -> bool {
        !self.has_members() && !self.renews() && self.maps.is_empty()
    }

    /// True if some agents are no learners.
    fn has_members(&self) -> bool {
        self.shares().iter().any(|(_, share, _)| *share > 0.0)
    }

    /// True if rooms change in obstacles or in their number of agents.
    pub(crate) fn renews(&self) -> bool {
        self.obstacles_max > 0 || self.agents_min > 0
    }

    /// True if some bodies are larger or smaller than a robot's.
    pub(crate) fn resizes(&self) -> bool {
        self.has_members() && (self.size_min, self.size_max) != (1.0, 1.0)
    }

    /// The configuration as far as starts and goals go: clearances grow with the largest body, and
    /// leave the same room around it.
    pub(crate) fn roomy(&self, config: &SimConfig) -> SimConfig {
        let mut roomy = config.clone();
        if self.resizes() && self.size_max > 1.0 {
            let more = config.robot.circumradius() * (self.size_max - 1.0);
            roomy.robot.length *= self.size_max;
            roomy.robot.width *= self.size_max;
            roomy.spawn.wall_clearance += more;
            roomy.spawn.body_clearance = (config.spawn.body_clearance + more).max(roomy.body_clearance_min());
        }
        roomy
    }

    /// The share of agents that have each role, with its key. The order is that of the draw: new
    /// ones come last, so that a crowd without them is drawn as ever.
    pub fn shares(&self) -> [(&'static str, f32, Role); 6] {
        [
            ("blind", self.blind, Role::Blind),
            ("seeing", self.seeing, Role::Seeing),
            ("straight", self.straight, Role::Straight),
            ("stop_and_go", self.stop_and_go, Role::StopAndGo),
            ("standing", self.standing, Role::Standing),
            ("opponents", self.opponents, Role::Opponent),
        ]
    }

    /// Checks that a run of so many rooms has one for each map.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] for `maps` when there are more of them.
    pub fn check_rooms(&self, n_rooms: usize) -> Result<(), SimError> {
        if self.maps.len() > n_rooms {
            let found = format!("{} maps", self.maps.len());
            return Err(SimError::field("maps", found, format!("at most n_rooms = {n_rooms}")));
        }
        Ok(())
    }

    /// Checks every field.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        let mut sum = 0.0;
        for (field, share, _) in self.shares() {
            within(field, share, 0.0, 1.0)?;
            sum += share;
            // Ten shares of 0.1 may add up to a little more.
            if sum > 1.0 + 1e-6 {
                let expected = format!("at most {}: all shares together at most 1", 1.0 - (sum - share));
                return Err(SimError::field(field, share, expected));
            }
        }
        ordered(("speed_min", self.speed_min), ("speed_max", self.speed_max), 100.0)?;
        ordered(("phase_min", self.phase_min), ("phase_max", self.phase_max), 1000.0)?;
        within("new_goal_every", self.new_goal_every, 0.0, 1e6)?;
        within("size_min", self.size_min, 0.1, 10.0)?;
        ordered(("size_min", self.size_min), ("size_max", self.size_max), 10.0)?;
        within("obstacle_size_min", self.obstacle_size_min, 0.01, 100.0)?;
        let sizes =
            [("obstacle_size_min", self.obstacle_size_min), ("obstacle_size_max", self.obstacle_size_max)];
        ordered(sizes[0], sizes[1], 100.0)?;
        if self.obstacles_max > OBSTACLES_MAX {
            let expected = format!("an integer in [0, {OBSTACLES_MAX}]");
            return Err(SimError::field("obstacles_max", self.obstacles_max, expected));
        }
        if self.obstacles_min > self.obstacles_max {
            let expected = format!("at most obstacles_max = {}", self.obstacles_max);
            return Err(SimError::field("obstacles_min", self.obstacles_min, expected));
        }
        if self.renew_steps == 0 {
            return Err(SimError::field("renew_steps", 0, "at least 1"));
        }
        if self.stall_limit == 0 {
            return Err(SimError::field("stall_limit", 0, "at least 1"));
        }
        Ok(())
    }

    /// Draws who an agent is for one episode.
    pub(crate) fn draw(&self, rng: &mut impl Rng) -> Traits {
        let mut share: f32 = rng.random();
        let drawn = self.shares().into_iter().find_map(|(_, of_role, role)| {
            share -= of_role;
            (share < 0.0).then_some(role)
        });
        let Some(role) = drawn else { return Traits::default() };
        let speed = rng.random_range(self.speed_min..=self.speed_max);
        let stands = role == Role::StopAndGo && rng.random();
        let opponent = if role == Role::Opponent { rng.random() } else { 0 };
        let size = if self.resizes() { rng.random_range(self.size_min..=self.size_max) } else { 1.0 };
        Traits { role, speed, stands, opponent, size, ..Traits::default() }
    }

    /// True if a member changes its goal on the way in a step of `dt` (s). Draws nothing where none
    /// ever does.
    pub(crate) fn changes_goal(&self, dt: f32, rng: &mut impl Rng) -> bool {
        self.walk_on && self.new_goal_every > 0.0 && rng.random::<f32>() < dt / self.new_goal_every
    }

    /// Steps of a walk or a stop.
    fn phase(&self, dt: f32, rng: &mut impl Rng) -> u32 {
        let seconds = rng.random_range(self.phase_min..=self.phase_max);
        // The cast saturates.
        ((seconds / dt).round() as u32).max(1)
    }
}

/// `low` and `high` must lie in [0, most], in that order.
fn ordered(low: (&str, f32), high: (&str, f32), most: f32) -> Result<(), SimError> {
    within(low.0, low.1, 0.0, most)?;
    within(high.0, high.1, 0.0, most)?;
    if high.1 < low.1 {
        return Err(SimError::field(high.0, high.1, format!("at least {} = {}", low.0, low.1)));
    }
    Ok(())
}

/// Most obstacles that a crowd may put into a room.
const OBSTACLES_MAX: u32 = 1000;

/// A walker goes forward while its goal is no further than this from straight ahead, rad.
const FACING: f32 = 0.1;

/// The role of an agent for one episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Driven by the policy that learns from what it does.
    #[default]
    Learner,
    /// Driven by the present policy; sees no other agent.
    Blind,
    /// Driven by the present policy; sees everyone.
    Seeing,
    /// Walks straight to its goal.
    Straight,
    /// Walks straight to its goal, with stops.
    StopAndGo,
    /// Does not move.
    Standing,
    /// Driven by a frozen policy; sees everyone.
    Opponent,
    /// Not in the room.
    Absent,
}

impl Role {
    /// True if the policy learns from what the agent does.
    pub fn learns(self) -> bool {
        self == Self::Learner
    }

    /// True if a policy drives the agent: it then has a laser, and the rule of crashing holds for
    /// it.
    pub fn has_policy(self) -> bool {
        matches!(self, Self::Learner | Self::Blind | Self::Seeing | Self::Opponent)
    }

    /// True if that policy is the present one.
    pub fn has_present_policy(self) -> bool {
        matches!(self, Self::Learner | Self::Blind | Self::Seeing)
    }

    /// True if the agent's laser shows other agents.
    pub(crate) fn sees_agents(self) -> bool {
        self != Self::Blind
    }
}

/// One agent's traits in its present episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Traits {
    pub(crate) role: Role,
    /// Factor on the linear velocity; exactly 1 for a learner.
    pub(crate) speed: f32,
    /// Steps in a row, up to the last one, in which a member was stopped by what was in its way; 0
    /// for a learner.
    pub(crate) stalled_steps: u32,
    /// True while a stop-and-go walker stands.
    #[serde(default)]
    pub(crate) stands: bool,
    /// For how many steps more it goes on with that.
    #[serde(default)]
    pub(crate) phase_steps: u32,
    /// Chooses among the frozen policies: uniform over all numbers for an opponent, else 0.
    #[serde(default)]
    pub(crate) opponent: u32,
    /// Factor on length and width of the body; exactly 1 for a learner.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub(crate) size: f32,
}

fn one() -> f32 {
    1.0
}

#[allow(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "serde passes a reference")]
fn is_one(value: &f32) -> bool {
    *value == 1.0
}

impl Default for Traits {
    fn default() -> Self {
        Self {
            role: Role::Learner,
            speed: 1.0,
            stalled_steps: 0,
            stands: false,
            phase_steps: 0,
            opponent: 0,
            size: 1.0,
        }
    }
}

impl Traits {
    /// The command that an agent executes for the clipped action.
    pub(crate) fn command(&self, [v, w]: [f32; 2]) -> [f32; 2] {
        if self.role.learns() { [v, w] } else { [v * self.speed, w] }
    }

    /// The action of a walker: at `v_max`, on which its speed is a factor, once it faces its goal,
    /// till then a turn towards it.
    pub(crate) fn walk(
        &mut self,
        crowd: &TrainingCrowd,
        (pose, goal): (Pose, Vec2),
        robot: &RobotConfig,
        dt: f32,
        rng: &mut impl Rng,
    ) -> [f32; 2] {
        if self.role == Role::StopAndGo {
            if self.phase_steps == 0 {
                self.stands = !self.stands;
                self.phase_steps = crowd.phase(dt, rng);
            }
            self.phase_steps -= 1;
        }
        if self.role == Role::Standing || self.stands {
            return [0.0, 0.0];
        }
        let goal_in_robot = pose.point_in_frame(goal);
        let bearing = libm::atan2f(goal_in_robot.y, goal_in_robot.x);
        let v = if bearing.abs() <= FACING { robot.v_max } else { 0.0 };
        [v, (bearing / dt).clamp(-robot.w_max, robot.w_max)]
    }

    /// Counts a step in which the agent was stalled, or not.
    pub(crate) fn count_stall(&mut self, stalled: bool) {
        let goes_on = stalled && !self.role.learns();
        self.stalled_steps = if goes_on { self.stalled_steps.saturating_add(1) } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Streams;

    #[test]
    fn shares_and_speeds_are_those_of_the_configuration() {
        let crowd = TrainingCrowd { blind: 0.4, speed_min: 0.5, speed_max: 1.5, ..TrainingCrowd::default() };
        let mut rng = Streams::new(3).stream("training_crowd", &[0, 1]);
        let drawn: Vec<Traits> = (0..10_000).map(|_| crowd.draw(&mut rng)).collect();
        let blind: Vec<f32> =
            drawn.iter().filter(|traits| traits.role == Role::Blind).map(|traits| traits.speed).collect();
        // Five standard deviations of the share are 0.0245; of the mean of 4000 speeds, 0.023.
        let share = blind.len() as f32 / 10_000.0;
        assert!((share - 0.4).abs() < 0.0245, "{share}");
        let mean = blind.iter().sum::<f32>() / blind.len() as f32;
        assert!((mean - 1.0).abs() < 0.023, "{mean}");
        assert!(blind.iter().all(|speed| (0.5..=1.5).contains(speed)));
        let learners = drawn.iter().filter(|traits| traits.role.learns());
        assert!(learners.into_iter().all(|traits| *traits == Traits::default()));
    }

    #[test]
    fn every_role_has_its_share_and_new_shares_move_no_old_draw() {
        let crowd = TrainingCrowd {
            blind: 0.2,
            seeing: 0.1,
            straight: 0.15,
            stop_and_go: 0.1,
            standing: 0.05,
            opponents: 0.1,
            ..TrainingCrowd::default()
        };
        assert_eq!(crowd.validate(), Ok(()));
        let draw = |crowd: &TrainingCrowd, episode| {
            crowd.draw(&mut Streams::new(3).stream("training_crowd", &[episode]))
        };
        let drawn: Vec<Traits> = (0..10_000).map(|episode| draw(&crowd, episode)).collect();
        for (key, share, role) in crowd.shares() {
            let found = drawn.iter().filter(|traits| traits.role == role).count() as f32 / 10_000.0;
            // Five standard deviations of a share of 0.2.
            assert!((found - share).abs() < 0.02, "{key}: {found}");
        }
        let numbers: Vec<u32> = drawn
            .iter()
            .filter(|traits| traits.role == Role::Opponent)
            .map(|traits| traits.opponent)
            .collect();
        let upper_half = numbers.iter().filter(|number| **number >= 1 << 31).count();
        assert!((400..600).contains(&upper_half), "half of the opponents: {upper_half}");
        let stands = drawn.iter().filter(|traits| traits.stands).count();
        assert!((400..600).contains(&stands), "half of the stop-and-go walkers: {stands}");
        let blind = TrainingCrowd { blind: 0.2, ..TrainingCrowd::default() };
        for (episode, traits) in (0..).zip(&drawn).filter(|(_, traits)| traits.role == Role::Blind) {
            assert_eq!(draw(&blind, episode), *traits);
        }
    }

    #[test]
    fn sizes_are_the_members_alone_and_change_no_other_trait() {
        let crowd = TrainingCrowd { blind: 0.5, speed_min: 0.5, speed_max: 1.5, ..TrainingCrowd::default() };
        let sized = TrainingCrowd { size_min: 0.6, size_max: 1.4, ..crowd.clone() };
        let rng = |episode: u64| Streams::new(3).stream("training_crowd", &[episode]);
        let drawn: Vec<Traits> = (0..2_000).map(|episode| sized.draw(&mut rng(episode))).collect();
        for (episode, traits) in (0..).zip(&drawn) {
            assert_eq!(Traits { size: 1.0, ..*traits }, crowd.draw(&mut rng(episode)));
            assert!(!traits.role.learns() || *traits == Traits::default());
        }
        let sizes: Vec<f32> = drawn.iter().filter(|t| !t.role.learns()).map(|t| t.size).collect();
        let mean = sizes.iter().sum::<f32>() / sizes.len() as f32;
        assert!(sizes.iter().all(|size| (0.6..=1.4).contains(size)) && (mean - 1.0).abs() < 0.05, "{mean}");
    }

    /// The actions of so many steps of a walker that stands in the origin with its goal at (0, 5).
    fn actions(mut traits: Traits, heading: f32, n_steps: usize) -> Vec<[f32; 2]> {
        let crowd = TrainingCrowd { phase_min: 0.2, phase_max: 0.2, ..TrainingCrowd::default() };
        let (robot, mut rng) = (RobotConfig::default(), Streams::new(3).stream("training_crowd", &[]));
        let way = (Pose::new(Vec2::ZERO, heading), Vec2::new(0.0, 5.0));
        (0..n_steps).map(|_| traits.walk(&crowd, way, &robot, 0.1, &mut rng)).collect()
    }

    #[test]
    fn walkers_turn_on_the_spot_and_go_straight() {
        let straight = Traits { role: Role::Straight, ..Traits::default() };
        let left = std::f32::consts::FRAC_PI_2;
        assert_eq!(actions(straight, 0.0, 1), [[0.0, 1.0]]);
        assert_eq!(actions(straight, left + 1.0, 1), [[0.0, -1.0]]);
        assert_eq!(actions(straight, left, 1)[0][0], 1.0);
        // What is left to turn is turned in one step, while it walks.
        let [v, w] = actions(straight, left - 0.05, 1)[0];
        assert!(v == 1.0 && (w - 0.5).abs() < 1e-4, "{v} {w}");
        assert_eq!(actions(Traits { role: Role::Standing, ..straight }, 0.0, 2), [[0.0; 2]; 2]);
    }

    #[test]
    fn stop_and_go_walkers_walk_and_stand_in_turns() {
        let walker = Traits { role: Role::StopAndGo, stands: true, ..Traits::default() };
        let speeds: Vec<f32> =
            actions(walker, std::f32::consts::FRAC_PI_2, 8).iter().map(|action| action[0]).collect();
        assert_eq!(speeds, [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let turns = actions(walker, 0.0, 4).iter().filter(|action| action[1] != 0.0).count();
        assert_eq!(turns, 2, "whoever stands does not turn");
    }

    #[test]
    fn messages_name_field_found_and_expected() {
        let check = |crowd: TrainingCrowd, expected: &str| {
            assert_eq!(crowd.validate().expect_err("out of range").to_string(), expected);
        };
        let base = TrainingCrowd::default();
        assert_eq!(base.validate(), Ok(()));
        check(TrainingCrowd { blind: 1.5, ..base.clone() }, "blind: found 1.5, expected a number in [0, 1]");
        check(
            TrainingCrowd { speed_max: f32::NAN, ..base.clone() },
            "speed_max: found NaN, expected a number in [0, 100]",
        );
        check(
            TrainingCrowd { speed_min: 1.25, ..base.clone() },
            "speed_max: found 1, expected at least speed_min = 1.25",
        );
        check(
            TrainingCrowd { phase_max: 0.25, ..base.clone() },
            "phase_max: found 0.25, expected at least phase_min = 0.5",
        );
        check(
            TrainingCrowd { blind: 0.5, seeing: 0.25, standing: 0.5, ..base.clone() },
            "standing: found 0.5, expected at most 0.25: all shares together at most 1",
        );
        check(
            TrainingCrowd { new_goal_every: -1.0, ..base.clone() },
            "new_goal_every: found -1, expected a number in [0, 1000000]",
        );
        check(
            TrainingCrowd { size_max: 0.5, ..base.clone() },
            "size_max: found 0.5, expected at least size_min = 1",
        );
        check(
            TrainingCrowd { obstacles_min: 4, obstacles_max: 3, ..base.clone() },
            "obstacles_min: found 4, expected at most obstacles_max = 3",
        );
        check(
            TrainingCrowd { obstacles_max: 1001, ..base.clone() },
            "obstacles_max: found 1001, expected an integer in [0, 1000]",
        );
        check(
            TrainingCrowd { obstacle_size_max: 0.25, ..base.clone() },
            "obstacle_size_max: found 0.25, expected at least obstacle_size_min = 0.3",
        );
        check(TrainingCrowd { renew_steps: 0, ..base.clone() }, "renew_steps: found 0, expected at least 1");
        check(TrainingCrowd { stall_limit: 0, ..base }, "stall_limit: found 0, expected at least 1");
    }

    #[test]
    fn minds_are_changed_as_often_as_the_configuration_says() {
        let mut rng = Streams::new(3).stream("training_crowd", &[]);
        let never = TrainingCrowd { walk_on: true, ..TrainingCrowd::default() };
        assert!(!(0..1000).any(|_| never.changes_goal(0.1, &mut rng)));
        assert_eq!(rng.get_word_pos(), 0, "nothing is drawn");
        let often = TrainingCrowd { new_goal_every: 2.0, ..never };
        let changes = (0..10_000).filter(|_| often.changes_goal(0.1, &mut rng)).count();
        // 10,000 steps of 0.1 s: 500 on average, five standard deviations are 109.
        assert!((391..609).contains(&changes), "{changes}");
    }

    #[test]
    fn only_members_stall() {
        let mut member = Traits { role: Role::Blind, ..Traits::default() };
        let counts = [true, true, false, true].map(|stalled| {
            member.count_stall(stalled);
            member.stalled_steps
        });
        assert_eq!(counts, [1, 2, 0, 1]);
        let mut learner = Traits::default();
        learner.count_stall(true);
        assert_eq!(learner, Traits::default());
    }

    #[test]
    fn a_member_drives_at_its_own_speed() {
        let member = Traits { role: Role::Blind, speed: 1.5, ..Traits::default() };
        assert_eq!(member.command([1.0, -0.5]), [1.5, -0.5]);
        assert_eq!(Traits::default().command([1.0, -0.5]), [1.0, -0.5]);
    }
}
