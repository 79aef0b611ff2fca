//! Crowd SF: pedestrians driven by social forces, from ground-truth positions.

use std::sync::Arc;

use rayon::prelude::*;

use super::{Border, SocialForce, SocialForceConfig, Walker};
use crate::{
    Command, Crowd, CrowdKind, CrowdName, Pedestrian, PedsError, RoomView, Visibility,
    crowd::{check_commands, with_commands},
    error::{checked, require},
};

/// Crowd SF. A speed factor multiplies its pedestrian's desired speed (see
/// [`super::DesiredSpeed::draw_factor`]).
///
/// Decided velocities are v' = limit(v + dt·F(x, v)); the world then moves x' = x + dt·v'.
/// Velocities are those that were executed, so a pedestrian that was stalled starts from rest.
#[derive(Debug, Clone)]
pub struct SocialForceCrowd {
    model: SocialForce,
    visibility: Visibility,
    time_step: f64,
    borders: Arc<[Border]>,
}

impl SocialForceCrowd {
    /// `time_step` is the control period; the borders are those of every room.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(
        config: &SocialForceConfig,
        visibility: Visibility,
        time_step: f32,
        borders: Arc<[Border]>,
    ) -> Result<Self, PedsError> {
        let time_step = f64::from(time_step);
        require((1e-4..=10.0).contains(&time_step), "time_step", time_step, "0.0001 to 10 s")?;
        Ok(Self { model: SocialForce::new(config)?, visibility, time_step, borders })
    }

    fn walker(&self, pedestrian: &Pedestrian, factor: f32) -> Result<Walker, PedsError> {
        Ok(Walker {
            position: checked("pedestrian position", pedestrian.position)?.as_dvec2(),
            velocity: checked("pedestrian velocity", pedestrian.velocity)?.as_dvec2(),
            goal: checked("goal", pedestrian.goal)?.as_dvec2(),
            desired_speed: self.model.config().desired_speed.base() * f64::from(factor),
        })
    }

    fn decide_room(&self, room: &RoomView<'_>, commands: &mut [Command]) -> Result<(), PedsError> {
        room.check_factors()?;
        let mut walkers = Vec::with_capacity(room.pedestrians.len() + room.others.len());
        for (i, pedestrian) in room.pedestrians.iter().enumerate() {
            walkers.push(self.walker(pedestrian, room.factor(i))?);
        }
        if self.visibility.robot {
            for other in room.others {
                walkers.push(self.walker(other, 1.0)?);
            }
        }
        let n_pedestrians = room.pedestrians.len();
        let mut alone = Vec::new();
        for (a, command) in commands.iter_mut().enumerate() {
            let velocity = if self.visibility.pedestrians {
                self.model.next_velocity(a, &walkers, &self.borders, self.time_step)
            } else {
                alone.clear();
                alone.push(walkers[a]);
                alone.extend_from_slice(&walkers[n_pedestrians..]);
                self.model.next_velocity(0, &alone, &self.borders, self.time_step)
            };
            *command = Command::Walk { velocity: velocity.as_vec2() };
        }
        Ok(())
    }
}

impl Crowd for SocialForceCrowd {
    fn name(&self) -> CrowdName {
        CrowdKind::Sf.into()
    }

    fn visibility(&self) -> Visibility {
        self.visibility
    }

    fn senses_by_laser(&self) -> bool {
        false
    }

    fn decide(&mut self, rooms: &[RoomView<'_>], commands: &mut [Command]) -> Result<(), PedsError> {
        check_commands(rooms, commands)?;
        with_commands(rooms, commands)
            .into_par_iter()
            .try_for_each(|(room, commands)| self.decide_room(room, commands))
    }
}
