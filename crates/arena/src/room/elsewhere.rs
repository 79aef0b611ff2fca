//! A room whose robot moves and looks in another simulator: its pedestrians walk here.
//!
//! Start, goal, pedestrians and the noise of the robot's ranges are those of the same episode of
//! the test. A control period has two halves: [`ArenaRoom::walk`] moves the pedestrians, and
//! [`ArenaRoom::follow`] is told where the robot has come in the meantime and what its laser
//! measures there. Pedestrians that arrived or crashed are renewed between the two, as in
//! [`ArenaRoom::step`]. Whoever moves the robot judges how the episode ends.

use jostle_peds::Command;
use jostle_sim::{Motion, Pose};

use super::{ArenaRoom, ROBOT, RoomPlan};
use crate::error::ArenaError;

impl ArenaRoom {
    /// The robot's first observation, from what its laser measures at the start: one noise-free
    /// range a beam (m).
    ///
    /// # Errors
    ///
    /// Ranges that are not one finite number of at least 0 for each beam; a robot that has mass
    /// here as well.
    pub fn look(&mut self, plan: &RoomPlan, ranges: &[f32]) -> Result<(), ArenaError> {
        plan.config.check_robot_moves_elsewhere()?;
        self.take_ranges(plan, ranges)?;
        // The start's own scan has used the first draws.
        self.observers[ROBOT].seek_noise(0);
        self.write_row(plan, ROBOT, jostle_sim::Observer::begin);
        Ok(())
    }

    /// Moves the pedestrians for a control period; the robot stays where it is.
    pub fn walk(&mut self, plan: &RoomPlan, walks: &[Command]) {
        self.motions[ROBOT] = Motion::Still;
        self.set_walks(plan, walks);
        self.advance_bodies(plan.config.sim.episode.dt);
    }

    /// Puts the robot where it has come in the same control period, with the velocity (v, ω) that
    /// it has there and the noise-free ranges of its laser, one a beam (m); then renews pedestrians
    /// and observes.
    ///
    /// # Errors
    ///
    /// As [`Self::look`]; a pose or velocity that is not finite. Nothing has changed then.
    pub fn follow(
        &mut self,
        plan: &RoomPlan,
        pose: Pose,
        velocity: [f32; 2],
        ranges: &[f32],
    ) -> Result<(), ArenaError> {
        if !(pose.is_finite() && velocity.iter().all(|value| value.is_finite())) {
            let found = format!("({}, {}, {})", pose.position.x, pose.position.y, pose.heading);
            let found = format!("pose {found} and velocity ({}, {})", velocity[0], velocity[1]);
            return Err(ArenaError::Setting { field: "robot", found, expected: "finite numbers".to_owned() });
        }
        self.take_ranges(plan, ranges)?;
        self.world.set_pose(ROBOT, pose);
        self.velocity = velocity;
        self.scan_pedestrians(plan);
        self.renew_pedestrians(plan);
        self.observe(plan, ROBOT);
        self.observe_pedestrians(plan);
        Ok(())
    }

    fn take_ranges(&mut self, plan: &RoomPlan, ranges: &[f32]) -> Result<(), ArenaError> {
        let laser = &plan.config.sim.laser;
        let refuse = |found: String| {
            let expected = format!("{} numbers of at least 0, one a beam", laser.beams);
            Err(ArenaError::Setting { field: "ranges", found, expected })
        };
        if ranges.len() != laser.beams {
            return refuse(format!("{} of them", ranges.len()));
        }
        if let Some(i) = ranges.iter().position(|range| !(range.is_finite() && *range >= 0.0)) {
            return refuse(format!("{} for beam {i}", ranges[i]));
        }
        for (own, range) in self.ranges.iter_mut().zip(ranges) {
            *own = range.min(laser.range);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use jostle_peds::CrowdKind;
    use jostle_sim::{Dynamics, Laser};

    use super::*;
    use crate::config::ArenaConfig;
    use crate::crowds::{Pools, make_crowd};
    use crate::step::RoomStepper;

    fn plan(change: impl FnOnce(&mut ArenaConfig)) -> (RoomPlan, ArenaRoom) {
        let mut config = ArenaConfig::default();
        change(&mut config);
        let plan = RoomPlan::new(&config, CrowdKind::Sf).unwrap();
        let laser = Laser::new(&config.sim.laser).unwrap();
        let room = ArenaRoom::new(&plan, &laser, 3).unwrap();
        (plan, room)
    }

    fn pose(room: &ArenaRoom) -> Pose {
        Pose::new(room.robot().position, room.robot().heading)
    }

    /// A room that is told what another room does is that room, to the bit.
    #[test]
    fn a_robot_that_moves_elsewhere_as_it_would_here_sees_and_meets_the_same() {
        let (plan, _) = plan(|_| ());
        let laser = Laser::new(&plan.config.sim.laser).unwrap();
        let polygons = plan.scenario.boundary();
        let crowd = || make_crowd(&plan.config, CrowdKind::Sf, &Pools::default(), &polygons).unwrap();
        let mut compared = 0;
        for episode in 0..8 {
            let mut here = ArenaRoom::new(&plan, &laser, episode).unwrap();
            let mut there = here.clone();
            let (mut one, mut other) = (crowd(), crowd());
            let (mut stepper, mut walker) = (RoomStepper::default(), RoomStepper::default());
            there.look(&plan, here.robot_ranges()).unwrap();
            assert_eq!(there.robot_observation(), here.robot_observation());
            for step in 0..150 {
                let action = [0.5, if step % 40 < 20 { 0.6 } else { -0.5 }];
                let rooms = std::slice::from_mut(&mut here);
                let end = stepper.step_with(&plan, &mut *one, rooms, &[action]).unwrap();
                walker.walk(&plan, &mut *other, &mut there).unwrap();
                if end[0].is_some() {
                    break;
                }
                there.follow(&plan, pose(&here), here.robot_velocity(), here.robot_ranges()).unwrap();
                assert_eq!(there.robot_observation(), here.robot_observation(), "{episode}, step {step}");
                assert_eq!(there.pedestrians(), here.pedestrians(), "{episode}, step {step}");
                compared += 1;
            }
        }
        assert!(compared > 100, "too short to tell anything: {compared} steps");
    }

    #[test]
    fn what_another_simulator_cannot_mean_is_refused_and_changes_nothing() {
        let (plan, mut room) = plan(|_| ());
        let ranges = room.robot_ranges().to_vec();
        let (start, row) = (pose(&room), room.robot_observation().to_vec());
        let mut check = |pose: Pose, velocity: [f32; 2], ranges: &[f32], message: &str| {
            let error = room.follow(&plan, pose, velocity, ranges).unwrap_err().to_string();
            assert_eq!(error, message);
        };
        let numbers = "512 numbers of at least 0, one a beam";
        check(start, [0.0; 2], &ranges[1..], &format!("ranges: found 511 of them, expected {numbers}"));
        let mut wrong = ranges.clone();
        wrong[7] = f32::NAN;
        check(start, [0.0; 2], &wrong, &format!("ranges: found NaN for beam 7, expected {numbers}"));
        let nowhere = Pose { position: Vec2::new(f32::NAN, 0.0), heading: 0.0 };
        let found = "pose (NaN, 0, 0) and velocity (0, 1)";
        check(nowhere, [0.0, 1.0], &ranges, &format!("robot: found {found}, expected finite numbers"));
        assert_eq!((pose(&room), room.robot_observation()), (start, &row[..]));
    }

    #[test]
    fn a_robot_that_has_mass_here_is_refused() {
        let (plan, mut room) = plan(|config| config.sim.robot.dynamics = Dynamics::Rapier);
        let ranges = room.robot_ranges().to_vec();
        let error = room.look(&plan, &ranges).unwrap_err().to_string();
        assert_eq!(error, "sim.robot.dynamics: found rapier, expected kinematic: the robot moves elsewhere");
    }
}
