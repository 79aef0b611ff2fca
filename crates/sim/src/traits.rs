//! Training crowds: agents of a training room that are not learners, drawn anew for each episode of each agent.
//!
//! With everything at its default every agent is a learner, and no number is drawn. Otherwise each episode of each agent
//! begins with a draw of its [`Role`], from the agent's own stream "training_crowd": by the shares of [`TrainingCrowd`]
//! it is a member of the crowd for that episode, else a learner. A member has the crowd's speed; a learner is always the
//! robot of the configuration. The first agent of each room always learns, so that no room is without a learner.
//!
//! # Rules for members
//!
//! - A blind member's laser shows walls and obstacles only, and so does its rule of crashing. A learner in its way sees
//!   it come and crashes by its own scan; the blind one goes on.
//! - Bodies never overlap, so a member that does not look stands still where it meets another member. Whoever has been
//!   stopped by a body for `stall_limit` steps in a row ends its episode there, as a collision with an agent.
//! - Goal, walls and time limit end a member's episode like a learner's.

use crate::config::check::within;
use crate::error::SimError;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// Who shares the training rooms with the learners; the `[training_crowd]` part of a training file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingCrowd {
    /// Share of agents that are blind for an episode: driven by the present policy, by a laser that shows walls and
    /// obstacles but no other agent. Nothing is learned from them. The first agent of a room is never one. Default 0.
    pub blind: f32,
    /// Least factor on the linear velocity that a member of the crowd executes; uniform up to `speed_max`, drawn for
    /// each episode. Learners keep theirs. Default 1.
    pub speed_min: f32,
    /// Largest factor on the linear velocity that a member of the crowd executes. Default 1.
    pub speed_max: f32,
    /// A member that another body has stopped for this many steps in a row ends its episode. Default 10: a second.
    pub stall_limit: u32,
}

impl Default for TrainingCrowd {
    fn default() -> Self {
        Self { blind: 0.0, speed_min: 1.0, speed_max: 1.0, stall_limit: 10 }
    }
}

impl TrainingCrowd {
    /// Whether all agents are learners, always.
    pub fn is_off(&self) -> bool {
        self.blind <= 0.0
    }

    /// Checks every field.
    ///
    /// # Errors
    ///
    /// [`SimError::Field`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        within("blind", self.blind, 0.0, 1.0)?;
        within("speed_min", self.speed_min, 0.0, 100.0)?;
        within("speed_max", self.speed_max, 0.0, 100.0)?;
        if self.speed_max < self.speed_min {
            return Err(SimError::field(
                "speed_max",
                self.speed_max,
                format!("at least speed_min = {}", self.speed_min),
            ));
        }
        if self.stall_limit == 0 {
            return Err(SimError::field("stall_limit", 0, "at least 1"));
        }
        Ok(())
    }

    /// Draws who an agent is for one episode.
    pub(crate) fn draw(&self, rng: &mut impl Rng) -> Traits {
        let share: f32 = rng.random();
        if share >= self.blind {
            return Traits::default();
        }
        let speed = rng.random_range(self.speed_min..=self.speed_max);
        Traits { role: Role::Blind, speed, stalled_steps: 0 }
    }
}

/// What an agent is for one episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Driven by the policy that learns from what it does.
    #[default]
    Learner,
    /// Driven by the present policy; sees no other agent.
    Blind,
}

impl Role {
    /// Whether what the agent does is learned from.
    pub fn learns(self) -> bool {
        self == Self::Learner
    }

    /// Whether the agent's laser shows other agents.
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
    /// Steps in a row, up to the last one, in which a member was stopped by what was in its way; 0 for a learner.
    pub(crate) stalled_steps: u32,
}

impl Default for Traits {
    fn default() -> Self {
        Self { role: Role::Learner, speed: 1.0, stalled_steps: 0 }
    }
}

impl Traits {
    /// The command that an agent executes for the clipped action.
    pub(crate) fn command(&self, [v, w]: [f32; 2]) -> [f32; 2] {
        if self.role.learns() { [v, w] } else { [v * self.speed, w] }
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
        check(TrainingCrowd { stall_limit: 0, ..base }, "stall_limit: found 0, expected at least 1");
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
        let member = Traits { role: Role::Blind, speed: 1.5, stalled_steps: 0 };
        assert_eq!(member.command([1.0, -0.5]), [1.5, -0.5]);
        assert_eq!(Traits::default().command([1.0, -0.5]), [1.0, -0.5]);
    }
}
