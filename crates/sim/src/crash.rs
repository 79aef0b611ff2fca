//! The crash rule: something is too near, or the body was stopped by something that no range shows.
//!
//! The rule of the paper's lineage is the scan's: the least noise-free range falls below the crash
//! range. A body stops one step before it would touch something, and for the usual body every such
//! stop is nearer than the crash range. A body that is larger, or faster, or looks with few beams
//! may be stopped farther away; it would then stand at a wall until the time limit. So what stopped
//! it counts as well:
//!
//! - A wall or an obstacle, always. (For the usual body the scan has seen it; only a pole between
//!   two beams has it not.)
//! - Another body, where the scan is not certain to see that ([`CrashRule::new`]): both have
//!   crashed. Elsewhere it does not count, because the other may have gone on within the same step.

use crate::config::SimConfig;
use crate::episode::Outcome;
use crate::laser::{Hit, ScanSummary};
use crate::world::Stop;

/// The rule of a configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrashRule {
    range: f32,
    bodies_touch: bool,
}

impl CrashRule {
    /// The rule for a robot and a laser.
    ///
    /// # Formula
    ///
    /// A stop is certain to be seen if `(ρ + v_max·dt) / (cos α − sin α) ≤ crash_range`: the body
    /// of radius ρ stopped at most one step before the contact, and half the angle between two
    /// beams, α = π/beams, off its direction a beam still meets a right-angled corner at this
    /// range. Around a sector the summary is no beam's range but the exact distance
    /// ([`ScanSummary`]), however many beams there are: α = 0.
    pub fn new(config: &SimConfig) -> Self {
        let reach = f64::from(config.robot.circumradius())
            + f64::from(config.robot.v_max) * f64::from(config.episode.dt);
        let half_angle = if config.laser.is_full_circle() {
            std::f64::consts::PI / config.laser.beams as f64
        } else {
            0.0
        };
        let seen_up_to =
            f64::from(config.episode.crash_range) * (libm::cos(half_angle) - libm::sin(half_angle));
        Self { range: config.episode.crash_range, bodies_touch: reach > seen_up_to }
    }

    /// True if a stop at another body is a crash of both.
    pub fn bodies_touch(&self) -> bool {
        self.bodies_touch
    }

    /// The crash of `body` after a step, if it is one: by its scan, else by the stops of the step,
    /// one per body. Bodies that are not `visible` to it count in neither.
    pub fn crash(
        &self,
        scan: ScanSummary,
        stops: &[Option<Stop>],
        body: usize,
        visible: impl Fn(usize) -> bool,
    ) -> Option<Outcome> {
        crash(scan, self.range).or_else(|| match stops[body] {
            Some(Stop::Wall | Stop::Obstacle(_)) => Some(Outcome::CollisionWall),
            Some(Stop::Body(other)) if self.bodies_touch && visible(other) => {
                Some(Outcome::CollisionPedestrian)
            }
            _ => {
                let was_hit =
                    |(other, stop): (usize, &Option<Stop>)| *stop == Some(Stop::Body(body)) && visible(other);
                let hit = self.bodies_touch && stops.iter().enumerate().any(was_hit);
                hit.then_some(Outcome::CollisionPedestrian)
            }
        })
    }
}

/// The collision that a scan amounts to, if its least range is below the crash range.
pub fn crash(scan: ScanSummary, crash_range: f32) -> Option<Outcome> {
    if scan.min_range >= crash_range {
        return None;
    }
    match scan.nearest {
        Hit::Body(_) => Some(Outcome::CollisionPedestrian),
        Hit::Wall(_) | Hit::Obstacle(_) | Hit::None => Some(Outcome::CollisionWall),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(change: impl FnOnce(&mut SimConfig)) -> CrashRule {
        let mut config = SimConfig::default();
        change(&mut config);
        CrashRule::new(&config)
    }

    #[test]
    fn the_usual_body_goes_by_its_scan() {
        // 0.3536 m of the square's half diagonal and a step of 0.1 m are nearer than 0.5 m.
        assert!(!rule(|_| ()).bodies_touch());
        assert!(!rule(|c| (c.robot.length, c.robot.width) = (0.508, 0.43)).bodies_touch());
        assert!(!rule(|c| c.laser.beams = 64).bodies_touch());
    }

    #[test]
    fn what_no_range_shows_counts_by_contact() {
        assert!(rule(|c| c.robot.length = 2.0).bodies_touch());
        assert!(rule(|c| c.robot.width = 1.2).bodies_touch());
        assert!(rule(|c| c.robot.v_max = 2.0).bodies_touch());
        assert!(rule(|c| c.episode.dt = 0.5).bodies_touch());
        assert!(rule(|c| c.episode.crash_range = 0.3).bodies_touch());
        assert!(rule(|c| c.laser.beams = 4).bodies_touch());
    }

    #[test]
    fn a_sector_judges_by_the_exact_distance_however_few_its_beams() {
        let sector = |beams, length| {
            rule(|c| {
                (c.laser.beams, c.laser.fov, c.laser.angle_min) = (beams, 3.0, -1.5);
                c.robot.length = length;
            })
        };
        assert!(!sector(4, 0.5).bodies_touch() && !sector(512, 0.5).bodies_touch());
        // 0.3990 m of half diagonal and a step of 0.1 m are just nearer than 0.5 m, and 0.4015 m
        // are not.
        assert!(!sector(512, 0.622).bodies_touch() && sector(512, 0.628).bodies_touch());
        // A full circle of 512 beams does not reach as far.
        assert!(rule(|c| c.robot.length = 0.622).bodies_touch());
    }

    #[test]
    fn a_contact_is_a_crash_of_both_and_the_scan_comes_first() {
        let (usual, long) = (rule(|_| ()), rule(|c| c.robot.length = 2.0));
        let scan = |min_range, nearest| ScanSummary { min_range, nearest };
        let (far, near) = (scan(1.0, Hit::None), scan(0.4, Hit::Wall(0)));
        let stops = [None, Some(Stop::Body(2)), None, Some(Stop::Obstacle(0)), Some(Stop::Command)];
        let crash = |rule: CrashRule, scan, body| rule.crash(scan, &stops, body, |_| true);
        let agent = Some(Outcome::CollisionPedestrian);
        let wall = Some(Outcome::CollisionWall);
        assert_eq!([0, 1, 2, 3, 4].map(|body| crash(long, far, body)), [None, agent, agent, wall, None]);
        assert_eq!([0, 1, 2, 3, 4].map(|body| crash(usual, far, body)), [None, None, None, wall, None]);
        assert_eq!(crash(long, near, 1), wall);
        // Who sees nobody touches nobody.
        assert_eq!([1, 2, 3].map(|body| long.crash(far, &stops, body, |_| false)), [None, None, wall]);
    }
}
