//! A room that a visitor plays with. No clock and no socket: a session is a function of its setup
//! and of what it is asked, in order.

use anyhow::{Context as _, Result, ensure};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use glam::Vec2;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::{Pools, make_crowd};
use jostle_arena::replay::beam_stride;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_arena::site::polygons;
use jostle_arena::{Outcome, Robot, RoomStepper};
use jostle_peds::{Crowd, CrowdKind, Pedestrian};
use jostle_sim::{Laser, Pose, Shape};

use super::message::{Frame, PolicyChoice, ServerMessage, Setup};
use crate::replay::driver::Driver;
use crate::replay::page::Scene;
use crate::replay::{BEAMS, config_of};

/// Pedestrians in a room at most: the page is to stay legible and the room alive.
pub(crate) const PEDESTRIANS_MAX: usize = 40;
/// Obstacles that may be added.
const OBSTACLES_MAX: usize = 60;
/// Radius of an added obstacle (m).
const OBSTACLE: f32 = 0.5;

/// The choices of all sessions.
pub(crate) struct Catalogue {
    pub(crate) drivers: Vec<Driver>,
    pub(crate) pools: Pools,
    /// The crowds that can be had with these pools.
    pub(crate) crowds: Vec<CrowdKind>,
}

impl Catalogue {
    /// The policies as they are offered.
    pub(crate) fn policies(&self) -> Vec<PolicyChoice> {
        let tokens = |driver: &Driver| driver.policy().map_or(0, |p| p.file.network.n_behaviours);
        let choice = |driver: &Driver| PolicyChoice {
            name: driver.name.clone(),
            note: driver.note.clone(),
            tokens: tokens(driver),
        };
        self.drivers.iter().map(choice).collect()
    }
}

/// A room with its people, and where it stands.
pub(crate) struct Session<'a> {
    catalogue: &'a Catalogue,
    setup: Setup,
    plan: RoomPlan,
    scene: Scene,
    laser: Laser,
    crowd: Box<dyn Crowd>,
    robot: Box<dyn Robot>,
    /// The robot's, kept from step to step.
    stepper: RoomStepper,
    room: ArenaRoom,
    episode: u64,
    /// Steps since the episode began.
    step: u64,
    outcome: Option<Outcome>,
}

impl<'a> Session<'a> {
    /// The episode that a setup begins with.
    ///
    /// # Errors
    /// A setup that is not among what the catalogue offers; what the room or the crowd refuses.
    pub(crate) fn new(catalogue: &'a Catalogue, setup: Setup) -> Result<Self> {
        let episode = setup.episode;
        Self::at(catalogue, setup, episode)
    }

    fn at(catalogue: &'a Catalogue, setup: Setup, episode: u64) -> Result<Self> {
        let n_policies = catalogue.drivers.len();
        let driver = catalogue
            .drivers
            .get(setup.policy)
            .with_context(|| format!("policy: found {}, expected less than {n_policies}", setup.policy))?;
        ensure!(
            setup.crowd != CrowdKind::Recorded,
            "crowd recorded: it can be replayed (`{} replay --recording FILE`), but not played with",
            jostle_runs::output::program()
        );
        ensure!(
            catalogue.crowds.contains(&setup.crowd),
            "crowd {}: its pedestrians are driven by policies; start with --pool",
            setup.crowd
        );
        ensure!(
            setup.pedestrians <= PEDESTRIANS_MAX,
            "pedestrians: found {}, expected at most {PEDESTRIANS_MAX}",
            setup.pedestrians
        );
        let config = ArenaConfig {
            seed: setup.seed,
            ..config_of(std::slice::from_ref(driver), Some(setup.pedestrians + 1))?
        };
        let plan = RoomPlan::new(&config, setup.crowd)?;
        let laser = Laser::new(&config.sim.laser)?;
        let robot = driver.robot_with(setup.token, &plan)?;
        Ok(Self {
            scene: Scene::new(&config, &polygons(&plan.scenario))?,
            crowd: crowd_of(catalogue, setup.crowd, &plan)?,
            room: ArenaRoom::new(&plan, &laser, episode)?,
            catalogue,
            setup,
            plan,
            laser,
            robot,
            stepper: RoomStepper::default(),
            episode,
            step: 0,
            outcome: None,
        })
    }

    /// One control period; a moment later the episode may have ended. A room whose episode has
    /// ended stands still.
    ///
    /// # Errors
    /// What the crowd or the room refuses.
    pub(crate) fn step(&mut self) -> Result<()> {
        if self.outcome.is_some() {
            return Ok(());
        }
        let room = std::slice::from_mut(&mut self.room);
        let ends = self.stepper.step(&self.plan, &mut *self.robot, &mut *self.crowd, room)?;
        self.outcome = ends[0].map(|ended| ended.outcome);
        self.step += 1;
        Ok(())
    }

    /// Control period (s).
    pub(crate) fn dt(&self) -> f32 {
        self.plan.config.sim.episode.dt
    }

    /// True if the episode has ended.
    pub(crate) fn has_ended(&self) -> bool {
        self.outcome.is_some()
    }

    /// The same episode from its start, without what was added.
    pub(crate) fn reset(&mut self) -> Result<()> {
        *self = Self::at(self.catalogue, self.setup.clone(), self.episode)?;
        Ok(())
    }

    /// The next episode, in the room as it is now.
    pub(crate) fn next(&mut self) -> Result<()> {
        let room = ArenaRoom::new(&self.plan, &self.laser, self.episode + 1)?;
        (self.room, self.episode, self.step, self.outcome) = (room, self.episode + 1, 0, None);
        Ok(())
    }

    /// Another goal for the robot.
    pub(crate) fn goal(&mut self, goal: Vec2) -> Result<()> {
        self.check_running()?;
        Ok(self.room.set_goal(&self.plan, goal)?)
    }

    /// One more pedestrian.
    pub(crate) fn pedestrian(&mut self, position: Vec2) -> Result<()> {
        self.check_running()?;
        let n_pedestrians = self.plan.config.n_pedestrians();
        ensure!(n_pedestrians < PEDESTRIANS_MAX, "there are {n_pedestrians} pedestrians already");
        self.room.add_pedestrian(&mut self.plan, position)?;
        // A learned crowd that was smaller than its pool may use more of it now.
        self.crowd = crowd_of(self.catalogue, self.setup.crowd, &self.plan)?;
        Ok(())
    }

    /// One more obstacle.
    pub(crate) fn obstacle(&mut self, position: Vec2) -> Result<()> {
        self.check_running()?;
        ensure!(
            self.plan.scenario.obstacles.len() < OBSTACLES_MAX,
            "there are {OBSTACLES_MAX} obstacles already"
        );
        let disc = Shape::Circle { radius: OBSTACLE };
        self.room.add_obstacle(&mut self.plan, &disc, Pose::new(position, 0.0))?;
        self.crowd = crowd_of(self.catalogue, self.setup.crowd, &self.plan)?;
        self.robot = self.driver().robot_with(self.setup.token, &self.plan)?;
        self.scene = Scene::new(&self.plan.config, &polygons(&self.plan.scenario))?;
        Ok(())
    }

    fn driver(&self) -> &'a Driver {
        &self.catalogue.drivers[self.setup.policy]
    }

    fn check_running(&self) -> Result<()> {
        ensure!(self.outcome.is_none(), "the episode has ended; start the next one");
        Ok(())
    }

    /// The room, for the page.
    pub(crate) fn describe(&self) -> ServerMessage<'_> {
        ServerMessage::Room {
            scene: &self.scene,
            setup: &self.setup,
            episode: self.episode,
            policy: &self.driver().name,
            learned: self.setup.crowd.is_learned(),
        }
    }

    /// The moment, for the page.
    pub(crate) fn frame(&self) -> Frame {
        let laser = &self.plan.config.sim.laser;
        let ranges = self.room.robot_ranges();
        let stride = beam_stride(laser.beams, BEAMS);
        let byte = |range: &f32| (range / laser.range * 255.0).round().clamp(0.0, 255.0) as u8;
        let pose = |body: &Pedestrian| [body.position.x, body.position.y, body.heading];
        let pedestrians = self.room.pedestrians();
        Frame {
            episode: self.episode,
            step: self.step,
            robot: pose(&self.room.robot()),
            command: self.room.robot_velocity(),
            goal: self.room.robot().goal.to_array(),
            near: self.room.robot_nearest(),
            ranges: BASE64_STANDARD.encode(ranges.iter().step_by(stride).map(byte).collect::<Vec<u8>>()),
            pedestrians: pedestrians.iter().map(pose).collect(),
            goals: pedestrians.iter().map(|pedestrian| pedestrian.goal.to_array()).collect(),
            outcome: self.outcome,
        }
    }
}

fn crowd_of(catalogue: &Catalogue, kind: CrowdKind, plan: &RoomPlan) -> Result<Box<dyn Crowd>> {
    Ok(make_crowd(&plan.config, kind, &catalogue.pools, &plan.scenario.boundary())?)
}

#[cfg(test)]
mod tests {
    use jostle_arena::Planner;

    use super::*;

    fn catalogue() -> Catalogue {
        Catalogue {
            drivers: vec![Driver::planner(Planner::GoalSeeker)],
            pools: Pools::default(),
            crowds: vec![CrowdKind::Vo, CrowdKind::Sf],
        }
    }

    fn setup(seed: u64) -> Setup {
        Setup { crowd: CrowdKind::Sf, pedestrians: 4, policy: 0, token: 0, seed, episode: 0 }
    }

    /// Steps with a goal, a pedestrian and an obstacle between them.
    fn played(catalogue: &Catalogue, seed: u64) -> Vec<Frame> {
        let mut session = Session::new(catalogue, setup(seed)).unwrap();
        let mut frames = vec![session.frame()];
        for step in 0..30 {
            match step {
                5 => session.goal(Vec2::new(1.0, 2.0)).unwrap(),
                8 => drop(session.pedestrian(Vec2::new(-3.0, 4.0))),
                9 => drop(session.obstacle(Vec2::new(4.0, -4.0))),
                _ => {}
            }
            session.step().unwrap();
            frames.push(session.frame());
        }
        frames
    }

    #[test]
    fn the_same_seed_and_asks_give_the_same_frames() {
        let catalogue = catalogue();
        let frames = played(&catalogue, 3);
        assert_eq!(frames, played(&catalogue, 3));
        assert_ne!(frames, played(&catalogue, 4));
        assert_eq!(frames[6].goal, [1.0, 2.0]);
        assert_eq!((frames[0].pedestrians.len(), frames[9].pedestrians.len()), (4, 5));
    }

    #[test]
    fn a_reset_takes_away_what_was_added_and_the_next_episode_keeps_it() {
        let catalogue = catalogue();
        let mut session = Session::new(&catalogue, setup(3)).unwrap();
        let first = session.frame();
        session.obstacle(Vec2::new(4.0, -4.0)).unwrap();
        session.step().unwrap();
        session.next().unwrap();
        assert_eq!((session.frame().episode, session.frame().step), (1, 0));
        assert_eq!(session.plan.scenario.obstacles.len(), 1);
        session.reset().unwrap();
        assert_eq!(session.plan.scenario.obstacles.len(), 0);
        session.episode = 0;
        session.reset().unwrap();
        assert_eq!(session.frame(), first);
    }

    #[test]
    fn what_is_not_offered_is_refused() {
        let catalogue = catalogue();
        let refused = |setup: Setup| Session::new(&catalogue, setup).err().unwrap().to_string();
        assert!(refused(Setup { crowd: CrowdKind::Nh, ..setup(0) }).contains("--pool"));
        assert!(refused(Setup { policy: 1, ..setup(0) }).contains("expected less than 1"));
        let third = Session::new(&catalogue, Setup { episode: 2, ..setup(0) }).unwrap();
        let mut next = Session::new(&catalogue, setup(0)).unwrap();
        next.next().unwrap();
        next.next().unwrap();
        assert_eq!((third.frame(), third.frame().episode), (next.frame(), 2), "an episode is where it is");
        assert!(refused(Setup { pedestrians: 41, ..setup(0) }).contains("at most 40"));
    }
}
